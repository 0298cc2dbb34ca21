"""warping, figure 27: seams between depth slices, seen on a floor and measured at the cut.

Slats float over a floor and are not drawn; their shadows are, with a hard test and few texels. Where one slice's map
hands over to the next, the size of a texel jumps. With light almost along the view and a uniform map in each slice,
both sides jump by f_i/n_i (left, as the source's figure). With light across the view and LiSPSM in each, the error
along the view does not jump, and across it jumps by √(f_i/n_i), which the source calls small (middle). The adaptive
cut of eq. 55 with parallel light moves the seam away from the eye and makes the jump smaller (right).

Measured: at floor points on the cut the texels of both maps are differentiated. Predicted: the closed forms of the
errors on both sides. The step of the texel's size between neighbouring pixels of the picture, on the two sides of the
seam, must be the same jump.

How to read it: above, the marked rows are the cut. Below, the error along the middle of the picture; lines are
formulas, markers are measured.
"""

import math
from dataclasses import dataclass
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from experiments.base import Claim
from experiments.claiming import agrees, equals
from experiments.layout import mark_x
from experiments.warped_views import check_count, check_gamma, check_view, in_double, log_range
from shadowjax._checks import require, require_int
from shadowjax._types import Array, Points
from shadowjax.evaluate.seams import seam_jump, seam_steps, texel_picture, texel_widths
from shadowjax.filters.hard import Hard
from shadowjax.geometry.camera import Camera
from shadowjax.geometry.light import DirectionalLight
from shadowjax.geometry.mesh import Mesh
from shadowjax.partitions.cascades import Cascades
from shadowjax.plotting import PALETTE, label, new_figure, show_image, styled
from shadowjax.rays.ray_grid import RayGrid, camera_grid
from shadowjax.scenes.base import to_mesh
from shadowjax.scenes.parts import Part
from shadowjax.scenes.primitives import box
from shadowjax.techniques.shadow_mapping import MappedShadows, ShadowMapping
from shadowjax.theory.aliasing.error import error_x, error_z
from shadowjax.theory.aliasing.split_rules import adaptive_splits, logarithmic_splits
from shadowjax.theory.aliasing.storage import slices
from shadowjax.warps.fit import NEAR_DISTANCES, PerspectiveFit, light_frustum

PARALLEL, ACROSS, ADAPTIVE = "light along the view, uniform", "light across, LiSPSM", "light along, eq. 55"
PADDED = 1e-3  # by which a map reaches beyond its slice on each side
EYE, DOWN_DEG = 1.7, 12.0  # height over the floor, metres; how far the view is turned down
ASPECT = 4 / 3
SLAT_HEIGHT = 2.5


@dataclass(frozen=True)
class Config:
    """Settings.

    Attributes:
        near: n, metres.
        far: f, metres.
        phi_deg: Half the vertical angle of view, degrees.
        gamma_deg: Angle between light and view where they are almost parallel, degrees; less than phi_deg.
        ratio: α of eq. 55.
        width: Pixels across.
        height: Pixels down.
        resolution: Texels along each side of each of the two maps.
        num_depths: Depths of the charts, ≥ 20.
    """

    near: float = 3.0
    far: float = 75.0
    phi_deg: float = 24.0
    gamma_deg: float = 8.0
    ratio: float = 2.0
    width: int = 400
    height: int = 300
    resolution: int = 128
    num_depths: int = 80

    def __post_init__(self):
        check_view(self.near, self.far, self.phi_deg)
        check_gamma(self.gamma_deg)
        require(0 < self.gamma_deg < self.phi_deg, f"gamma_deg must lie below phi_deg; got {self.gamma_deg}")
        require(1 < self.ratio < self.far / self.near, f"ratio must lie between 1 and far/near; got {self.ratio}")
        require_int(self.width, "width", 16)
        require_int(self.height, "height", 12)
        require_int(self.resolution, "resolution", 8)
        check_count(self.num_depths, "num_depths", 20)


