"""warping, figure 20: largest errors and storage factor over η, from the uniform map to PSM.

The parameter η puts the family of perspective warps on [−1, 1]: −1 is the uniform map, 0 LiSPSM, 1 PSM. The source
reads off its plot that M_x is least for PSM, M_z is least for LiSPSM, and that the storage factor S = M_x·M_z is least
and constant for every η ≥ 0: there n' only moves the place of the largest error and the shape of the map.

Measured: for every η the errors of the warp's 4 × 4 matrix are taken by differentiation at many depths, and their
largest values are multiplied. The η ≥ 0 branch of eq. 33 lacks a factor n as printed; the claims show that only the
corrected form leads back to the η that it started from.

How to read it: lines are eqs 28 to 31, markers are measured. Each curve is divided by its least value, so all start
at 1 where they are best.
"""

from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure

from experiments.base import Claim
from experiments.claiming import agrees, all_true, equals
from experiments.layout import mark_x
from experiments.warped_views import check_count, check_view, in_double, log_range, measured_errors, views
from shadowjax._types import Array
from shadowjax.plotting import PALETTE, label, new_figure, styled
from shadowjax.theory.aliasing.light_frustum import LightFrustum
from shadowjax.theory.aliasing.near_distances import eta_from_near_distance, near_distance_from_eta
from shadowjax.theory.aliasing.overhead import overhead_max_x, overhead_max_z
from shadowjax.theory.aliasing.storage import overhead_storage

NAMES = {"x": "M_x, across the view", "z": "M_z, along it", "storage": "S = M_x·M_z"}
MARKERS = ("o", "s", "D")


@dataclass(frozen=True)
class Config:
    """Settings.

    Attributes:
        near: n, world units; not 1, or eq. 33 as printed would look right.
        far: f, world units.
        phi_deg: Half the angle of view, degrees.
        num_etas: Values of η, odd, ≥ 21.
        num_measured: Values of η at which matrices are differentiated, odd, ≥ 5.
        num_depths: Depths at which they are, ≥ 10.
    """

    near: float = 2.0
    far: float = 200.0
    phi_deg: float = 45.0
    num_etas: int = 401
    num_measured: int = 21
    num_depths: int = 61

    def __post_init__(self):
        check_view(self.near, self.far, self.phi_deg)
        check_count(self.num_etas, "num_etas", 21)
        check_count(self.num_measured, "num_measured", 5)
        check_count(self.num_depths, "num_depths", 10)


@dataclass(frozen=True)
class Result:
    """Largest errors.

    Attributes:
        config: The settings.
        etas: Values of η.
        near_distance: n' of each.
        again: η found back from n' by eq. 32.
        curves: x, z and storage → values by eqs 28, 29 and 31.
        measured_etas: Values of η at which was measured.
        measured: x, z and storage → values from derivatives.
    """

    config: Config
    etas: np.ndarray
    near_distance: np.ndarray
    again: np.ndarray
    curves: dict[str, np.ndarray]
    measured_etas: np.ndarray
    measured: dict[str, np.ndarray]


@jax.jit
def _curves(view: LightFrustum, etas: Array) -> tuple[Array, ...]:
    distance = near_distance_from_eta(view, etas)
    largest = overhead_max_x(view, distance), overhead_max_z(view, distance), overhead_storage(view, distance)
    return distance, eta_from_near_distance(view, distance), *largest


@in_double
def run(config: Config) -> Result:
    """Formulas over η, and derivatives at some of them."""
    view = views(config.near, config.far, config.phi_deg)
    etas = np.linspace(-1, 1, config.num_etas)
    distance, again, *curves = (np.asarray(x) for x in _curves(view, jnp.asarray(etas)))
    chosen = np.unique(np.round(np.linspace(0, etas.size - 1, config.num_measured)).astype(int))
    depth = log_range(config.near, config.far, config.num_depths)
    # The uniform map's matrix needs a finite n': at 10⁹ times f the error is below the claims' tolerance.
    at = np.minimum(distance[chosen], 1e9 * config.far)
    across, along = (error.max(axis=1) for error in measured_errors(view, at[:, None], depth, 2**20))
    return Result(
        config, etas, distance, again, dict(zip(NAMES, curves, strict=True)), etas[chosen],
        {"x": across, "z": along, "storage": across * along},
    )  # fmt: skip


