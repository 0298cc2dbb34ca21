"""warping, figure 18: what a perspective warp does to the view, from the uniform map to PSM.

The light is overhead and the view is seen from it: a trapezium with pillars. Above, the texels lie over the view, ever
closer together near the eye as n' falls. Below is what the map stores: texels are squares there, and the view and its
pillars are deformed. With n' = n the trapezium becomes the whole square and nothing is wasted next to it; with n' = ∞
it keeps its shape and fills (1 + n/f)/2 of the map.

Measured: outlines are put through the package's warp, and areas are those of the resulting polygons. The share of the
map that the view fills is (1 + n f'/(f n'))/2, the depth in the map's middle row is the harmonic mean of n' and f', and
a small pillar's area over its area in the world is the derivative of the warp.

How to read it: grey lines are rows and columns of the map, a few of many; the eye is at the bottom.
"""

import math
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Polygon

from experiments.base import Claim
from experiments.claiming import agrees, all_true
from experiments.warped_views import check_count, check_view, in_double
from shadowjax._checks import require
from shadowjax._types import Array
from shadowjax.plotting import PALETTE, label, new_figure, styled
from shadowjax.warps.perspective import PerspectiveWarp

NAMES = ("n' = ∞, uniform", "n' = 4 (n + √(fn))", "n' = n + √(fn), LiSPSM", "n' = n, PSM")
PILLAR = 0.035  # half the width of a pillar over its depth
CORNERS = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * PILLAR


@dataclass(frozen=True)
class Config:
    """Settings.

    Attributes:
        near: n, world units.
        far: f, world units.
        phi_deg: Half the angle of view, degrees.
        num_pillars: Pillars along each of three rows, ≥ 3.
        num_lines: Texel lines drawn each way, ≥ 5.
    """

    near: float = 1.0
    far: float = 16.0
    phi_deg: float = 30.0
    num_pillars: int = 7
    num_lines: int = 21

    def __post_init__(self):
        check_view(self.near, self.far, self.phi_deg)
        check_count(self.num_pillars, "num_pillars", 3)
        check_count(self.num_lines, "num_lines", 5)
        require(self.far / self.near > 1.5, f"far/near must exceed 1.5; got {self.far / self.near:g}")


@dataclass(frozen=True)
class Result:
    """Outlines (x, z) in the world and (s, t) in the map; the first axis runs over NAMES.

    Attributes:
        config: The settings.
        near_distance: n' of each.
        view: Corners of the view, (4, 2).
        pillars: Corners of the pillars, (pillars, 4, 2).
        lines: Texel lines, (lines, points, 2) in the map.
        mapped_view: The view in the maps.
        mapped_pillars: The pillars in the maps.
        world_lines: The texel lines in the world.
        again: The pillars, mapped and back.
        middle: z of the middle row of each map.
        density: Map area per world area at each pillar's centre, from the warp's derivative.
    """

    config: Config
    near_distance: np.ndarray
    view: np.ndarray
    pillars: np.ndarray
    lines: np.ndarray
    mapped_view: np.ndarray
    mapped_pillars: np.ndarray
    world_lines: np.ndarray
    again: np.ndarray
    middle: np.ndarray
    density: np.ndarray


@jax.jit
def _map(strengths: Array, view: Array, pillars: Array, lines: Array) -> tuple[Array, ...]:
    def one(strength: Array) -> tuple[Array, ...]:
        warp = PerspectiveWarp.fit(view, strength)
        mapped = warp.forward(pillars)
        rate = warp.inverse_spacing(jnp.mean(pillars, axis=1))
        density = rate[:, 0, 0] * rate[:, 1, 1] - rate[:, 0, 1] * rate[:, 1, 0]
        middle = warp.inverse(jnp.asarray([0.5, 0.5]))[1]
        return warp.forward(view), mapped, warp.inverse(lines), warp.inverse(mapped), middle, jnp.abs(density)

    return jax.vmap(one)(strengths)


def area(outline: np.ndarray) -> np.ndarray:
    """Area of polygons (…, corners, 2)."""
    x, y = outline[..., 0], outline[..., 1]
    return 0.5 * np.abs(np.sum(x * np.roll(y, -1, axis=-1) - y * np.roll(x, -1, axis=-1), axis=-1))


