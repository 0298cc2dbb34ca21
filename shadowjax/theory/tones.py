"""How many attenuation tones a filter can give: nominal, exact over windows and edges, and counted in an image."""

import itertools
import math
from collections.abc import Sequence
from fractions import Fraction

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from shadowjax._checked import checked
from shadowjax._checks import require, require_int
from shadowjax._types import ArrayLike
from shadowjax.theory import windows
from shadowjax.theory.windows import POLICIES, kernel_width, lit_numerators


@checked
def nominal_tones(num_samples: int, num_levels: int) -> int:
    """k = (w − 1)·n + 1: tones of a mean of n samples with w equally spaced, equally weighted levels.

    Args:
        num_samples: n, elements of the filter.
        num_levels: w, values that an element can take; 2 for a plain shadow test.

    Source: mdsm, eqs 4.1 (w = 2) and 4.2; with other levels `max_tones` is the bound.
    """
    n, w = require_int(num_samples, "number of samples", 1), require_int(num_levels, "number of levels", 1)
    return (w - 1) * n + 1


@checked
def max_tones(num_samples: int, num_levels: int, equal_weights: bool = True) -> int:
    """Most tones that n samples of w levels can give, whatever the levels: C(n+w−1, w−1) multisets, or w^n if weights
    differ too.

    Source: corrects the scope of mdsm, eq. 4.2.
    """
    n, w = require_int(num_samples, "number of samples", 1), require_int(num_levels, "number of levels", 1)
    return math.comb(n + w - 1, w - 1) if equal_weights else w**n


@checked
def count_sums(levels: Sequence[Fraction], num_samples: int, weights: Sequence[Fraction] | None = None) -> int:
    """Distinct values of a weighted sum of samples, each taking any of `levels`; exact rational arithmetic.

    Args:
        levels: Values of one sample, as exact numbers.
        num_samples: Number of samples.
        weights: One for each sample; all 1 if None.
    """
    n = require_int(num_samples, "number of samples", 1)
    factors = [Fraction(1)] * n if weights is None else list(weights)
    require(len(factors) == n, f"weights must hold one number a sample ({n}); got {len(factors)}")
    sums = {Fraction(0)}
    for factor in factors:
        # The set of reachable sums grows by one sample at a time; fractions make equality exact.
        sums = {total + factor * level for total, level in itertools.product(sums, levels)}
    return len(sums)


@checked
def predicted_tones(num_taps: int, num_depths: int = 1) -> int:
    """n·k + 1: tones of PCF(k, n), a filter of k taps over composite tests of n depths.

    Source: mdsm, section 4.4. A bound that binary windows attain; straight edges give fewer (`straight_edge_tones`).
    """
    return require_int(num_taps, "number of taps", 1) * require_int(num_depths, "number of depths", 1) + 1


def _numerators(patterns: Bool[np.ndarray, "patterns rows cols"], policy: str) -> tuple[int, ...]:
    return tuple(int(tone) for tone in np.unique(lit_numerators(patterns, policy)))


@checked
def exhaustive_tones(num_taps: int, policy: str, include_centre: bool = True) -> tuple[int, ...]:
    """Numerators (of n·k) of the tones that some binary window gives; neighbourhood 3 × 3."""
    histogram = windows.window_histogram(num_taps, policy, include_centre)
    return tuple(tone for tone, count in enumerate(histogram) if count)


@checked
def straight_edge_tones(num_taps: int, policy: str) -> tuple[int, ...]:
    """Numerators (of n·k) of the tones along straight shadow edges of every direction and offset."""
    return _numerators(windows.half_plane_windows(kernel_width(num_taps) + 2), policy)


@checked
def axis_step_tones(num_taps: int, policy: str) -> tuple[int, ...]:
    """Numerators (of n·k) of the tones along a shadow edge parallel to an axis of the map."""
    return _numerators(windows.axis_step_windows(kernel_width(num_taps) + 2), policy)


@checked
def diagonal_step_tones(num_taps: int, policy: str) -> tuple[int, ...]:
    """Numerators (of n·k) of the tones along a shadow edge at 45° to the map."""
    return _numerators(windows.diagonal_step_windows(kernel_width(num_taps) + 2), policy)


@checked
def edge_shift(policy: str, size: int = 3) -> Fraction:
    """How far a policy moves the mean shadow edge towards the shadow, in texels, whatever the filter's size.

    A maximum over a neighbourhood of width `size` moves its own edge by (size−1)/2 into the shadow, a minimum as far
    out of it; the composite test averages the n edges. Counted on an edge along an axis.
    """
    span = 4 * size
    # A step in the middle, and every window position over it: the sum of lit tests counts where the edge lies.
    lit = np.broadcast_to(np.arange(span) >= span // 2, (size, span))
    numerators = [lit_numerators(lit[:, i : i + size], policy, size) for i in range(span - size + 1)]
    plain = [lit_numerators(lit[:, i : i + size], "1-SM", size) for i in range(span - size + 1)]
    return Fraction(int(np.sum(numerators)), windows.num_depths(policy)) - int(np.sum(plain))


@checked
def tones(visibility: ArrayLike, mask: ArrayLike | None = None, tolerance: float = 1e-4) -> Float[np.ndarray, "tones"]:
    """Distinct values of a visibility image, each the mean of a cluster of values.

    Args:
        visibility: Values in [0, 1].
        mask: Where to look; everywhere if None.
        tolerance: Values closer than this are one tone. It must lie above rounding (about 1e-6 in float32) and below
            1/(n·k).

    Raises:
        ValueError: If values are not finite or the tolerance is not positive.
    """
    require(tolerance > 0, f"tolerance must be positive; got {tolerance}")
    values = np.asarray(visibility, np.float64)
    values = np.sort(values.ravel() if mask is None else values[np.broadcast_to(np.asarray(mask, bool), values.shape)])
    require(bool(np.isfinite(values).all()), "visibility must be finite to count its tones")
    if values.size == 0:
        return values
    # Sorted values belong to one cluster until a gap exceeds the tolerance.
    clusters = np.split(values, np.flatnonzero(np.diff(values) > tolerance) + 1)
    return np.array([cluster.mean() for cluster in clusters])


@checked
def count_tones(visibility: ArrayLike, mask: ArrayLike | None = None, tolerance: float = 1e-4) -> int:
    """Number of distinct values of a visibility image; see `tones`."""
    return int(tones(visibility, mask, tolerance).size)


@checked
def tone_count(
    visibility: Float[Array, "*shape"], mask: Bool[Array, "*shape"] | None = None, tolerance: float = 1e-4
) -> Int[Array, ""]:
    """`count_tones` as a function of arrays, for `jit` and `vmap`: clusters of values, found by sorting.

    Args:
        visibility: Finite values.
        mask: Where to look; everywhere if None.
        tolerance: Values closer than this are one tone, > 0; see `tones`.
    """
    looked_at = jnp.ones(visibility.shape, bool) if mask is None else mask
    # What is not looked at becomes one of the values that are, and no tone of its own.
    some = jnp.max(jnp.where(looked_at, visibility, -jnp.finfo(visibility.dtype).max))
    values = jnp.sort(jnp.where(looked_at, visibility, some).ravel())
    count = 1 + jnp.sum(jnp.diff(values) > tolerance, dtype=jnp.int32)
    return jnp.where(jnp.any(looked_at), count, 0)


__all__ = [
    "POLICIES", "axis_step_tones", "count_sums", "count_tones", "diagonal_step_tones", "edge_shift",
    "exhaustive_tones", "max_tones", "nominal_tones", "predicted_tones", "straight_edge_tones", "tone_count", "tones",
]  # fmt: skip
