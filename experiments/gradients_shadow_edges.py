"""Gradients that see shadows' edges, against closed forms and finely sampled differences.

A plate, two plates that overlap, a tetrahedron and a faceted sphere cast shadows on a plane. The area of each shadow
has a closed form; its derivative in every vertex and in the light's position is compared with that of the picture's
sum.

Then triangles that hide one another are moved at random. An image loss (the picture times smooth weights) changes;
its slope by reverse mode is compared with central differences of visibility sampled at many places in each pixel.
Left: the sphere's shadow. Middle: how each pixel changes when the sphere moves to the right; only the border does.
Right: the error of every case.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure

from experiments.base import Claim
from experiments.claiming import at_most
from shadowjax import Mesh, MeshEdges, PointLight, RayGrid, Receiver, mesh_edges, plane_receiver, shadow_picture
from shadowjax._checks import require, require_int
from shadowjax._types import Array
from shadowjax.geometry.scenes.closed_forms import ReceivingPlane, project
from shadowjax.geometry.scenes.plate_over_plane import PlateOverPlane
from shadowjax.geometry.scenes.shadow_moments import convex_shadow_moments, polygon_moments, union_moments
from shadowjax.geometry.scenes.sphere_over_plane import SphereOverPlane
from shadowjax.geometry.scenes.two_plates import TwoPlates
from shadowjax.plotting import PALETTE, label, new_figure, styled
from shadowjax.rays.brute import BruteForce
from shadowjax.rays.grid import Grid
from shadowjax.rays.light_space import light_space

LOWER, UPPER = (-3.2, -3.0), (2.6, 3.1)
LAMP = (0.9, 4.1, -0.4)
TETRAHEDRON = [(0.5, 0.8, 0.1), (-0.6, 0.9, 0.7), (-0.2, 0.7, -0.8), (-0.1, 1.6, 0.05)]
TETRAHEDRON_FACES = [[0, 1, 2], [0, 3, 1], [1, 3, 2], [2, 3, 0]]


@dataclass(frozen=True)
class Config:
    """Settings.

    Attributes:
        resolution: Pixels along a side of the picture, ≥ 8.
        num_seeds: Random scenes, ≥ 1.
        num_triangles: Triangles of each, ≥ 2.
        samples_per_axis: Samples along a side of a pixel for the differences, ≥ 2.
        step: Half the distance of the differences, world units.
        frequency: Pieces of an edge of the icosahedron that the sphere is made from, ≥ 1.
    """

    resolution: int = 256
    num_seeds: int = 6
    num_triangles: int = 12
    samples_per_axis: int = 6
    step: float = 0.02
    frequency: int = 12

    def __post_init__(self):
        require_int(self.resolution, "resolution", 8)
        require_int(self.num_seeds, "num_seeds", 1)
        require_int(self.num_triangles, "num_triangles", 2)
        require_int(self.samples_per_axis, "samples_per_axis", 2)
        require_int(self.frequency, "frequency", 1)
        require(self.step > 0, f"step must be positive; got {self.step}")


@dataclass(frozen=True)
class Result:
    """Errors and pictures.

    Attributes:
        names: Of the scenes with a closed form.
        area: Relative error of the area.
        gradient: Largest error of its derivative, as part of the largest derivative.
        modes: Relative difference of forward and reverse mode, every scene.
        differences: Relative error against sampled differences, every seed.
        picture: The sphere's shadow.
        slope: Change of every pixel as the sphere moves along u by a pixel.
    """

    names: tuple[str, ...]
    area: np.ndarray
    gradient: np.ndarray
    modes: np.ndarray
    differences: np.ndarray
    picture: np.ndarray
    slope: np.ndarray


@dataclass(frozen=True)
class _Stage:
    """Receiver, view and light that all scenes share, with the plane's own coordinates."""

    plane: ReceivingPlane
    receiver: Receiver
    view: RayGrid
    light: PointLight
    cell: float

    def summed(self, weights: Array, mesh: Mesh, edges: MeshEdges) -> Callable[[Array, Array], Array]:
        """The dark part of the picture times weights, from vertices and the light's position."""
        return lambda vertices, position: jnp.sum(weights * (1 - self.picture(vertices, position, mesh, edges)))

    def picture(self, vertices: Array, position: Array, mesh: Mesh, edges: MeshEdges) -> Array:
        """The shadow picture."""
        moved = Mesh(vertices, mesh.faces, mesh.face_colors)
        caster = BruteForce() if mesh.num_faces <= 256 else Grid()
        lamp = PointLight(position, self.light.color)
        return shadow_picture(moved, edges, lamp, self.view, caster, self.receiver)


