"""Shadow bias: its rule, its kinds and its units."""
