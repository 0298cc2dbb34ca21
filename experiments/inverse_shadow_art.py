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

from dataclasses import dataclass
from typing import Any

import jax
import numpy as np
from matplotlib.figure import Figure

from experiments.base import Claim
from experiments.claiming import all_true, at_most
from experiments.gradient_scenes import padded, size_of
from experiments.wall_scenes import Wall, behind, in_pixels, on_walls, show_mesh, spots
from shadowjax._checks import require, require_int
from shadowjax.optimize.solvers.descent import descend, diffuser
from shadowjax.plotting import PALETTE, label, new_figure, show_image, styled
from shadowjax.scenes.sphere_over_plane import SphereOverPlane

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
        reasons: Why each descent ended.
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
    reasons: tuple[str, ...]


def heart(u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Whether places lie in a heart of height 2 about the origin."""
    x, y = 1.12 * u, 1.12 * v + 0.12
    return (x * x + y * y - 1) ** 3 < x * x * y**3


def star(u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Whether places lie in a rounded star of four points, of height 2 about the origin."""
    return np.hypot(u, v) < 0.82 + 0.18 * np.cos(4 * np.arctan2(v, u))


def run(config: Config) -> Result:
    """All descents, in double precision."""
    with jax.enable_x64(True):
        return _run(config)


def _run(config: Config) -> Result:
    size = config.resolution
    walls = Wall.create((0.0, 0.0, 1.0), size), Wall.create((1.0, 0.0, 0.0), size)
    u, v = spots(size)
    shapes = heart(u, v), star(u, v)
    targets = np.stack([in_pixels(shape, size) for shape in shapes])
    ball = SphereOverPlane(radius=1.0, height=0.0, frequency=config.frequency).ball()
    mesh, edges = padded(ball.vertices, ball.faces, size_of(config.frequency))
    faces = np.asarray(mesh.faces)
    spread = diffuser(faces, mesh.num_vertices, config.diffusion)

    losses, counted, miscounted, reasons, finite, first = [], [], [], [], True, None
    for seed in range(config.num_seeds):
        rng = np.random.default_rng(seed)
        turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
        start = rng.uniform(0.45, 0.65) * np.asarray(mesh.vertices) @ (turn * np.sign(np.linalg.det(turn)))
        found = descend(
            lambda moved: on_walls(walls, targets, moved, mesh, edges), start, spread, config.num_steps, config.rate
        )
        losses.append(found.certificate.losses)
        finite &= found.certificate.finite
        reasons.append(found.certificate.reason)
        last = found.value
        shadows = [behind(wall.shadow_of(last)[faces], u, v) for wall in walls]
        counted.append([float((a & b).sum() / (a | b).sum()) for a, b in zip(shadows, shapes, strict=True)])
        miscounted.append(
            [np.abs(in_pixels(a, size) - b).mean() for a, b in zip(shadows, found.certificate.others[-1], strict=True)]
        )
        first = first or found
    assert first is not None
    # Often at first, when most happens.
    steps = np.unique(np.round(config.num_steps * np.linspace(0, 1, 16) ** 2).astype(int))
    return Result(
        np.array(losses), finite, np.array(counted), np.array(miscounted), targets, steps,
        np.stack([first.certificate.others[i] for i in steps]), first.certificate.vertices[steps], faces,
        tuple(reasons),
    )  # fmt: skip


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
        "reasons": result.reasons,
        "triangles": len(result.faces),
    }


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
    show_mesh(body, result.vertices[-1], result.faces)
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
        show_mesh(axes[0, 2], vertices, result.faces)
        label(axes[0, 2], "", "", f"step {step}")
        frames.append(figure)
    return frames
