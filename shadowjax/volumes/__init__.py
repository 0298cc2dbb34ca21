"""Shadow volumes: what bounds a light's shadow, the counting of its boundaries, and the order of polygons."""
