"""Shadow art: one mesh, two lamps, two shadows that were asked for.

Measured: a ball stands between two lamps and two walls. Its vertices are moved by gradient descent until one wall shows
a heart and the other a star. The loss is the squared difference between the shadow pictures and the targets, summed
over both walls; its gradient comes through the edges of the shadows alone. A step moves each vertex with its
neighbours: steps are spread by diffusion over the mesh, so that no vertex runs ahead. Starts are balls of random turn
and size.

The loss falls by more than ten times from every start. The last shadows are checked by counting which of many places on
a wall lie behind a triangle of the mesh.

How to read it: upper row, one wall; lower row, the other; right, the loss of every start, and the mesh of the first.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure

from experiments.base import Claim
from experiments.claiming import all_true, at_most
from experiments.gradient_scenes import padded, size_of
from shadowjax import Mesh, MeshEdges, PointLight, RayGrid, Receiver, plane_receiver, shadow_picture
from shadowjax._checks import require, require_int
from shadowjax._types import Array
from shadowjax.geometry.scenes.sphere_over_plane import SphereOverPlane
from shadowjax.plotting import PALETTE, label, new_figure, show_image, styled
from shadowjax.rays.brute import BruteForce

LAMP, WALL, HALF = 6.0, -1.5, 1.5  # metres: lamps from the middle, walls behind it, half a picture's side
FINE = 8  # samples along a side of a pixel
NAMES = ("heart", "star")


@dataclass(frozen=True)
class Config:
    """Settings.

    Attributes:
        resolution: Pixels along a side of each picture, ≥ 8.
        frequency: Pieces of an edge of the icosahedron that the ball is made from, ≥ 1; 20 frequency² triangles.
        num_seeds: Starts, ≥ 1.
        num_steps: Of the descent, ≥ 8.
        rate: Largest length of a first step before it is spread, metres, > 0.
        diffusion: How far a step is spread: λ of (1 + λL)⁻¹, L the mesh's graph Laplacian; ≥ 0.
    """

    resolution: int = 40
    frequency: int = 4
    num_seeds: int = 3
    num_steps: int = 45
    rate: float = 0.15
    diffusion: float = 2.0

    def __post_init__(self):
        require_int(self.resolution, "resolution", 8)
        require_int(self.frequency, "frequency", 1)
        require_int(self.num_seeds, "num_seeds", 1)
        require_int(self.num_steps, "num_steps", 8)
        require(self.rate > 0, f"rate must be positive; got {self.rate}")
        require(self.diffusion >= 0, f"diffusion must not be negative; got {self.diffusion}")


@dataclass(frozen=True)
class Result:
    """Every descent, and the first one's pictures.

    Attributes:
        losses: Mean squared difference of a pixel; seeds × steps.
        finite: Whether every number of every gradient was finite.
        counted: Intersection over union of counted shadow and target, seeds × walls.
        miscounted: Mean difference of a pixel between the picture after and the counted shadow, seeds × walls.
        targets: Pictures, walls × rows × columns.
        steps: Steps of which the first descent's pictures and vertices are kept.
        pictures: steps × walls × rows × columns.
        vertices: steps × vertices × 3.
        faces: Of the mesh.
    """

    losses: np.ndarray
    finite: bool
    counted: np.ndarray
    miscounted: np.ndarray
    targets: np.ndarray
    steps: np.ndarray
    pictures: np.ndarray
    vertices: np.ndarray
    faces: np.ndarray


@dataclass(frozen=True)
class Wall:
    """A wall with its lamp: axis_u and axis_v in the wall, `facing` the direction to the lamp."""

    receiver: Receiver
    view: RayGrid
    light: PointLight
    axes: np.ndarray

    @classmethod
    def create(cls, facing: tuple[float, float, float], axis_u: tuple[float, float, float], resolution: int) -> "Wall":
        """A wall behind the origin, upright."""
        frame = np.array([axis_u, (0.0, 1.0, 0.0), facing])
        corner = jnp.asarray([HALF, HALF], jnp.float64)
        receiver, view = plane_receiver(
            jnp.asarray(WALL * frame[2]), jnp.asarray(frame[0]), jnp.asarray(frame[1]), -corner, corner,
            (resolution, resolution),
        )  # fmt: skip
        return cls(receiver, view, PointLight.create(LAMP * frame[2], dtype=jnp.float64), frame)

    def shadow_of(self, vertices: np.ndarray) -> np.ndarray:
        """(u, v) on the wall of the vertices' shadows."""
        u, v, w = self.axes @ vertices.T
        return np.stack([u, v], axis=-1) * ((LAMP - WALL) / (LAMP - w))[:, None]


