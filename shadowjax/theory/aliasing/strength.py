"""The perspective-warp strength 1/n' that minimises the largest weighted error of a set of points."""

import jax.numpy as jnp

from shadowjax._checked import checked
from shadowjax._types import Array, Float
from shadowjax.theory.aliasing.roots import least_largest


@checked
def worst_error(
    strength: Float[Array, ""],
    offset: Float[Array, "points"],
    weight: Float[Array, "points"],
    extent: Float[Array, ""],
) -> Float[Array, ""]:
    """Largest weight·W(1 + u·κ)²/(1 + W·κ): plane distance per unit of t at each offset, times its weight."""
    stretch = 1 + offset * strength
    return jnp.max(weight * stretch * stretch) * extent / (1 + extent * strength)


@checked
def least_worst_strength(
    offset: Float[Array, "points"],
    weight: Float[Array, "points"],
    extent: Float[Array, ""],
    largest: float = 1e6,
) -> Float[Array, ""]:
    """κ = 1/n' of least worst weighted error along the axis.

    Each point's error has one minimum in κ, so their maximum has one too, found by bisecting the sign of the worst
    point's slope along ln(1 + W·κ). The best is strength 0, the uniform map, where the worst point of that map lies
    beyond the middle. κ carries its implicit derivative: at a kink, where two points are the worst, and at a smooth
    minimum of one.

    Args:
        offset: u ∈ [0, W] of each point, plane units.
        weight: What a plane distance at the point costs, ≥ 0: world size of the plane unit over pixel size.
        extent: W, plane units.
        largest: Largest W·κ considered.
    """
    # In x = ln(1 + W·κ) the stretch 1 + u·κ is 1 + (u/W)(eˣ − 1), and ln of each error is convex.
    share = offset / extent
    # A point without weight has ln 0: a level that is never the largest, from a harmless logarithm.
    counts = weight > 0
    level = jnp.where(counts, jnp.log(jnp.where(counts, weight, jnp.ones_like(weight))), -1e30)

    def logs(x: Array) -> Array:
        return level + 2 * jnp.log1p(share * jnp.expm1(x)) - x

    # Slopes are sums of a few terms of size ≤ 2: a few ulps of them are no slope.
    def rounding(x: Array) -> Array:
        return 4 * float(jnp.finfo(x.dtype).eps) * jnp.ones_like(share)

    zero = jnp.zeros_like(extent)
    best = least_largest(logs, zero, jnp.log1p(zero + largest), rounding)
    return jnp.expm1(best) / extent


__all__ = ["least_worst_strength", "worst_error"]
