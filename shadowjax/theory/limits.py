"""Numerical limits of filters: overflow, ringing, light bleeding, rounding of moments; predicted and measured."""

import math

import jax.numpy as jnp
import numpy as np
from scipy.special import sici

from shadowjax._checked import checked
from shadowjax._checks import require, require_int
from shadowjax._types import Array, ArrayLike, DType, Float

# --- exponents ------------------------------------------------------------------------------------------------------


@checked
def largest_exponent(
    dtype: DType, num_moments: int = 1, kernel_size: int = 1, largest_depth: float = 1.0, normalised: bool = True
) -> float:
    """Largest c for which exp(c·z) and its powers stay finite while a K × K kernel filters them.

    ln(max) / (m · z_max): the m-th moment is the one that overflows first. A kernel whose weights add up to 1 costs
    nothing; one that adds first and divides afterwards needs room for K² terms.

    Args:
        dtype: Floating dtype of the map, float16 included.
        num_moments: m, highest power that is stored: 1 for exponential maps, 2 for exponential variance maps.
        kernel_size: K ≥ 1.
        largest_depth: Largest |z| that reaches the exponential, > 0: 1 for depths in [0, 1] and in [−1, 1].
        normalised: Whether weights are applied before adding.

    Returns:
        c, in units of 1/z: 88.72 for float32, 44.36 with two moments, 11.09 and 5.545 for float16.

    Source: filtering, section 2.5.1, which names c = 30 for 16 bits: that overflows for z > 0.37.
    """
    require_int(num_moments, "the highest moment", 1)
    require_int(kernel_size, "kernel_size", 1)
    require(largest_depth > 0, f"the largest depth must be positive; got {largest_depth}")
    # growth · e^(m·c·z) ≤ max in logarithms; growth is K² only where weights come after the sum.
    room = math.log(float(jnp.finfo(dtype).max)) - (0.0 if normalised else math.log(kernel_size**2))
    return room / (num_moments * largest_depth)


@checked
def largest_receiver_exponent(dtype: DType, largest_depth: float = 1.0, subnormal: bool = False) -> float:
    """Largest c for which the receiver's factor exp(−c·d) keeps all its digits at the largest depth.

    Args:
        dtype: Floating dtype of the lookup.
        largest_depth: Largest d, > 0.
        subnormal: Whether numbers that lose digits still count.

    Returns:
        −ln(smallest positive number) / d: 87.34 for float32, 9.70 for float16.
    """
    require(largest_depth > 0, f"the largest depth must be positive; got {largest_depth}")
    info = jnp.finfo(dtype)
    return -math.log(float(info.smallest_subnormal if subnormal else info.tiny)) / largest_depth


@checked
def measured_exponent(
    dtype: DType, num_moments: int = 1, kernel_size: int = 1, largest_depth: float = 1.0, normalised: bool = True
) -> float:
    """`largest_exponent` found by bisection: the map is made, raised to the moment and filtered in its own dtype."""
    kind = np.dtype(jnp.dtype(dtype))
    taps = kernel_size**2
    depths = np.full(taps, largest_depth)

    def survives(c: float) -> bool:
        with np.errstate(over="ignore"):
            stored = np.exp(num_moments * c * depths).astype(kind)  # the exponential itself is exact here
            weight = np.asarray(1 / taps if normalised else 1, kind)
            total = np.zeros((), kind)
            # One addition after the other, rounded each time, as a filter that accumulates in this dtype does.
            for value in stored:
                total = (total + value * weight).astype(kind)
        return bool(np.isfinite(total))

    # The bracket starts well above the prediction, so that a prediction too low would be noticed.
    low, high = 0.0, 4 * largest_exponent(dtype, num_moments, 1, largest_depth)
    high = min(high, 700.0 / (num_moments * largest_depth))  # what float64 itself can raise
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if survives(middle) else (low, middle)
    return low


# --- ringing --------------------------------------------------------------------------------------------------------


