"""Moment shadow maps: the sharpest bound on visibility from four moments of depth, on the line or on an interval."""

import equinox as eqx
import jax.numpy as jnp

from shadowjax._checked import Checked, checked
from shadowjax._checks import require, require_choice
from shadowjax._types import Array, Float
from shadowjax.filters.encoded import Encoded, Values
from shadowjax.filters.prefilter import Prefilter
from shadowjax.filters.variance import check_step, linear_step

Numbers = Float[Array, "*points"]

PROBLEMS = ("hamburger", "hausdorff")


@checked
def power_moments(depth: Float[Array, "rows cols"]) -> Float[Array, "4 rows cols"]:
    """z, z², z³, z⁴ of every texel."""
    square = depth * depth
    return jnp.stack([depth, square, square * depth, square * square])


@checked
def bias_moments(moments: Values, moment_bias: float) -> Values:
    """Moments of the mixture of a distribution with weight 1 − α and of the points ±1 with weight α/2 each.

    It keeps the moments those of a distribution of at least three depths where rounding would not, at the price of a
    little light.

    Args:
        moments: First four moments of depths in [−1, 1].
        moment_bias: α in [0, 1).

    Source: Peters and Klein 2015, "Moment Shadow Mapping", section 3.2; its (½, ½, ½, ½) for depths in [0, 1].
    """
    ends = (0.0, 1.0, 0.0, 1.0)
    return [(1 - moment_bias) * value + moment_bias * end for value, end in zip(moments, ends, strict=True)]


@checked
def hamburger_visibility(moments: Values, depth: Numbers) -> Numbers:
    """Upper bound on the share of depths at or beyond the receiver, from the first four moments alone. It is sharp.

    The distribution that attains it has the receiver's depth t and two more points; these are the roots of the kernel
    K(x, t) = Σ pₙ(x)pₙ(t)/hₙ of the polynomials orthogonal under the moments, and the weight of a point x is
    1/K(x, x). In central coordinates p₁ = x, p₂ = x² − (m₃/m₂)x − m₂, h₁ = m₂, h₂ = m₄ − m₃²/m₂ − m₂².

    Args:
        moments: E[z] … E[z⁴].
        depth: Receiver's depth, in the same unit.

    Returns:
        1 minus the weight of the points before the receiver. Where rounding leaves no variance or no h₂, these are
        taken as a few roundings of the moments.

    Source: Peters and Klein 2015, "Moment Shadow Mapping", algorithm 1; the form with orthogonal polynomials is
    Krein and Nudelman's.
    """
    central = _Central.of(moments)
    t = depth - central.mean
    return 1 - central.share_before(t, *central.partners(t))


@checked
def hausdorff_visibility(moments: Values, depth: Numbers) -> Numbers:
    """As `hamburger_visibility` for depths that are known to lie in [−1, 1]: never larger, and sharp too.

    Where a point of the attaining distribution would lie outside, it has four points instead: −1, 1, the receiver's t,
    and x = E[(z²−1)(z−t)z] / E[(z²−1)(z−t)].

    Args:
        moments: E[z] … E[z⁴].
        depth: Receiver's depth; limited to [−1, 1 − 2⁻¹⁰], since at 1 two of the points meet.

    Source: Peters and Klein 2015, "Moment Shadow Mapping", section 3 (four moments, Hausdorff).
    """
    central = _Central.of(moments)
    t = depth - central.mean
    low, high = central.partners(t)
    inside = (low + central.mean >= -1) & (high + central.mean <= 1)
    three = central.share_before(t, low, high)
    four = _shadow_of_four_points(moments, jnp.clip(depth, -1.0, 1.0 - END_GAP))
    return 1 - jnp.where(inside, three, four)


class _Central(Checked):
    """Central moments, made safe for division."""

    mean: Numbers
    variance: Numbers
    skew: Numbers  # m₃/m₂
    rest: Numbers  # h₂

    @classmethod
    def of(cls, moments: Values) -> "_Central":
        b1, b2, b3, b4 = moments
        few = 8 * jnp.finfo(b1.dtype).eps
        square = b1 * b1
        variance = jnp.maximum(b2 - square, few)
        third = b3 - 3 * b1 * b2 + 2 * b1 * square
        fourth = b4 - 4 * b1 * b3 + 6 * square * b2 - 3 * square * square
        skew = third / variance
        rest = jnp.maximum(fourth - third * skew - variance * variance, few * variance)
        return cls(b1, variance, skew, rest)

    def kernel(self, x: Numbers) -> Numbers:
        """K(x, x) ≥ 1, the inverse weight of a point of the attaining distribution."""
        second = x * x - self.skew * x - self.variance
        return 1 + x * x / self.variance + second * second / self.rest

    def share_before(self, t: Numbers, low: Numbers, high: Numbers) -> Numbers:
        """Weight of the two partners of t that lie before it."""
        low_kernel, high_kernel, kernel = self.kernel(low), self.kernel(high), self.kernel(t)
        # Weights 1/K add up to 1. Where rounding has left few digits of h₂, one of them is off and the sum tells. With
        # all three multiplied by the product of the K, one division remains.
        weights = (high_kernel * kernel, low_kernel * kernel, low_kernel * high_kernel)
        before = jnp.where(t > low, weights[0], 0.0) + jnp.where(t > high, weights[1], 0.0)
        return before / (weights[0] + weights[1] + weights[2])

    def partners(self, t: Numbers) -> tuple[Numbers, Numbers]:
        """The other two points, in order: roots of K(x, t) in x. One runs to infinity where p₂(t) is 0."""
        second = t * t - self.skew * t - self.variance
        a = second * self.variance
        b = t * self.rest - second * self.skew * self.variance
        c = self.variance * (self.rest - second * self.variance)
        # The roots are real; rounding may say otherwise.
        root = _safe_root(b * b - 4 * a * c)
        # The half-sum without cancellation; the other root follows from the product.
        half = -0.5 * (b + jnp.where(b >= 0, root, -root))
        one, two = _far_divide(half, a), _far_divide(c, half)
        return jnp.minimum(one, two), jnp.maximum(one, two)


