"""Gradients that see shadows' edges, against closed forms and finely sampled differences.

Measured: a plate, two plates that overlap, a tetrahedron and a faceted sphere cast shadows on a plane. The area of each
shadow has a closed form; its derivative in every vertex and in the light's position is compared with that of the
picture's sum.

Then triangles that hide one another are moved at random. An image loss (the picture times smooth weights) changes;
its slope by reverse mode is compared with central differences of visibility sampled at many places in each pixel.

How to read it: left, the sphere's shadow; middle, how each pixel changes when the sphere moves to the right, which
only the border does; right, the error of every case.
"""

from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure

from experiments.base import Claim
from experiments.claiming import at_most
from experiments.gradient_scenes import LOWER, UPPER, Closed, Stage, random_triangles, size_of
from shadowjax import PointLight
from shadowjax._checks import require, require_int
from shadowjax._types import Array
from shadowjax.plotting import PALETTE, label, new_figure, styled


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
    frequency: int = 4

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


def run(config: Config) -> Result:
    """Closed forms, then random scenes; in double precision."""
    with jax.enable_x64(True):
        return _run(config)


def _run(config: Config) -> Result:
    stage = Stage.create(config.resolution)
    full = jnp.full((config.resolution, config.resolution), stage.cell)
    scenes = stage.closed_scenes(config.frequency)
    area, gradient, modes = [], [], []
    rng = np.random.default_rng(0)
    for mesh, edges, closed in scenes.values():
        at = mesh.vertices, stage.light.position
        function = stage.summed(full, mesh, edges)

        def exact(vertices: Array, position: Array, closed: Closed = closed) -> Array:
            return closed(vertices, PointLight(position, stage.light.color)).area

        value, found = jax.value_and_grad(function, (0, 1))(*at)
        truth, wanted = jax.jit(jax.value_and_grad(exact, (0, 1)))(*at)
        area.append(abs(float(value / truth) - 1))
        errors = [jnp.max(jnp.abs(a - b)) / jnp.max(jnp.abs(b)) for a, b in zip(found, wanted, strict=True)]
        gradient.append(max(map(float, errors)))
        change = tuple(jnp.asarray(rng.normal(size=part.shape)) for part in at)
        forward = float(jax.jvp(function, at, change)[1])
        paired = sum(float(jnp.sum(a * b)) for a, b in zip(found, change, strict=True))
        modes.append(abs(forward / paired - 1))
    ball, edges, _ = scenes["sphere"]
    width = (UPPER[0] - LOWER[0]) / config.resolution
    change = jnp.broadcast_to(jnp.asarray([width, 0.0, 0.0]), ball.vertices.shape), jnp.zeros(3)
    at = ball.vertices, stage.light.position
    picture, slope = jax.jvp(lambda v, p: stage.picture(v, p, ball, edges), at, change)
    differences = [_against_differences(stage, config, seed) for seed in range(config.num_seeds)]
    return Result(
        tuple(scenes), np.array(area), np.array(gradient), np.array(modes), np.array(differences), np.asarray(picture),
        np.asarray(slope),
    )  # fmt: skip


def _against_differences(stage: Stage, config: Config, seed: int) -> float:
    """Relative error of the slope of an image loss as the whole scene moves."""
    mesh, edges = random_triangles(seed, config.num_triangles, size_of(config.frequency))
    spots = stage.fine_spots(config.samples_per_axis)
    weights = jnp.sin(1.3 * spots[..., 0] + 0.4)
    change = jnp.asarray(np.random.default_rng(seed).normal(size=3))
    loss = stage.summed(stage.in_pixels(weights), mesh, edges)
    slope = jax.grad(loss, (0, 1))(mesh.vertices, stage.light.position)[0]
    low, high = (
        jnp.sum(weights * (1 - stage.sampled(mesh.vertices + sign * config.step * change, mesh, spots)))
        for sign in (-1.0, 1.0)
    )
    expected = float(high - low) / (2 * config.step) / config.samples_per_axis**2
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
    left.grid(False)
    label(left, "u (m)", "v (m)", "Visibility: a sphere's shadow")
    most = float(np.abs(result.slope).max())
    shown = middle.imshow(result.slope, cmap="RdBu", vmin=-most, vmax=most, extent=extent)
    figure.colorbar(shown, ax=middle, shrink=0.8, label="change per pixel moved")
    label(middle, "u (m)", "v (m)", "Derivative by u of the sphere")
    middle.grid(False)
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
    right.legend(loc="center", fontsize=8)
    label(right, "relative error", "", "Errors of the derivative")
    return figure