@checked
def gibbs_peak(num_terms: int | None, damping: float = 0.0) -> float:
    """Largest value of the series: how far above 1 light rings next to a shadow edge.

    Without damping the first maximum lies at t = 1/(2M), where Σ cos((2k − 1)πt) = sin(2Mπt)/(2 sin πt) has its first
    zero; for M → ∞ it is ½ + Si(π)/π. With damping the maximum is looked for between 0 and 1 − 1/(2M).

    Args:
        num_terms: M; None for the limit of many terms without damping.
        damping: α ≥ 0.

    Returns:
        1.0897 for M = 16, and 1.0895 in the limit; with α = 1 and M = 16, 1.0130.
    """
    if num_terms is None:
        require(damping == 0, "the limit of many terms is known without damping only")
        return float(0.5 + sici(math.pi)[0] / math.pi)
    if damping == 0:
        return float(_step64(np.array([1 / (2 * num_terms)]), num_terms, 0.0)[0])
    # 64 samples per term resolve every lobe of the highest frequency; the best is refined between its neighbours.
    t = np.linspace(0, 1 - 1 / (2 * num_terms), 64 * num_terms + 1)
    values = _step64(t, num_terms, damping)
    best = int(np.argmax(values))
    low, high = t[max(best - 1, 0)], t[min(best + 1, len(t) - 1)]
    fine = np.linspace(low, high, 2001)
    return float(_step64(fine, num_terms, damping).max())


def _step64(t: np.ndarray, num_terms: int, damping: float) -> np.ndarray:
    """The series in NumPy's double precision, whatever JAX's default is."""
    k = np.arange(1, num_terms + 1)
    frequency = np.pi * (2 * k - 1)
    return 0.5 + 2 * np.sum(np.exp(-damping * (k / num_terms) ** 2) * np.sin(frequency * t[..., None]) / frequency, -1)


@checked
def step_slope(num_terms: int, damping: float = 0.0) -> float:
    """Slope of the series at the step, 2 Σ e^{−α(k/M)²}: 2M without damping, less with it.

    Source: corrects filtering, section 2.4.3, where damping is said to make the step steeper.
    """
    k = np.arange(1, require_int(num_terms, "the number of terms M", 1) + 1)
    return float(2 * np.sum(np.exp(-damping * (k / num_terms) ** 2)))


# --- light bleeding -------------------------------------------------------------------------------------------------


@checked
def variance_bleed(spread: ArrayLike, share: ArrayLike) -> Float[Array, "..."]:
    """Light that variance maps let onto a receiver behind two occluders, where there is none.

    A share q of the kernel sees the far occluder, 1 − q the near one. With r, the distance between them over that from
    the far one to the receiver, Chebyshev's bound is q(1−q)r² / (q(1−q)r² + (1 + (1−q)r)²): it grows with r towards q.

    Args:
        spread: r ≥ 0.
        share: q in [0, 1].

    Source: filtering, eq. 2.7 for two depths; sections 2.3.2–2.3.3.
    """
    r, q = (jnp.asarray(x, jnp.result_type(float)) for x in (spread, share))
    # Two depths: σ² = q(1−q)r² and d − μ = 1 + (1−q)r, in units of the distance from the far one to the receiver.
    variance = q * (1 - q) * r**2
    return variance / (variance + (1 + (1 - q) * r) ** 2)


@checked
def exponential_variance_bleed(
    near: ArrayLike, far: ArrayLike, receiver: ArrayLike, share: ArrayLike, exponent: ArrayLike
) -> Float[Array, "..."]:
    """`variance_bleed` of depths warped by exp(c·z): the spread becomes (1 − e^{−cΔ})/(e^{cδ} − 1).

    Args:
        near: Depth of the near occluder.
        far: Depth of the far occluder, between near and receiver.
        receiver: Depth of the receiver.
        share: q, part of the kernel that sees the far occluder.
        exponent: c ≥ 0; 0 is the variance map.
    """
    near, far, receiver, c = (jnp.asarray(x, jnp.result_type(float)) for x in (near, far, receiver, exponent))
    between, behind = far - near, receiver - far
    # 0/0 as c → 0: the limit Δ/δ is put in, and the branch not taken gets a harmless c for its gradient.
    small = c < 1e-6
    safe = jnp.where(small, 1.0, c)
    spread = jnp.where(small, between / behind, -jnp.expm1(-safe * between) / jnp.expm1(safe * behind))
    return variance_bleed(spread, share)


