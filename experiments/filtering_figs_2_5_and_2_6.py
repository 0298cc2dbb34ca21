"""filtering, figures 2.5 and 2.6: Chebyshev's bound, and the light that bleeds through it behind two occluders.

The source shows a receiver a little behind the mean depth, where the bound is 0.8, and a picture of light bleeding,
which it blames on a large variance.

Measured, on the left: random kernels of depths go through the package's variance filter; the share that PCF would call
lit never exceeds the bound, and kernels of two depths attain it at the farther one.

Measured, on the right: a kernel sees two occluders, the receiver lies behind both, so nothing is lit. What each filter
lets through is plotted over r, the distance between the occluders over that from the far one to the receiver. Variance
maps tend to the far occluder's whole share of the kernel, whatever the variance: what counts is r. Exponential warps
shorten r; four moments know two depths exactly, and bleed again when a third occluder is added.

How to read it: lines are predictions, markers are filters.
"""

from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure

from experiments.base import Claim
from shadowjax._checks import require, require_int
from shadowjax._types import Array
from shadowjax.filters.exponential_variance import warp_depth
from shadowjax.filters.moment import hamburger_visibility
from shadowjax.filters.variance import chebyshev_visibility, variance_of
from shadowjax.plotting import PALETTE, label, new_figure, series_style, styled
from shadowjax.theory import limits

BEHIND = 0.05  # distance from the far occluder to the receiver, in the range of the map


@dataclass(frozen=True)
class Config:
    """Settings.

    Attributes:
        num_kernels: Random kernels, ≥ 100.
        kernel_depths: Depths in each, ≥ 2.
        share: Part of the kernel that sees the far occluder, in (0, 1).
        exponents: Of the exponential warps, rising, the first 0 for the plain variance map.
        num_spreads: Values of r, ≥ 4.
    """

    num_kernels: int = 100_000
    kernel_depths: int = 9
    share: float = 0.6
    exponents: tuple[float, ...] = (0.0, 5.0, 20.0)
    num_spreads: int = 13

    def __post_init__(self):
        require_int(self.num_kernels, "num_kernels", 100)
        require_int(self.kernel_depths, "kernel_depths", 2)
        require_int(self.num_spreads, "num_spreads", 4)
        require(0 < self.share < 1, f"share must lie in (0, 1); got {self.share}")
        rising = all(a < b for a, b in zip(self.exponents, self.exponents[1:], strict=False))
        require(
            rising and len(self.exponents) > 1 and self.exponents[0] == 0, "exponents must rise from 0, two at least"
        )


@dataclass(frozen=True)
class Result:
    """Bounds and bleeding.

    Attributes:
        distance: (d − μ)/σ of the random kernels that have one.
        lit: Share of each that PCF calls lit.
        bound: Chebyshev's bound of each.
        two_point: (bound, share) at the farther of two depths.
        spread: r.
        predicted: Exponent → predicted bleed.
        measured: Exponent → bleed of the filter.
        moments_two: Bleed of four moments behind two occluders.
        moments_three: Bleed of four moments behind three.
    """

    distance: np.ndarray
    lit: np.ndarray
    bound: np.ndarray
    two_point: tuple[np.ndarray, np.ndarray]
    spread: np.ndarray
    predicted: dict[float, np.ndarray]
    measured: dict[float, np.ndarray]
    moments_two: np.ndarray
    moments_three: np.ndarray


@jax.jit
def _bound(depths: Array, receiver: Array) -> Array:
    """Chebyshev's bound through the variance filter's functions."""
    mean = jnp.mean(depths, axis=-1)
    return chebyshev_visibility(mean, variance_of(mean, jnp.mean(depths**2, axis=-1)), receiver)


def _bleed(depths: np.ndarray, weights: np.ndarray, receiver: np.ndarray, exponent: float) -> np.ndarray:
    """What a variance map of warped depths lets onto a receiver."""

    def warped(z: np.ndarray) -> Array:
        as_array = jnp.asarray(z, jnp.float64)
        return as_array if exponent == 0 else warp_depth(as_array, exponent / 2)  # e^(c(2z − 1)) has twice its c

    z, w = warped(depths), jnp.asarray(weights)
    mean = jnp.sum(w * z, axis=-1)
    return np.asarray(chebyshev_visibility(mean, variance_of(mean, jnp.sum(w * z * z, axis=-1)), warped(receiver)))


def _moment_bleed(depths: np.ndarray, weights: np.ndarray, receiver: np.ndarray) -> np.ndarray:
    """What four moments let through, without any moment bias."""
    z, w = jnp.asarray(2 * depths - 1), jnp.asarray(weights)
    moments = [jnp.sum(w * z**k, axis=-1) for k in range(1, 5)]
    return np.asarray(hamburger_visibility(moments, jnp.asarray(2 * receiver - 1)))


