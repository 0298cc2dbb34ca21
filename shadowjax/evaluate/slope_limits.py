"""Where the limit of a bias that follows slopes leaves acne: how much, on which faces, and what frees them."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from shadowjax._checked import checked
from shadowjax._numerics import dot
from shadowjax._types import Array, Bool, Float, Int, Points
from shadowjax.bias.rule import BiasRule
from shadowjax.techniques.base import Shadows

# Cosine of incidence: a face that receives less than one of 256 levels of the light shows neither acne nor its lack.
LEAST_LIGHT = 1 / 256


@checked
@dataclass(frozen=True)
class SlopeLimit:
    """Acne that the limit of a bias leaves on faces that light grazes.

    Attributes:
        incidence_deg: Least incidence at which the limit is reached and acne seen, degrees from the normal.
        reached: Share of the receivers that face the light at which the limit is reached, lit in the reference.
        acne: Share that the limit darkens falsely.
        limit: Steepest slope that the bias follows, texels of depth for each texel.
        needed: The limit that frees them.
        limit_text: The limit in words.
        remedy: The call that makes the bias with the limit that frees them.
    """

    incidence_deg: float
    reached: float
    acne: float
    limit: float
    needed: float
    limit_text: str
    remedy: str

    def __str__(self) -> str:
        return (
            f"acne on faces that light grazes at more than {self.incidence_deg:.1f}°: the limit of "
            f"{self.limit_text} is reached on {100 * self.reached:.2g} % of the seen pixels that face the light, and "
            f"darkens {100 * self.acne:.2g} % falsely; {self.remedy} frees them, and so does a higher light"
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
    """What the limit of a bias does to receivers; None where no acne comes from it.

    Receivers at which the limit is reached are looked up once more without it: what is lit then is acne. Faces almost
    along the light, which receive less than a 256th of it, do not count.

    Args:
        shadows: Built maps. Those without a map, or with a bias that follows no slope, have no such limit.
        points: Receivers.
        normals: Their unit normals.
        faces: Triangle that each lies on.
        lit: Whether each is lit in the reference.
        counted: Which ones the shares are of, such as those that face the light.
    """
    bias = shadows.depth_bias
    if bias is None or math.isinf(bias.steepest):
        return None
    slope, cosine, is_limited = (np.asarray(x) for x in _slopes(shadows, bias, points, normals))
    # Lit, counted, steeper than the limit, and not almost along the light.
    reached = np.asarray(lit & counted) & is_limited & (cosine > LEAST_LIGHT)
    if not reached.any():
        return None
    chosen = np.flatnonzero(reached)
    # Few sizes mean few compilations: the list is filled up to a power of two.
    place = np.resize(chosen, 1 << max(len(chosen) - 1, 255).bit_length())
    most = max(1.01 * float(slope[reached].max()), bias.steepest)
    free = eqx.tree_at(lambda s: s.bias, shadows, bias.following(most), is_leaf=lambda x: x is bias)
    limited, whole = (np.asarray(_looked_up(s, points[place], normals[place], faces[place])) for s in (shadows, free))
    dark = (whole > limited)[: len(chosen)]
    if not dark.any():
        return None
    total = int(np.asarray(counted).sum())
    # the lost light, not the number of pixels that lose some of it
    lost = float((whole - limited)[: len(chosen)][dark].sum())
    needed = max(float(math.ceil(1.01 * float(slope[chosen[dark]].max()))), bias.steepest)
    least = math.degrees(math.acos(min(1.0, float(cosine[chosen[dark]].max()))))
    remedy = bias.following(needed).made_by
    return SlopeLimit(least, len(chosen) / total, lost / total, bias.steepest, needed, bias.limit_text, remedy)


@eqx.filter_jit
def _slopes(shadows: Shadows, bias: BiasRule, points: Points, normals: Points) -> tuple[Array, Array, Array]:
    """Slope of each receiver's plane, texels; the cosine of incidence; and whether the limit is reached."""
    grids, region = shadows.maps_of(points)

    def own(each: list[Array]) -> Array:
        """Of the map of each receiver's region."""
        return jnp.take_along_axis(jnp.stack(each), jnp.clip(region, 0)[None], axis=0)[0]

    # Slopes without a limit: how large a limit would have to be is what is asked for.
    slopes = own([bias.steepness(grid, points, normals) for grid in grids])
    is_limited = own([bias.is_limited(grid, points, normals) for grid in grids])
    return slopes, dot(normals, grids[0].space.to_source(points)), is_limited


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
