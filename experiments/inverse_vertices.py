"""Inverse problem: the vertices of a free-form body from its shadows under several lamps.

Measured: a smooth body hangs among walls, each with a lamp before it. All that is known are the pictures of its
shadows. Descent moves every vertex of a ball until the ball's shadows are the same; steps are spread over the mesh.
Three tests say how good the answer is: the loss on the walls that were given; the shadow on another wall, from a lamp
that was not given; and how far vertices lie from the true surface, which has a closed form, along the ray from the
middle. Bodies are random. The same is tried with one lamp.

Shadows of one lamp are matched as well as those of many, but they tell little of the body: the wall that was not given
shows it. Several lamps tell the surface, as far as it takes part in an outline.

How to read it: upper row, the bodies; lower row, the shadow on the wall that was not given; right, losses over steps,
and the distance from the true surface for every body, before and after.
"""

from dataclasses import dataclass
from typing import Any

import jax
import numpy as np
from matplotlib.figure import Figure

from experiments.base import Claim
from experiments.claiming import all_true
from experiments.gradient_scenes import padded, size_of
from experiments.wall_scenes import Wall, on_walls, show_mesh
from shadowjax._checks import require, require_int
from shadowjax.optimize.solution import Solution
from shadowjax.optimize.solvers.descent import DescentCertificate, descend, diffuser
from shadowjax.plotting import PALETTE, label, new_figure, show_image, styled
from shadowjax.scenes.sphere_over_plane import SphereOverPlane

SIZE = 0.6  # metres: radius of the ball to start from, and of bodies without bumps; all shadows stay on the walls
BUMPS = np.array([0.06] * 3 + [0.3] * 8)  # largest coefficient of each function in `radius`
OTHER = (0.3, 0.4, -0.8)  # where the lamp is that is not given
ONE, MANY = "one lamp", "several lamps"
AT_LEAST = 10.0  # times that the loss must fall


@dataclass(frozen=True)
class Config:
    """Settings.

    Attributes:
        resolution: Pixels along a side of each picture, ≥ 8.
        frequency: Pieces of an edge of the icosahedron that the ball is made from, ≥ 1; 20 frequency² triangles.
        num_lamps: Lamps whose shadows are given, ≥ 2.
        num_seeds: Random bodies, ≥ 1.
        num_steps: Most steps of a descent, ≥ 4.
        rate: Largest length of a first step before it is spread, metres, > 0.
        diffusion: How far a step is spread: λ of (1 + λL)⁻¹, L the mesh's graph Laplacian; ≥ 0.
    """

    resolution: int = 32
    frequency: int = 2
    num_lamps: int = 6
    num_seeds: int = 8
    num_steps: int = 24
    rate: float = 0.35
    diffusion: float = 0.5

    def __post_init__(self):
        require_int(self.resolution, "resolution", 8)
        require_int(self.frequency, "frequency", 1)
        require_int(self.num_lamps, "num_lamps", 2)
        require_int(self.num_seeds, "num_seeds", 1)
        require_int(self.num_steps, "num_steps", 4)
        require(self.rate > 0, f"rate must be positive; got {self.rate}")
        require(self.diffusion >= 0, f"diffusion must not be negative; got {self.diffusion}")


@dataclass(frozen=True)
class Found:
    """One body.

    Attributes:
        descent: The search; its pictures are those of the given walls.
        other: Loss on the wall that was not given, before and after.
        away: Root mean square distance of vertices from the true surface, before and after, metres.
        seen: The picture on the wall that was not given, after.
    """

    descent: Solution[np.ndarray, DescentCertificate]
    other: tuple[float, float]
    away: tuple[float, float]
    seen: np.ndarray


@dataclass(frozen=True)
class Result:
    """All bodies, with one lamp and with several.

    Attributes:
        found: By number of lamps, one entry for every body.
        truth: Vertices of the first true body.
        truth_seen: Its picture on the wall that was not given.
        given: Its pictures on the given walls.
        faces: Of the mesh.
    """

    found: dict[str, list[Found]]
    truth: np.ndarray
    truth_seen: np.ndarray
    given: np.ndarray
    faces: np.ndarray


