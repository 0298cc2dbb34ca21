"""Where to cut the view in depth: uniform, logarithmic, practical and adaptive splits."""

import math
from collections.abc import Sequence

import jax.numpy as jnp

from shadowjax._checked import checked
from shadowjax._checks import require, require_int, require_value
from shadowjax._types import Array, ArrayLike, Float, as_float_array

Splits = Float[Array, "... planes"]


def _range(near: ArrayLike, far: ArrayLike, num_partitions: int) -> tuple[Array, Array, Array]:
    near, far = as_float_array(near), as_float_array(far)
    near = require_value(near, near > 0, "near must be positive")
    far = require_value(far, far > near, "far must be greater than near")
    require_int(num_partitions, "the number of partitions k", 1)
    near, far = near[..., None], far[..., None]
    return near, far, jnp.arange(num_partitions + 1, dtype=far.dtype) / num_partitions


def _ends(splits: Array, near: Array, far: Array) -> Splits:
    """The planes with n and f exact."""
    return splits.at[..., 0].set(near[..., 0]).at[..., -1].set(far[..., 0])


@checked
def uniform_splits(near: ArrayLike, far: ArrayLike, num_partitions: int) -> Splits:
    """Slices of equal depth: k + 1 planes from n to f."""
    near, far, step = _range(near, far, num_partitions)
    return _ends(near + (far - near) * step, near, far)


@checked
def logarithmic_splits(near: ArrayLike, far: ArrayLike, num_partitions: int) -> Splits:
    """Slices of equal ratio f_i/n_i, so similar to each other: n(f/n)^(i/k).

    They minimise the largest storage factor, and the sum wherever S is convex in ln(f/n): with the light overhead, for
    uniform maps and for parallel light.

    Args:
        near: Depth n, world units, > 0.
        far: Depth f, world units, > near.
        num_partitions: k ≥ 1.

    Raises:
        ValueError: If a number is out of range.

    Source: warping, eq. 50.
    """
    near, far, step = _range(near, far, num_partitions)
    return _ends(near * (far / near) ** step, near, far)


@checked
def practical_splits(near: ArrayLike, far: ArrayLike, num_partitions: int, weight: ArrayLike = 0.5) -> Splits:
    """weight · logarithmic + (1 − weight) · uniform splits.

    Args:
        near: Depth n, world units, > 0.
        far: Depth f, world units, > near.
        num_partitions: k ≥ 1.
        weight: λ in [0, 1]; 1 is logarithmic.

    Raises:
        ValueError: If a number is out of range.
    """
    weight = as_float_array(weight)
    weight = require_value(weight, (weight >= 0) & (weight <= 1), "the weight λ must lie in [0, 1]")
    logarithmic, uniform = logarithmic_splits(near, far, num_partitions), uniform_splits(near, far, num_partitions)
    weight = weight[..., None].astype(uniform.dtype)
    return uniform + weight * (logarithmic - uniform)


@checked
def given_splits(near: ArrayLike, far: ArrayLike, shares: ArrayLike) -> Splits:
    """Cuts at given shares of the range: n + s·(f − n), as engines state them.

    Args:
        near: Depth n, world units, > 0.
        far: Depth f, world units, > near.
        shares: k − 1 rising shares in (0, 1).

    Raises:
        ValueError: If a number is out of range, or shares do not rise.
    """
    given = as_float_array(shares)
    near, far, step = _range(near, far, given.shape[-1] + 1)
    # 0 and 1 of `step` close the list, so that one test of differences covers order and range.
    steps = jnp.concatenate([step[:1], given.astype(step.dtype), step[-1:]])
    given = require_value(steps, jnp.all(jnp.diff(steps) > 0), "shares must rise between 0 and 1")
    return _ends(near + (far - near) * given, near, far)