@in_double
def run(config: Config) -> Result:
    """Map the view, the pillars and the texel lines."""
    near, far, tangent = config.near, config.far, math.tan(math.radians(config.phi_deg))
    best = near + math.sqrt(near * far)
    distance = np.array([np.inf, 4 * best, best, near])
    view = np.array([[-near, near], [near, near], [far, far], [-far, far]]) * np.array([tangent, 1])
    depth = near * (far / near) ** ((np.arange(config.num_pillars) + 0.5) / config.num_pillars)
    centres = np.array([[side * tangent * z, z] for side in (-0.66, 0.0, 0.66) for z in depth])
    pillars = centres[:, None] + CORNERS * centres[:, None, 1:]
    steps, fine = np.linspace(0, 1, config.num_lines), np.linspace(0, 1, 41)
    across = np.stack(np.broadcast_arrays(fine, steps[:, None]), axis=-1)
    lines = np.concatenate([across, across[..., ::-1]])
    found = _map(jnp.asarray(1 / distance), jnp.asarray(view), jnp.asarray(pillars), jnp.asarray(lines))
    return Result(config, distance, view, pillars, lines, *(np.asarray(x) for x in found))


def claims(result: Result) -> tuple[Claim, ...]:
    """Shapes, shares and areas in the maps."""
    config, q = result.config, result.near_distance
    near, far = config.near, config.far
    with np.errstate(invalid="ignore"):
        end = q + far - near
        stretch = np.where(np.isinf(q), 1.0, end / q)
        middle = np.where(np.isinf(q), (near + far) / 2, 2 * q * end / (q + end) - q + near)
    share = area(result.mapped_view)
    edges = result.mapped_view
    touches = [np.allclose(edge.min(axis=0), 0, atol=1e-12) and np.allclose(edge.max(axis=0), 1) for edge in edges]
    found = area(result.mapped_pillars) / area(result.pillars)
    nearest = [density[: config.num_pillars].argmax() == 0 for density in found[1:]]
    first, last = (result.world_lines[:, :, at] - result.world_lines[:, :, 0] for at in (20, 40))
    bend = first[..., 0] * last[..., 1] - first[..., 1] * last[..., 0]
    return (
        all_true("the view touches all four sides of the map", touches, "maps"),
        agrees("the view fills (1 + n f'/(f n'))/2 of the map", share, (1 + near / far * stretch) / 2, 1e-12),
        agrees("PSM: the view is the whole map", share[-1], 1.0, 1e-12),
        agrees("the middle row holds the harmonic mean of n' and f'", result.middle, middle, 1e-12),
        # of second order in a pillar's size over its depth
        agrees("a pillar's area in the map is its area times the warp's derivative", found, result.density,
               4 * PILLAR**2),
        agrees("uniform: all pillars keep their proportions", found[0], found[0, 0], 1e-12),
        all_true("with a warp the nearest pillar of a row is enlarged most", nearest, "maps"),
        all_true("texel lines stay straight", np.abs(bend) < 1e-9 * far**2, "lines"),
        agrees("back from the map every pillar is where it was", result.again[..., 1],
               np.broadcast_to(result.pillars[..., 1], result.again[..., 1].shape), 1e-12),
    )  # fmt: skip


def numbers(result: Result) -> dict[str, Any]:
    """Shares, middles and pillar areas."""
    q = np.where(np.isinf(result.near_distance), -1.0, result.near_distance)
    return {
        "near_distance_-1_is_infinite": q, "share_filled": area(result.mapped_view), "middle_depth": result.middle,
        "pillar_share": area(result.mapped_pillars),
    }  # fmt: skip


def _outlines(spot: Axes, view: np.ndarray, pillars: np.ndarray) -> None:
    spot.add_patch(Polygon(view, closed=True, facecolor=PALETTE[4], alpha=0.25, linewidth=0))
    spot.add_patch(Polygon(view, closed=True, fill=False, edgecolor=PALETTE[0], linewidth=1.4))
    for corners in pillars:
        spot.add_patch(Polygon(corners, closed=True, facecolor=PALETTE[1], linewidth=0, zorder=3))
    spot.grid(False)


@styled
def draw(result: Result) -> Figure:
    """The world above, the map below."""
    figure, axes = new_figure(11.4, 6.2, 2, len(NAMES))
    far, tangent = result.config.far, math.tan(math.radians(result.config.phi_deg))
    for column, name in enumerate(NAMES):
        world, stored = axes[:, column]
        for line in result.world_lines[column]:
            world.plot(line[:, 0], line[:, 1], color="#9aa3b2", linewidth=0.5)
        for line in result.lines:
            stored.plot(line[:, 0], line[:, 1], color="#9aa3b2", linewidth=0.5)
        _outlines(world, result.view, result.pillars)
        _outlines(stored, result.mapped_view[column], result.mapped_pillars[column])
        world.set_aspect("equal")
        world.set_xlim(-1.04 * far * tangent, 1.04 * far * tangent)
        world.set_ylim(0, 1.02 * far)
        stored.set_aspect("equal")
        stored.set_xlim(-0.02, 1.02)
        stored.set_ylim(-0.02, 1.02)
        label(world, "x (world units)", "z (world units)" if column == 0 else "", name)
        filled = 100 * area(result.mapped_view)[column]
        label(stored, "s", "t" if column == 0 else "", f"the map, {filled:.0f} % filled")
    return figure
