"""warping, figure 26: storage factor over f/n for one to many depth slices, with and without a warp.

The source cuts the view in k similar slices (eq. 50). Each costs (q − 1)/(2 tan φ) texels per pixel with a perspective
warp, q = (f/n)^(1/k), and q times that without one (eq. 51). With many slices both reach the logarithmic map's
ln(f/n)/(2 tan φ) (eq. 52), which nothing beats.

Measured: every slice gets its own warp matrix, errors are taken by differentiation and by beams at many depths, and
M_x·M_z is summed over the slices. How far k warped slices are from the limit is bounded: S over it is
(q − 1)/ln q, and a logarithmic mean lies between √q and (1 + q)/2.

How to read it: lines are eqs 51 and 52, markers are measured. Both axes are logarithmic.
"""

from dataclasses import dataclass
from typing import Any

import jax
import numpy as np
from matplotlib.figure import Figure

from experiments.base import Claim
from experiments.claiming import agrees, all_true, equals
from experiments.sliced_views import equal_planes, measured_storage
from experiments.warped_views import check_count, check_view, in_double, log_range, views
from shadowjax._checks import require, require_int
from shadowjax._types import Array
from shadowjax.plotting import label, new_figure, series_style, styled
from shadowjax.theory.aliasing.light_frustum import LightFrustum
from shadowjax.theory.aliasing.storage import storage_logarithmic, storage_z_partitions


@dataclass(frozen=True)
class Config:
    """Settings.

    Attributes:
        phi_deg: Half the angle of view, degrees.
        largest_ratio: Largest f/n, > 2.
        num_ratios: Values of f/n, ≥ 10.
        num_measured: Values of f/n at which is measured, ≥ 2.
        partitions: Numbers of slices, rising from 1.
    """

    phi_deg: float = 45.0
    largest_ratio: float = 1000.0
    num_ratios: int = 121
    num_measured: int = 7
    partitions: tuple[int, ...] = (1, 2, 4, 8)

    def __post_init__(self):
        check_view(1.0, self.largest_ratio, self.phi_deg)
        require(self.largest_ratio > 2, f"largest_ratio must exceed 2; got {self.largest_ratio}")
        check_count(self.num_ratios, "num_ratios", 10)
        check_count(self.num_measured, "num_measured", 2)
        require(len(self.partitions) > 1 and self.partitions[0] == 1, "partitions must begin with 1 and go on")
        for k in self.partitions:
            require_int(k, "partitions", 1)
        require(tuple(sorted(set(self.partitions))) == self.partitions, "partitions must rise")


@dataclass(frozen=True)
class Result:
    """Storage factors: rows are numbers of slices, columns values of f/n.

    Attributes:
        config: The settings.
        ratios: f/n.
        warped: Eq. 51 with n' of LiSPSM.
        uniform: Eq. 51 with n' → ∞.
        limit: Eq. 52.
        measured_ratios: f/n at which was measured.
        measured_warped: Sums over slices.
        measured_uniform: Sums over slices.
        expected: Eq. 51 there: warped and uniform.
    """

    config: Config
    ratios: np.ndarray
    warped: np.ndarray
    uniform: np.ndarray
    limit: np.ndarray
    measured_ratios: np.ndarray
    measured_warped: np.ndarray
    measured_uniform: np.ndarray
    expected: tuple[np.ndarray, np.ndarray]


@jax.jit
def _formulas(view: LightFrustum, partitions: Array) -> tuple[Array, ...]:
    return (
        storage_z_partitions(view, partitions), storage_z_partitions(view, partitions, warped=False),
        storage_logarithmic(view),
    )  # fmt: skip


