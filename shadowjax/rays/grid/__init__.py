"""The caster for coherent rays: triangles drawn over the cells of a grid of rays."""
