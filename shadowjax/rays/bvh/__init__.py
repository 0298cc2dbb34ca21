"""The caster for any rays: a bounding volume hierarchy."""
