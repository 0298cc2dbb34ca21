"""How a light's plane is split into several maps."""
