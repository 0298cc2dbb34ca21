"""Where the limit of the slope bias is reached and leaves acne: how much, on which faces, and what frees them."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from shadowjax._checked import checked
from shadowjax._numerics import dot
from shadowjax._types import Array, Bool, Float, Int, Points
from shadowjax.bias.rule import Bias, depth_slope, texel_size
from shadowjax.techniques.base import Shadows

# Cosine of incidence: a face that receives less than one of 256 levels of the light shows neither acne nor its lack.
LEAST_LIGHT = 1 / 256


@checked
@dataclass(frozen=True)
class SlopeLimit:
    """Acne that the limit of a slope bias leaves on faces that light grazes.

    Attributes:
        incidence_deg: Least incidence at which the limit is reached and acne seen, degrees from the normal.
        reached: Share of the receivers that face the light at which the limit is reached, lit in the reference.
        acne: Share that the limit darkens falsely.
        value: The bias, texels of slope.
        limit: Its limit, texels of depth for each texel of slope.
        needed: The limit that frees them.
    """

    incidence_deg: float
    reached: float
    acne: float
    value: float
    limit: float
    needed: float

    def __str__(self) -> str:
        return (
            f"acne on faces that light grazes at more than {self.incidence_deg:.1f}°: the limit of {self.limit:g} "
            f"texels of slope is reached on {100 * self.reached:.2g} % of the seen pixels that face the light, and "
            f'darkens {100 * self.acne:.2g} % falsely; Bias.create({self.value:g}, "slope", limit={self.needed:g}) '
            "frees them, and so does a higher light"
        )


@checked
def slope_limit(
    shadows: Shadows,
    points: Float[Array, "points 3"],
    normals: Float[Array, "points 3"],
    faces: Int[Array, "points"],
    lit: Bool[Array, "points"],
    counted: Bool[Array, "points"],
) -> SlopeLimit | None:
    """What the limit of the slope bias does to receivers; None where no acne comes from it.

    Receivers at which the limit is reached are looked up once more without it: what is lit then is acne. Faces almost
    along the light, which receive less than a 256th of it, do not count.

    Args:
        shadows: Built maps. Those without a map or with another rule than a slope bias have no such limit.
        points: Receivers.
        normals: Their unit normals.
        faces: Triangle that each lies on.
        lit: Whether each is lit in the reference.
        counted: Which ones the shares are of, such as those that face the light.
    """
    bias = shadows.depth_bias
    if not isinstance(bias, Bias) or bias.unit != "slope" or float(bias.value) <= 0:
        return None
    ratio, cosine = (np.asarray(x, float) for x in _ratio_and_cosine(shadows, points, normals))
    # Lit, counted, steeper than the limit, and not almost along the light.
    reached = np.asarray(lit & counted) & (ratio > bias.limit) & (cosine > LEAST_LIGHT)
    if not reached.any():
        return None
    chosen = np.flatnonzero(reached)
    # Few sizes mean few compilations: the list is filled up to a power of two.
    place = np.resize(chosen, 1 << max(len(chosen) - 1, 255).bit_length())
    most = 1.01 * ratio[reached].max()
    free = eqx.tree_at(lambda s: s.bias, shadows, Bias(bias.value, "slope", float(most)))
    limited, whole = (np.asarray(_looked_up(s, points[place], normals[place], faces[place])) for s in (shadows, free))
    dark = (whole > limited)[: len(chosen)]
    if not dark.any():
        return None
    total = int(np.asarray(counted).sum())
    # the lost light, not the number of pixels that lose some of it
    lost = float((whole - limited)[: len(chosen)][dark].sum())
    needed = math.ceil(1.01 * ratio[chosen[dark]].max())
    least = math.degrees(math.acos(min(1.0, cosine[chosen[dark]].max())))
    return SlopeLimit(least, len(chosen) / total, lost / total, float(bias.value), bias.limit, float(needed))


@eqx.filter_jit
def _ratio_and_cosine(shadows: Shadows, points: Points, normals: Points) -> tuple[Array, Array]:
    """Depth change of each receiver's plane over a texel, in texels, and the cosine of incidence."""
    grids, region = shadows.maps_of(points)
    # Slopes without a limit: how large a limit would have to be is what is asked for.
    ratios = [depth_slope(grid, points, normals, math.inf) / texel_size(grid, points) for grid in grids]
    ratio = jnp.take_along_axis(jnp.stack(ratios), jnp.clip(region, 0)[None], axis=0)[0]
    return ratio, dot(normals, grids[0].space.to_source(points))


@eqx.filter_jit
def _looked_up(shadows: Shadows, points: Points, normals: Points, faces: Array) -> Array:
    return shadows.visibility_of(points, normals, faces)


@checked
def told(found: Sequence[tuple[str, SlopeLimit | None]]) -> str | None:
    """One sentence about several techniques; None where none has acne from its limit.

    Args:
        found: Names, and what `slope_limit` says of each.
    """
    said = [(name, one) for name, one in found if one is not None]
    if not said:
        return None
    worst = max((one for _, one in said), key=lambda one: one.acne)
    return f"{', '.join(name for name, _ in said)}: {worst}"


__all__ = ["LEAST_LIGHT", "SlopeLimit", "slope_limit", "told"]
