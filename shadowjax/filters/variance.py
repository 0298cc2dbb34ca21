"""Variance shadow maps: two moments of depth, and Chebyshev's bound on the share of depths beyond the receiver."""

import dataclasses

import equinox as eqx
import jax.numpy as jnp

from shadowjax._checked import checked
from shadowjax._checks import concrete, require, require_value
from shadowjax._types import Array, Float, ScalarLike
from shadowjax.filters.prefilter import Prefilter
from shadowjax.filters.prefiltered import Prefiltered, Values

# E[x²] along one axis of footprints of depth inside a texel, texels².
FOOTPRINTS = {"point": 0.0, "texel": 1 / 12, "disc": 1 / 16, "tent": 1 / 6, "gaussian": 1 / 4}

Numbers = Float[Array, "*points"]


@checked
def surface_slopes(
    depth: Float[Array, "rows cols"], limit: ScalarLike | None = None
) -> tuple[Float[Array, "rows cols"], Float[Array, "rows cols"]]:
    """Depth change over one texel along columns and along rows, of the surface seen at each texel.

    The mean of the differences to both neighbours where they agree to a factor of two; else the smaller one, or 0 where
    their signs differ. So the slope is exact on a plane up to its silhouette, has a derivative there, and a jump
    between surfaces does not count.

    Args:
        depth: Depth map.
        limit: Largest magnitude; None for no limit. Surfaces parallel to the light have any slope.
    """

    def along(axis: int) -> Array:
        # Differences to both neighbours, `before` and `after`, at every texel.
        step = jnp.diff(depth, axis=axis)
        # Beyond the edge of the map the last difference goes on.
        first, last = (jnp.take(step, jnp.asarray([i], jnp.int32), axis=axis) for i in (0, step.shape[axis] - 1))
        before, after = jnp.concatenate([first, step], axis=axis), jnp.concatenate([step, last], axis=axis)
        # At a silhouette one of both differences crosses to another surface and is the larger: the smaller one counts.
        sizes = jnp.abs(before), jnp.abs(after)
        smaller = jnp.where(sizes[0] <= sizes[1], before, after)
        agree = jnp.maximum(*sizes) <= 2 * jnp.minimum(*sizes)
        one_sided = jnp.where(agree, 0.5 * (before + after), smaller)
        # Opposite signs: a ridge or a valley, whose tangent plane is taken as level.
        slope = jnp.where(before * after > 0, one_sided, jnp.zeros_like(smaller))
        return slope if limit is None else jnp.clip(slope, -limit, limit)

    def flat() -> Array:
        return jnp.zeros_like(depth)

    num_rows, num_cols = depth.shape
    return (along(1) if num_cols > 1 else flat()), (along(0) if num_rows > 1 else flat())


@checked
def depth_moments(
    depth: Float[Array, "rows cols"], footprint: ScalarLike = 0.25, slope_limit: ScalarLike | None = None
) -> Float[Array, "2 rows cols"]:
    """First and second moment of depth inside each texel, for a surface that is flat there.

    Args:
        depth: Depth map.
        footprint: E[x²] of the texel's footprint along one axis, texels²: ¼ (as printed) is a Gaussian with σ = ½, 1/12
            the texel's own square, 0 a point. See `FOOTPRINTS`.
        slope_limit: Largest slope that counts, depth per texel; None for no limit.

    Returns:
        M₁ = z and M₂ = z² + footprint·(z_x² + z_y²).

    Source: filtering, eqs 2.3, 2.4 and 2.9.
    """
    square = depth * depth
    if concrete(footprint) != 0:
        across, down = surface_slopes(depth, slope_limit)
        square = square + footprint * (across * across + down * down)
    return jnp.stack([depth, square])


@checked
def variance_of(mean: Numbers, square: Numbers, min_variance: ScalarLike = 0.0) -> Numbers:
    """σ² = M₂ − M₁², not less than `min_variance`: rounding can make it negative. Source: filtering, eqs 2.5, 2.6."""
    return jnp.maximum(square - mean * mean, jnp.asarray(min_variance, mean.dtype))


@checked
def chebyshev_visibility(mean: Numbers, variance: Numbers, depth: Numbers) -> Numbers:
    """Upper bound on the share of depths at or beyond the receiver, from their mean and variance.

    Args:
        mean: M₁ at the receiver.
        variance: σ² ≥ 0, in the square of the depths' unit.
        depth: Receiver's depth, in the same unit.

    Returns:
        1 where depth ≤ mean, else σ²/(σ² + (depth − mean)²). Exact for two depths and a receiver at the farther one.

    Raises:
        ValueError: If a variance is negative.

    Source: filtering, eqs 2.7 and 2.8 (one-sided Chebyshev); the bound holds for depth > mean only.
    """
    return _chebyshev(mean, require_value(variance, variance >= 0, "variance must not be negative"), depth)


def _chebyshev(mean: Numbers, variance: Numbers, depth: Numbers) -> Numbers:
    behind = depth > mean
    # Receivers in front get harmless numbers before they are set to 1, so that no gradient multiplies 0 by infinity.
    beyond = jnp.where(behind, depth - mean, jnp.ones_like(mean))
    # Eq. 2.7, σ²/(σ² + (d − μ)²), with 0/0 taken as lit.
    spread = jnp.where(behind, variance, jnp.zeros_like(mean))
    total = spread + beyond * beyond
    lost = total == 0  # a distance so small that its square is 0
    bound = spread / jnp.where(lost, jnp.ones_like(mean), total)
    return jnp.where(behind & ~lost, bound, jnp.ones_like(mean))


