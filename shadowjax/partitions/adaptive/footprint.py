"""How fine a map has to be where a pixel looks: the pixel's true footprint, and the source's estimate by mip levels."""

from collections.abc import Callable

import jax.numpy as jnp

from shadowjax._checked import checked
from shadowjax._numerics import dot, norm, safe_sqrt, singular_values
from shadowjax._types import Array, Float, Points, Scalar
from shadowjax.rays.ray_grid import RayGrid, pixel_footprint

Span = Float[Array, "*points"]
# Grazing rays are taken as meeting a surface at 1°.
LEAST_COSINE = 0.0174524064372835


@checked
def on_surface(grid: RayGrid, points: Points, normals: Points) -> tuple[Points, Points]:
    """World vectors over a receiver's plane for one column and one row of a grid, of a camera or a light.

    Args:
        grid: The rays.
        points: Receivers.
        normals: Their unit normals; a surface seen edge-on is taken as seen at 1°.
    """
    along = grid.space.to_source(points)
    cosine = dot(normals, along)
    cosine = jnp.where(cosine < 0, jnp.minimum(cosine, -LEAST_COSINE), jnp.maximum(cosine, LEAST_COSINE))
    # A cell's step at constant depth, moved along the ray back onto the receiver's plane.
    first, second = (step - along * (dot(normals, step) / cosine)[..., None] for step in grid.cell_vectors(points))
    return first, second


@checked
def narrowest(view: RayGrid, grid: RayGrid, points: Points, normals: Points) -> Span:
    """Texels across a pixel's footprint where it is shortest: no direction is coarser than asked."""
    return singular_values(pixel_footprint(view, grid, points, normals))[1]


@checked
def by_area(view: RayGrid, grid: RayGrid, points: Points, normals: Points) -> Span:
    """Root of the texels in a pixel's footprint: right on average, too coarse across a stretched footprint."""
    larger, smaller = singular_values(pixel_footprint(view, grid, points, normals))
    return safe_sqrt(larger * smaller)


@checked
def mip_value(length: Span, finest: Scalar) -> Span:
    """What a texture of mip levels labelled 1, 2, 3, … reads for a pixel of some length: a level, not an area.

    Args:
        length: Longest side of the pixel on the surface, world units.
        finest: Texel of the finest level.

    Returns:
        1 + log₂(length/finest), and 1 for all that is smaller than the finest texel.

    Source: asm, estimate of a pixel's area by mip levels; the area is 4^(value − 1) finest texels.
    """
    return 1 + jnp.log2(jnp.maximum(length / finest, 1))


@checked
def by_mip_levels(view: RayGrid, grid: RayGrid, points: Points, normals: Points) -> Span:
    """Texels across a pixel by the source's estimate: two mip levels read, one from the camera and one from the light.

    A texture with one texel size all over the scene is drawn from both. Hardware takes the longer axis of a footprint
    for both axes, so the estimate sees lengths but no shape and no angle between them.

    Source: asm, estimate of a pixel's area by mip levels.
    """
    lengths = []
    for rays in (view, grid):
        first, second = on_surface(rays, points, normals)
        lengths.append(jnp.maximum(norm(first), norm(second)))
    finest = grid.far / (1 << 20)  # far below any texel: a finer texture would read the same difference
    return jnp.exp2(mip_value(lengths[0], finest) - mip_value(lengths[1], finest))


FootprintRule = Callable[[RayGrid, RayGrid, Points, Points], Span]
FOOTPRINTS: dict[str, FootprintRule] = {"jacobian": narrowest, "area": by_area, "mip": by_mip_levels}

__all__ = [
    "FOOTPRINTS", "FootprintRule", "Span", "by_area", "by_mip_levels", "mip_value", "narrowest", "on_surface",
]  # fmt: skip