@dataclass(frozen=True)
class Setup:
    """What one light and partition gave.

    Attributes:
        planes: n, the cut and f.
        picture: Visibility of the floor; NaN above the horizon and beyond f.
        seam_rows: Rows of the picture between which the cut lies.
        depth: Depths of the chart.
        predicted: Errors across and along by formula, (2, depths), each point in its own slice.
        measured: The same from the maps.
        jump_predicted: Jump across and along at the cut, by formula.
        jump_measured: The same from the two maps at floor points on the cut.
        step: Mean jump of the texel's size (root of its area) between neighbouring pixels at the seam.
        elsewhere: The same between neighbours of one slice.
        room: Largest factor that the margin of the maps can add to an error.
    """

    planes: np.ndarray
    picture: np.ndarray
    seam_rows: tuple[int, int]
    depth: np.ndarray
    predicted: np.ndarray
    measured: np.ndarray
    jump_predicted: np.ndarray
    jump_measured: np.ndarray
    step: float
    elsewhere: float
    room: float


@dataclass(frozen=True)
class Result:
    """Setups by name, and the settings."""

    config: Config
    setups: dict[str, Setup]


def slats(far: float) -> Mesh:
    """Long slats that run away from the viewer, and a floor."""
    parts: list[Part] = [box((-far, -0.1, -1.2 * far), (far, 0.0, 0.3 * far))]
    for x, turn in ((-7.5, -0.16), (-2.2, -0.07), (0.9, 0.035), (3.2, 0.09), (9.0, 0.2)):
        slat = box((-0.4, SLAT_HEIGHT, -1.1 * far), (0.4, SLAT_HEIGHT + 0.05, 0.4 * far))
        parts.append(slat.turned((0.0, 1.0, 0.0), turn).moved(x=x))
    for step in range(6):
        z = 1.5 - 4.0 * 1.75**step
        parts.append(box((-far, SLAT_HEIGHT, z - 0.04 * abs(z) - 0.1), (far, SLAT_HEIGHT + 0.05, z)))
    return to_mesh(parts)


def view(config: Config) -> Camera:
    """The viewer over the floor."""
    down = math.radians(DOWN_DEG)
    return Camera.look_at(
        (0.0, EYE, 0.0), (0.0, EYE - math.sin(down), -math.cos(down)), phi_y=math.radians(config.phi_deg),
        aspect=ASPECT, near=config.near, far=config.far, dtype=jnp.float64,
    )  # fmt: skip


def floor_points(camera: Camera, grid: RayGrid) -> tuple[Points, np.ndarray]:
    """Where every pixel meets the floor, and whether it does between the camera's planes."""
    rays = grid.rays()
    down = -np.asarray(rays.directions)[..., 1]
    reach = EYE / np.where(down > 1e-6, down, 1.0)
    points = np.asarray(rays.origins) + reach[..., None] * np.asarray(rays.directions)
    depth = np.asarray(camera.to_view(jnp.asarray(points)))[..., 2]
    met = (down > 1e-6) & (depth >= float(camera.near)) & (depth <= float(camera.far))
    return jnp.asarray(np.where(met[..., None], points, [0.0, 0.0, -5.0])), met


def line_points(camera: Camera, depth: np.ndarray) -> Points:
    """Floor points in the middle of the picture at given depths along the view."""
    forward, up = np.asarray(camera.forward), np.asarray(camera.up)
    height = -(EYE + depth * forward[1]) / up[1]
    return jnp.asarray(np.asarray(camera.position) + depth[:, None] * forward + height[:, None] * up)


@eqx.filter_jit
def _read(
    shadows: MappedShadows, points: Points, normals: Points, line: Points
) -> tuple[Float[Array, "rows cols"], Array, Array, tuple[Array, ...], Array]:
    """Visibility, texel sizes and regions of the floor; texel widths of both maps and regions along the line."""
    grids, partition = shadows.grids, shadows.partition
    return (
        shadows.visibility(points, normals), texel_picture(shadows, points),
        partition.select(grids, shadows.camera, points), tuple(texel_widths(grid, line) for grid in grids),
        partition.select(grids, shadows.camera, line),
    )  # fmt: skip


