"""Light spaces, rays and the casters that trace them."""