@checked
def splits_after(near: ArrayLike, first: ArrayLike, far: ArrayLike, num_partitions: int) -> Splits:
    """A first cut at a given depth and equal ratios beyond it; equal ratios throughout if it lies outside the range.

    Args:
        near: Depth n, world units, > 0.
        first: Depth of the first cut, world units.
        far: Depth f, world units, > near.
        num_partitions: k ≥ 1.

    Raises:
        ValueError: If a number is out of range.
    """
    equal = logarithmic_splits(near, far, num_partitions)
    if num_partitions == 1:
        return equal
    first = as_float_array(first, equal.dtype)
    # Strictly inside, so that every slice has a length.
    inside = (first > equal[..., 0]) & (first < equal[..., -1])
    # A first cut outside the range is not used, but must not reach `logarithmic_splits`, which would refuse it.
    start = jnp.where(inside, first, equal[..., 1])
    rest = logarithmic_splits(start, equal[..., -1], num_partitions - 1)
    return jnp.where(inside[..., None], jnp.concatenate([equal[..., :1], rest], axis=-1), equal)


@checked
def iterate_adaptive(
    near: Float[Array, "..."], far: Float[Array, "..."], weight: Float[Array, "..."], ratios: Float[Array, "... cuts"],
    least_share: float = 0.0,
) -> Splits:  # fmt: skip
    """The adaptive iteration without checks; `least_share` 0 is the source's own. See `adaptive_splits`."""
    # Eq. 55 from the last slice to the second: each cut depends on the one behind it, which is why this is a loop.
    planes = [far]
    for i in range(ratios.shape[-1] + 1, 1, -1):
        end = planes[-1]
        equal = near * (end / near) ** ((i - 1) / i)
        cut = weight * equal + (1 - weight) * end / ratios[..., i - 2]
        if least_share > 0:
            # The clamp, in logarithms: i − 1 slices in front of a cut keep least_share of (i − 1)/i of ln(end/n).
            cut = jnp.maximum(cut, near * (end / near) ** (least_share * (i - 1) / i))
        planes.append(cut)
    planes.append(jnp.broadcast_to(near, planes[-1].shape))
    return jnp.stack(jnp.broadcast_arrays(*planes[::-1]), axis=-1)


@checked
def adaptive_splits(
    near: ArrayLike,
    far: ArrayLike,
    gamma: ArrayLike,
    ratios: ArrayLike | Sequence[float],
    least_share: float = 0.25,
) -> Splits:
    """Logarithmic splits when the light is overhead, chosen ratios f_i/n_i (against seams) as it turns parallel.

    From the last slice to the second, n_i = λ·n(f_i/n)^((i−1)/i) + (1 − λ)·f_i/α_i with λ = γ/(π/2). As printed the
    cuts can leave [n, f] even when the product of the α is below f/n. Here the slices in front of a cut keep at least
    `least_share` of the log range that equal ratios would give them, so n < n_2 < … < f always.

    Args:
        near: Depth n, world units, > 0.
        far: Depth f, world units, > near.
        gamma: Angle between light and view, radians, in [0, π/2].
        ratios: α_2 … α_k, each > 1, one a cut; their product at most f/n.
        least_share: 0 for the printed form, 1 never to let a slice be longer than its equal share.

    Returns:
        k + 1 planes from n to f.

    Raises:
        ValueError: If a number is out of range.

    Source: warping, eq. 55, with the clamp that it lacks.
    """
    near, far, _ = _range(near, far, 1)
    near, far = near[..., 0], far[..., 0]
    ratios = jnp.asarray(ratios, dtype=near.dtype)
    gamma = jnp.asarray(gamma, dtype=near.dtype)
    require(ratios.ndim > 0, "ratios must be a sequence α_2 … α_k, one a cut")
    require(0 <= least_share <= 1, f"least_share must lie in [0, 1]; got {least_share}")
    right_angle = jnp.asarray(math.pi / 2, near.dtype)
    gamma = require_value(gamma, (gamma >= 0) & (gamma <= right_angle), "gamma must be in radians and lie in [0, π/2]")
    ratios = require_value(ratios, ratios > 1, "every ratio α of the slices must exceed 1")
    fits = jnp.prod(ratios, axis=-1) <= far / near
    ratios = require_value(ratios, fits, "the product of the ratios α must not exceed far/near")
    return iterate_adaptive(near, far, gamma / right_angle, ratios, least_share)


__all__ = [
    "Splits", "adaptive_splits", "given_splits", "iterate_adaptive", "logarithmic_splits", "practical_splits",
    "splits_after", "uniform_splits",
]  # fmt: skip
