"""Inverse problem: where sun and camera should stand so that one warped shadow map aliases least.

A camera looks at a subject from a fixed distance; its height is free within limits, and so are the sun's height and
its turn about the subject, and n' of the map. The mean number of pixels that a texel decides, m, has a closed form over
the pixels that see the ground (`optimize.viewed.seen_pixels`: perspective error by four moments, projection error by
cosines). JAX gives its slope in all four; L-BFGS-B within bounds lowers its logarithm from several starts. Lenses and
limits are random.

Measured: slopes against central differences; a brute-force grid over all four parameters, of which no point may be
better; the slope that is left, and the bounds that hold the answer; how many starts reach it. The formula knows the
bare ground only. So blocks are put on it, the camera's rays are cast, and the texels of the real map are projected into
the picture at what each pixel sees: the same grid of suns and cameras is measured, ranks are compared, and the best
place by formula against the best that was measured. On the bare ground formula and texels agree; walls that the sun
grazes are what the formula does not know.

How to read it: left, the formula over the sun's place for the best camera, with the searches' ends; middle, measured
against formula for every sun and camera tried; right, how much more than the best every start of every scene ends with.
"""

from dataclasses import dataclass
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from scipy.stats import spearmanr

from experiments.base import Claim
from experiments.claiming import all_true, at_most
from shadowjax import DirectionalLight, Mesh
from shadowjax._checks import require_int
from shadowjax._types import Array, Scalar
from shadowjax.evaluate.measure import aliasing_map
from shadowjax.geometry.camera import Camera
from shadowjax.optimize.solution import Solution
from shadowjax.optimize.solvers.bounded import SearchCertificate, minimise_multistart
from shadowjax.optimize.viewed.seen_pixels import STEEPEST, chart_between, mean_error, seen_pixels
from shadowjax.plotting import PALETTE, label, new_figure, styled
from shadowjax.rays.brute import BruteForceCaster
from shadowjax.rays.ray_grid import RayGrid, camera_grid
from shadowjax.scenes.primitives import box
from shadowjax.shading import Surface, trace_surface, valid_receivers
from shadowjax.warps.fit import view_axis
from shadowjax.warps.perspective import PerspectiveWarp

DISTANCE = 10.0  # metres from the camera to the subject
NEARLY = 1e-3  # excess in ln m that counts as the best
BESIDE = 512  # points near each answer that are tried
STEPS = (5, 5, 24, 16)  # of the grid: camera's height, sun's height, its turn, bend
MEASURED = (3, 3, 8)  # of those, how many cameras, heights and turns are measured


@dataclass(frozen=True)
class Config:
    """Settings.

    Attributes:
        num_seeds: Random lenses and limits, ≥ 1.
        num_starts: Random starts of each search, ≥ 2.
        width: Pixels along a side of the picture, ≥ 16.
        num_blocks: Blocks on the measured ground, ≥ 1.
    """

    num_seeds: int = 8
    num_starts: int = 8
    width: int = 48
    num_blocks: int = 6

    def __post_init__(self):
        require_int(self.num_seeds, "num_seeds", 1)
        require_int(self.num_starts, "num_starts", 2)
        require_int(self.width, "width", 16)
        require_int(self.num_blocks, "num_blocks", 1)


@dataclass(frozen=True)
class Found:
    """One lens with its limits. Parameters are the camera's and the sun's height and the sun's turn, radians, and bend.

    Attributes:
        phi: Half the angle of view, radians.
        lower, upper: Limits.
        search: Of ln m.
        grid: Least ln m of every sun and camera on the grid, over bends; camera, height, turn.
        axes: The grid's values.
        slopes: At the first start, by program and by central differences.
        formula: ln m by formula where it was measured.
        bare: ln m measured on the bare ground.
        measured: The same among blocks.
        here: ln m measured at the search's answer.
        next to: Least ln m of random points near the answer.
    """

    phi: float
    lower: np.ndarray
    upper: np.ndarray
    search: Solution[np.ndarray, SearchCertificate]
    grid: np.ndarray
    axes: tuple[np.ndarray, ...]
    slopes: tuple[np.ndarray, np.ndarray]
    formula: np.ndarray
    bare: np.ndarray
    measured: np.ndarray
    here: float
    beside: float


@dataclass(frozen=True)
class Result:
    """All lenses."""

    found: tuple[Found, ...]


def _camera(height: Scalar, phi: Scalar) -> Camera:
    """On a circle about the subject."""
    zero = jnp.zeros_like(height)
    position = DISTANCE * jnp.stack([-jnp.cos(height), jnp.sin(height), zero])
    return Camera.look_at(position, jnp.zeros(3), phi_y=phi, near=jnp.asarray(0.1), far=jnp.asarray(1000.0))