def run(config: Config) -> Result:
    """Draw kernels, then move the near occluder away."""
    with jax.enable_x64(True):
        rng = np.random.default_rng(0)
        depths = rng.uniform(0, 1, (config.num_kernels, config.kernel_depths))
        receiver = rng.uniform(0, 1, config.num_kernels)
        bound = np.asarray(_bound(jnp.asarray(depths), jnp.asarray(receiver)))
        lit = (depths >= receiver[:, None]).mean(axis=-1)
        deviation = depths.std(axis=-1)
        pairs = np.where(rng.uniform(size=(200, config.kernel_depths)) < 0.5, 0.3, 0.8)
        two = np.asarray(_bound(jnp.asarray(pairs), jnp.full(200, 0.8)))
        spread = np.geomspace(0.25, 16, config.num_spreads)
        end, middle = np.full_like(spread, 0.95), np.full_like(spread, 0.95 - BEHIND)
        near = middle - BEHIND * spread
        both, q = np.stack([near, middle], -1), config.share
        weights = np.array([1 - q, q])
        three = np.stack([near, middle - 0.5 * BEHIND * spread, middle], -1)
        return Result(
            (receiver - depths.mean(axis=-1)) / deviation,
            lit,
            bound,
            (two, (pairs == 0.8).mean(axis=-1)),
            spread,
            {c: np.asarray(limits.exponential_variance_bleed(near, middle, end, q, c)) for c in config.exponents},
            {c: _bleed(both, weights, end, c) for c in config.exponents},
            _moment_bleed(both, weights, end),
            _moment_bleed(three, np.array([1 - q, 0.5 * q, 0.5 * q]), end),
        )


def claims(result: Result) -> tuple[Claim, ...]:
    """The bound holds and is attained; bleeding follows r."""
    over = float((result.lit - result.bound).max())
    two, share = result.two_point
    known = (share > 0) & (share < 1)
    attained = float(np.abs(two - share)[known].max())
    wrong = max(float(np.abs(result.predicted[c] - result.measured[c]).max()) for c in result.predicted)
    plain = result.measured[0.0]
    ordered = [float(result.measured[c][-1]) for c in result.measured]
    return (
        Claim("at (d − μ)/σ = ½ the bound is 0.8", abs(1 / (1 + 0.5**2) - 0.8) < 1e-15, "0.8", "0.8"),
        Claim("the lit share of a kernel never exceeds the bound", over < 1e-12, f"{over:.1e} at most", "0"),
        Claim("two depths attain it at the farther one", attained < 1e-12, f"off by {attained:.1e}", "0"),
        Claim("predicted bleeding is what the filter gives", wrong < 1e-7, f"off by {wrong:.1e}", "less than 1e-7"),
        Claim(
            "bleeding of variance maps rises with r",
            bool((np.diff(plain) > 0).all()),
            f"{plain[0]:.3f} to {plain[-1]:.3f}",
            "rising",
        ),
        Claim(
            "larger exponents bleed less",
            ordered == sorted(ordered, reverse=True),
            ", ".join(f"{value:.3f}" for value in ordered),
            "falling",
        ),
        Claim(
            "four moments do not bleed behind two occluders",
            float(result.moments_two.max()) < 1e-6,
            f"{result.moments_two.max():.1e}",
            "0",
        ),
        Claim(
            "and do behind three",
            float(result.moments_three.max()) > 0.01,
            f"{result.moments_three.max():.3f}",
            "more than 0.01",
        ),
    )


def numbers(result: Result) -> dict[str, Any]:
    """Bleeding over r."""
    return {
        "spread": result.spread, "predicted": result.predicted, "measured": result.measured,
        "moments_two_occluders": result.moments_two, "moments_three_occluders": result.moments_three,
    }  # fmt: skip


@styled
def draw(result: Result) -> Figure:
    """The bound on the left, bleeding on the right."""
    figure, axes = new_figure(9.2, 4.2, 1, 2)
    left, right = axes[0]
    seen = (result.distance > -1) & (result.distance < 3)
    few = np.flatnonzero(seen)[:1500]
    left.plot(result.distance[few], result.lit[few], ".", color="#9aa3b2", markersize=3, label="lit share of a kernel")
    t = np.linspace(-1, 3, 300)
    left.plot(t, np.where(t < 0, 1, 1 / (1 + np.maximum(t, 0) ** 2)), color=PALETTE[0], label="bound")
    left.plot([0.5], [0.8], "o", color=PALETTE[1], label="figure 2.5: 0.8")
    label(left, "(d − μ)/σ, receiver behind the mean", "lit share", "Nothing lies above the bound")
    left.legend(loc="upper right")
    for index, (c, values) in enumerate(result.predicted.items()):
        style = series_style(index)
        name = "variance map" if c == 0 else f"exponential variance, c = {c:g}"
        right.plot(result.spread, values, color=style["color"])
        right.plot(result.spread, result.measured[c], style["marker"], color=style["color"], label=name)
    right.plot(result.spread, result.moments_two, "D", color=PALETTE[3], label="four moments")
    right.plot(result.spread, result.moments_three, "x", color=PALETTE[6], label="four moments, three occluders")
    right.set_xscale("log", base=2)
    right.set_xticks([0.25, 1, 4, 16], ["¼", "1", "4", "16"])
    label(right, "r, between the occluders / behind them", "light that should be 0", "Bleeding follows r")
    right.legend(loc="upper left")
    return figure
