"""Exponential variance shadow maps: Chebyshev's bound on exponentially warped depths, from two or four moments."""

import dataclasses

import equinox as eqx
import jax.numpy as jnp

from shadowjax._checked import checked
from shadowjax._checks import POSITIVE, require_number
from shadowjax._types import Array, DType, Float, ScalarLike
from shadowjax.filters.exponential import check_exponent
from shadowjax.filters.prefilter import Prefilter
from shadowjax.filters.prefiltered import Prefiltered, Values
from shadowjax.filters.variance import _chebyshev, check_spread, check_step, linear_step, surface_slopes

Numbers = Float[Array, "*points"]


@checked
def warp_depth(depth: Float[Array, "*shape"], exponent: ScalarLike) -> Float[Array, "*shape"]:
    """e^(c(2z−1)) for positive c, −e^(c(2z−1)) for negative c: rising in z either way.

    Args:
        depth: z in [0, 1].
        exponent: c; a positive one stretches far depths, a negative one near depths.

    Source: Lauritzen and McCool 2008, "Layered Variance Shadow Maps", section 7; c₋ with its sign.
    """
    warped = jnp.exp(exponent * (2 * depth - 1))
    return jnp.where(jnp.asarray(exponent) > 0, warped, -warped)


@checked
def warped_moments(
    depth: Float[Array, "rows cols"], exponent: ScalarLike, footprint: ScalarLike, slope_limit: ScalarLike
) -> Float[Array, "2 rows cols"]:
    """First and second moment of the warped depth inside each texel.

    The planar term of eq. 2.9 is carried through the warp: its slope is 2|c|·|warped| times that of depth.
    """
    warped = warp_depth(depth, exponent)
    across, down = surface_slopes(depth, slope_limit)
    # M₂ = w² + footprint·(w_x² + w_y²) with w_x = 2c·w·z_x, so w² can be taken out.
    spread = footprint * (2 * exponent) ** 2 * (across * across + down * down)
    return jnp.stack([warped, warped * warped * (1 + spread)])


@checked
def warped_bound(values: Values, depth: Numbers, exponent: ScalarLike, min_variance: ScalarLike) -> Numbers:
    """Chebyshev's bound on visibility from two moments of depths warped with one exponent.

    Args:
        values: Averaged moments.
        depth: Receiver's depth in [0, 1].
        exponent: c of the warp.
        min_variance: Least variance of *depth*, carried through the warp.
    """
    mean, square = values
    receiver = warp_depth(depth, exponent)
    # dw/dz = 2c·w carries a variance of depth to one of warped depth, at the receiver.
    least = min_variance * (2 * exponent) ** 2 * receiver * receiver
    # Measured in units of the receiver's own warped depth, squares cannot overflow where the moments did not. In front
    # of the mean they can, and moments do not matter there.
    behind = receiver > mean
    unit = jnp.abs(receiver)
    variance = jnp.maximum(jnp.where(behind, square - mean * mean, least), least)
    bound = _chebyshev(jnp.where(behind, mean, receiver) / unit, variance / unit / unit, receiver / unit)
    return jnp.where(behind, bound, jnp.ones_like(bound))


@checked
def encode_exponential_variance(
    depth: Float[Array, "rows cols"],
    positive: ScalarLike = 40.0,
    negative: ScalarLike | None = 5.0,
    footprint: ScalarLike = 0.25,
    slope_limit: ScalarLike = 0.05,
) -> Float[Array, "n rows cols"]:
    """What an exponential variance shadow map stores: two moments of each warp, to be averaged.

    Args:
        depth: Parts of the map's range, [0, 1] (`unit_depth`).
        positive: c₊ > 0; 2c₊ must fit the dtype (below 44.36 in float32).
        negative: c₋ > 0, the magnitude of the second warp's exponent; None for two moments only.
        footprint: E[x²] of a texel's footprint, texels², ≥ 0 (`depth_moments`).
        slope_limit: Largest slope that counts in it, parts of the range per texel, ≥ 0.
    """
    exponents = (positive,) if negative is None else (positive, -negative)
    return jnp.concatenate([warped_moments(depth, exponent, footprint, slope_limit) for exponent in exponents])


