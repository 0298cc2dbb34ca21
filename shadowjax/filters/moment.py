"""Moment shadow maps: the sharpest bound on visibility from four moments of depth, on the line or on an interval."""

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp

from shadowjax._checked import Checked, checked
from shadowjax._checks import require, require_choice
from shadowjax._numerics import safe_divide, safe_sqrt
from shadowjax._types import Array, Float, ScalarLike
from shadowjax.filters.prefilter import Prefilter
from shadowjax.filters.prefiltered import Prefiltered, Values
from shadowjax.filters.variance import check_step, linear_step

Numbers = Float[Array, "*points"]

PROBLEMS = ("hamburger", "hausdorff")


@checked
def power_moments(depth: Float[Array, "rows cols"]) -> Float[Array, "4 rows cols"]:
    """z, z², z³, z⁴ of every texel."""
    square = depth * depth
    return jnp.stack([depth, square, square * depth, square * square])


@checked
def bias_moments(moments: Values, moment_bias: ScalarLike) -> Values:
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
    return 1 - central.share_before(t, central.partners(t))


@checked
def hausdorff_visibility(moments: Values, depth: Numbers) -> Numbers:
    """As `hamburger_visibility` for depths that are known to lie in [−1, 1]: never larger, and sharp too.

    Where a point of the attaining distribution would lie outside, it has four points instead: −1, 1, the receiver's t,
    and x = E[(z²−1)(z−t)z] / E[(z²−1)(z−t)].

    Args:
        moments: E[z] … E[z⁴].
        depth: Receiver's depth; limited to [−1, 1].

    Source: Peters and Klein 2015, "Moment Shadow Mapping", section 3 (four moments, Hausdorff).
    """
    central = _Central.of(moments)
    t = depth - central.mean
    partners = central.partners(t)
    # |mean + above/below| ≤ 1, multiplied out: a partner at infinity has below = 0.
    inside = jnp.ones_like(t, bool)
    for point in partners:
        inside &= jnp.abs(point.above + central.mean * point.below) <= point.below
    # Both distributions are worked out everywhere, and chosen by whether three points fit into [−1, 1].
    three = central.share_before(t, partners)
    four = _shadow_of_four_points(moments, jnp.clip(depth, -1.0, 1.0))
    return 1 - jnp.where(inside, three, four)


@checked
def encode_moments(depth: Float[Array, "rows cols"]) -> Float[Array, "4 rows cols"]:
    """What a moment shadow map stores: four powers of depths moved to [−1, 1], to be averaged.

    Args:
        depth: Parts of the map's range, [0, 1] (`unit_depth`).
    """
    return power_moments(2 * depth - 1)


@checked
def decode_moments(
    values: Values,
    depth: Numbers,
    problem: str = "hamburger",
    moment_bias: ScalarLike = 3e-6,
    bleed_low: ScalarLike = 0.0,
    bleed_high: ScalarLike = 1.0,
) -> Numbers:
    """Visibility from four averaged moments: the bound, its low end cut.

    Args:
        values: The four moments at each receiver.
        depth: Receivers' depth in the map's range, [0, 1], less the bias.
        problem: "hamburger" knows the moments alone; "hausdorff" also that depths lie in the range, which is darker.
        moment_bias: α in [0, 1): share of the ends of the range mixed in against rounding (`bias_moments`).
        bleed_low: Bound that becomes 0, in [0, 1).
        bleed_high: Bound that becomes 1, in (bleed_low, 1].
    """
    require_choice(problem, "problem", PROBLEMS)
    bound = {"hamburger": hamburger_visibility, "hausdorff": hausdorff_visibility}[problem]
    visibility = bound(bias_moments(values, moment_bias), jnp.clip(2 * depth - 1, -1.0, 1.0))
    return linear_step(visibility, bleed_low, bleed_high)


