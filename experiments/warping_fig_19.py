"""warping, figure 19: aliasing error along the view axis for warps between PSM and the uniform map.

The source plots m_x and m_z over depth with the light overhead, for n' = n (PSM), n' = n + √(fn) (LiSPSM) and n' = ∞
(the uniform map): with PSM m_z rises in proportion to depth, with the uniform map both fall like 1/z, and LiSPSM's m_z
is equal at both planes, where it is largest and least possible.

Measured: the 4 × 4 matrix of each warp is differentiated across the view for m_x. For m_z the pixel and the texel that
meet at a depth are cut out by their edge rays; no formula of the source is used. A beam's thickness is that of a whole
texel, so it differs from eq. 26 by 1/(1 − (W z'/(2 res f' n'))²) exactly, and the claim asks for that. That LiSPSM is
best is tried out: n' is scanned.

How to read it: lines are eqs 25 and 26, markers are measured; both axes are logarithmic, and texels equal pixels in
number.
"""

from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure

from experiments.base import Claim
from experiments.claiming import agrees, all_true, at_most, equals
from experiments.warped_views import check_count, check_view, in_double, log_range, measured_errors, views
from shadowjax._checks import require
from shadowjax._types import Array
from shadowjax.plotting import label, new_figure, series_style, styled
from shadowjax.plotting.style import legend_below
from shadowjax.theory.aliasing.light_frustum import LightFrustum
from shadowjax.theory.aliasing.near_distances import near_distance_from_eta, wimmer
from shadowjax.theory.aliasing.overhead import overhead_error_x, overhead_error_z

ETAS = (-1.0, -0.3, 0.0, 0.5, 1.0)
NAMES = ("n' = ∞, uniform", "η = −0.3", "n' = n + √(fn), LiSPSM", "η = 0.5", "n' = n, PSM")
UNIFORM, LISPSM, PSM = 0, 2, 4
EVERY = 12  # depths between markers
LARGEST = 1e4  # n' over f − n of the matrix that stands for n' = ∞: a larger one has too few digits left for beams


@dataclass(frozen=True)
class Config:
    """Settings.

    Attributes:
        near: n, world units.
        far: f, world units.
        phi_deg: Half the angle of view, degrees.
        num_depths: Depths on the view axis, ≥ 25.
        num_near_distances: Values of n' tried against LiSPSM's, ≥ 10.
        rows: Rows of image and map for the beams, ≥ 16.
    """

    near: float = 1.0
    far: float = 100.0
    phi_deg: float = 45.0
    num_depths: int = 121
    num_near_distances: int = 2001
    rows: int = 1024

    def __post_init__(self):
        check_view(self.near, self.far, self.phi_deg)
        check_count(self.num_depths, "num_depths", 25)
        check_count(self.num_near_distances, "num_near_distances", 10)
        check_count(self.rows, "rows", 16)
        require(2 * self.rows > self.far / self.near, f"rows must exceed far/(2·near); got {self.rows}")


@dataclass(frozen=True)
class Result:
    """Errors; the first axis runs over ETAS, the second over depths.

    Attributes:
        config: The settings.
        near_distance: n' of each warp.
        depth: z.
        error_x: m_x by eq. 25.
        error_z: m_z by eq. 26.
        measured_x: m_x of the matrix, n' at most LARGEST·(f − n).
        measured_z: m_z by beams, of the same matrix.
        expected_x: m_x by eq. 25 at that n'.
        expected_z: m_z by eq. 26 at that n', times what a whole texel adds.
        scanned: The largest m_z of every other n' tried.
    """

    config: Config
    near_distance: np.ndarray
    depth: np.ndarray
    error_x: np.ndarray
    error_z: np.ndarray
    measured_x: np.ndarray
    measured_z: np.ndarray
    expected_x: np.ndarray
    expected_z: np.ndarray
    scanned: np.ndarray


@jax.jit
def _formulas(view: LightFrustum, distance: Array, depth: Array) -> tuple[Array, Array]:
    return overhead_error_x(view, distance, depth), overhead_error_z(view, distance, depth)


@jax.jit
def _near_distances(view: LightFrustum, etas: Float[Array, "etas"]) -> tuple[Array, Array]:
    return near_distance_from_eta(view, etas), wimmer(view)