def _sun(height: Scalar, turn: Scalar) -> DirectionalLight:
    """A turn of 0 stands before the camera, behind the subject."""
    away = jnp.stack([jnp.cos(height) * jnp.cos(turn), jnp.sin(height), jnp.cos(height) * jnp.sin(turn)])
    return DirectionalLight(-away, jnp.ones(3))


def _log_error(x: Array, phi: Scalar, width: int) -> Scalar:
    """ln of the mean m over pixels of the bare ground."""
    camera, sun = _camera(x[0], phi), _sun(x[1], x[2])
    rays = camera_grid(camera, width, width).rays()
    depth = -rays.origins[..., 1] / rays.directions[..., 1]
    up = jnp.broadcast_to(jnp.asarray([0.0, 1.0, 0.0]), rays.directions.shape)
    face = jnp.zeros(depth.shape, jnp.int32)
    surface = Surface(rays.at(depth), up, up, up, -rays.directions, depth, face)
    pixels = seen_pixels(surface, camera, sun, projection=True)
    extent = chart_between(pixels, pixels.frustum.near, pixels.frustum.far).extent
    mean = mean_error(pixels, extent * (1 - x[3]) / jnp.maximum(x[3], 1e-9))
    return jnp.log(mean * jnp.sum(pixels.weight) / pixels.weight.shape[0])


@eqx.filter_jit
def _both(x: Array, phi: Array, width: int) -> tuple[Array, Array]:
    return jax.value_and_grad(_log_error)(x, phi, width)


@eqx.filter_jit
def _many(points: Array, phi: Array, width: int) -> Array:
    return jax.lax.map(lambda x: _log_error(x, phi, width), points, batch_size=256)


@eqx.filter_jit
def _measure(mesh: Mesh, points: Array, phi: Array, width: int) -> Array:
    """ln of the mean m over what the camera sees of a scene, by projecting texels; one point after the other."""

    def one(x: Array) -> Array:
        camera, sun = _camera(x[0], phi), _sun(x[1], x[2])
        surface = trace_surface(mesh, camera, width, width, BruteForceCaster())
        valid = valid_receivers(surface, sun)
        depth = (surface.points - camera.position) @ camera.forward
        near, far = jnp.min(jnp.where(valid, depth, jnp.inf)), jnp.max(jnp.where(valid, depth, 0.0))
        space = sun.space(camera.forward, *mesh.bounds())
        part = eqx.tree_at(lambda c: (c.near, c.far), camera, (near, far))
        corners, axis = space.project(part.frustum_corners())[0], view_axis(space, camera)
        extent = jnp.max(corners @ axis) - jnp.min(corners @ axis)
        warp = PerspectiveWarp.fit(corners, x[3] / (1 - x[3]) / extent, axis)
        grid = RayGrid(space, warp, jnp.asarray(1000.0), width, width)
        found = aliasing_map(camera_grid(camera, width, width), grid, surface.points, surface.normals)
        each = found.perspective * jnp.minimum(found.projection, STEEPEST)
        return jnp.log(jnp.sum(jnp.where(valid, each, 0.0)) / jnp.sum(valid.astype(each.dtype)))

    return jax.lax.map(one, points)


def _blocks(config: Config, seed: int) -> Mesh:
    """Random blocks on a wide ground."""
    rng = np.random.default_rng(seed)
    parts = [box((-400.0, -0.2, -400.0), (400.0, 0.0, 400.0))]
    for _ in range(config.num_blocks):
        x, z = rng.uniform(-2, 2, 2)
        half, height = rng.uniform(0.15, 0.35), rng.uniform(0.3, 1.2)
        parts.append(box((x - half, 0.0, z - half), (x + half, height, z + half)))
    sizes = np.cumsum([0] + [len(part.vertices) for part in parts])
    faces = np.concatenate([part.faces + size for part, size in zip(parts, sizes[:-1], strict=True)])
    return Mesh.create(np.concatenate([part.vertices for part in parts]), faces, dtype=jnp.float64)


def run(config: Config) -> Result:
    """All searches, in double precision."""
    with jax.enable_x64(True):
        return Result(tuple(_search(config, seed) for seed in range(config.num_seeds)))


