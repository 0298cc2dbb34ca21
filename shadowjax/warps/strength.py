"""The warp strength of least worst error for measured weights: spot lights, visible pixels, any mix of points."""

from typing import Any

import jax
import jax.numpy as jnp

from shadowjax._checked import checked
from shadowjax._types import Array, Float


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

    Each point's error has one minimum in κ (its derivative has the sign of 2u − W + u·W·κ), so their maximum has one
    too: κ is bisected on the sign of the worst point's derivative. The best is strength 0, the uniform map, where the
    worst point of that map lies beyond the middle.

    Args:
        offset: u ∈ [0, W] of each point, plane units.
        weight: What a plane distance at the point costs, ≥ 0: world size of the plane unit over pixel size.
        extent: W, plane units.
        largest: Largest W·κ considered.
    """

    def rises(strength: Array) -> Array:
        stretch = 1 + offset * strength
        worst = jnp.argmax(weight * stretch * stretch)
        return 2 * offset[worst] - extent + offset[worst] * extent * strength > 0

    def halve(_: Any, ends: tuple[Array, Array]) -> tuple[Array, Array]:
        low, high = ends
        middle = (low + high) / 2
        up = rises(jnp.expm1(middle) / extent)
        return jnp.where(up, low, middle), jnp.where(up, middle, high)

    zero = jnp.zeros_like(extent)
    top = jnp.log1p(jnp.asarray(largest, extent.dtype))
    low, high = jax.lax.fori_loop(0, 60, halve, (zero, zero + top))
    best = jnp.expm1((low + high) / 2) / extent
    return jax.lax.stop_gradient(jnp.where(rises(zero), zero, best))


__all__ = ["least_worst_strength", "worst_error"]