@checked
def linear_step(value: Numbers, low: ScalarLike = 0.0, high: ScalarLike = 1.0) -> Numbers:
    """(value − low)/(high − low), clamped to [0, 1]: darkens what bleeds through and rescales the rest.

    Args:
        value: A bound on visibility.
        low: Becomes 0, in [0, 1).
        high: Becomes 1, in (low, 1].

    Raises:
        ValueError: If not 0 ≤ low < high ≤ 1.

    Source: filtering, Algorithm 2.
    """
    check_step(low, high)
    return jnp.clip((value - low) / (high - low), 0.0, 1.0)


@checked
def check_step(low: ScalarLike, high: ScalarLike) -> None:
    """Complain unless 0 ≤ low < high ≤ 1, where both are known."""
    known = concrete(low) is not None and concrete(high) is not None
    require(not known or bool(0 <= low < high <= 1), f"0 ≤ bleed_low < bleed_high ≤ 1 must hold; got {low} and {high}")


@checked
def check_spread(min_variance: ScalarLike, footprint: ScalarLike, slope_limit: ScalarLike) -> None:
    """Complain about a negative least variance, footprint or limit of slopes."""
    require(bool(min_variance >= 0), f"min_variance must not be negative; got {min_variance}")
    require(bool(footprint >= 0), f"footprint is a mean square, ≥ 0; got {footprint}")
    require(bool(slope_limit >= 0), f"slope_limit must not be negative; got {slope_limit}")


@checked
def encode_variance(
    depth: Float[Array, "rows cols"], footprint: ScalarLike = 0.25, slope_limit: ScalarLike = 0.05
) -> Float[Array, "2 rows cols"]:
    """What a variance shadow map stores: two moments, to be averaged.

    Args:
        depth: Parts of the map's range, [0, 1] (`unit_depth`).
        footprint: E[x²] of a texel's footprint, texels², ≥ 0 (`depth_moments`).
        slope_limit: Largest slope that counts in it, parts of the range per texel, ≥ 0.
    """
    return depth_moments(depth, footprint, slope_limit)


@checked
def decode_variance(
    values: Values,
    depth: Numbers,
    min_variance: ScalarLike = 1e-6,
    bleed_low: ScalarLike = 0.0,
    bleed_high: ScalarLike = 1.0,
) -> Numbers:
    """Visibility from averaged moments: Chebyshev's bound, its low end cut.

    Args:
        values: The two moments at each receiver.
        depth: Receivers' depth in the same range, less the bias.
        min_variance: Least variance, in squares of the range, ≥ 0.
        bleed_low: Bound that becomes 0, in [0, 1).
        bleed_high: Bound that becomes 1, in (bleed_low, 1].

    Source: filtering, eqs 2.5 to 2.8 and Algorithm 2.
    """
    mean, square = values
    bound = _chebyshev(mean, variance_of(mean, square, min_variance), depth)
    return linear_step(bound, bleed_low, bleed_high)


class Variance(Prefiltered):
    """Variance shadow maps. Depths are parts of the map's range, [0, 1].

    Attributes:
        prefilter: How moments are averaged.
        min_variance: Least variance, in squares of the range: what is no more than rounding. It keeps flat surfaces
            lit; larger values soften contact.
        bleed_low: Bound that becomes 0, in [0, 1): the cure for light bleeding, which also darkens soft edges.
        bleed_high: Bound that becomes 1.
        footprint: E[x²] of a texel's footprint, texels² (see `depth_moments`).
        slope_limit: Largest slope that counts in it, parts of the range per texel.
    """

    prefilter: Prefilter = Prefilter()
    min_variance: float = eqx.field(static=True, default=1e-6)
    bleed_low: float = eqx.field(static=True, default=0.0)
    bleed_high: float = eqx.field(static=True, default=1.0)
    footprint: float = eqx.field(static=True, default=0.25)
    slope_limit: float = eqx.field(static=True, default=0.05)

    def __check_init__(self) -> None:
        check_spread(self.min_variance, self.footprint, self.slope_limit)
        check_step(self.bleed_low, self.bleed_high)

    def encode(self, depth: Float[Array, "rows cols"]) -> Float[Array, "n rows cols"]:
        """Two moments."""
        return encode_variance(depth, self.footprint, self.slope_limit)

    def decode(self, values: Values, depth: Numbers) -> Numbers:
        """Chebyshev's bound, its low end cut."""
        return decode_variance(values, depth, self.min_variance, self.bleed_low, self.bleed_high)

    @property
    def num_planes(self) -> int:
        """Two moments."""
        return 2

    def for_coverage(self) -> "Variance":
        """Without a footprint."""
        return dataclasses.replace(self, footprint=0.0)

    @property
    def supports_coverage(self) -> bool:
        """Without a footprint, whose slopes are differences of neighbours."""
        return self.footprint == 0

    @property
    def bias_reach(self) -> float:
        """The mean of a plane is its depth at the receiver; half a texel covers how a map bends it."""
        return 0.5