@eqx.filter_jit
def _predict(camera: Camera, light: DirectionalLight, planes: Array, rule: str, points: Points) -> tuple[Array, Array]:
    """Errors across and along at points by the formula of each slice, and the most that the maps' margin adds."""
    parts = slices(light_frustum(camera, light.direction, planes[0], planes[-1]), planes)
    distance = NEAR_DISTANCES[rule](parts)
    _, y, z = jnp.moveaxis(camera.to_view(points), -1, 0)
    errors = jnp.stack([error(parts, distance, z[:, None], y[:, None]) for error in (error_x, error_z)])
    return errors, (1 + 2 * PADDED) * jnp.max((1 + PADDED * parts.extent / distance) ** 2)


def _setup(config: Config, mesh: Mesh, camera: Camera, gamma_deg: float, planes: Array, rule: str) -> Setup:
    gamma = math.radians(gamma_deg)
    light = DirectionalLight.create(math.cos(gamma) * camera.forward - math.sin(gamma) * camera.up, dtype=jnp.float64)
    partition = Cascades.at(planes, warp=PerspectiveFit(rule, tight=False), choose="depth")
    shadows = ShadowMapping(Hard(), config.resolution, partition=partition).build(mesh, light, camera)
    points, met = floor_points(camera, camera_grid(camera, config.width, config.height))
    upward = jnp.broadcast_to(jnp.asarray([0.0, 1.0, 0.0]), points.shape)
    depth = log_range(1.02 * float(EYE / np.sin(np.radians(config.phi_deg + DOWN_DEG))), config.far, config.num_depths)
    line = line_points(camera, depth)
    seen, sizes, region, widths, line_region = _read(shadows, points, upward, line)
    steps = seam_steps(sizes, region, jnp.asarray(met))
    at_cut = line_points(camera, np.asarray(planes[1:2]))
    jump = seam_jump(shadows, 0, 1, at_cut, jnp.broadcast_to(jnp.asarray([0.0, 1.0, 0.0]), at_cut.shape))

    by_slice, margin = _predict(camera, light, planes, rule, jnp.concatenate([line, at_cut]))
    errors = np.asarray(by_slice)
    own = np.asarray(line_region)
    pixel = 2 * depth * np.asarray(camera.half_size)[:, None] / np.array([[config.width], [config.height]])
    ratio = np.array([[config.width], [config.height]]) / config.resolution
    measured = np.where(own == 0, np.asarray(widths[0]).T, np.asarray(widths[1]).T) / pixel
    rows = np.asarray(jnp.where(jnp.asarray(met), region, -1)).max(axis=1)
    first_near = int(np.flatnonzero(rows == 0).min())
    cut = errors[:, -1]
    return Setup(
        np.asarray(planes), np.where(met, np.asarray(seen), np.nan), (first_near - 1, first_near), depth,
        ratio * errors[:, np.arange(depth.size), own], measured,
        np.maximum(cut[:, 0] / cut[:, 1], cut[:, 1] / cut[:, 0]),
        np.array([float(jump.across[0]), float(jump.along[0])]), float(jnp.exp(steps.across)),
        float(jnp.exp(steps.elsewhere)),
        float(margin),
    )  # fmt: skip


@in_double
def run(config: Config) -> Result:
    """Three lights and partitions over one floor."""
    mesh, camera = slats(config.far), view(config)
    mesh = Mesh.create(np.asarray(mesh.vertices, float), np.asarray(mesh.faces), np.asarray(mesh.face_colors, float))
    near, far = jnp.asarray(config.near), jnp.asarray(config.far)
    equal = logarithmic_splits(near, far, 2)
    gamma = jnp.asarray(math.radians(config.gamma_deg))
    adaptive = adaptive_splits(near, far, gamma, jnp.asarray([config.ratio]))
    return Result(config, {
        PARALLEL: _setup(config, mesh, camera, config.gamma_deg, equal, "uniform"),
        ACROSS: _setup(config, mesh, camera, 90.0, equal, "lispsm"),
        ADAPTIVE: _setup(config, mesh, camera, config.gamma_deg, adaptive, "uniform"),
    })  # fmt: skip