def _stage(resolution: int) -> _Stage:
    plane = ReceivingPlane.horizontal(jnp.asarray(0.0, jnp.float64))
    lower, upper = (jnp.asarray(corner, jnp.float64) for corner in (LOWER, UPPER))
    receiver, view = plane_receiver(plane.origin, plane.axis_u, plane.axis_v, lower, upper, (resolution, resolution))
    light = PointLight.create(LAMP, dtype=jnp.float64)
    return _Stage(plane, receiver, view, light, float(jnp.prod(upper - lower)) / resolution**2)


def _quads(corners: Array) -> Mesh:
    corners = corners.reshape(-1, 4, 3)
    faces = np.array([[0, 1, 2], [0, 2, 3]])[None] + 4 * np.arange(len(corners))[:, None, None]
    return Mesh.create(np.asarray(corners).reshape(-1, 3), faces.reshape(-1, 3), dtype=jnp.float64)


def _closed_scenes(stage: _Stage, frequency: int) -> dict[str, tuple[Mesh, Callable[[Array, PointLight], Array]]]:
    """Meshes, and the area of the shadow of each."""
    ball = SphereOverPlane(frequency=frequency).ball()
    faces = {"tetrahedron": np.array(TETRAHEDRON_FACES), "sphere": np.asarray(ball.faces)}

    def convex(name: str) -> Callable[[Array, PointLight], Array]:
        return lambda vertices, light: convex_shadow_moments(vertices[faces[name]], light, stage.plane).area

    def polygon(vertices: Array, light: PointLight) -> Array:
        return polygon_moments(project(vertices, light, stage.plane)).area

    def union(vertices: Array, light: PointLight) -> Array:
        return union_moments(project(vertices.reshape(2, 4, 3), light, stage.plane)).area

    two = TwoPlates(upper_x=0.4, upper_z=0.35)
    solid = Mesh.create(np.array(TETRAHEDRON), faces["tetrahedron"], dtype=jnp.float64)
    round_ = Mesh.create(np.asarray(ball.vertices, float), faces["sphere"], dtype=jnp.float64)
    return {
        "plate": (_quads(PlateOverPlane().corners()), polygon),
        "two plates": (_quads(two.corners()), union),
        "tetrahedron": (solid, convex("tetrahedron")),
        "sphere": (round_, convex("sphere")),
    }


def _random_triangles(seed: int, count: int) -> Mesh:
    """Triangles in layers: they hide one another and none crosses another."""
    rng = np.random.default_rng(seed)
    height = np.linspace(0.4, 1.9, count)[:, None]
    middle = np.concatenate([rng.uniform(-1, 0.8, (count, 1)), height, rng.uniform(-1, 1, (count, 1))], axis=1)
    corners = middle[:, None] + rng.uniform(-1, 1, (count, 3, 3)) * [0.9, 0.6 / count, 0.9]
    return Mesh.create(corners.reshape(-1, 3), np.arange(3 * count).reshape(-1, 3), dtype=jnp.float64)


def run(config: Config) -> Result:
    """Closed forms, then random scenes; in double precision."""
    with jax.enable_x64(True):
        return _run(config)


def _run(config: Config) -> Result:
    stage = _stage(config.resolution)
    full = jnp.full((config.resolution, config.resolution), stage.cell)
    scenes = _closed_scenes(stage, config.frequency)
    area, gradient, modes = [], [], []
    rng = np.random.default_rng(0)
    for mesh, closed in scenes.values():
        at = mesh.vertices, stage.light.position
        function = stage.summed(full, mesh, mesh_edges(mesh))

        def exact(vertices: Array, position: Array, closed: Callable = closed) -> Array:
            return closed(vertices, PointLight(position, stage.light.color))

        value, found = jax.value_and_grad(function, (0, 1))(*at)
        truth, wanted = jax.jit(jax.value_and_grad(exact, (0, 1)))(*at)
        area.append(abs(float(value / truth) - 1))
        gradient.append(
            max(float(jnp.max(jnp.abs(a - b)) / jnp.max(jnp.abs(b))) for a, b in zip(found, wanted, strict=True))
        )
        change = tuple(jnp.asarray(rng.normal(size=part.shape)) for part in at)
        forward = float(jax.jvp(function, at, change)[1])
        paired = sum(float(jnp.sum(a * b)) for a, b in zip(found, change, strict=True))
        modes.append(abs(forward / paired - 1))
    ball, _ = scenes["sphere"]
    width = (UPPER[0] - LOWER[0]) / config.resolution
    along = jnp.broadcast_to(jnp.asarray([width, 0.0, 0.0]), ball.vertices.shape)
    seen = mesh_edges(ball)
    picture, slope = jax.jvp(lambda v: stage.picture(v, stage.light.position, ball, seen), (ball.vertices,), (along,))
    differences = [_against_differences(stage, config, seed) for seed in range(config.num_seeds)]
    return Result(
        tuple(scenes), np.array(area), np.array(gradient), np.array(modes), np.array(differences), np.asarray(picture),
        np.asarray(slope),
    )  # fmt: skip


