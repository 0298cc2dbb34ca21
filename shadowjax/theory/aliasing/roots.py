"""Roots and optima found by bisection, with the derivative that the implicit function theorem gives them."""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp

from shadowjax._checked import checked
from shadowjax._types import Array, Float, Scalar

HALVINGS = 80  # of a bracket of at most a thousand units: finer than the spacing of float64 numbers in it

_NOT_UNIQUE = (
    "an optimum has no derivative here: its condition does not change along the variable, so equally good optima lie "
    "next to it; differentiate its objective instead, or move the view a little"
)


@checked
def implicit(residual: Callable[[Array], Array], found: Float[Array, "..."]) -> Float[Array, "..."]:
    """`found`, with the derivative of the root of `residual` that it is: −(∂r/∂x)⁻¹·∂r/∂θ.

    Forward and reverse, of any order, under `jit` and `vmap`. The derivative is taken by whatever numbers the residual
    closes over; the search that found the root is not differentiated.

    Args:
        residual: Acts on each element; 0 at the root.
        found: The roots.

    Raises:
        RuntimeError: When differentiated (at run time) where the residual does not change with x.
    """

    def tangent(linear: Callable[[Array], Array], change: Array) -> Array:
        # The residual acts on each element, so its Jacobian is diagonal: one product with ones is all of it.
        slope = linear(jnp.ones_like(change))
        return change / eqx.error_if(slope, jnp.any(slope == 0), _NOT_UNIQUE)

    # `solve` returns the root that is known; `tangent` solves the linearised residual for its change.
    return jax.lax.custom_root(residual, jax.lax.stop_gradient(found), lambda _, x: x, tangent)


@checked
def bisect(
    decreasing: Callable[[Float[Array, "..."]], Float[Array, "..."]],
    low: Float[Array, "..."],
    high: Float[Array, "..."],
) -> Float[Array, "..."]:
    """Roots of a decreasing function between two points; the end that it points to where there is none.

    A root carries its implicit derivative, and an end its own.

    Args:
        decreasing: A function that acts on each element.
        low: Lower ends.
        high: Upper ends.
    """
    low, high = jnp.broadcast_arrays(low, high)
    fixed_low, fixed_high = jax.lax.stop_gradient((low, high))
    # No sign change: the function is negative from the start, or positive to the end.
    below, above = decreasing(fixed_low) <= 0, decreasing(fixed_high) >= 0

    def halve(_: Any, ends: tuple[Array, Array]) -> tuple[Array, Array]:
        left, right = ends
        middle = (left + right) / 2
        # A decreasing function that is positive at the middle has its root to the right.
        positive = decreasing(middle) > 0
        return jnp.where(positive, middle, left), jnp.where(positive, right, middle)

    left, right = jax.lax.fori_loop(0, HALVINGS, halve, (fixed_low, fixed_high))
    # An end that stands for the root follows that end: the residual x − low has the derivative dx = d(low).
    root = jnp.where(below, fixed_low, jnp.where(above, fixed_high, (left + right) / 2))
    return implicit(lambda x: jnp.where(below, x - low, jnp.where(above, x - high, decreasing(x))), root)


@checked
def least(
    value: Callable[[Scalar, Any], Scalar],
    active: Callable[[Scalar], Any],
    low: Scalar,
    high: Scalar,
    flat: Callable[[Scalar, Any], Scalar],
) -> Scalar:
    """The point of an interval at which a function made of smooth pieces is least.

    The function must fall, then rise; it may do only one of both. The sign of its slope is bisected, which finds a
    smooth minimum as well as a kink between two pieces. The pieces just below and just above the minimum are its active
    set: with two of them the minimum stays where they are equal, with one where its slope is 0, and at an end of the
    interval it moves with the end. That gives its derivative by all that `value`, `low` and `high` close over; at a
    change of the active set it is that of one side.

    Args:
        value: A smooth piece at a point, given which it is; best of order 1, such as a logarithm.
        active: Which piece the function follows at a point, as integers.
        low: Lower end.
        high: Upper end.
        flat: Slope of a piece up to which it counts as falling: what rounding leaves of a slope of 0. Of equally good
            points the largest is taken.

    Raises:
        RuntimeError: When differentiated where the optimum is not unique.
    """
    fixed_low, fixed_high = jax.lax.stop_gradient((low, high))

    def slope(x: Array, piece: Any) -> Array:
        return jax.jvp(lambda at: value(at, piece), (x,), (jnp.ones_like(x),))[1]

    # The piece that is largest at x, and whether it rises there; `flat` keeps rounding from looking like a slope.
    def look(x: Array) -> tuple[Any, Array]:
        piece = active(x)
        return piece, slope(x, piece) > flat(x, piece)

    def halve(_: Any, state: tuple[Array, Array, Any, Any]) -> tuple[Array, Array, Any, Any]:
        left, right, before, after = state
        middle = (left + right) / 2
        piece, up = look(middle)
        # Where the function rises the minimum lies left: the right end moves in and brings its piece along.
        keep = lambda old, new: jnp.where(up, old, new)  # noqa: E731
        before, after = jax.tree.map(keep, before, piece), jax.tree.map(keep, piece, after)
        return keep(left, middle), keep(middle, right), before, after

    (before, starts_up), (after, ends_up) = look(fixed_low), look(fixed_high)
    # What is active is kept with the ends: worked out anew, rounding may decide a tie in another way.
    state = (fixed_low, fixed_high, before, after)
    left, right, before, after = jax.lax.fori_loop(0, HALVINGS, halve, state)
    found = jnp.where(starts_up, fixed_low, jnp.where(ends_up, (left + right) / 2, fixed_high))
    # Pieces that are one function along the variable (equal at every point) have no kink between them.
    jump = jnp.abs(slope(found, before) - slope(found, after))
    kink = jump > 1e3 * float(jnp.finfo(found.dtype).eps)

    # On a kink two pieces stay equal; at a smooth minimum the slope of one stays 0. Their implicit derivatives differ.
    def residual(x: Array) -> Array:
        inside = jnp.where(kink, value(x, before) - value(x, after), slope(x, before))
        return jnp.where(starts_up, x - low, jnp.where(ends_up, inside, x - high))

    return implicit(residual, found)


@checked
def least_largest(
    pieces: Callable[[Scalar], Float[Array, "pieces"]],
    low: Scalar,
    high: Scalar,
    flat: Callable[[Scalar], Float[Array, "pieces"]],
) -> Scalar:
    """`least` of the largest of several smooth functions.

    Args:
        pieces: The functions.
        low: Lower end.
        high: Upper end.
        flat: For each function, the slope up to which it counts as falling.
    """
    return least(
        lambda x, first: pieces(x)[first], lambda x: jnp.argmax(pieces(x)), low, high, lambda x, first: flat(x)[first]
    )


__all__ = ["HALVINGS", "bisect", "implicit", "least", "least_largest"]
