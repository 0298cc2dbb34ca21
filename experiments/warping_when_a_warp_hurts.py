"""warping, equations 30 and 42 to 44, beyond: when does a warp need more storage than none?

The storage factor S = M_x·M_z counts the texels of a map without perspective aliasing. With the light overhead every
warp up to LiSPSM needs f/n times less than the uniform map. As light and view align, a warp makes M_z little better
and M_x much worse. The source chooses n' by M_z alone, and below an angle its n' needs *more* storage than no warp.

The n' of least storage has a closed form for every γ. It follows the uniform map where nothing beats that, so it never
hurts; and where the source's n' saves most, it saves as much.

Measured: M_x and M_z of the source's n' are taken from the warp's matrix at many depths, by differentiation and beams;
the closed form is held to a search over n'.

How to read it: storage over the uniform map's, below 1 is a gain. On the right for many views: the line is where the
source's n' breaks even, orange is where it hurts.
"""

from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure

from experiments.base import Claim
from experiments.claiming import agrees, at_most, equals
from experiments.layout import mark_x
from experiments.warped_views import (
    check_count,
    check_view,
    in_double,
    log_range,
    measured_errors,
    refined_largest,
    views,
)
from shadowjax._types import Array
from shadowjax.plotting import PALETTE, label, new_figure, styled
from shadowjax.plotting.style import DIFFERENCE
from shadowjax.theory.aliasing.error import storage_factor
from shadowjax.theory.aliasing.light_frustum import LightFrustum
from shadowjax.theory.aliasing.near_distances import generalised, uniform
from shadowjax.theory.aliasing.optimal import least_storage, minimax

CURVES: tuple[str, ...] = ("eqs 42 and 44", "eqs 42 and 43", "least M_z", "least storage")
PUBLISHED, SINE, MINIMAX, LEAST = CURVES
ROUNDS, POINTS = 6, 65
ROWS = 2**14  # of the measured maps: more would lose digits of the nearly uniform one
LARGEST = 1e4  # n' over f of the matrix that stands for the uniform map


@dataclass(frozen=True)
class Config:
    """Settings.

    Attributes:
        near: n, world units.
        far: f, world units.
        phi_deg: Half the angle of view, degrees.
        num_gammas: Angles from 0.5 to 90 degrees, ≥ 50.
        num_measured: Angles at which matrices are measured, ≥ 3.
        num_near_distances: Values of n' tried for each of them, ≥ 100.
        num_ratios: Values of f/n of the chart, ≥ 10.
    """

    near: float = 1.0
    far: float = 100.0
    phi_deg: float = 30.0
    num_gammas: int = 719
    num_measured: int = 15
    num_near_distances: int = 4001
    num_ratios: int = 121

    def __post_init__(self):
        check_view(self.near, self.far, self.phi_deg)
        check_count(self.num_gammas, "num_gammas", 50)
        check_count(self.num_measured, "num_measured", 3)
        check_count(self.num_near_distances, "num_near_distances", 100)
        check_count(self.num_ratios, "num_ratios", 10)


@dataclass(frozen=True)
class Result:
    """Storage over the uniform map's, γ in degrees.

    Attributes:
        config: The settings.
        gammas: Angles.
        curves: Name of CURVES → storage over the uniform map's, on the view axis.
        even: γ at which the published n' breaks even.
        worst: γ at which it needs most, and how much.
        measured_gammas: Angles at which was measured.
        measured: S of the published n' and of a nearly uniform map, from matrices.
        expected: The same by formula.
        searched: Least storage of all n' tried over that of the closed form.
        step: ln of the ratio of neighbouring n' tried.
        ratios: f/n of the chart.
        chart: Storage of the published n' over the uniform map's: rows are f/n, columns γ.
        chart_least: The same of the n' of least storage.
        limits: γ_lim of each f/n.
    """

    config: Config
    gammas: np.ndarray
    curves: dict[str, np.ndarray]
    even: float
    worst: tuple[float, float]
    measured_gammas: np.ndarray
    measured: np.ndarray
    expected: np.ndarray
    searched: np.ndarray
    step: float
    ratios: np.ndarray
    chart: np.ndarray
    chart_least: np.ndarray
    limits: np.ndarray


