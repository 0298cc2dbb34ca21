"""Shadow volumes: what a light's shadow is bounded by, and the counting of its boundaries."""
