"""From stored depths to visibility."""
