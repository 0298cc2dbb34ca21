"""filtering, section 3.2: XCSM makes its basis images after the blur, and is not a convolution shadow map.

The source blurs the depth map and evaluates the Fourier series during the lookup instead of blurring basis images, and
finds both very similar. But a basis of a mean depth is not the mean of bases: B(w∗z) ≠ w∗B(z).

Measured: a kernel that sees an occluder with a share p and the ground behind the receiver with the rest. PCF lets
1 − p through, CSM nearly so; XCSM compares the receiver with the *mean* depth, so it answers 0 or 1. Across a blurred
straight edge the shadow of XCSM is as hard as without blur, and lies where the mean depth passes the receiver instead
of where half the kernel does: the blur moves the edge instead of softening it.

How to read it: left, one kernel; right, across an edge blurred with σ = 1 texel, all for the same receiver.
"""

from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure
from scipy.special import ndtr, ndtri

from experiments.base import Claim
from shadowjax._checks import require, require_int
from shadowjax.filters.convolution import fourier_bases, fourier_visibility
from shadowjax.plotting import MARKERS, PALETTE, label, new_figure, styled


@dataclass(frozen=True)
class Config:
    """Settings.

    Attributes:
        terms: M of the series, ≥ 1.
        near: Depth of the occluder, in [0, 1].
        far: Depth of the ground.
        receiver: Depth of the receiver, between them.
        num_shares: Shares p, ≥ 11 and odd.
    """

    terms: int = 16
    near: float = 0.2
    far: float = 0.8
    receiver: float = 0.7
    num_shares: int = 101

    def __post_init__(self):
        require_int(self.terms, "terms", 1)
        require(require_int(self.num_shares, "num_shares", 11) % 2 == 1, "num_shares must be odd")
        require(0 <= self.near < self.receiver < self.far <= 1, "depths must rise: near, receiver, far, in [0, 1]")


@dataclass(frozen=True)
class Result:
    """Visibility by three ways.

    Attributes:
        config: Depths and terms.
        share: Share of the kernel that sees the occluder.
        convolution: CSM.
        mean_depth: XCSM.
        switch: Share at which the mean depth is the receiver's.
        across: Position across a straight edge, texels; the occluder lies at negative positions.
        covered: Share of the blur's weight that sees the occluder there.
    """

    config: Config
    share: np.ndarray
    convolution: np.ndarray
    mean_depth: np.ndarray
    switch: float
    across: np.ndarray
    covered: np.ndarray


def answers(share: np.ndarray, config: Config) -> tuple[np.ndarray, np.ndarray]:
    """CSM and XCSM of two depths with weights p and 1 − p, undamped."""
    with jax.enable_x64(True):
        p = jnp.asarray(share)[None]
        ends = [fourier_bases(jnp.full((1, 1), z), config.terms) for z in (config.near, config.far)]
        receiver = jnp.full(p.shape, config.receiver)
        mixed = [p * a + (1 - p) * b for a, b in zip(*ends, strict=True)]
        of_mean = list(fourier_bases(p * config.near + (1 - p) * config.far, config.terms))
        first, second = (np.asarray(fourier_visibility(bases, receiver))[0] for bases in (mixed, of_mean))
    return first, second


def run(config: Config) -> Result:
    """All shares, and the profile of an edge."""
    share = np.linspace(0, 1, config.num_shares)
    across = np.linspace(-3, 3, 241)
    first, second = answers(share, config)
    switch = (config.far - config.receiver) / (config.far - config.near)
    return Result(config, share, first, second, switch, across, ndtr(-across))


def claims(result: Result) -> tuple[Claim, ...]:
    """The counterexample, and what it does to an edge."""
    half = len(result.share) // 2
    csm, xcsm = result.convolution, result.mean_depth
    config = result.config
    worst = float(np.abs(csm - (1 - result.share)).max())
    known = Config()
    at = answers(np.array([0.5]), known)
    profile = answers(result.covered, config)[1]
    crossing = float(np.interp(0.5, profile[60:181], result.across[60:181]))
    expected = float(-ndtri(result.switch))
    away = np.abs(result.share - result.switch) > 1 / config.terms / (config.far - config.near)
    steps = float(np.abs(xcsm - (result.share < result.switch))[away].max())
    return (
        Claim(
            "half near, half far: CSM gives 0.518623",
            abs(at[0][0] - 0.51862315861768148) < 1e-12,
            f"{at[0][0]:.9f}",
            "0.518623159",
        ),
        Claim(
            "XCSM gives 0.005887 there", abs(at[1][0] - 0.0058874675300166453) < 1e-12, f"{at[1][0]:.9f}", "0.005887468"
        ),
        Claim("CSM follows PCF within its ringing", worst < 0.12, f"off by {worst:.3f}", "less than 0.12"),
        Claim(
            "XCSM answers as a test of the mean depth",
            steps < 0.12,
            f"off by {steps:.3f} away from its switch",
            "less than 0.12",
        ),
        Claim(
            "refuted: the two are not similar",
            float(np.abs(csm - xcsm).max()) > 0.4,
            f"differ by {np.abs(csm - xcsm).max():.2f}",
            "more than 0.4",
        ),
        Claim(
            "corrected: XCSM's edge lies where the mean depth is the receiver's",
            abs(crossing - expected) < 0.05,
            f"{crossing:.3f} σ from the edge",
            f"{expected:.3f} σ",
        ),
        Claim("so blur moves it", expected > 0.3, f"{expected:.2f} σ", "0 would be in place"),
        Claim("CSM's lies where half the kernel does", abs(csm[half] - 0.5) < 0.05, f"{csm[half]:.3f} at p = ½", "0.5"),
    )


def numbers(result: Result) -> dict[str, Any]:
    """Visibilities by share."""
    return {
        "share": result.share, "csm": result.convolution, "xcsm": result.mean_depth, "pcf": 1 - result.share,
        "switch": result.switch,
    }  # fmt: skip


@styled
def draw(result: Result) -> Figure:
    """A kernel on the left, an edge on the right."""
    figure, axes = new_figure(9.2, 4.0, 1, 2, sharey=True)
    left, right = axes[0]
    series = {"PCF": 1 - result.share, "CSM": result.convolution, "XCSM": result.mean_depth}
    profile = answers(result.covered, result.config)
    edges = {"PCF": 1 - result.covered, "CSM": profile[0], "XCSM": profile[1]}
    for index, name in enumerate(series):
        look = {"color": PALETTE[index], "marker": MARKERS[index], "markersize": 4}
        left.plot(result.share, series[name], markevery=max(1, len(result.share) // 12), label=name, **look)
        right.plot(result.across, edges[name], markevery=20, label=name, **look)
    left.axvline(result.switch, color="#5c6575", linewidth=1, linestyle=(0, (4, 3)))
    left.annotate("mean depth = receiver", (result.switch, 0.95), (4, 0), textcoords="offset points", fontsize=8)
    left.legend(loc="lower left")
    label(left, "p, share of the kernel that sees the occluder", "visibility", "XCSM tests the mean depth")
    label(right, "position across the edge (σ of the blur)", "", "The blur moves its edge, hard as before")
    right.axvline(0, color="#5c6575", linewidth=0.8, linestyle=(0, (1, 2)))
    return figure