@checked
def exponential_bleed(
    near: ArrayLike, far: ArrayLike, receiver: ArrayLike, share: ArrayLike, exponent: ArrayLike
) -> Float[Array, "..."]:
    """Light that exponential maps let onto a receiver behind two occluders: q·e^{−c(d−z₂)} + (1−q)·e^{−c(d−z₁)}.

    Args:
        near: Depth of the near occluder.
        far: Depth of the far occluder, between near and receiver.
        receiver: Depth of the receiver.
        share: q, part of the kernel that sees the far occluder.
        exponent: c ≥ 0.

    Source: filtering, eq. 2.21 for two depths.
    """
    near, far, receiver, q, c = (jnp.asarray(x, jnp.result_type(float)) for x in (near, far, receiver, share, exponent))
    return q * jnp.exp(-c * (receiver - far)) + (1 - q) * jnp.exp(-c * (receiver - near))


@checked
def least_bleed_clamp(spread: float, share: float | None = None) -> float:
    """Smallest lower end a of the clamp (p − a)/(1 − a) that leaves no light behind two occluders.

    Args:
        spread: r, as in `variance_bleed`.
        share: q; the worst one if None: q = (1 + r)/(2 + r), where the bound is (r/(r + 2))².

    Source: filtering, Algorithm 2.
    """
    worst = (1 + spread) / (2 + spread) if share is None else share
    return float(variance_bleed(spread, worst))


# --- rounding of moments --------------------------------------------------------------------------------------------


@checked
def smallest_deviation(mean: float, dtype: DType) -> float:
    """Standard deviation of depth below which E[z²] − E[z]² is rounding: about |μ|·√ε.

    Args:
        mean: μ, depth about which values spread, in the units that are stored.
        dtype: Floating dtype of the moments.

    Returns:
        3.5e-4·|μ| for float32, so 0.0035 at a depth of 10: a variance of 1e-6 there is lost. Shift depths by a local
        mean, or store them in [−1, 1], and μ is small where it matters.
    """
    return abs(mean) * math.sqrt(float(jnp.finfo(dtype).eps))


@checked
def measured_deviation(mean: float, dtype: DType, num_pairs: int = 4096) -> float:
    """`smallest_deviation`, measured: root mean square error of the variance of two-point sets, as a deviation.

    Args:
        mean: μ.
        dtype: Floating dtype.
        num_pairs: Sets, each of two depths near μ, drawn with a fixed seed.
    """
    # Pairs two ulps of the mean apart: their true variance is far below what the difference of moments can resolve.
    drawn = np.random.default_rng(0).uniform(0.9, 1.1, num_pairs) * mean
    tiny = mean * float(jnp.finfo(dtype).eps)
    pairs = jnp.asarray(np.stack([drawn - tiny, drawn + tiny]), dtype)
    exact = np.var(np.asarray(pairs, np.float64), axis=0)
    first, second = jnp.mean(pairs, axis=0), jnp.mean(pairs**2, axis=0)
    error = np.asarray(second - first**2, np.float64) - exact
    return float(np.sqrt(np.sqrt(np.mean(error**2))))


__all__ = [
    "exponential_bleed", "exponential_variance_bleed", "gibbs_peak", "largest_exponent", "largest_receiver_exponent",
    "least_bleed_clamp", "measured_deviation", "measured_exponent", "smallest_deviation",
    "step_slope", "variance_bleed",
]  # fmt: skip