def _safe_root(value: Numbers) -> Numbers:
    positive = value > 0
    return jnp.where(positive, jnp.sqrt(jnp.where(positive, value, jnp.ones_like(value))), jnp.zeros_like(value))


# How far a receiver stays from the far end of the interval among four points.
END_GAP = 2.0**-10

# Farther than this in [−1, 1] a point weighs nothing, and its fourth power is still finite in float16.
_FAR = 8.0


def _far_divide(numerator: Numbers, denominator: Numbers) -> Numbers:
    """The quotient, kept within ±`_FAR`."""
    too_far = jnp.abs(numerator) >= _FAR * jnp.abs(denominator)
    quotient = numerator / jnp.where(too_far, jnp.ones_like(denominator), denominator)
    negative = (numerator < 0) ^ (denominator < 0)
    far = jnp.where(negative, -_FAR, _FAR).astype(numerator.dtype)
    return jnp.where(too_far, far, quotient)


def _shadow_of_four_points(moments: Values, t: Numbers) -> Numbers:
    """Weight before t of the distribution on −1, x, t, 1 with these moments."""
    b1, b2, b3, b4 = moments
    # E[(z²−1)(z−t)] and E[(z²−1)(z−t)z].
    lower = b3 - t * b2 - b1 + t
    upper = b4 - t * b3 - b2 + t * b1
    x = jnp.clip(_far_divide(upper, lower), -1.0, 1.0)

    def weight(at: Numbers, others: tuple[Numbers, Numbers, Numbers]) -> Numbers:
        """E of the cubic that is 1 at `at` and 0 at the others."""
        p, q, r = others
        value = b3 - (p + q + r) * b2 + (p * q + q * r + r * p) * b1 - p * q * r
        scale = (at - p) * (at - q) * (at - r)
        lost = scale == 0
        return jnp.where(lost, jnp.zeros_like(value), value / jnp.where(lost, jnp.ones_like(scale), scale))

    one = jnp.ones_like(t)
    # Whichever two of x, −1 and t lie close together, the weights of the other side are well conditioned.
    ends = weight(-one, (x, t, one))
    rest = 1 - weight(t, (-one, x, one)) - weight(one, (-one, x, t))
    return jnp.clip(jnp.where(x < t, rest, ends), 0.0, 1.0)


class Moments(Encoded):
    """Moment shadow maps with four moments. Depths are mapped to [−1, 1], where the moments are smallest.

    Attributes:
        problem: "hamburger" knows the moments alone; "hausdorff" also that depths lie in [−1, 1], which is darker.
        moment_bias: α in [0, 1): share of the points ±1 mixed in against rounding (see `bias_moments`); 3·10⁻⁶ suits
            float32, 6·10⁻⁵ half precision.
        prefilter: How moments are averaged.
        bleed_low: Bound that becomes 0 (`linear_step`).
        bleed_high: Bound that becomes 1.

    The depth bias belongs to the test as for every filter. Its default reaches as far as the kernel: a plane under the
    kernel lies partly before the receiver, which four moments, unlike two, can tell.
    """

    problem: str = eqx.field(static=True, default="hamburger")
    moment_bias: float = eqx.field(static=True, default=3e-6)
    prefilter: Prefilter = Prefilter()
    bleed_low: float = eqx.field(static=True, default=0.0)
    bleed_high: float = eqx.field(static=True, default=1.0)

    def __check_init__(self):
        require_choice(self.problem, "problem", PROBLEMS)
        require(0 <= self.moment_bias < 1, f"moment_bias is a share, in [0, 1); got {self.moment_bias}")
        check_step(self.bleed_low, self.bleed_high)

    def encode(self, depth: Float[Array, "rows cols"]) -> Float[Array, "n rows cols"]:
        """Four powers."""
        return power_moments(2 * depth - 1)

    def decode(self, values: Values, depth: Numbers) -> Numbers:
        """The bound, its low end cut."""
        bound = {"hamburger": hamburger_visibility, "hausdorff": hausdorff_visibility}[self.problem]
        visibility = bound(bias_moments(values, self.moment_bias), jnp.clip(2 * depth - 1, -1.0, 1.0))
        return linear_step(visibility, self.bleed_low, self.bleed_high)

    @property
    def num_planes(self) -> int:
        """Four moments."""
        return 4