def claims(result: Result) -> tuple[Claim, ...]:
    """Jumps by formula, by maps and by pixels."""
    config, setups = result.config, result.setups
    ratio = math.sqrt(config.far / config.near)
    cut = float(setups[ADAPTIVE].planes[1])
    weight = config.gamma_deg / 90
    told = weight * math.sqrt(config.near * config.far) + (1 - weight) * config.far / config.ratio
    every = list(setups.values())
    room = max(setup.room for setup in every)
    drift = max(setup.elsewhere for setup in every)  # texels also grow from pixel to pixel inside a slice
    return (
        agrees("texels along the picture are as large as the formulas say, but for the maps' margin",
               np.stack([setup.measured for setup in every]), np.stack([setup.predicted for setup in every]), room - 1),
        agrees("parallel light, uniform: both errors jump by f_i/n_i", setups[PARALLEL].jump_measured, ratio, room - 1),
        agrees("LiSPSM: the error along does not jump", setups[ACROSS].jump_measured[1], 1.0, room - 1),
        agrees("LiSPSM: the error across jumps by √(f_i/n_i)", setups[ACROSS].jump_measured[0], math.sqrt(ratio),
               room - 1),
        equals("eq. 55 puts the cut at λ√(fn) + (1 − λ)f/α", cut, told, 1e-9),
        agrees("there both errors jump by f/n₂ only", setups[ADAPTIVE].jump_measured, config.far / cut, room - 1),
        agrees("formulas on both sides of the cut give the measured jumps",
               np.stack([setup.jump_measured for setup in every]), np.stack([setup.jump_predicted for setup in every]),
               room - 1),
        agrees("neighbouring pixels on the seam step by the same jump",
               [setup.step for setup in every], [math.sqrt(setup.jump_measured.prod()) for setup in every],
               4 * (drift - 1) + room - 1),
    )  # fmt: skip


def numbers(result: Result) -> dict[str, Any]:
    """Planes, jumps and errors."""
    return {
        name: {"planes": setup.planes, "jump_predicted": setup.jump_predicted, "jump_measured": setup.jump_measured,
               "pixel_step": setup.step, "depth": setup.depth, "error_x": setup.measured[0],
               "error_z": setup.measured[1]}
        for name, setup in result.setups.items()
    }  # fmt: skip


@styled
def draw(result: Result) -> Figure:
    """Floors above, errors below."""
    config = result.config
    figure, axes = new_figure(12.4, 5.3, 2, 3, height_ratios=[1, 1.25])
    for column, (name, setup) in enumerate(result.setups.items()):
        floor, chart = axes[:, column]
        met = np.isfinite(setup.picture)
        shade = np.where(met, 0.25 + 0.7 * np.nan_to_num(setup.picture), 1.0)
        top = int(np.flatnonzero(met.any(axis=1)).min())
        show_image(floor, shade[top:], name)
        row = setup.seam_rows[0] - top + 0.5
        for x, marker in ((-0.02, ">"), (1.02, "<")):
            floor.plot([x * config.width], [row], marker, color=PALETTE[1], markersize=6, clip_on=False)
        floor.set_xlim(-0.5, config.width - 0.5)
        for index, (axis, marker) in enumerate((("m_x", "o"), ("m_z", "s"))):
            color = PALETTE[(0, 2)[index]]
            near = setup.depth < setup.planes[1]
            for part in (near, ~near):
                chart.plot(setup.depth[part], setup.predicted[index, part], color=color, linewidth=1.5,
                           label=axis if part is near else None)  # fmt: skip
            chart.plot(setup.depth[::4], setup.measured[index, ::4], marker, color=color, markersize=4)
        chart.set_xscale("log")
        chart.set_yscale("log")
        jumps = ", ".join(f"{axis} ×{jump:.2f}" for axis, jump in zip(("m_x", "m_z"), setup.jump_measured, strict=True))
        mark_x(chart, setup.planes[1], "cut", color=PALETTE[1])
        label(chart, "depth of the floor (metres)", "pixels per texel", f"jumps: {jumps}")
        chart.legend(loc="lower left")
    low = min(setup.predicted.min() for setup in result.setups.values())
    high = max(setup.predicted.max() for setup in result.setups.values())
    for spot in axes[1]:
        spot.set_ylim(low / 1.5, high * 1.5)
        for axis in (spot.xaxis, spot.yaxis):
            axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
            axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
            axis.set_minor_formatter(NullFormatter())
    return figure