def printed(config: Config, etas: np.ndarray) -> np.ndarray:
    """The η ≥ 0 branch of eq. 33 as the source prints it."""
    root = np.sqrt(config.far * config.near)
    return (config.near + root) / (config.near + etas * root)


def claims(result: Result) -> tuple[Claim, ...]:
    """What the source reads off the figure, and the slip in eq. 33."""
    config, etas = result.config, result.etas
    ratio, tangent = config.far / config.near, np.tan(np.radians(config.phi_deg))
    curves = result.curves
    best = {name: float(etas[np.argmin(values)]) for name, values in curves.items()}
    warped = etas >= 0
    flat = (ratio - 1) / (2 * tangent)
    root = np.sqrt(config.far * config.near)
    away = curves["z"].min() + np.abs(etas) * (curves["z"].max() - curves["z"].min())
    sampled = [np.interp(result.measured_etas, etas, values) for values in curves.values()]
    return (
        agrees("largest errors of the matrices are eqs 28, 29 and 31", list(result.measured.values()), sampled, 1e-8),
        agrees("S = (f/n − 1)/(2 tan φ) for every η ≥ 0", curves["storage"][warped], flat, 1e-12),
        all_true("S is larger for every η < 0", curves["storage"][~warped] > flat * (1 + 1e-12), "values of η"),
        equals("the uniform map needs f/n times as much", curves["storage"][0], flat * ratio, 1e-9),
        Claim("M_x is least for PSM", best["x"] == 1, f"at η = {best['x']:g}", "η = 1"),
        equals("and is 1 there", curves["x"][-1], 1.0, 1e-12),
        Claim("M_z is least for LiSPSM", abs(best["z"]) < 1e-12, f"at η = {best['z']:g}", "η = 0"),
        equals("M_z is (f − n)/(2 tan φ √(fn)) there", curves["z"].min(),
               (config.far - config.near) / (2 * tangent * root), 1e-12),
        agrees("M_z rises linearly in |η|, by definition of η", curves["z"], away, 1e-9),
        agrees("corrected eq. 33 leads back to its η", 2 + result.again, 2 + etas, 1e-12),
        agrees("eq. 33 as printed is n times too small for η ≥ 0", printed(config, etas[warped]) * config.near,
               result.near_distance[warped], 1e-12),
    )  # fmt: skip


def numbers(result: Result) -> dict[str, Any]:
    """Curves and measurements."""
    return {
        "eta": result.etas, "near_distance": result.near_distance, "formula": result.curves,
        "eta_measured": result.measured_etas, "measured": result.measured,
    }  # fmt: skip


@styled
def draw(result: Result) -> Figure:
    """Three curves, each divided by its least value."""
    figure, axes = new_figure(7.6, 4.3)
    spot = axes[0, 0]
    for index, (name, text) in enumerate(NAMES.items()):
        least, color = result.curves[name].min(), PALETTE[index]
        spot.plot(result.etas, result.curves[name] / least, color=color, label=f"{text}; least {least:.4g}")
        spot.plot(result.measured_etas, result.measured[name] / least, MARKERS[index], color=color, markersize=4.5)
    spot.set_yscale("log")
    for x, text, align, top in (
        (-1.0, "uniform", "right", 0.4),
        (0.0, "LiSPSM", "left", 0.98),
        (1.0, "PSM", "left", 0.72),
    ):
        mark_x(spot, x, text, align, top)
    label(spot, "η", "value over the least value", "Storage is flat from LiSPSM to PSM")
    spot.legend(loc="upper left", bbox_to_anchor=(0.51, 1.0))
    return figure
