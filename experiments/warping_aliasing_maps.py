"""warping, equations 11 to 15: aliasing error of every pixel of a scene, split in perspective and projection error.

A walker looks along an avenue; the sun stands behind him, at a given angle to the view and in its vertical plane. For
every pixel m says how many pixels one texel decides. It is a product: *perspective* error w_l/w_c, which depends on
where the texels are, and *projection* error cos θ_c/cos θ_l, which depends on the surface and is the same for every
map. All maps have equally many texels.

Measured: both projections, of points to pixels and of points to texels, are differentiated along the surface that each
pixel sees. The areas that corner rays cut out of the surface must agree. Perspective error must be what the source's
formulas say: m_x·m_z/cos α, with the view angle α of the pixel that eqs 16 and 17 leave out. The real maps reach 0.1 %
beyond the view on each side, so that nothing falls on their border; the claim's bound is what that can add.

How to read it: white is one texel per pixel, orange is too coarse (jagged edges), blue is finer than needed (wasted).
Grey is sky or turned away from the light.
"""

import itertools
import math
from dataclasses import dataclass
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure

from experiments.base import Claim
from experiments.claiming import agrees, all_true, at_most
from experiments.warped_views import check_count, check_gamma, in_double
from shadowjax import scenes
from shadowjax._checks import require, require_int
from shadowjax._types import Array
from shadowjax.evaluate.measure import AliasingMap, aliasing_map, footprint
from shadowjax.geometry.camera import Camera
from shadowjax.geometry.light import DirectionalLight
from shadowjax.partitions.base import Partition
from shadowjax.partitions.cascades import Cascades
from shadowjax.partitions.single import SingleMap
from shadowjax.plotting import new_figure, show_image, styled
from shadowjax.plotting.style import DIFFERENCE
from shadowjax.rays.brute import BruteForceCaster
from shadowjax.rays.ray_grid import RayGrid, camera_grid
from shadowjax.shading import Surface, shade, trace_surface, valid_receivers
from shadowjax.theory.aliasing.error import error_x, error_z, max_error_z
from shadowjax.theory.aliasing.light_frustum import LightFrustum
from shadowjax.warps.fit import NEAR_DISTANCES, LogarithmicFit, PerspectiveFit, light_frustum, visible_range

UNIFORM, LISPSM, BEST, LOGARITHMIC, SLICED = "uniform", "LiSPSM", "optimal n'", "logarithmic", "4 slices, optimal n'"
RULES = {UNIFORM: "uniform", LISPSM: "lispsm", BEST: "minimax"}
PARTITIONS: dict[str, Partition] = {
    **{name: SingleMap(PerspectiveFit(rule)) for name, rule in RULES.items()},
    LOGARITHMIC: SingleMap(LogarithmicFit()),
    SLICED: Cascades(4, warp=PerspectiveFit("minimax")),
}
SLICES = 4
FINER = 64  # of the cells whose areas are compared, so that their size does not matter
PADDED = 1e-3  # by which a map reaches beyond the view on each side
SCALE = 64.0  # largest error shown


@dataclass(frozen=True)
class Config:
    """Settings.

    Attributes:
        scene: A built-in scene.
        num_triangles: About that many.
        gamma_deg: Angle between light and view, degrees.
        width: Pixels across.
        height: Pixels down.
        resolution: Texels along each side of a map, even; each of the four slices has half as many.
    """

    scene: str = "avenue"
    num_triangles: int = 6564
    gamma_deg: float = 50.0
    width: int = 320
    height: int = 240
    resolution: int = 640

    def __post_init__(self):
        low, high = scenes.family(self.scene).min_triangles, scenes.family(self.scene).max_triangles
        require(low <= self.num_triangles <= high, f"num_triangles must lie between {low} and {high}")
        check_gamma(self.gamma_deg)
        check_count(self.width, "width", 16)
        check_count(self.height, "height", 12)
        require_int(self.resolution, "resolution", 2)
        require(self.resolution % 2 == 0, f"resolution must be even; got {self.resolution}")


@dataclass(frozen=True)
class Result:
    """Errors of every pixel.

    Attributes:
        config: The settings.
        picture: What the camera sees, sRGB, without shadows.
        valid: Where a surface faces the light.
        projection: cos θ_c/cos θ_l.
        perspective: Map → w_l/w_c by areas.
        total: Map → m.
        predicted: Map → m_x·m_z/cos α by formula; the four slices and the three rules.
        room: Map → largest factor that the margin of the map can add, for each pixel.
        cut: Map → m by areas that corner rays cut out.
        axis_error: Map → M_z on the view axis by formula, for the three rules.
    """

    config: Config
    picture: np.ndarray
    valid: np.ndarray
    projection: np.ndarray
    perspective: dict[str, np.ndarray]
    total: dict[str, np.ndarray]
    predicted: dict[str, np.ndarray]
    room: dict[str, np.ndarray]
    cut: dict[str, np.ndarray]
    axis_error: dict[str, float]