class _Point(NamedTuple):
    """A depth as a ratio whose lower part is ≥ 0: 0 stands for a point at infinity, which weighs nothing."""

    above: Numbers
    below: Numbers

    @classmethod
    def of(cls, above: Numbers, below: Numbers) -> "_Point":
        """The ratio, brought to size 1."""
        # A ratio is known up to a factor: brought to size 1 with a lower part ≥ 0, its powers neither overflow nor
        # change sign.
        size = jnp.maximum(jnp.abs(above), jnp.abs(below))
        size = jnp.where(size > 0, size, jnp.ones_like(size))
        size = jnp.where(below < 0, -size, size)
        return cls(above / size, below / size)


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
        # By covariances of z and z²: fewer sums, so fewer digits lost, than by central moments one by one.
        variance = jnp.maximum(b2 - b1 * b1, few)
        # z² regressed on z: the slope is cov(z, z²)/var(z) = m₃/m₂ + 2m₁, and what is left of var(z²) is h₂.
        slope = (b3 - b1 * b2) / variance
        rest = jnp.maximum(b4 - b2 * b2 - (b3 - b1 * b2) * slope, few * variance)
        skew = slope - 2 * b1
        return cls(b1, variance, skew, rest)

    def weight(self, point: _Point) -> Numbers:
        """Weight 1/K(x, x) of a point of the attaining distribution, in [0, 1]; it falls to 0 towards infinity."""
        up, down = point
        square = down * down
        # K(x, x) = 1 + x²/m₂ + p₂(x)²/h₂ times below⁴, so a point at infinity needs no division.
        second = up * up - self.skew * up * down - self.variance * square
        whole = square * square
        return whole / (whole + up * up * square / self.variance + second * second / self.rest)

    def share_before(self, t: Numbers, partners: tuple[_Point, _Point]) -> Numbers:
        """Weight of the two partners of t that lie before it."""
        # The receiver's own weight joins the sum, but does not lie before itself.
        whole = self.weight(_Point.of(t, jnp.ones_like(t)))
        before = jnp.zeros_like(t)
        for point in partners:
            weight = self.weight(point)
            before = before + jnp.where(t * point.below > point.above, weight, 0.0)
            whole = whole + weight
        # Weights add up to 1. Where rounding has left few digits of h₂, one of them is off and the sum shows it.
        return before / whole

    def partners(self, t: Numbers) -> tuple[_Point, _Point]:
        """The other two points: roots of K(x, t) in x. One runs to infinity where p₂(t) is 0."""
        # m₂·h₂·K(x, t) as a quadratic in x; its leading term has the factor p₂(t).
        second = t * t - self.skew * t - self.variance
        a = second * self.variance
        b = t * self.rest - second * self.skew * self.variance
        c = self.variance * (self.rest - second * self.variance)
        # The roots are real; rounding may say otherwise.
        root = safe_sqrt(b * b - 4 * a * c)
        # The half-sum without cancellation; the other root follows from the product.
        half = -0.5 * (b + jnp.where(b >= 0, root, -root))
        return _Point.of(half, a), _Point.of(c, half)


def _shadow_of_four_points(moments: Values, t: Numbers) -> Numbers:
    """Weight before t of the distribution on −1, x, t, 1 with these moments."""
    b1, b2, b3, b4 = moments
    # E[(z²−1)(z−t)] and E[(z²−1)(z−t)z].
    lower = b3 - t * b2 - b1 + t
    upper = b4 - t * b3 - b2 + t * b1
    size = jnp.maximum(jnp.abs(lower), jnp.abs(upper))
    # Between −1 and 1 but for rounding; where both vanish, three points do and the fourth weighs nothing.
    x = jnp.where(jnp.abs(upper) < jnp.abs(lower), safe_divide(upper, lower), jnp.sign(upper) * jnp.sign(lower))
    x = jnp.where(size > 0, x, jnp.zeros_like(x))

    def weight(at: Numbers, others: tuple[Numbers, Numbers, Numbers]) -> Numbers:
        """E of the cubic that is 1 at `at` and 0 at the others."""
        p, q, r = others
        # ∏(x − others) expanded in powers of x, whose expectations are the moments.
        value = b3 - (p + q + r) * b2 + (p * q + q * r + r * p) * b1 - p * q * r
        return safe_divide(value, (at - p) * (at - q) * (at - r))

    one = jnp.ones_like(t)
    end = weight(-one, (x, t, one))
    # Two points that lie close together have weights that only their sum keeps the digits of: take the other two.
    far_sum = 1 - weight(t, (-one, x, one)) - weight(one, (-one, x, t))
    near_sum = end + weight(x, (-one, t, one))
    both = jnp.where(x + 1 < 1 - t, far_sum, near_sum)
    # −1 always lies before the receiver, x only where it is less.
    return jnp.clip(jnp.where(x < t, both, end), 0.0, 1.0)


class Moments(Prefiltered):
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

    def __check_init__(self) -> None:
        require_choice(self.problem, "problem", PROBLEMS)
        require(0 <= self.moment_bias < 1, f"moment_bias is a share, in [0, 1); got {self.moment_bias}")
        check_step(self.bleed_low, self.bleed_high)

    def encode(self, depth: Float[Array, "rows cols"]) -> Float[Array, "n rows cols"]:
        """Four powers."""
        return encode_moments(depth)

    def decode(self, values: Values, depth: Numbers) -> Numbers:
        """The bound, its low end cut."""
        return decode_moments(values, depth, self.problem, self.moment_bias, self.bleed_low, self.bleed_high)

    @property
    def num_planes(self) -> int:
        """Four moments."""
        return 4
