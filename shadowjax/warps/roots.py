"""A root finder for monotone functions, elementwise and differentiable."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp

from shadowjax._checked import checked
from shadowjax._numerics import safe_divide
from shadowjax._types import Array, Float


@checked
def bisect(
    decreasing: Callable[[Float[Array, "..."]], Float[Array, "..."]],
    low: Float[Array, "..."],
    high: Float[Array, "..."],
) -> Float[Array, "..."]:
    """Roots of a decreasing function between two points; the end that it points to where there is none.

    The last step is one of Newton's from a constant start, so the root carries its implicit derivative.

    Args:
        decreasing: A function that acts on each element.
        low: Lower ends.
        high: Upper ends.
    """
    low, high = jnp.broadcast_arrays(low, high)

    def halve(_: Any, ends: tuple[Array, Array]) -> tuple[Array, Array]:
        left, right = ends
        middle = (left + right) / 2
        above = decreasing(middle) > 0
        return jnp.where(above, middle, left), jnp.where(above, right, middle)

    ends = jax.lax.stop_gradient((low, high))
    left, right = jax.lax.fori_loop(0, 60, halve, ends)
    root = jax.lax.stop_gradient((left + right) / 2)
    value, slope = jax.jvp(decreasing, (root,), (jnp.ones_like(root),))
    inside = (root > low + 1e-6) & (root < high - 1e-6)
    step = safe_divide(value, jax.lax.stop_gradient(slope))
    return jnp.where(inside, root - step, jnp.clip(root, low, high))


__all__ = ["bisect"]
