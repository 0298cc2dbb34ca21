"""stencil, section 3: splits against balance in BSP trees, and what the choice means for order and shadows.

The source builds its trees for the fewest cuts. It says that there is a trade between cuts and balance, that a tree of
a convex body degenerates to a list, and that other settings hardly changed the speed of shadows.

Measured, on the four scenes rebuilt: for a weight from 0 (fewest cuts) to 1 (equal halves), the pieces, the height of
the tree, and the outer edges of the pieces that face a light. Every tree is checked along rays from inside and outside
its scene: the pieces that a ray meets must come in the tree's order.

Found: cubes need no cut at all, and recursive tetrahedra only where the plane of one body crosses another; weight on
balance lowers both their trees for more cuts. A convex body stays a list whatever the weight, since each of its planes
has the rest of the body behind it: the sphere wholly, and solids with as many nodes as the largest has planes. Cuts
lengthen no shadow's outline, but they put corners on it, and every corner is one more shadow side: few, which is why
the source saw no difference.

How to read it: each line is a scene, each mark a weight; hollow marks are the source's setting.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure

from experiments.base import Claim
from experiments.claiming import all_true
from experiments.stencil_counting import generate
from experiments.stencil_scenes import CUBES, SPHERE, TETRAHEDRON, light_places, parts
from shadowjax._checks import require, require_int
from shadowjax.plotting import label, new_figure, series_style, styled
from shadowjax.volumes.bsp import BspTree, build_bsp


@dataclass(frozen=True)
class Config:
    """Settings.

    Attributes:
        balances: Weights of balance against cuts, each in [0, 1], beginning with 0 and ending with 1.
        candidates: Planes tried for each node, ≥ 1.
        num_lights: Places of the light, ≥ 1.
        num_eyes: Places from which the order is checked, ≥ 1; every other one inside the scene.
        num_rays: Rays from each, ≥ 1.
    """

    balances: tuple[float, ...] = (0.0, 0.05, 0.1, 0.2, 0.35, 0.5, 0.75, 1.0)
    candidates: int = 32
    num_lights: int = 10
    num_eyes: int = 4
    num_rays: int = 150

    def __post_init__(self):
        require(
            len(self.balances) >= 2 and self.balances[0] == 0 and self.balances[-1] == 1,
            f"balances must begin with 0 and end with 1; got {self.balances}",
        )
        require(all(0 <= weight <= 1 for weight in self.balances), f"balances must lie in [0, 1]; got {self.balances}")
        for value, name in (
            (self.candidates, "candidates"), (self.num_lights, "num_lights"), (self.num_eyes, "num_eyes"),
            (self.num_rays, "num_rays"),
        ):  # fmt: skip
            require_int(value, name, 1)


@dataclass(frozen=True)
class Tree:
    """One tree.

    Attributes:
        polygons: Of the scene.
        splits: Cuts.
        pieces: Polygons in the tree.
        height: Nodes on the longest way down.
        sides: Outer edges of the pieces that face a light, mean over the lights.
        outline: Their length, mean over the lights, metres.
        met: Pairs of pieces, one behind the other on a ray, that were looked at.
        inversions: Those in the wrong order.
    """

    polygons: int
    splits: int
    pieces: int
    height: int
    sides: float
    outline: float
    met: int
    inversions: int


@dataclass(frozen=True)
class Result:
    """Scene → one tree for each weight."""

    balances: tuple[float, ...]
    trees: Mapping[str, tuple[Tree, ...]]


def run(config: Config) -> Result:
    """Build all trees in double precision, and look along rays."""
    with jax.enable_x64(True):
        trees = {}
        for name, part in parts().items():
            places = light_places(part, config.num_lights, 4.0)
            rng = np.random.default_rng(1)
            lower, upper = part.vertices.min(axis=0), part.vertices.max(axis=0)
            eyes = 0.5 * (lower + upper) + rng.uniform(-0.5, 0.5, (config.num_eyes, 3)) * (upper - lower)
            eyes[::2] += 2 * (upper - lower) * [0.3, 1.0, 0.5]
            found = []
            for balance in config.balances:
                tree = build_bsp(part.vertices, part.faces, balance, config.candidates)
                found.append(_measured(tree, part.num_faces, places, eyes, config.num_rays))
            trees[name] = tuple(found)
        return Result(config.balances, trees)


_order = eqx.filter_jit(lambda tree, eye: tree.front_to_back(eye))


def _measured(tree: BspTree, polygons: int, places: np.ndarray, eyes: np.ndarray, num_rays: int) -> Tree:
    points = np.asarray(tree.vertices)
    pieces = [c[:n] for c, n in zip(np.asarray(tree.corners), np.asarray(tree.num_corners), strict=True)]
    planes = np.asarray(tree.planes)[np.asarray(tree.node)] * np.where(np.asarray(tree.turned), -1, 1)[:, None]
    outer = [generate(planes, pieces, place)[0].external for place in places]
    lengths = [np.linalg.norm(points[sides[:, 1]] - points[sides[:, 0]], axis=1).sum() for sides in outer]
    met = wrong = 0
    for number, eye in enumerate(eyes):
        rank = np.argsort(np.asarray(_order(tree, jnp.asarray(eye))))
        for depths in ray_depths(points, np.asarray(tree.corners), planes, eye, num_rays, number):
            hit = np.flatnonzero(np.isfinite(depths))
            hit = hit[np.argsort(depths[hit])]
            apart = np.diff(depths[hit]) > 1e-6
            met, wrong = met + int(apart.sum()), wrong + int((np.diff(rank[hit])[apart] < 0).sum())
    return Tree(
        polygons, tree.num_splits, tree.num_pieces, tree.height, float(np.mean([len(sides) for sides in outer])),
        float(np.mean(lengths)), met, wrong,
    )  # fmt: skip


def ray_depths(
    points: np.ndarray, corners: np.ndarray, planes: np.ndarray, eye: np.ndarray, num_rays: int, seed: int
) -> np.ndarray:
    """(rays, pieces) distance along random rays into the scene to each convex piece; infinity where it is missed."""
    rng = np.random.default_rng(seed)
    directions = rng.uniform(points.min(axis=0), points.max(axis=0), (num_rays, 3)) - eye
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    slope = directions @ planes[:, :3].T
    steep = np.abs(slope) > 1e-9
    depths = -(planes[:, :3] @ eye + planes[:, 3]) / np.where(steep, slope, 1)
    inside = steep & (depths > 1e-9)
    for side in range(corners.shape[1]):
        start, end = points[corners[:, side]], points[np.roll(corners, -1, axis=1)[:, side]]
        inward = np.cross(planes[:, :3], end - start)
        # (eye + t·direction - start)·inward ≥ 0, without an array of points
        inside &= (eye @ inward.T - (start * inward).sum(axis=1)) + depths * (directions @ inward.T) >= 0
    return np.where(inside, depths, np.inf)


def claims(result: Result) -> tuple[Claim, ...]:
    """Order, the source's statements, and what cuts do to outlines."""
    every = [tree for trees in result.trees.values() for tree in trees]
    first, last = ({name: trees[end] for name, trees in result.trees.items()} for end in (0, -1))
    sphere = result.trees[SPHERE]
    grown = max(tree.outline / first[name].outline - 1 for name, trees in result.trees.items() for tree in trees)
    return (
        Claim(
            "along every ray the pieces come in the tree's order", sum(tree.inversions for tree in every) == 0,
            f"{sum(tree.inversions for tree in every)} inversions of {sum(tree.met for tree in every)} pairs", "none",
        ),
        Claim(
            "cubes need no cut; recursive tetrahedra do, though they are disjoint",
            first[CUBES].splits == 0 < first[TETRAHEDRON].splits,
            f"{first[CUBES].splits} and {first[TETRAHEDRON].splits} cuts", "0 and more than 0",
        ),
        Claim(
            "the tree of a sphere is a list, whatever the weight",
            all(tree.height >= 0.95 * (tree.polygons - 2) for tree in sphere),
            ", ".join(str(tree.height) for tree in sphere), f"at least 95 % of {sphere[0].polygons - 2}",
        ),
        all_true(
            "balance has more cuts than the fewest, and lowers the trees of many bodies",
            [last[n].splits > first[n].splits and last[n].height < first[n].height for n in (CUBES, TETRAHEDRON)],
            "scenes",
        ),
        Claim(
            "cuts do not lengthen an outline: repaired sides cancel as uncut ones did", abs(grown) < 1e-6,
            f"by {grown:.1e} at most", "less than 1e-6",
        ),
        all_true(
            "cuts add shadow sides: the pieces' outlines have as many sides or more",
            [tree.sides >= first[name].sides for name, trees in result.trees.items() for tree in trees
             if tree.splits >= first[name].splits and first[name].splits == 0], "trees of scenes without cuts",
        ),
    )  # fmt: skip


def numbers(result: Result) -> dict[str, Any]:
    """Everything measured of every tree."""
    return {"balances": result.balances, "trees": result.trees}


@styled
def draw(result: Result) -> Figure:
    """Cuts, height and shadow sides over the weight."""
    figure, axes = new_figure(11.5, 4.0, 1, 3)
    quantities = (
        (lambda tree: 100 * tree.splits / tree.polygons, "cuts for 100 polygons"),
        (lambda tree: tree.height, "height of the tree (nodes)"),
        (lambda tree: tree.sides / tree.polygons, "shadow sides for each polygon"),
    )
    for spot, (value, title) in zip(axes[0], quantities, strict=True):
        for index, (name, trees) in enumerate(result.trees.items()):
            style = series_style(index)
            heights = [value(tree) for tree in trees]
            spot.plot(result.balances, heights, label=name, **style)
            spot.plot(0, heights[0], style.get("marker", "o"), color=style["color"], markerfacecolor="white", zorder=5)
        label(spot, "weight of balance against cuts", title, "")
    axes[0, 1].set_yscale("log")
    handles, names = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, names, loc="outside lower center", ncols=4)
    return figure