@jax.jit
def _dark(vertices: Array, faces: Array, weights: Array, stage_parts: tuple[Any, Array]) -> Array:
    """Weights times darkness, summed over sampled places."""
    space, points = stage_parts
    lit = Grid().visible(Mesh(vertices, faces, jnp.ones((faces.shape[0], 3))), space, points)
    return jnp.sum(weights * (1 - lit.astype(weights.dtype)))


def _against_differences(stage: _Stage, config: Config, seed: int) -> float:
    """Relative error of the slope of an image loss as the whole scene moves."""
    fine, size = config.samples_per_axis, config.resolution
    mesh = _random_triangles(seed, config.num_triangles)
    edges = mesh_edges(mesh)
    grid = RayGrid(stage.view.space, stage.view.plane_map, stage.view.far, size * fine, size * fine)
    spots = stage.view.plane_map.inverse(grid.centres())
    weights = jnp.sin(1.3 * spots[..., 0] + 0.4)
    pixels = jnp.mean(weights.reshape(size, fine, size, fine), axis=(1, 3))
    change = jnp.asarray(np.random.default_rng(seed).normal(size=3))
    slope = jax.grad(stage.summed(pixels, mesh, edges), 0)(mesh.vertices, stage.light.position)
    space = light_space(stage.light, jnp.asarray([1.0, 0.0, 0.0]), *stage.receiver.mesh.bounds())
    parts = (space, stage.plane.to_world(spots))
    low, high = (
        float(_dark(mesh.vertices + sign * config.step * change, mesh.faces, weights, parts)) for sign in (-1.0, 1.0)
    )
    expected = (high - low) / (2 * config.step) / fine**2
    return abs(float(jnp.sum(slope @ change)) / expected - 1)


def claims(result: Result) -> tuple[Claim, ...]:
    """Closed forms to rounding, differences to five per cent."""
    border = np.abs(result.slope) > 0
    inner = (result.picture == 0) | (result.picture == 1)
    return (
        at_most("areas are those of the closed forms, relative", result.area, 1e-6),
        at_most("their derivatives in vertices and light too", result.gradient, 1e-6),
        at_most("forward and reverse mode agree", result.modes, 1e-9),
        at_most("random scenes: slope against sampled differences, worst case", result.differences, 0.05),
        Claim(
            "only pixels on the border of the shadow change",
            bool((border <= ~inner).all() or (border & inner).mean() < 1e-3),
            f"{int(border.sum())} of {border.size} pixels",
            "none wholly lit or dark",
        ),
    )


def numbers(result: Result) -> dict[str, Any]:
    """Errors by scene."""
    return {
        "area_error": dict(zip(result.names, result.area, strict=True)),
        "gradient_error": dict(zip(result.names, result.gradient, strict=True)),
        "modes_difference": dict(zip(result.names, result.modes, strict=True)),
        "random_scene_error": result.differences,
    }


@styled
def draw(result: Result) -> Figure:
    """The sphere's shadow, how it changes, and errors."""
    figure, axes = new_figure(11.6, 4.0, 1, 3)
    left, middle, right = axes[0]
    extent = (LOWER[0], UPPER[0], UPPER[1], LOWER[1])
    left.imshow(result.picture, cmap="gray", vmin=0, vmax=1, extent=extent)
    label(left, "u (m)", "v (m)", "Shadow picture of a sphere: visibility")
    most = float(np.abs(result.slope).max())
    shown = middle.imshow(result.slope, cmap="RdBu", vmin=-most, vmax=most, extent=extent)
    figure.colorbar(shown, ax=middle, shrink=0.8, label="change per pixel moved")
    label(middle, "u (m)", "v (m)", "Its derivative as the sphere moves along u")
    places = np.arange(len(result.names))
    floor = 1e-16
    right.plot(np.maximum(result.area, floor), places, "o", color=PALETTE[0], label="area")
    right.plot(np.maximum(result.gradient, floor), places, "s", color=PALETTE[1], label="derivative")
    right.plot(
        result.differences, np.full(len(result.differences), len(places)), "^", color=PALETTE[2], label="random scenes"
    )
    right.set_xscale("log")
    right.set_yticks([*places, len(places)], [*result.names, "random"])
    right.axvline(1e-6, color="#1d2330", linewidth=0.8)
    right.axvline(0.05, color="#1d2330", linewidth=0.8, linestyle=":")
    right.legend(loc="lower center", fontsize=8)
    label(right, "relative error", "", "Against closed forms, and sampled differences")
    return figure