def _search(config: Config, seed: int) -> Found:
    rng = np.random.default_rng(seed)
    phi = np.radians(rng.uniform(10, 20))
    lower = np.array([phi + np.radians(rng.uniform(4, 10)), np.radians(rng.uniform(15, 30)), -np.pi, 0.0])
    upper = np.array([np.radians(rng.uniform(35, 60)), np.radians(rng.uniform(45, 75)), np.pi, 0.95])
    lens = jnp.asarray(phi)

    def both(x: Any) -> tuple[Array, Array]:
        return _both(jnp.asarray(x), lens, config.width)

    starts = rng.uniform(lower, upper, (config.num_starts, 4))
    search = minimise_multistart(both, starts, lower, upper)
    axes = tuple(np.linspace(low, high, count) for low, high, count in zip(lower, upper, STEPS, strict=True))
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    values = np.asarray(_many(jnp.asarray(points.reshape(-1, 4)), lens, config.width)).reshape(STEPS)
    # Where the answer lies on a kink, its slope says little: look around it.
    spread = np.geomspace(1e-4, 5e-2, BESIDE)[:, None] * (upper - lower) * rng.uniform(-1, 1, (BESIDE, 4))
    beside = np.clip(search.value + spread, lower, upper)
    step = 1e-6
    central = [(both(starts[0] + step * unit)[0] - both(starts[0] - step * unit)[0]) / (2 * step) for unit in np.eye(4)]
    slopes = np.asarray(both(starts[0])[1]), np.array([float(x) for x in central])
    cameras, heights = (np.linspace(0, STEPS[k] - 1, MEASURED[k]).astype(int) for k in range(2))
    # The last turn is the first one.
    turns = np.linspace(0, STEPS[2] - 1, MEASURED[2] + 1).astype(int)[:-1]
    chosen = np.ix_(cameras, heights, turns)
    best = np.take_along_axis(points, values.argmin(axis=-1)[..., None, None], axis=-2)[..., 0, :]
    some = np.concatenate([best[chosen].reshape(-1, 4), search.value[None]])
    scene = _blocks(config, seed)
    measured = np.asarray(_measure(scene, jnp.asarray(some), lens, config.width))
    # The same mesh with its blocks sunk under the ground is the formula's own scene.
    sunk = eqx.tree_at(lambda mesh: mesh.vertices, scene, scene.vertices.at[8:, 1].add(-5.0))
    bare = np.asarray(_measure(sunk, jnp.asarray(some), lens, config.width))[:-1]
    formula = values.min(axis=-1)[chosen].reshape(-1)
    near = float(np.asarray(_many(jnp.asarray(beside), lens, config.width)).min())
    return Found(float(phi), lower, upper, search, values.min(axis=-1), axes[:3], slopes, formula, bare, measured[:-1],
                 float(measured[-1]), near)  # fmt: skip


def claims(result: Result) -> tuple[Claim, ...]:
    """Searches find the grid's minimum, and the formula ranks places as a measurement does."""
    found = result.found
    away = [np.abs(a - b).max() / np.abs(b).max() for a, b in (one.slopes for one in found)]
    below = np.array([one.grid.min() - one.search.objective_value for one in found])
    near = np.array([one.beside - one.search.objective_value for one in found])
    reached = [one.search.certificate.reached(NEARLY) for one in found]
    starts = sum(len(one.search.certificate.losses) for one in found)
    ranks = np.array([spearmanr(one.formula, one.measured)[0] for one in found])
    bare = [np.abs(np.exp(one.formula - one.bare) - 1).max() for one in found]
    lost = np.exp([one.here - one.measured.min() for one in found])
    worse = np.exp([np.median(one.measured) - one.here for one in found])
    ended = sum(bool(one.search.converged) for one in found)
    held = sum(bool(one.search.certificate.at_bound.any()) for one in found)
    return (
        at_most("slope against central differences, relative", away, 1e-4),
        Claim(
            "no point of the grid is better than the search", bool((below > -1e-9).all()),
            f"the grid's best is ×{np.exp(below.min()):.4f} to ×{np.exp(below.max()):.4f} of the search's",
            "at least ×1",
        ),
        Claim(
            "no point near the answer is better by a hundredth", bool((near > -0.01).all()),
            f"the best near it is ×{np.exp(near.min()):.5f} to ×{np.exp(near.max()):.5f} of the answer's",
            "at least ×0.99",
        ),
        Claim(
            "the best is found from more than one start in every scene", min(reached) >= 2,
            f"{sum(reached)} of {starts} starts in all, at least {min(reached)} in each", "at least 2 in each",
        ),
        Claim(
            "every search says whether no way down is left", all(one.search.certificate.reason for one in found),
            f"{ended} of {len(found)} have converged, {held} on a bound; largest "
            f"free slope {max(one.search.certificate.slope for one in found):.2g}", "a reason each",
        ),
        at_most("formula against measured texels on the bare ground, relative", bare, 1e-6),
        Claim(
            "refuted: blocks leave the ranks of places as they are", bool((ranks < 0.99).any()),
            f"rank correlation of formula and measurement {ranks.min():.3f} to {ranks.max():.3f}",
            "below 0.99 somewhere",
        ),
        at_most("measured at the answer, over the best place that was measured", lost, 1.1),
        Claim(
            "the answer is measured better than the median place", bool((worse > 1).all()),
            f"×{worse.min():.2f} to ×{worse.max():.2f}", "all more than ×1",
        ),
        all_true("all measured errors are finite", [np.isfinite(one.measured).all() for one in found], "scenes"),
    )  # fmt: skip