def heart(u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Whether places lie in a heart of height 2 about the origin."""
    x, y = 1.12 * u, 1.12 * v + 0.12
    return (x * x + y * y - 1) ** 3 < x * x * y**3


def star(u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Whether places lie in a rounded star of four points, of height 2 about the origin."""
    return np.hypot(u, v) < 0.82 + 0.18 * np.cos(4 * np.arctan2(v, u))


def spots(resolution: int) -> tuple[np.ndarray, np.ndarray]:
    """(u, v) of the samples of a picture."""
    side = ((np.arange(resolution * FINE) + 0.5) / (resolution * FINE) * 2 - 1) * HALF
    u, v = np.meshgrid(side, side)
    return u, v


def in_pixels(inside: np.ndarray, resolution: int) -> np.ndarray:
    """Visibility of pixels of which samples lie in the shadow."""
    return 1 - inside.reshape(resolution, FINE, resolution, FINE).mean((1, 3))


def behind(triangles: np.ndarray, u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Whether places lie in at least one of the triangles (triangles × 3 × 2)."""
    inside = np.zeros(u.shape, bool)
    for corners in triangles:
        signs = []
        for (au, av), (bu, bv) in zip(corners, np.roll(corners, -1, axis=0), strict=True):
            signs.append((bu - au) * (v - av) - (bv - av) * (u - au))
        inside |= np.all([s >= 0 for s in signs], axis=0) | np.all([s <= 0 for s in signs], axis=0)
    return inside


def diffuser(faces: np.ndarray, num_vertices: int, amount: float) -> np.ndarray:
    """(1 + λL)⁻¹ of the mesh's graph: spreads a change over neighbours, keeps the change of all by the same."""
    graph = np.zeros((num_vertices, num_vertices))
    for a, b in ((0, 1), (1, 2), (2, 0)):
        graph[faces[:, a], faces[:, b]] = graph[faces[:, b], faces[:, a]] = 1
    laplacian = np.diag(graph.sum(1)) - graph
    return np.linalg.inv(np.eye(num_vertices) + amount * laplacian)


def descend(
    value_and_slope: Callable[[np.ndarray], tuple[float, Any, np.ndarray]],
    start: np.ndarray,
    spread: np.ndarray,
    num_steps: int,
    rate: float,
) -> list[tuple[float, Any, np.ndarray, np.ndarray]]:
    """Adam with one scale for all numbers, on displacements that are spread over the mesh.

    One scale keeps small slopes small: vertices that no shadow's edge depends on move with their neighbours only.
    The rate falls to a tenth along half a cosine.

    Args:
        value_and_slope: Vertices → loss, what goes with it, and slope.
        start: Vertices.
        spread: From `diffuser`.
        num_steps: Steps.
        rate: Length of a first step.

    Returns:
        Of every step, and after the last: loss, what goes with it, vertices and slope.
    """
    moved, mean, square = (np.zeros_like(start) for _ in range(3))
    kept = []
    for step in range(num_steps + 1):
        vertices = start + spread @ moved
        loss, other, slope = value_and_slope(vertices)
        kept.append((loss, other, vertices, slope))
        downhill = spread.T @ slope
        mean = 0.8 * mean + 0.2 * downhill
        square = 0.95 * square + 0.05 * downhill**2
        scale = math.sqrt(square.max() / (1 - 0.95 ** (step + 1))) + 1e-12
        now = rate * (0.55 + 0.45 * math.cos(math.pi * step / num_steps))
        moved = moved - now * mean / (1 - 0.8 ** (step + 1)) / scale
    return kept


def run(config: Config) -> Result:
    """All descents, in double precision."""
    with jax.enable_x64(True):
        return _run(config)


def _run(config: Config) -> Result:
    size = config.resolution
    walls = (Wall.create((0.0, 0.0, 1.0), (-1.0, 0.0, 0.0), size), Wall.create((1.0, 0.0, 0.0), (0.0, 0.0, 1.0), size))
    u, v = spots(size)
    shapes = heart(u, v), star(u, v)
    targets = np.stack([in_pixels(shape, size) for shape in shapes])
    ball = SphereOverPlane(radius=1.0, height=0.0, frequency=config.frequency).ball()
    mesh, edges = padded(ball.vertices, ball.faces, size_of(config.frequency))
    faces = np.asarray(mesh.faces)
    spread = diffuser(faces, mesh.num_vertices, config.diffusion)

    def value_and_slope(vertices: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
        found = [_one_wall(wall, target, vertices, mesh, edges) for wall, target in zip(walls, targets, strict=True)]
        loss, pictures, slope = zip(*found, strict=True)
        return sum(loss) / 2, np.stack(pictures), np.sum(slope, axis=0)

    losses, counted, miscounted, finite, first = [], [], [], True, []
    for seed in range(config.num_seeds):
        rng = np.random.default_rng(seed)
        turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
        start = rng.uniform(0.45, 0.65) * np.asarray(mesh.vertices) @ (turn * np.sign(np.linalg.det(turn)))
        kept = descend(value_and_slope, start, spread, config.num_steps, config.rate)
        losses.append([one[0] for one in kept])
        finite &= all(bool(np.isfinite(one[3]).all()) for one in kept)
        last = kept[-1][2]
        shadows = [behind(wall.shadow_of(last)[faces], u, v) for wall in walls]
        counted.append([float((a & b).sum() / (a | b).sum()) for a, b in zip(shadows, shapes, strict=True)])
        miscounted.append([np.abs(in_pixels(a, size) - b).mean() for a, b in zip(shadows, kept[-1][1], strict=True)])
        first = first or kept
    # Often at first, when most happens.
    steps = np.unique(np.round(config.num_steps * np.linspace(0, 1, 16) ** 2).astype(int))
    return Result(
        np.array(losses), finite, np.array(counted), np.array(miscounted), targets, steps,
        np.stack([first[i][1] for i in steps]), np.stack([first[i][2] for i in steps]), faces,
    )  # fmt: skip


def _one_wall(
    wall: Wall, target: np.ndarray, vertices: np.ndarray, mesh: Mesh, edges: MeshEdges
) -> tuple[float, np.ndarray, np.ndarray]:
    """Loss, picture and slope in the vertices."""

    def loss(vertices: Array, position: Array) -> tuple[Array, Array]:
        moved, lamp = Mesh(vertices, mesh.faces, mesh.face_colors), PointLight(position, wall.light.color)
        picture = shadow_picture(moved, edges, lamp, wall.view, BruteForce(), wall.receiver)
        return jnp.mean((picture - target) ** 2), picture

    # The slope in the lamp is not used: with it the program is the one that other experiments compile.
    (value, picture), (slope, _) = jax.value_and_grad(loss, (0, 1), has_aux=True)(
        jnp.asarray(vertices), wall.light.position
    )
    return float(value), np.asarray(picture), np.asarray(slope)


def claims(result: Result) -> tuple[Claim, ...]:
    """Every start succeeds, and counting agrees."""
    falls = result.losses[:, 0] / result.losses[:, -1]
    wrong = np.abs(result.pictures[-1] - result.targets) > 0.5
    return (
        Claim(
            "the loss falls at least ten times from every start",
            bool((falls >= 10).all()),
            f"{int((falls >= 10).sum())} of {len(falls)}, the least ×{falls.min():.1f}",
            "at least ×10, all",
        ),
        Claim("every gradient is finite", result.finite, str(result.finite), "True"),
        at_most("share of pixels on the wrong side of one half, first start", wrong.mean(), 0.02),
        at_most("pictures after against counted places, mean difference of a pixel", result.miscounted, 0.005),
        all_true(
            "no start ends higher than it was after eight steps", result.losses[:, -1] <= result.losses[:, 8], "starts"
        ),
    )


def numbers(result: Result) -> dict[str, Any]:
    """Losses and shares."""
    return {
        "losses": result.losses,
        "falls": result.losses[:, 0] / result.losses[:, -1],
        "intersection_over_union": result.counted,
        "triangles": len(result.faces),
    }


def _object(axes: Axes, vertices: np.ndarray, faces: np.ndarray) -> None:
    """The mesh, seen from between the lamps and above, far triangles first."""
    towards = np.array([1.0, 0.7, 1.0]) / math.sqrt(2.49)
    right = np.cross([0.0, 1.0, 0.0], towards)
    right /= np.linalg.norm(right)
    corners = vertices[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True) + 1e-12
    order = np.argsort(corners.mean(1) @ towards)
    tone = 0.35 + 0.6 * np.abs(normals @ (np.array([0.3, 0.8, 0.5]) / math.sqrt(0.98)))
    color = np.clip(tone[:, None] * np.array([0.90, 0.72, 0.55]), 0, 1)
    flat = np.stack([corners @ right, corners @ np.cross(towards, right)], axis=-1)
    axes.add_collection(
        PolyCollection(list(flat[order]), facecolors=color[order], edgecolors="#00000030", linewidths=0.3)
    )
    axes.set(xlim=(-1.15, 1.15), ylim=(-1.15, 1.15), aspect="equal", xticks=[], yticks=[])
    axes.grid(False)
    for side in axes.spines.values():
        side.set_visible(False)


@styled
def draw(result: Result) -> Figure:
    """Targets, before, after; losses and the object."""
    figure, axes = new_figure(10.6, 5.4, 2, 4)
    for row, name in enumerate(NAMES):
        shown = result.targets[row], result.pictures[0, row], result.pictures[-1, row]
        for spot, picture, title in zip(axes[row], shown, (f"target: {name}", "before", "after"), strict=False):
            show_image(spot, picture[::-1], title)
            for side in spot.spines.values():
                side.set_visible(True)
    curve, body = axes[0, 3], axes[1, 3]
    for seed, losses in enumerate(result.losses):
        curve.plot(losses, color=PALETTE[seed % len(PALETTE)], linewidth=1.2, label=f"start {seed}")
    curve.set_yscale("log")
    curve.legend(fontsize=7)
    label(curve, "step", "mean squared difference", "loss")
    _object(body, result.vertices[-1], result.faces)
    label(body, "", "", "the mesh after")
    return figure


@styled
def animate(result: Result) -> list[Figure]:
    """Both shadows and the mesh, as the first descent goes on."""
    frames = []
    for step, pictures, vertices in zip(result.steps, result.pictures, result.vertices, strict=True):
        figure, axes = new_figure(6.0, 2.2, 1, 3)
        for spot, picture, name in zip(axes[0], pictures, NAMES, strict=False):
            show_image(spot, picture[::-1], f"wall of the {name}")
        _object(axes[0, 2], vertices, result.faces)
        label(axes[0, 2], "", "", f"step {step}")
        frames.append(figure)
    return frames