@in_double
def run(config: Config) -> Result:
    """Formulas, and slices one by one."""
    ratios = log_range(1.02, config.largest_ratio, config.num_ratios)
    some = log_range(2.0, config.largest_ratio, config.num_measured)
    counts = np.asarray(config.partitions, float)[:, None]
    warped, uniform, limit = (np.asarray(x) for x in _formulas(views(1.0, ratios, config.phi_deg), counts))
    expected = [np.asarray(x) for x in _formulas(views(1.0, some, config.phi_deg), counts)[:2]]
    # all slices of all views side by side, so that they are one computation
    planes = [[equal_planes(1.0, ratio, k) for ratio in some] for k in config.partitions]
    near, far = (np.concatenate([p[cut] for row in planes for p in row]) for cut in (slice(None, -1), slice(1, None)))
    owner = np.concatenate([np.full(k, i * some.size + j) for i, k in enumerate(config.partitions)
                            for j in range(some.size)])  # fmt: skip
    shape = (len(config.partitions), some.size)
    sums = [
        np.bincount(owner, measured_storage(near, far, config.phi_deg, distance)).reshape(shape)
        for distance in (near + np.sqrt(near * far), np.full_like(near, np.inf))
    ]
    return Result(config, ratios, warped, uniform, limit, some, sums[0], sums[1], (expected[0], expected[1]))


def claims(result: Result) -> tuple[Claim, ...]:
    """Equations 51 and 52, and how near the limit few slices are."""
    counts = np.asarray(result.config.partitions, float)[:, None]
    q = result.ratios ** (1 / counts)
    over = result.warped / result.limit
    tangent = 2 * np.tan(np.radians(result.config.phi_deg))
    at = float(result.measured_ratios[-1])
    gain = result.measured_warped[0, -1] / result.measured_warped[:, -1]
    return (
        agrees("with a warp: M_x·M_z summed over slices is eq. 51", result.measured_warped, result.expected[0], 1e-8),
        agrees("and without", result.measured_uniform, result.expected[1], 1e-6),
        all_true("more slices always need less storage, with a warp", np.diff(result.warped, axis=0) < 0, "pairs"),
        all_true("and without a warp", np.diff(result.uniform, axis=0) < 0, "pairs"),
        all_true("nothing is below the logarithmic map", over >= 1, "slices and ratios"),
        all_true("with a warp S over that limit lies between √q and (1 + q)/2", (over >= np.sqrt(q) * (1 - 1e-12))
                 & (over <= (1 + q) / 2 * (1 + 1e-12)), "slices and ratios"),
        agrees("a warp saves the factor q = (f/n)^(1/k)", result.uniform / result.warped, q, 1e-12),
        equals(f"f/n = {at:g}: {result.config.partitions[-1]} warped slices gain this much over one", gain[-1],
               (at - 1) / (result.config.partitions[-1] * (at ** (1 / result.config.partitions[-1]) - 1)), 1e-7),
        equals("S of the logarithmic map there", result.limit[-1], np.log(at) / tangent, 1e-12),
    )  # fmt: skip


def numbers(result: Result) -> dict[str, Any]:
    """Storage factors by formula and measured."""
    return {
        "f_over_n": result.ratios, "partitions": result.config.partitions, "warped": result.warped,
        "uniform": result.uniform, "logarithmic": result.limit, "f_over_n_measured": result.measured_ratios,
        "warped_measured": result.measured_warped, "uniform_measured": result.measured_uniform,
    }  # fmt: skip


@styled
def draw(result: Result) -> Figure:
    """With a warp on the left, without on the right."""
    figure, axes = new_figure(9.2, 4.3, 1, 2, sharey=True)
    sides = ((result.warped, result.measured_warped, "LiSPSM in every slice"),
             (result.uniform, result.measured_uniform, "A uniform map in every slice"))  # fmt: skip
    for spot, (curves, measured, title) in zip(axes[0], sides, strict=True):
        for index, k in enumerate(result.config.partitions):
            style = series_style(index)
            spot.plot(result.ratios, curves[index], color=style["color"], label=f"k = {k}")
            spot.plot(result.measured_ratios, measured[index], style["marker"], color=style["color"], markersize=4.5)
        spot.plot(result.ratios, result.limit, "--", color="#4d4d4d", linewidth=1.4, label="logarithmic map")
        spot.set_xscale("log")
        spot.set_yscale("log")
        spot.set_ylim(0.3, 1e5)
        label(spot, "f/n", "S, texels per pixel", title)
        spot.legend(loc="upper left")
    return figure
