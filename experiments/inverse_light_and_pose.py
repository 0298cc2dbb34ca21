"""Inverse problems: where is the light, and how does a body lie, if only the picture of a shadow is known?

Measured: a tetrahedron casts its shadow on a plane. From the picture alone, least squares through `shadow_picture`
recovers the direction of a sun and the position of a lamp, each from the scene as it is known or from random starts.
The difference of pictures is taken sharp and blurred: a blur reaches across gaps where sharp pictures do not overlap,
and the sharp one tells the exact answer. Found: place and turn of the tetrahedron in a lamp's light are another matter.
A pose with the same shadow is always found, but it need not be the true one: three corners seen from a point fit up to
four poses, as in photogrammetry. Under a sun a whole motion leaves no trace, the one along the rays; the derivative of
the picture finds it by itself.

How to read it: left, the loss over the steps of every search; middle, how far each answer is from the
truth, with the number of starts in it; right, the singular values of the picture's derivative by the six numbers of the
pose.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure

from experiments.base import Claim
from experiments.claiming import at_most
from experiments.gradient_scenes import LAMP, TETRAHEDRON, TETRAHEDRON_FACES, Stage
from shadowjax import DirectionalLight, Mesh, MeshEdges, PointLight, mesh_edges, shadow_picture
from shadowjax._checks import require, require_int
from shadowjax._numerics import normalize
from shadowjax._types import Array, Float
from shadowjax.geometry.light import Light
from shadowjax.optimize.solution import Solution
from shadowjax.optimize.solvers.least_squares import RecoveryCertificate, linearized, recover
from shadowjax.plotting import PALETTE, label, new_figure, styled
from shadowjax.rays.brute import BruteForceCaster

# Parameters: light (a position, or a direction with −1 downwards), translation in metres, rotation vector in radians.
LIGHT, MOVE, TURN = slice(0, 3), slice(3, 6), slice(6, 9)
SUN = (0.35, -1.0, 0.2)
SOLVED, NEAR = 1e-9, 1e-3


@dataclass(frozen=True)
class Config:
    """Settings.

    Attributes:
        resolution: Pixels along a side of the picture, ≥ 16.
        num_seeds: Random truths of each problem, ≥ 1.
        num_starts: Random starts of each search, ≥ 1.
        blur: Width of the blur, pixels, > 0.
    """

    resolution: int = 48
    num_seeds: int = 8
    num_starts: int = 6
    blur: float = 6.0

    def __post_init__(self):
        require_int(self.resolution, "resolution", 16)
        require_int(self.num_seeds, "num_seeds", 1)
        require_int(self.num_starts, "num_starts", 1)
        require(self.blur > 0, f"blur must be positive; got {self.blur}")


@dataclass(frozen=True)
class Problem:
    """What is unknown.

    Attributes:
        name: For the figure.
        sun: Whether the light is a direction.
        free: The unknown parameters.
        spread: How far truths and starts may lie from the known scene.
    """

    name: str
    sun: bool
    free: tuple[int, ...]
    spread: float


PROBLEMS = (
    Problem("direction of a sun", True, (0, 2), 0.5),
    Problem("position of a lamp", False, (0, 1, 2), 0.8),
    Problem("pose in a lamp's light", False, (3, 4, 5, 6, 7, 8), 0.25),
)


@dataclass(frozen=True)
class Found:
    """One search.

    Attributes:
        problem: Its name.
        recovered: What was found.
        error: Largest difference from the truth, metres or radians.
    """

    problem: str
    recovered: Solution[np.ndarray, RecoveryCertificate]
    error: float


@dataclass(frozen=True)
class Result:
    """All searches, and what a pose changes.

    Attributes:
        found: Every search.
        values: By kind of light, the singular values of the picture's derivative by the pose, largest first.
        hidden: Cosine between the motion that changes the picture least under the sun, and a motion along its rays.
        paths: By problem, the picture that is given and those that the first search made of it.
    """

    found: tuple[Found, ...]
    values: dict[str, np.ndarray]
    hidden: float
    paths: dict[str, tuple[np.ndarray, np.ndarray]]


class Difference(eqx.Module):
    """A picture less another one, sharp and blurred."""

    target: Float[Array, "rows cols"]
    free: Float[Array, "9"]
    known: Float[Array, "9"]
    blur: Float[Array, "rows rows"]
    mesh: Mesh
    edges: MeshEdges
    stage: Stage = eqx.field(static=True)
    sun: bool = eqx.field(static=True)

    def picture(self, parameters: Float[Array, "9"]) -> Float[Array, "rows cols"]:
        """The shadow on the plane."""
        at = self.known + self.free * parameters
        middle = jnp.mean(self.mesh.vertices, axis=0)
        vertices = middle + at[MOVE] + (self.mesh.vertices - middle) @ _rotation(at[TURN]).T
        mesh = Mesh(vertices, self.mesh.faces, self.mesh.face_colors)
        return shadow_picture(
            mesh, self.edges, self._light(at), self.stage.view, BruteForceCaster(), self.stage.receiver
        )

    def _light(self, at: Array) -> Light:
        color = jnp.ones(3, at.dtype)
        return DirectionalLight(normalize(at[LIGHT]), color) if self.sun else PointLight(at[LIGHT], color)

    def __call__(self, parameters: Float[Array, "9"]) -> Float[Array, "residuals"]:
        sharp = self.picture(parameters) - self.target
        return jnp.concatenate([sharp.reshape(-1), 3 * (self.blur @ sharp @ self.blur.T).reshape(-1)])


def _rotation(vector: Float[Array, "3"]) -> Float[Array, "3 3"]:
    """The rotation by |vector| about it: the exponential of its cross product."""
    x, y, z = vector
    zero = jnp.zeros_like(x)
    return jax.scipy.linalg.expm(jnp.array([[zero, -z, y], [z, zero, -x], [-y, x, zero]]))


_picture: Callable[[Difference, Array], Array] = eqx.filter_jit(lambda one, parameters: one.picture(parameters))


def _scene(config: Config, problem: Problem) -> Difference:
    stage = Stage.create(config.resolution)
    mesh = Mesh.create(np.array(TETRAHEDRON), np.array(TETRAHEDRON_FACES), dtype=jnp.float64)
    place = jnp.arange(config.resolution, dtype=jnp.float64)
    blur = jnp.exp(-0.5 * ((place[:, None] - place) / config.blur) ** 2)
    known = jnp.zeros(9).at[LIGHT].set(jnp.asarray(SUN if problem.sun else LAMP))
    return Difference(
        jnp.zeros((config.resolution, config.resolution)),
        jnp.zeros(9).at[jnp.asarray(problem.free)].set(1.0),
        known, blur / blur.sum(axis=1, keepdims=True), mesh, mesh_edges(mesh), stage, problem.sun,
    )  # fmt: skip


def _search(config: Config, problem: Problem, seed: int) -> tuple[Found, Difference]:
    """Recover one random truth from random starts, the scene as it is known first; and what was compared."""
    rng = np.random.default_rng([seed, len(problem.name)])
    scene = _scene(config, problem)
    free = np.asarray(scene.free)
    truth = problem.spread * rng.uniform(-1, 1, 9) * free
    scene = eqx.tree_at(lambda one: one.target, scene, _picture(scene, jnp.asarray(truth)))
    starts = problem.spread * rng.uniform(-1, 1, (config.num_starts, 9)) * free
    starts[0] = 0
    recovered = recover(scene, starts, target=SOLVED)
    return Found(problem.name, recovered, float(np.abs(recovered.value * free - truth).max())), scene


def run(config: Config) -> Result:
    """Search everything; in double precision."""
    with jax.enable_x64(True):
        return _run(config)


def _run(config: Config) -> Result:
    found, paths = [], {}
    for problem in PROBLEMS:
        for seed in range(config.num_seeds):
            one, scene = _search(config, problem, seed)
            found.append(one)
            if seed == 0:
                made = [np.asarray(_picture(scene, jnp.asarray(step))) for step in one.recovered.certificate.history]
                paths[problem.name] = np.asarray(scene.target), np.stack(made)
    values, motions = {}, {}
    for name, sun in (("lamp", False), ("sun", True)):
        scene = _scene(config, Problem(name, sun, PROBLEMS[-1].free, 0.0))
        slopes = np.asarray(linearized(scene, jnp.zeros(9))[1])[:, 3:]
        _, values[name], motions[name] = np.linalg.svd(slopes, full_matrices=False)
    along = np.concatenate([np.array(SUN) / np.linalg.norm(SUN), np.zeros(3)])
    return Result(tuple(found), values, float(abs(motions["sun"][-1] @ along)), paths)


def claims(result: Result) -> tuple[Claim, ...]:
    """What is found, and what cannot be found."""
    made, pose = [], PROBLEMS[-1]
    for problem in PROBLEMS[:-1]:
        own = [one for one in result.found if one.problem == problem.name]
        solved = [one for one in own if one.recovered.certificate.solved and one.error < NEAR]
        starts = sum(one.recovered.certificate.tried for one in own)
        made.append(Claim(
            f"{problem.name} is found from its shadow", len(solved) == len(own),
            f"{len(solved)} of {len(own)}, {starts} starts in all", f"all within {NEAR:g}",
        ))  # fmt: skip
    posed = [one for one in result.found if one.problem == pose.name]
    same = [one for one in posed if one.recovered.certificate.solved]
    others = [one for one in same if one.error > 10 * NEAR]
    lamp, sun = result.values["lamp"], result.values["sun"]
    return (
        *made,
        Claim(
            "a pose with the same shadow is found", len(same) == len(posed),
            f"{len(same)} of {len(posed)}, {sum(one.recovered.certificate.tried for one in posed)} starts in all",
            "all",
        ),
        Claim(
            "refuted: one shadow tells the pose", len(others) > 0,
            f"{len(others)} of {len(same)} are other poses, by up to {max(one.error for one in posed):.2g}",
            "at least one",
        ),
        at_most("under a sun one motion changes nothing", sun[-1] / sun[0], 1e-9),
        Claim("that motion is the one along the rays", result.hidden > 1 - 1e-9, f"cosine {result.hidden:.12f}", "1"),
        Claim(
            "a lamp's shadow shows every motion", bool(lamp[-1] / lamp[0] > 1e-3), f"{lamp[-1] / lamp[0]:.3g}",
            "more than 0.001",
        ),
        Claim(
            "every search says why it ended", all(one.recovered.certificate.reason for one in result.found),
            "; ".join(sorted({one.recovered.certificate.reason for one in result.found})), "a reason each",
        ),
    )  # fmt: skip


def numbers(result: Result) -> dict[str, Any]:
    """Errors, losses and singular values."""
    return {
        "searches": [
            {
                "problem": one.problem, "error": one.error, "loss": float(one.recovered.objective_value),
                "starts": one.recovered.certificate.tried,
                "reason": one.recovered.certificate.reason,
            }
            for one in result.found
        ],
        "singular_values": result.values, "hidden_cosine": result.hidden,
    }  # fmt: skip


@styled
def draw(result: Result) -> Figure:
    """Losses, errors, singular values."""
    figure, axes = new_figure(11.6, 4.0, 1, 3)
    left, middle, right = axes[0]
    for index, problem in enumerate(PROBLEMS):
        own = [one for one in result.found if one.problem == problem.name]
        for place, one in enumerate(own):
            losses = np.maximum(one.recovered.certificate.losses, 1e-20)
            left.semilogy(losses, color=PALETTE[index], lw=1.2, label=problem.name if place == 0 else None)
            middle.semilogy(place, max(one.error, 1e-16), "o", color=PALETTE[index])
            middle.annotate(
                str(one.recovered.certificate.tried), (place, max(one.error, 1e-16)), xytext=(0, 5),
                textcoords="offset points",
                ha="center", fontsize=7.5,
            )  # fmt: skip
    middle.axhline(NEAR, color="k", lw=0.8)
    middle.set_xticks(range(len(result.found) // len(PROBLEMS)))
    left.legend(loc="lower left", fontsize=8)
    label(left, "accepted steps", "half the sum of squared differences", "Searches")
    label(middle, "random truth", "error (m or rad)", "Answers, and the starts they took")
    for index, (name, values) in enumerate(result.values.items()):
        right.semilogy(
            range(1, 7), np.maximum(values / values[0], 1e-18), "so"[index], color=PALETTE[index], label=name
        )
    right.legend(loc="lower left")
    label(right, "motion of the body, by its trace", "change of the picture / largest", "What a shadow shows of a pose")
    return figure


@styled
def animate(result: Result) -> list[Figure]:
    """The shadows of the first search of each problem, step by step, over the shadow that is given."""
    last = max(len(made) for _, made in result.paths.values())
    frames = []
    for step in range(last + 3):
        figure, axes = new_figure(7.2, 2.9, 1, len(result.paths))
        for spot, (name, (given, made)) in zip(axes[0], result.paths.items(), strict=True):
            at = min(step, len(made) - 1)
            # Blue where only the given picture is dark, orange where only the search's is, black where both are.
            spot.imshow(np.stack([given, 0.5 * (given + made[at]), made[at]], axis=-1), interpolation="nearest")
            spot.set_xticks([])
            spot.set_yticks([])
            spot.grid(False)
            spot.set_title(name, fontsize=9)
            spot.set_xlabel(f"step {at} of {len(made) - 1}", fontsize=8)
        frames.append(figure)
    return frames


__all__ = ["Config", "Result", "animate", "claims", "draw", "numbers", "run"]