@jax.jit
def _relative(view: LightFrustum) -> tuple[Array, ...]:
    """Storage on the axis over the uniform map's, in the order of CURVES."""
    rules = generalised(view), generalised(view, "sine"), minimax(view), least_storage(view, "axis")
    none = storage_factor(view, uniform(view))
    return tuple(storage_factor(view, distance) / none for distance in rules)


@jax.jit
def _search(view: LightFrustum, tried: Array) -> Array:
    found = jnp.min(storage_factor(view, tried), axis=-1, keepdims=True)
    return found / storage_factor(view, least_storage(view, "axis"))


@jax.jit
def _storages(view: LightFrustum, nearly_uniform: Array) -> tuple[Array, Array]:
    """n' and S of the published rule and of a nearly uniform map, stacked along a new first axis."""
    both = jnp.stack([generalised(view), nearly_uniform + 0 * view.gamma])
    return both, storage_factor(view, both)


@in_double
def run(config: Config) -> Result:
    """Curves, the angles that matter, measurements and the chart."""

    def view(gammas: Any) -> LightFrustum:
        return views(config.near, config.far, config.phi_deg, gammas)

    def published(gammas: np.ndarray) -> np.ndarray:
        return np.asarray(_relative(view(gammas))[0])

    gammas = np.linspace(0.5, 90, config.num_gammas)
    curves = dict(zip(CURVES, (np.asarray(x) for x in _relative(view(gammas))), strict=True))
    low, high = 0.5, 90.0
    for _ in range(ROUNDS):  # the one angle above which the published n' helps
        points = np.linspace(low, high, POINTS)
        at = int(np.flatnonzero(published(points) > 1).max())
        low, high = points[at], points[at + 1]
    even = 0.5 * (low + high)
    worst = refined_largest(published, 0.5, even)
    some = np.linspace(8, 90, config.num_measured)
    tried = config.near * np.exp(np.linspace(-4, 4 + np.log(1e4 * config.far / config.near), config.num_near_distances))
    searched = np.asarray(_search(view(some[:, None]), jnp.asarray(tried)))[:, 0]
    distance, expected = (np.asarray(x) for x in _storages(view(some), jnp.asarray(LARGEST * config.far)))
    depth = log_range(config.near, config.far, 33)
    across, along = measured_errors(view(some[:, None]), distance[..., None], depth, ROWS)
    ratios = log_range(1.5, 1000.0, config.num_ratios)
    many = views(1.0, ratios[:, None], config.phi_deg, np.linspace(0.5, 90, POINTS * 4))
    chart = [np.asarray(x) for x in _relative(many)]
    return Result(
        config, gammas, curves, float(even), worst, some,
        across.max(axis=-1) * along.max(axis=-1), expected, searched,
        float(np.log(tried[1] / tried[0])), ratios, chart[0], chart[3], np.degrees(np.asarray(many.gamma_limit))[:, 0],
    )  # fmt: skip