def radius(directions: np.ndarray, seed: int) -> np.ndarray:
    """Distance from the middle to the surface of a random body, metres, along unit directions."""
    x, y, z = directions.T
    functions = (x, y, z, x * y, y * z, z * x, x * x - y * y, 3 * z * z - 1, x * (x * x - 3 * y * y), x * y * z,
                 y * (5 * z * z - 1))  # fmt: skip
    return SIZE * np.exp((np.random.default_rng(seed).uniform(-1, 1, len(BUMPS)) * BUMPS) @ np.stack(functions))


def away(vertices: np.ndarray, seed: int) -> float:
    """Root mean square distance of vertices from a body's surface, along the rays from the middle."""
    length = np.linalg.norm(vertices, axis=1)
    return float(np.sqrt(np.mean((length - radius(vertices / length[:, None], seed)) ** 2)))


def spread_over_half_a_sphere(count: int) -> np.ndarray:
    """Directions to lamps: on a spiral, each for an equal part of the upper half of the sphere."""
    place = np.arange(count)
    height = (place + 0.5) / count
    turn = 2 * np.pi * place / ((1 + np.sqrt(5)) / 2)
    flat = np.sqrt(1 - height**2)
    return np.stack([flat * np.cos(turn), height, flat * np.sin(turn)], axis=-1)


def run(config: Config) -> Result:
    """All descents, in double precision."""
    with jax.enable_x64(True):
        return _run(config)


def _run(config: Config) -> Result:
    ball = SphereOverPlane(radius=1.0, height=0.0, frequency=config.frequency).ball()
    mesh, edges = padded(ball.vertices, ball.faces, size_of(config.frequency))
    directions, faces = np.asarray(mesh.vertices), np.asarray(mesh.faces)
    spread = diffuser(faces, mesh.num_vertices, config.diffusion)
    lamps = spread_over_half_a_sphere(config.num_lamps)
    walls, other = [Wall.create(one, config.resolution) for one in lamps], Wall.create(OTHER, config.resolution)
    dark = np.zeros((config.resolution, config.resolution))
    found: dict[str, list[Found]] = {ONE: [], MANY: []}
    first = None
    for seed in range(config.num_seeds):
        truth = radius(directions, seed)[:, None] * directions
        given = np.stack([wall.difference(dark, truth, mesh, edges)[1] for wall in walls])
        unknown = other.difference(dark, truth, mesh, edges)[1]
        first = first or (truth, unknown, given)
        for name, count in ((ONE, 1), (MANY, config.num_lamps)):
            descent = descend(
                lambda moved, n=count, given=given: on_walls(walls[:n], given[:n], moved, mesh, edges),
                SIZE * directions, spread, config.num_steps, config.rate,
            )  # fmt: skip
            ends = descent.certificate.vertices[0], descent.certificate.vertices[-1]
            seen = [other.difference(unknown, end, mesh, edges) for end in ends]
            found[name].append(
                Found(descent, (seen[0][0], seen[1][0]), (away(ends[0], seed), away(ends[1], seed)), seen[1][1])
            )
    assert first is not None
    return Result(found, *first, faces)


def claims(result: Result) -> tuple[Claim, ...]:
    """Several lamps tell the body, one does not."""
    one, many = result.found[ONE], result.found[MANY]
    fall = {name: np.array([x.descent.gain for x in found]) for name, found in result.found.items()}
    other = {name: np.array([x.other[0] / x.other[1] for x in found]) for name, found in result.found.items()}
    nearer = np.array([x.away[0] / x.away[1] for x in many])
    ends = [x.descent for x in (*one, *many)]
    return (
        Claim(
            "several lamps: the loss falls at least ten times for every body", bool((fall[MANY] >= AT_LEAST).all()),
            f"{int((fall[MANY] >= AT_LEAST).sum())} of {len(many)}, the least ×{fall[MANY].min():.1f}", "all",
        ),
        Claim(
            "several lamps: on a wall that was not given it falls at least five times", bool((other[MANY] >= 5).all()),
            f"{int((other[MANY] >= 5).sum())} of {len(many)}, the least ×{other[MANY].min():.1f}", "all",
        ),
        Claim(
            "several lamps: vertices come at least twice as near to the true surface", bool((nearer >= 2).all()),
            f"{int((nearer >= 2).sum())} of {len(many)}, the least ×{nearer.min():.1f}", "all",
        ),
        Claim(
            "refuted: a matched shadow tells the body",
            bool((fall[ONE] >= AT_LEAST).all() and (other[ONE] < 0.5 * other[MANY]).all()),
            f"one lamp: loss falls at least ×{fall[ONE].min():.1f}, on another wall at most ×{other[ONE].max():.1f}",
            f"at least ×{AT_LEAST:g}, and less than half as far on another wall as with several lamps",
        ),
        all_true("every loss and gradient is finite", [end.certificate.finite for end in ends], "descents"),
        Claim(
            "every descent says whether it has settled", all(end.certificate.reason for end in ends),
            f"{sum(bool(end.converged) for end in ends)} of {len(ends)} have", "a reason each",
        ),
    )  # fmt: skip