@in_double
def run(config: Config) -> Result:
    """Formulas, beams and the scan."""
    view = views(config.near, config.far, config.phi_deg)
    depth = log_range(config.near, config.far, config.num_depths)
    distance, best = (np.asarray(x) for x in _near_distances(view, jnp.asarray(ETAS)))
    finite = np.minimum(distance, LARGEST * (config.far - config.near))[:, None]
    errors, (expected_x, expected_z) = (_formulas(view, q, depth) for q in (distance[:, None], finite))
    measured = measured_errors(view, finite, depth, config.rows)
    tried = best * log_range(1e-3, 1e3, config.num_near_distances)
    scanned = np.max(_formulas(view, tried[:, None], depth)[1], axis=1)
    expected_z = expected_z * whole_texel(config, finite, depth)
    arrays = (*errors, *measured, expected_x, expected_z, scanned)
    return Result(config, distance, depth, *(np.asarray(x) for x in arrays))


def whole_texel(config: Config, near_distance: np.ndarray, depth: np.ndarray) -> np.ndarray:
    """Thickness of a texel's beam over its first-order value: 1/(1 − (W z'/(2 res f' n'))²)."""
    extent, offset = config.far - config.near, depth - config.near
    share = extent * (near_distance + offset) / (2 * config.rows * (near_distance + extent) * near_distance)
    return 1 / (1 - share**2)


def claims(result: Result) -> tuple[Claim, ...]:
    """What the source reads off the figure, with the numbers that eqs 25 to 27 give."""
    config, depth = result.config, result.depth
    near, far = config.near, config.far
    equal = (far - near) / (2 * np.tan(np.radians(config.phi_deg)))
    lispsm, psm = result.error_z[LISPSM], result.error_z[PSM]
    factor = whole_texel(config, result.near_distance[:, None], depth)
    most = (far / near - 1) ** 2 / 4  # of PSM at the far plane
    ends = np.maximum(result.error_z[:, 0], result.error_z[:, -1])
    return (
        agrees("m_x of the matrices is eq. 25", result.measured_x, result.expected_x, 1e-10),
        agrees("m_z of the beams is eq. 26 times what a whole texel adds", result.measured_z, result.expected_z,
               1e-10),
        at_most("what a whole texel adds is of the order of 1/res²", (factor - 1) * config.rows**2,
                most / (1 - most / config.rows**2) * (1 + 1e-12)),
        agrees("PSM: m_x = 1 at every depth", result.error_x[PSM], 1.0, 1e-12),
        agrees("PSM: m_z rises in proportion to depth", psm, equal * depth / (near * far), 1e-12),
        agrees("uniform map: m_x and m_z fall like 1/z",
               np.stack([result.error_x[UNIFORM], result.error_z[UNIFORM]]),
               np.stack([far / depth, equal / depth]), 1e-12),
        equals("LiSPSM: m_z is equal at both planes", lispsm[-1], lispsm[0], 1e-12),
        equals("LiSPSM: M_z is (f − n)/(2 tan φ √(fn))", ends[LISPSM], equal / np.sqrt(far * near), 1e-12),
        Claim("no other n' has a smaller M_z", bool(result.scanned.min() >= ends[LISPSM] * (1 - 1e-12)),
              f"at least {result.scanned.min():.9g} for {result.scanned.size} values of n'", f"{ends[LISPSM]:.9g}"),
        all_true("m_z is largest at one of the two planes", result.error_z.max(axis=1) == ends, "warps"),
    )  # fmt: skip


def numbers(result: Result) -> dict[str, Any]:
    """Errors by formula and by beams."""
    return {
        "eta": ETAS, "near_distance": result.near_distance, "depth": result.depth, "m_x": result.error_x,
        "m_z": result.error_z, "m_x_measured": result.measured_x, "m_z_measured": result.measured_z,
    }  # fmt: skip


@styled
def draw(result: Result) -> Figure:
    """m_x on the left, m_z on the right."""
    figure, axes = new_figure(9.2, 4.2, 1, 2)
    pairs = ((result.error_x, result.measured_x), (result.error_z, result.measured_z))
    for spot, (error, measured), title in zip(axes[0], pairs, ("m_x, across the view", "m_z, along it"), strict=True):
        for index, name in enumerate(NAMES):
            style = series_style(index)
            spot.plot(result.depth, error[index], color=style["color"], linewidth=1.6, label=name)
            start = index * EVERY // len(NAMES)  # so that markers of crossing lines do not meet
            spot.plot(result.depth[start::EVERY], measured[index, start::EVERY], style["marker"],
                      color=style["color"], markersize=4.5)  # fmt: skip
        spot.set_xscale("log")
        spot.set_yscale("log")
        label(spot, "depth z (world units)", "error, pixels per texel", title)
    legend_below(figure, axes[0, 0], 5)
    return figure