@eqx.filter_jit
def _measure(
    camera: RayGrid, shadow_map: RayGrid, fine: tuple[RayGrid, RayGrid], surface: Surface
) -> tuple[AliasingMap, Array]:
    """Errors by derivatives, and m as a ratio of cut areas."""
    points, normals = surface.points, surface.normals
    areas = [footprint(grid, grid.locate(points)[0], points, normals) for grid in fine]
    return aliasing_map(camera, shadow_map, points, normals), areas[1] / jnp.where(areas[0] > 0, areas[0], 1)


@eqx.filter_jit
def _predict(frustum: LightFrustum, distance: Array, camera: Camera, surface: Surface) -> Array:
    """m_x·m_z/cos α of every pixel at equal resolutions."""
    x, y, z = jnp.moveaxis(camera.to_view(surface.points), -1, 0)
    z = jnp.where(surface.is_seen, z, camera.near)
    cosine = z / jnp.sqrt(x * x + y * y + z * z)
    return error_x(frustum, distance, z, y) * error_z(frustum, distance, z, y) / cosine


def _finer(grid: RayGrid) -> RayGrid:
    return RayGrid(grid.space, grid.plane_map, grid.far, FINER * grid.num_rows, FINER * grid.num_cols)


@in_double
def run(config: Config) -> Result:
    """Trace the camera's rays once, then measure every map."""
    scene = scenes.make_scene(config.scene, config.num_triangles, jnp.float64)
    mesh, camera, gamma = scene.mesh, scene.camera, math.radians(config.gamma_deg)
    direction = math.cos(gamma) * camera.forward - math.sin(gamma) * camera.up
    light = DirectionalLight.create(direction, dtype=jnp.float64)
    surface = trace_surface(mesh, camera, config.width, config.height, BruteForceCaster())
    valid = np.asarray(eqx.filter_jit(valid_receivers)(surface, light))
    picture = shade(surface, (light,), (jnp.ones_like(surface.depth),))
    image_grid = camera_grid(camera, config.width, config.height)
    near, far = visible_range(camera, mesh)
    result = Result(config, np.asarray(picture), valid, np.ones(valid.shape), {}, {}, {}, {}, {}, {})
    pixels = config.width * config.height
    for name, partition in PARTITIONS.items():
        resolution = config.resolution // (2 if name == SLICED else 1)
        grids = partition.grids(mesh, light, camera, resolution)
        region = np.asarray(partition.select(grids, camera, surface.points))
        planes = partition.planes(mesh, light, camera) if isinstance(partition, Cascades) else jnp.stack([near, far])
        parts = []
        for index, grid in enumerate(grids):
            found, cut = _measure(image_grid, grid, (_finer(image_grid), _finer(grid)), surface)
            frustum = light_frustum(camera, light.direction, planes[index], planes[index + 1])
            distance = NEAR_DISTANCES[RULES.get(name, "minimax")](frustum)
            if name in RULES:
                result.axis_error[name] = float(max_error_z(frustum, distance))
            result.projection[:] = np.asarray(found.projection)
            room = (1 + 2 * PADDED) ** 2 * (1 + PADDED * frustum.extent / distance) ** 3
            predicted = _predict(frustum, distance, camera, surface) * pixels / resolution**2
            parts.append((found.perspective, found.total, predicted, jnp.broadcast_to(room, cut.shape), cut))
        chosen = [np.choose(region, [np.asarray(part[i]) for part in parts]) for i in range(5)]
        result.perspective[name], result.total[name] = chosen[:2]
        result.cut[name] = chosen[4]
        if name != LOGARITHMIC:
            result.predicted[name], result.room[name] = chosen[2:4]
    return result


def largest(result: Result, errors: dict[str, np.ndarray], name: str) -> float:
    """Largest error of a map over valid pixels."""
    return float(errors[name][result.valid].max())


def typical(result: Result, errors: dict[str, np.ndarray], name: str) -> float:
    """Geometric mean of an error over valid pixels."""
    return float(np.exp(np.log(errors[name][result.valid]).mean()))