def claims(result: Result) -> tuple[Claim, ...]:
    """Where the published n' hurts, and that the least-storage n' never does."""
    config = result.config
    published, least = result.curves[PUBLISHED], result.curves[LEAST]
    below = result.gammas < result.even
    room = np.exp(4 * result.step / 2)  # ln S changes by at most four times as much as ln n' does
    ratio = config.far / config.near
    others = min((result.curves[name] / least).min() for name in CURVES)
    found = [
        agrees("M_x·M_z of the matrices is the formula's, warped and nearly uniform", result.measured,
               result.expected, 1e-6),
        Claim("below one angle the published n' always hurts, above it never",
              bool((published[below] > 1).all() and (published[~below] <= 1).all()), f"{result.even:.6f}°",
              "one change of sign"),
        equals("light overhead: it needs n/f of the uniform map's storage", published[-1], 1 / ratio, 1e-9),
        at_most("the n' of least storage never needs more than the uniform map, for any f/n and γ",
                max(least.max(), result.chart_least.max()), 1 + 1e-12),
        Claim("and never more than any other rule", bool(others >= 1 - 1e-12), f"{others:.15g}", "at least 1"),
        Claim("no n' tried needs less", bool(result.searched.min() >= 1 - 1e-12), f"{result.searched.min():.15g}",
              "at least 1"),
        at_most("and the best one tried comes as near as neighbours are apart", result.searched, room),
        Claim("the published n' hurts for some γ in every view of the chart",
              bool((result.chart.max(axis=1) > 1).all()), f"by ×{result.chart.max(axis=1).min():.4f} at least",
              "above 1"),
    ]  # fmt: skip
    if (config.near, config.far, config.phi_deg) == (1.0, 100.0, 30.0):
        found += [
            Claim("it breaks even at 23.2062251°", abs(result.even - 23.2062251038) < 1e-6, f"{result.even:.8f}°",
                  "23.20622510°"),
            Claim("and needs most near 18.656°, ×1.237063", abs(result.worst[1] - 1.237062808) < 1e-8
                  and abs(result.worst[0] - 18.656) < 1e-2, f"×{result.worst[1]:.9f} at {result.worst[0]:.3f}°",
                  "×1.237062808"),
        ]  # fmt: skip
    return tuple(found)


def numbers(result: Result) -> dict[str, Any]:
    """Curves, and the chart's break-even line."""
    return {
        "gamma_deg": result.gammas, "storage_over_uniform": result.curves, "break_even_deg": result.even,
        "worst_deg_and_factor": result.worst, "gamma_measured_deg": result.measured_gammas,
        "measured": result.measured[0] / result.measured[1], "f_over_n": result.ratios,
        "largest_factor": result.chart.max(axis=1),
    }  # fmt: skip


@styled
def draw(result: Result) -> Figure:
    """One view on the left, all f/n on the right."""
    figure, axes = new_figure(10.4, 4.6, 1, 2)
    left, right = axes[0]
    styles = (("-", PALETTE[0], 1.8), ("-", PALETTE[2], 1.2), ("-", PALETTE[4], 1.4), ("-", PALETTE[1], 2.0))
    left.axhspan(1, 4, color="#f0d9cc", linewidth=0)
    for name, (dashes, color, width) in zip(CURVES, styles, strict=True):
        left.plot(result.gammas, result.curves[name], dashes, color=color, linewidth=width, label=name)
    left.plot(result.measured_gammas, result.measured[0] / result.measured[1], "o", color=PALETTE[0], markersize=4.5)
    left.set_yscale("log")
    left.set_ylim(0.8 * result.config.near / result.config.far, 4)
    mark_x(left, result.even, f"even at {result.even:.2f}°", top=0.45)
    left.text(88, 1.9, "worse than no warp", ha="right", fontsize=8.5)
    label(left, "γ, angle of light and view (degrees)", "storage over the uniform map's",
          f"f/n = {result.config.far / result.config.near:g}, φ = {result.config.phi_deg:g}°")  # fmt: skip
    left.legend(loc="center right")
    columns = np.linspace(0.5, 90, result.chart.shape[1])
    largest = 10.0
    shown = right.pcolormesh(columns, result.ratios, result.chart, cmap=DIFFERENCE,
                             norm=LogNorm(1 / largest, largest), rasterized=True)  # fmt: skip
    right.contour(columns, result.ratios, result.chart, [1.0], colors="#1d2330", linewidths=1.4)
    right.plot(result.limits, result.ratios, "--", color="#4d4d4d", linewidth=1.2, label="γ_lim")
    right.plot([], [], color="#1d2330", linewidth=1.4, label="even")
    right.set_yscale("log")
    right.grid(False)
    right.legend(loc="lower left")
    label(right, "γ, angle of light and view (degrees)", "f/n", f"eqs 42 and 44, φ = {result.config.phi_deg:g}°")
    bar = figure.colorbar(shown, ax=right, extend="both")
    bar.set_label("storage over the uniform map's")
    return figure
