"""filtering, figure 2.7: ringing of convolution shadow maps, and what damping does to the step.

The source's picture shows bright bands next to shadows and blames the truncated Fourier series. It damps the k-th term
by e^(−α(k/M)²) and says that the step becomes *steeper* and the transitions *less* soft.

Measured: the series through the package's own basis images, for several M, with and without damping. The first peak
lies at z − d = 1/(2M) and hardly falls as M grows: more terms make bands narrower, not weaker. Damping flattens the
peak, and the step with it: its slope 2 Σ e^(−α(k/M)²) is less than 2M and it rises over a longer way. The source has
that the wrong way round; and its eq. 2.16 has the sign of the sine wrong, which gives the complement.

How to read it: left, each step without damping; right, the one with the most terms with rising damping.
"""

from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure

from experiments.base import Claim
from shadowjax._checks import require, require_int
from shadowjax.filters.convolution import fourier_bases, fourier_visibility
from shadowjax.plotting import MARKERS, PALETTE, label, new_figure, styled
from shadowjax.theory import limits

RECEIVER = 0.5


@dataclass(frozen=True)
class Config:
    """Settings.

    Attributes:
        terms: M of each series, rising.
        damping: α, rising from 0.
        num_depths: Depths at which the step is sampled, ≥ 100.
    """

    terms: tuple[int, ...] = (4, 8, 16)
    damping: tuple[float, ...] = (0.0, 0.5, 1.0)
    num_depths: int = 8001

    def __post_init__(self):
        require_int(self.num_depths, "num_depths", 100)
        for terms in self.terms:
            require_int(terms, "terms", 1)
        require(list(self.terms) == sorted(set(self.terms)) and len(self.terms) > 1, "terms must rise, two at least")
        rising = list(self.damping) == sorted(set(self.damping)) and len(self.damping) > 1
        require(rising and self.damping[:1] == (0,), "damping must rise from 0, two at least")


@dataclass(frozen=True)
class Result:
    """Steps sampled at z − d.

    Attributes:
        offset: z − d.
        plain: M → step without damping.
        damped: α → step of the largest M.
    """

    offset: np.ndarray
    plain: dict[int, np.ndarray]
    damped: dict[float, np.ndarray]


def _step(offset: np.ndarray, terms: int, damping: float) -> np.ndarray:
    """The step of the filter: bases of stored depths, coefficients of one receiver."""
    stored = jnp.asarray(RECEIVER + offset)[None]
    bases = list(fourier_bases(stored, terms))
    receiver = jnp.full(stored.shape, RECEIVER)
    return np.asarray(fourier_visibility(bases, receiver, damping))[0]


def run(config: Config) -> Result:
    """Sample each step."""
    with jax.enable_x64(True):
        offset = np.linspace(-0.45, 0.45, config.num_depths)
        plain = {terms: _step(offset, terms, 0.0) for terms in config.terms}
        damped = {damping: _step(offset, config.terms[-1], damping) for damping in config.damping}
    return Result(offset, plain, damped)


def rise(offset: np.ndarray, step: np.ndarray) -> float:
    """Distance over which a step climbs from 10 % to 90 %, first crossings on either side of its middle."""
    middle = len(step) // 2
    low = offset[: middle + 1][step[: middle + 1] <= 0.1][-1]
    high = offset[middle:][step[middle:] >= 0.9][0]
    return float(high - low)


