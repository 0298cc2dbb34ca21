"""Depth maps and how they are read."""
