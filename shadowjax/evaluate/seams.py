"""Seams between the regions of a partition: how much texel size and visibility jump there, measured and in pictures.

The predicted jump is `shadowjax.theory.aliasing.storage.seam_jumps`.
"""

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp

from shadowjax._checked import checked
from shadowjax._numerics import norm, safe_divide
from shadowjax._types import Array, Bool, Float, Int, Points
from shadowjax.rays.ray_grid import RayGrid
from shadowjax.techniques.shadow_mapping import MappedShadows


class SeamJump(NamedTuple):
    """What changes at points of a seam as one map takes over from another.

    Attributes:
        across: Factor ≥ 1 between the widths of the two maps' texels along their columns (s).
        along: The same along their rows (t); the jump of m_z for a split in depth.
        visibility: |difference| of what the two maps answer, in [0, 1].
    """

    across: Float[Array, "*points"]
    along: Float[Array, "*points"]
    visibility: Float[Array, "*points"]


@checked
def texel_widths(grid: RayGrid, points: Points) -> Float[Array, "*points 2"]:
    """World length of a texel's step by one column and by one row at each point, across the light."""
    return jnp.stack([norm(step) for step in grid.cell_vectors(points)], axis=-1)


@checked
@eqx.filter_jit
def seam_jump(shadows: MappedShadows, first: int, second: int, points: Points, normals: Points) -> SeamJump:
    """Jump between the maps of two regions at points that both maps hold, such as the surface at a cut.

    Args:
        shadows: A partition's maps, ready to be read.
        first: Index of one region.
        second: Index of the other.
        points: World points on the seam.
        normals: Their unit normals.

    Source: warping, text after eq. 52 and figure 27.
    """
    widths = [texel_widths(shadows.maps[region].grid, points) for region in (first, second)]
    factor = safe_divide(widths[0], widths[1])
    # A jump up or down by the same factor counts alike.
    factor = jnp.maximum(factor, safe_divide(jnp.ones_like(factor), factor))
    answers = [shadows.read(region, points, normals) for region in (first, second)]
    return SeamJump(factor[..., 0], factor[..., 1], jnp.abs(answers[0] - answers[1]))


@checked
@eqx.filter_jit
def texel_picture(shadows: MappedShadows, points: Points) -> Float[Array, "*points"]:
    """ln of the texel's size at each point, the root of its area in world units, mixed by the partition's shares.

    Its steps between neighbouring pixels are the seams one sees; blending turns them into ramps.
    """
    grids = shadows.grids
    # ln √(width · height) of a texel.
    sizes = [jnp.sum(jnp.log(jnp.maximum(texel_widths(grid, points), 1e-30)), axis=-1) / 2 for grid in grids]
    if len(grids) == 1:
        return sizes[0]
    shares = shadows.partition.shares(grids, shadows.camera, points)
    mixed = jnp.zeros_like(sizes[0])
    for share, size in zip(shares, sizes, strict=True):
        mixed = mixed + share * size
    return mixed


class SeamSteps(NamedTuple):
    """Steps of a picture between neighbouring pixels.

    Attributes:
        across: Mean |step| where the two pixels belong to different regions; 0 if there are none.
        elsewhere: Mean |step| between neighbours of one region: what the picture does anyway.
        largest: Largest |step| across a seam.
        pairs: How many neighbours a seam runs between.
    """

    across: Float[Array, ""]
    elsewhere: Float[Array, ""]
    largest: Float[Array, ""]
    pairs: Int[Array, ""]


@checked
@eqx.filter_jit
def seam_steps(
    values: Float[Array, "rows cols"],
    region: Int[Array, "rows cols"],
    valid: Bool[Array, "rows cols"],
    face: Int[Array, "rows cols"] | None = None,
) -> SeamSteps:
    """How a picture steps across the seams of a partition, next to how it steps elsewhere.

    Args:
        values: Any quantity of the pixels: `texel_picture`, or the difference of visibility from the exact one.
        region: Region that answers for each pixel, from `Partition.select`.
        valid: Pixels that count.
        face: Triangle that each pixel sees; then only neighbours on one triangle count, so that a silhouette in front
            of a distant surface is no seam.
    """
    face = jnp.zeros_like(region) if face is None else face

    def pairs(image: Array) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
        return (image[1:], image[:-1]), (image[:, 1:], image[:, :-1])

    # Each pixel with the one below it, then with the one to its right: every border is counted once.
    total, count, other, others, largest = (jnp.zeros((), values.dtype) for _ in range(5))
    for value, place, both, on in zip(pairs(values), pairs(region), pairs(valid), pairs(face), strict=True):
        step = jnp.abs(value[0] - value[1])
        counts = both[0] & both[1] & (on[0] == on[1])
        seam = (counts & (place[0] != place[1])).astype(step.dtype)
        inner = (counts & (place[0] == place[1])).astype(step.dtype)
        total, count = total + jnp.sum(step * seam), count + jnp.sum(seam)
        other, others = other + jnp.sum(step * inner), others + jnp.sum(inner)
        largest = jnp.maximum(largest, jnp.max(step * seam, initial=0.0))
    # A mean over no pairs is 0, not 0/0.
    one = jnp.ones_like(count)
    return SeamSteps(
        total / jnp.maximum(count, one), other / jnp.maximum(others, one), largest, count.astype(jnp.int32)
    )


__all__ = ["SeamJump", "SeamSteps", "seam_jump", "seam_steps", "texel_picture", "texel_widths"]