def claims(result: Result) -> tuple[Claim, ...]:
    """Peaks, and the correction about damping."""
    spacing = result.offset[1] - result.offset[0]
    peaks = {terms: float(step.max()) for terms, step in result.plain.items()}
    # the sampled maximum lies within the parabola of half a spacing round the true one: |f''| ≤ 4πM² there
    close = all(
        limits.gibbs_peak(m) - 2 * np.pi * (m * spacing) ** 2 <= p <= limits.gibbs_peak(m) + 1e-12
        for m, p in peaks.items()
    )
    where = {m: abs(result.offset[int(step.argmax())]) * 2 * m for m, step in result.plain.items()}
    most = max(result.plain)
    tops = [float(step.max()) for step in result.damped.values()]
    slopes = [float(np.gradient(step, spacing)[len(step) // 2]) for step in result.damped.values()]
    rises = [rise(result.offset, step) for step in result.damped.values()]
    predicted = [limits.step_slope(most, damping) for damping in result.damped]
    k = np.arange(1, most + 1)
    c = np.pi * (2 * k - 1)
    printed = 0.5 + 2 * np.sum(np.sin(-c * result.offset[:, None]) / c, -1)
    wrong_sign = float(np.abs(printed + result.plain[most] - 1).max())
    told = ", ".join(f"M = {m}: {p:.4f}" for m, p in peaks.items())
    return (
        Claim(
            "peaks are ½ + 2Σ sin(c_k/(2M))/c_k", close, told, ", ".join(f"{limits.gibbs_peak(m):.4f}" for m in peaks)
        ),
        Claim(
            "they lie at |z − d| = 1/(2M)",
            all(abs(w - 1) < 4 * m * spacing for m, w in where.items()),
            ", ".join(f"{w:.3f}/(2M)" for w in where.values()),
            "1/(2M)",
        ),
        Claim(
            "more terms do not lower them: the limit is 1.0895",
            all(p > limits.gibbs_peak(None) - 1e-4 for p in peaks.values()),
            f"{peaks[most]:.5f}",
            f"{limits.gibbs_peak(None):.5f}",
        ),
        Claim(
            "a receiver on the stored depth gets ½",
            abs(float(result.plain[most][len(result.offset) // 2]) - 0.5) < 1e-9,
            f"{result.plain[most][len(result.offset) // 2]:.6f}",
            "0.5",
        ),
        Claim(
            "damping lowers the peak",
            tops == sorted(tops, reverse=True),
            ", ".join(f"{t:.4f}" for t in tops),
            "falling",
        ),
        Claim(
            "corrected: damping makes the step less steep, by 2Σe^(−α(k/M)²)",
            slopes == sorted(slopes, reverse=True) and np.allclose(slopes, predicted, rtol=3e-3),
            ", ".join(f"{s:.2f}" for s in slopes),
            ", ".join(f"{p:.2f}" for p in predicted),
        ),
        Claim(
            "corrected: it makes transitions longer",
            rises == sorted(rises),
            ", ".join(f"{r:.4f}" for r in rises),
            "rising",
        ),
        Claim(
            "corrected: eq. 2.16 as printed gives the complement", wrong_sign < 1e-9, f"sum − 1 = {wrong_sign:.1e}", "0"
        ),
    )


def numbers(result: Result) -> dict[str, Any]:
    """Peaks and slopes."""
    most = max(result.plain)
    return {
        "peaks": {terms: float(step.max()) for terms, step in result.plain.items()},
        "predicted_peaks": {terms: limits.gibbs_peak(terms) for terms in result.plain},
        "damped_peaks": {damping: float(step.max()) for damping, step in result.damped.items()},
        "slopes": {damping: limits.step_slope(most, damping) for damping in result.damped},
        "rise": {damping: rise(result.offset, step) for damping, step in result.damped.items()},
    }


@styled
def draw(result: Result) -> Figure:
    """Terms on the left, damping on the right."""
    figure, axes = new_figure(9.2, 4.0, 1, 2, sharey=True)
    left, right = axes[0]
    every = max(1, len(result.offset) // 18)
    for index, (terms, step) in enumerate(result.plain.items()):
        left.plot(
            result.offset,
            step,
            color=PALETTE[index],
            marker=MARKERS[index],
            markevery=every,
            markersize=4,
            label=f"M = {terms}, peak {step.max():.4f}",
        )
    for index, (damping, step) in enumerate(result.damped.items()):
        right.plot(
            result.offset,
            step,
            color=PALETTE[index],
            marker=MARKERS[index],
            markevery=every,
            markersize=4,
            label=f"α = {damping:g}, peak {step.max():.4f}",
        )
    for spot in (left, right):
        spot.axhline(1, color="#5c6575", linewidth=0.8, linestyle=(0, (4, 3)))
        spot.legend(loc="lower right")
    right.set_xlim(-0.12, 0.12)
    label(left, "z − d, stored less receiver's depth (of the range)", "visibility", "More terms ring just as high")
    label(right, "z − d (of the range)", "", f"M = {max(result.plain)}: damping rings less and rises later")
    return figure