@checked
def decode_exponential_variance(
    values: Values,
    depth: Numbers,
    positive: ScalarLike = 40.0,
    negative: ScalarLike | None = 5.0,
    min_variance: ScalarLike = 1e-6,
    bleed_low: ScalarLike = 0.0,
    bleed_high: ScalarLike = 1.0,
) -> Numbers:
    """Visibility from averaged moments of warped depths: the smallest of the warps' bounds, its low end cut.

    Args:
        values: The two or four moments at each receiver.
        depth: Receivers' depth in the same range, less the bias.
        positive: c₊, as stored.
        negative: c₋, as stored.
        min_variance: Least variance of depth, in squares of the range, ≥ 0.
        bleed_low: Bound that becomes 0, in [0, 1).
        bleed_high: Bound that becomes 1, in (bleed_low, 1].
    """
    # Nothing is stored outside [0, 1]: receivers before it are lit as at 0, those behind it as dark as at 1.
    depth = jnp.clip(depth, 0.0, 1.0)
    bound = warped_bound(values[:2], depth, positive, min_variance)
    if negative is not None:
        bound = jnp.minimum(bound, warped_bound(values[2:], depth, -negative, min_variance))
    return linear_step(bound, bleed_low, bleed_high)


class ExponentialVariance(Prefiltered):
    """Exponential variance shadow maps: EVSM2 with a positive exponent alone, EVSM4 with both.

    Attributes:
        positive: c₊ > 0. Larger values bleed less between occluders; 2c₊ must fit the dtype (below 44.36 in float32).
        negative: c₋ > 0, the magnitude of the second warp's exponent, or None for two moments only. The smaller of the
            two bounds counts.
        prefilter: How moments are averaged.
        min_variance: Least variance of depth, in squares of the map's range.
        bleed_low: Bound that becomes 0 (`linear_step`).
        bleed_high: Bound that becomes 1.
        footprint: E[x²] of a texel's footprint, texels² (see `depth_moments`).
        slope_limit: Largest slope that counts in it, parts of the range per texel.
    """

    positive: float = eqx.field(static=True, default=40.0)
    negative: float | None = eqx.field(static=True, default=5.0)
    prefilter: Prefilter = Prefilter()
    min_variance: float = eqx.field(static=True, default=1e-6)
    bleed_low: float = eqx.field(static=True, default=0.0)
    bleed_high: float = eqx.field(static=True, default=1.0)
    footprint: float = eqx.field(static=True, default=0.25)
    slope_limit: float = eqx.field(static=True, default=0.05)

    def __check_init__(self) -> None:
        for name, exponent in (("positive", self.positive), ("negative", self.negative)):
            if exponent is not None:
                require_number(exponent, f"{name}, the magnitude of an exponent,", POSITIVE)
        check_spread(self.min_variance, self.footprint, self.slope_limit)
        check_step(self.bleed_low, self.bleed_high)

    @property
    def exponents(self) -> tuple[float, ...]:
        """c₊, and −c₋ if there is one."""
        return (self.positive,) if self.negative is None else (self.positive, -self.negative)

    def check(self, dtype: DType) -> None:
        """Second moments must be finite."""
        for exponent in map(abs, self.exponents):
            # The planar term multiplies the second moment by at most this, with both slopes at their limit.
            growth = 1 + self.footprint * (2 * exponent) ** 2 * 2 * self.slope_limit**2
            check_exponent(exponent, dtype, 2, growth)

    def encode(self, depth: Float[Array, "rows cols"]) -> Float[Array, "n rows cols"]:
        """Two moments of each warp."""
        return encode_exponential_variance(depth, self.positive, self.negative, self.footprint, self.slope_limit)

    def decode(self, values: Values, depth: Numbers) -> Numbers:
        """The smallest of the warps' bounds, its low end cut."""
        exponents, bleed = (self.positive, self.negative), (self.bleed_low, self.bleed_high)
        return decode_exponential_variance(values, depth, *exponents, self.min_variance, *bleed)

    @property
    def num_planes(self) -> int:
        """Two or four moments."""
        return 2 * len(self.exponents)

    def for_coverage(self) -> "ExponentialVariance":
        """Without a footprint."""
        return dataclasses.replace(self, footprint=0.0)

    @property
    def supports_coverage(self) -> bool:
        """Without a footprint, whose slopes are differences of neighbours."""
        return self.footprint == 0

    @property
    def bias_reach(self) -> float:
        """Half a texel with c₊ alone: the mean of e^(cz) over a plane lies behind the receiver. With c₋ it lies before
        it, and the bias must reach as far as the kernel."""
        return 0.5 if self.negative is None else self.reach