def numbers(result: Result) -> dict[str, Any]:
    """Losses and distances."""
    return {
        name: [
            {
                "fall": float(one.descent.gain), "fall_on_another_wall": one.other[0] / one.other[1],
                "metres_from_surface": one.away, "reason": one.descent.certificate.reason,
            }
            for one in found
        ]
        for name, found in result.found.items()
    }  # fmt: skip


@styled
def draw(result: Result) -> Figure:
    """Bodies, a shadow that was not given, losses and distances."""
    figure, axes = new_figure(11.2, 5.4, 2, 4)
    one, many = result.found[ONE], result.found[MANY]
    bodies = {
        "the true body": (result.truth, result.truth_seen),
        "from one lamp": (one[0].descent.certificate.vertices[-1], one[0].seen),
        "from several lamps": (many[0].descent.certificate.vertices[-1], many[0].seen),
    }
    for column, (name, (vertices, seen)) in enumerate(bodies.items()):
        show_mesh(axes[0, column], vertices, result.faces)
        label(axes[0, column], "", "", name)
        show_image(axes[1, column], seen[::-1], "its shadow on a wall not given")
        for side in axes[1, column].spines.values():
            side.set_visible(True)
    curve, spot = axes[0, 3], axes[1, 3]
    for color, (name, found) in zip(PALETTE, result.found.items(), strict=False):
        for place, x in enumerate(found):
            told = name if place == 0 else None
            curve.semilogy(x.descent.certificate.losses, color=color, lw=1.0, label=told)
            spot.plot([place, place], np.array(x.away) * 100, color=color, lw=0.8, alpha=0.5)
            spot.plot(place, 100 * x.away[1], "o", color=color, ms=4, label=told)
            spot.plot(place, 100 * x.away[0], "_", color="k", ms=9, label="the ball" if told == ONE else None)
    curve.legend(fontsize=7)
    spot.legend(fontsize=7)
    spot.set_ylim(0, 165 * max(x.away[0] for x in many))
    spot.set_xticks(range(len(many)))
    label(curve, "step", "mean squared difference", "loss on the given walls")
    label(spot, "random body", "RMS distance (cm)", "from the true surface")
    return figure


@styled
def animate(result: Result) -> list[Figure]:
    """The first body and its shadows on three given walls, step by step: given less found in colours."""
    descent = result.found[MANY][0].descent
    frames = []
    for step, (vertices, pictures) in enumerate(
        zip(descent.certificate.vertices, descent.certificate.others, strict=True)
    ):
        figure, axes = new_figure(7.2, 2.2, 1, 4)
        show_mesh(axes[0, 0], vertices, result.faces)
        label(axes[0, 0], "", "", f"step {step}")
        # Blue where only the given picture is dark, orange where only the search's is, black where both are.
        for number, (spot, given, made) in enumerate(zip(axes[0, 1:], result.given, pictures, strict=False), 1):
            show_image(spot, np.stack([given, 0.5 * (given + made), made], axis=-1)[::-1], f"wall {number}")
        frames.append(figure)
    return frames


__all__ = ["Config", "Result", "animate", "claims", "draw", "numbers", "run"]