def claims(result: Result) -> tuple[Claim, ...]:
    """Three routes to one error, and the order of the maps."""
    valid = result.valid
    steep = valid & (result.projection < 20)  # of what grazes more, a finite cell reaches too far
    ratio = {name: (result.perspective[name] / result.predicted[name])[valid] for name in result.predicted}
    kept = {name: (ratio[name] >= 1 - 1e-9) & (ratio[name] <= result.room[name][valid] * (1 + 1e-9)) for name in ratio}
    worst = {name: largest(result, result.perspective, name) for name in PARTITIONS}
    mean = {name: typical(result, result.perspective, name) for name in PARTITIONS}
    names = [UNIFORM, LISPSM, BEST]
    spread = max(float((room[valid] - 1).max()) for room in result.room.values())
    product = {name: result.perspective[name] * result.projection for name in PARTITIONS}
    return (
        *(
            agrees(f"{name}: areas cut out by corner rays give m", result.cut[name][steep], result.total[name][steep],
                   1e-3)
            for name in (UNIFORM, SLICED)
        ),
        all_true("m is perspective times projection error for every map and pixel",
                 [np.allclose(product[name][valid], result.total[name][valid], rtol=1e-9) for name in PARTITIONS],
                 "maps"),
        *(
            Claim(f"{name}: perspective error is m_x·m_z/cos α at every pixel", bool(kept[name].all()),
                  f"between {ratio[name].min():.6f} and {ratio[name].max():.6f} times that",
                  f"from 1 to what the margin adds, at most {1 + spread:.4f}")
            for name in kept
        ),
        at_most("on the view axis the optimal n' has the least M_z of the three", result.axis_error[BEST],
                min(result.axis_error.values())),
        all_true("the largest perspective error seen falls from uniform over LiSPSM to the optimal n'",
                 [worst[a] > worst[b] for a, b in itertools.pairwise(names)], "steps"),
        Claim("four slices and the logarithmic map have less at most, and on the whole, than one optimal warp",
              all(found[name] < found[BEST] for found in (worst, mean) for name in (SLICED, LOGARITHMIC)),
              f"{worst[SLICED]:.3g} and {worst[LOGARITHMIC]:.3g}", f"less than {worst[BEST]:.3g}"),
    )  # fmt: skip


def numbers(result: Result) -> dict[str, Any]:
    """Largest and typical errors."""
    return {
        "pixels": int(result.valid.sum()),
        "largest_perspective": {name: largest(result, result.perspective, name) for name in PARTITIONS},
        "typical_perspective": {name: typical(result, result.perspective, name) for name in PARTITIONS},
        "typical_total": {name: typical(result, result.total, name) for name in PARTITIONS},
        "largest_m_z_on_axis_at_equal_resolution": result.axis_error,
    }


def _show(spot: Axes, error: np.ndarray, valid: np.ndarray, title: str, caption: str = "") -> None:
    """One map of an error in colours."""
    colors = np.asarray(DIFFERENCE(LogNorm(1 / SCALE, SCALE, clip=True)(np.where(valid, error, 1.0))))[..., :3]
    show_image(spot, np.where(valid[..., None], colors, 0.78), title, caption)


@styled
def draw(result: Result) -> Figure:
    """Picture and projection error on the left; perspective error over m for every map."""
    columns = 1 + len(PARTITIONS)
    figure, axes = new_figure(13.6, 4.15, 2, columns)
    show_image(axes[0, 0], result.picture, "the view", f"light at γ = {result.config.gamma_deg:g}° from behind")
    _show(axes[1, 0], result.projection, result.valid, "projection error", "the same for every map")
    for column, name in enumerate(PARTITIONS, 1):
        for row, errors in enumerate((result.perspective, result.total)):
            told = f"at most {largest(result, errors, name):.2g}, typical {typical(result, errors, name):.2g}"
            _show(axes[row, column], errors[name], result.valid, name if row == 0 else "", told)
    for row, name in enumerate(("perspective error", "m, their product")):
        axes[row, 1].set_ylabel(name, fontsize=9)
    bar = figure.colorbar(ScalarMappable(LogNorm(1 / SCALE, SCALE), DIFFERENCE), ax=axes, fraction=0.02, pad=0.01,
                          ticks=[1 / 64, 1 / 16, 1 / 4, 1, 4, 16, 64])  # fmt: skip
    bar.ax.set_yticklabels(["1/64", "1/16", "1/4", "1", "4", "16", "64"])
    bar.ax.minorticks_off()
    bar.set_label("pixels per texel (areas)")
    return figure
