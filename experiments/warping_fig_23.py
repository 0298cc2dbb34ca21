"""warping, figure 23: the error along z' over depth for several angles between light and view, and what eq. 37 misses.

With the generalised n'(γ) of eq. 39 the error is equal at near and far plane for every γ from γ_lim to 90°, and it is
least at z = √(fn) whatever γ is. The source shows the shape of the curves. Their height needs a correction: eq. 37
measures a texel along the view axis, dz, but a beam's thickness is measured across the light, dz' = sin γ·dz. So the
printed error is 1/sin γ too large, and diverges as light and view align, against eq. 53.

Measured: pixels and texels are cut out by their edge rays at every depth, with the matrix of the warp.

How to read it: lines are sin γ times eq. 37, markers are beams, and the dotted lines on the right are eq. 37 as
printed. Image and map have equally many rows.
"""

from dataclasses import dataclass
from typing import Any

import jax
import numpy as np
from matplotlib.figure import Figure

from experiments.base import Claim
from experiments.claiming import agrees, all_true
from experiments.layout import mark_x
from experiments.warped_views import check_count, check_gamma, check_view, in_double, log_range, measured_errors, views
from shadowjax._checks import require
from shadowjax._types import Array
from shadowjax.plotting import label, new_figure, series_style, styled
from shadowjax.plotting.style import legend_below
from shadowjax.theory.aliasing.error import error_z
from shadowjax.theory.aliasing.light_frustum import LightFrustum
from shadowjax.theory.aliasing.near_distances import equalising
from shadowjax.theory.aliasing.overhead import least_error_depth, literal_error_z

EVERY = 12  # depths between markers
ROWS = 2**20


@dataclass(frozen=True)
class Config:
    """Settings.

    Attributes:
        near: n, world units.
        far: f, world units.
        phi_deg: Half the angle of view, degrees.
        gammas_deg: Angles between light and view, falling, degrees; the last is replaced by γ_lim.
        num_depths: Depths on the view axis, odd, so that √(fn) is one; ≥ 25.
    """

    near: float = 1.0
    far: float = 100.0
    phi_deg: float = 30.0
    gammas_deg: tuple[float, ...] = (90.0, 70.0, 50.0, 40.0, 0.0)
    num_depths: int = 121

    def __post_init__(self):
        check_view(self.near, self.far, self.phi_deg)
        require(len(self.gammas_deg) > 1, "gammas_deg must hold at least two angles")
        for gamma_deg in self.gammas_deg:
            check_gamma(gamma_deg)
        check_count(self.num_depths, "num_depths", 25)
        require(self.num_depths % 2 == 1, f"num_depths must be odd; got {self.num_depths}")


@dataclass(frozen=True)
class Result:
    """Errors: rows are angles, columns depths.

    Attributes:
        config: The settings.
        gammas: Angles, degrees.
        near_distance: n' of eq. 39.
        depth: z.
        error: sin γ times eq. 37.
        printed: Eq. 37.
        measured: By beams.
        lowest: Depth of least error by eq. 38.
    """

    config: Config
    gammas: np.ndarray
    near_distance: np.ndarray
    depth: np.ndarray
    error: np.ndarray
    printed: np.ndarray
    measured: np.ndarray
    lowest: np.ndarray


@jax.jit
def _formulas(view: LightFrustum, depth: Array) -> tuple[Array, ...]:
    distance = equalising(view)
    errors = error_z(view, distance, depth), literal_error_z(view, distance, depth)
    return distance, *errors, least_error_depth(view, distance)


@in_double
def run(config: Config) -> Result:
    """Formulas and beams."""
    limit = np.degrees(np.asarray(views(config.near, config.far, config.phi_deg).gamma_limit))
    gammas = np.array([*config.gammas_deg[:-1], float(limit)])
    view = views(config.near, config.far, config.phi_deg, gammas[:, None])
    depth = log_range(config.near, config.far, config.num_depths)
    distance, error, printed, lowest = (np.asarray(x) for x in _formulas(view, depth))
    measured = measured_errors(view, distance, depth, ROWS)[1]
    return Result(config, gammas, distance[:, 0], depth, error, printed, measured, lowest[:, 0])


def claims(result: Result) -> tuple[Claim, ...]:
    """Equal at both planes, least at √(fn), and 1/sin γ below the printed height."""
    config = result.config
    middle = np.sqrt(config.near * config.far)
    sine = np.sin(np.radians(result.gammas))
    inner = result.measured[:, 1:-1].max(axis=1) < result.measured[:, 0]
    # a beam is one texel thick: 1/(1 − (W z'/(2 res f' n'))²), at most at the far plane
    texel = (config.far / config.near) ** 2 / ROWS**2
    ratio = np.argmin(result.measured, axis=1)
    return (
        agrees("beams give sin γ times eq. 37", result.measured, result.error, 1e-12 + texel),
        agrees("eq. 37 as printed is 1/sin γ too large", result.printed / result.measured, 1 / sine[:, None],
               1e-12 + texel),
        agrees("the error is equal at near and far plane for every γ", result.measured[:, -1], result.measured[:, 0],
               1e-12 + texel),
        all_true("and smaller everywhere between", inner, "angles"),
        agrees("eq. 38: least at √(fn) for every γ", result.lowest, middle, 1e-12),
        all_true("measured: least at √(fn) for every γ", ratio == config.num_depths // 2, "angles"),
        all_true("n' falls with γ down to γ_lim", np.diff(result.near_distance) < 0, "steps"),
    )  # fmt: skip


def numbers(result: Result) -> dict[str, Any]:
    """Errors over depth."""
    return {
        "gamma_deg": result.gammas, "near_distance": result.near_distance, "depth": result.depth,
        "error": result.error, "printed": result.printed, "measured": result.measured,
    }  # fmt: skip


@styled
def draw(result: Result) -> Figure:
    """Errors on the left; at the near plane over γ on the right."""
    figure, axes = new_figure(9.6, 4.3, 1, 2, width_ratios=[3, 2])
    left, right = axes[0]
    for index, gamma in enumerate(result.gammas):
        style = series_style(index)
        limit = " = γ_lim" if index == len(result.gammas) - 1 else ""
        left.plot(
            result.depth, result.error[index], color=style["color"], linewidth=1.6, label=f"γ = {gamma:.4g}°{limit}"
        )
        start = 2 * index % EVERY
        left.plot(result.depth[start::EVERY], result.measured[index, start::EVERY], style["marker"],
                  color=style["color"], markersize=4.5)  # fmt: skip
        right.plot([gamma], [result.measured[index, 0]], style["marker"], color=style["color"], markersize=6, zorder=3)
    left.set_xscale("log")
    mark_x(left, np.sqrt(result.config.near * result.config.far), "z = √(fn)", "right")
    label(left, "depth z (world units)", "m_z, pixels per texel", "Equal at both planes for every γ")
    right.plot(result.gammas, result.error[:, 0], color="#4d4d4d", linewidth=1.2, label="sin γ · eq. 37", zorder=1)
    right.plot(result.gammas, result.printed[:, 0], ":", color="#4d4d4d", linewidth=1.6, label="eq. 37 as printed")
    right.set_ylim(bottom=0)
    label(right, "γ, angle of light and view (degrees)", "M_z, pixels per texel", "Its height")
    right.legend(loc="lower left")
    legend_below(figure, left, 5)
    return figure