def numbers(result: Result) -> dict[str, Any]:
    """Answers and errors."""
    return {
        "scenes": [
            {
                "phi_deg": np.degrees(one.phi), "lower": one.lower, "upper": one.upper,
                "camera_sun_turn_bend": one.search.value, "log_error": float(one.search.objective_value),
                "ends": one.search.certificate.ends,
                "losses": one.search.certificate.losses, "reasons": one.search.certificate.reasons,
                "slope": one.search.certificate.slope,
                "grid": one.grid.min(), "formula": one.formula, "bare": one.bare, "measured": one.measured,
                "measured_here": one.here,
            }
            for one in result.found
        ]
    }  # fmt: skip


def _chart(figure: Figure, spot: Any, one: Found) -> None:
    """ln m over the sun's place, for the camera that is best on the grid."""
    camera = int(one.grid.min(axis=(1, 2)).argmin())
    turns, heights = np.degrees(one.axes[2]), np.degrees(one.axes[1])
    shown = spot.contourf(turns, heights, one.grid[camera], 16, cmap="cividis")
    bar = figure.colorbar(shown, ax=spot, label="ln of the mean pixels a texel", format="%.1f")
    bar.locator = MaxNLocator(5)
    bar.update_ticks()
    spot.set_xticks([-180, -90, 0, 90, 180])
    label(spot, "sun's turn (degrees)", "sun's height (degrees)", "")


@styled
def draw(result: Result) -> Figure:
    """The landscape, formula against measurement, and the searches."""
    figure, axes = new_figure(11.8, 4.0, 1, 3)
    left, middle, right = axes[0]
    first = result.found[0]
    _chart(figure, left, first)
    near = first.search.certificate.losses <= float(first.search.objective_value) + NEARLY
    for chosen, color, name in ((~near, "w", "another end"), (near, PALETTE[1], "the best end")):
        height, turn = np.degrees(first.search.certificate.ends[chosen, 1:3]).T
        left.plot(turn, height, "o", color=color, markeredgecolor="k", label=name, clip_on=False)
    left.legend(fontsize=8, loc="lower center", ncols=2, frameon=True, facecolor="w", framealpha=0.9)
    left.set_title("Formula, and ends of searches", loc="left")
    for index, one in enumerate(result.found):
        color = PALETTE[index % len(PALETTE)]
        middle.loglog(np.exp(one.formula), np.exp(one.measured), ".", color=color, ms=4)
        middle.loglog(
            np.exp(one.search.objective_value), np.exp(one.here), "*", color=color, ms=11, markeredgecolor="k"
        )
    ends = np.exp(np.concatenate([one.formula for one in result.found]))
    middle.plot([ends.min(), ends.max()], [ends.min(), ends.max()], color="k", lw=0.8)
    label(middle, "mean pixels a texel, formula", "measured among blocks", "Stars: answers of the searches")
    for index, one in enumerate(result.found):
        over = np.maximum(np.sort(one.search.certificate.losses) - one.search.objective_value, 1e-9)
        right.semilogy(np.arange(len(over)) + 1, over, ".-", color=PALETTE[index % len(PALETTE)])
    right.xaxis.get_major_locator().set_params(integer=True)
    right.axhline(NEARLY, color="k", lw=0.8)
    label(right, "start, best first", "excess of ln m", "Ends of all starts")
    return figure


@styled
def animate(result: Result) -> list[Figure]:
    """The best search of the first scene on the map of ln m; next to it, the camera's height and n'."""
    one = result.found[0]
    history = one.search.certificate.history
    shown = np.linspace(0, len(history) - 1, 12).astype(int)
    frames = []
    for index in shown:
        figure, axes = new_figure(7.2, 2.8, 1, 2)
        chart, bars = axes[0]
        _chart(figure, chart, one)
        path = np.degrees(history[: index + 1])
        chart.plot(path[:, 2], path[:, 1], "-", color="w")
        chart.plot(path[-1, 2], path[-1, 1], "o", color=PALETTE[1], markeredgecolor="k", clip_on=False)
        share = (history[index] - one.lower) / (one.upper - one.lower)
        bars.barh(["camera's height", "sun's height", "sun's turn", "bend of the warp"], share, color=PALETTE[0])
        bars.set_xlim(0, 1)
        label(bars, "between its limits", "", f"step {index}")
        frames.append(figure)
    return frames


__all__ = ["Config", "Result", "animate", "claims", "draw", "numbers", "run"]
