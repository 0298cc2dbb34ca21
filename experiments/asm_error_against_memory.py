"""asm, adaptive shadow maps: wrong pixels against memory, next to uniform maps of any size.

The source gives no numbers: it says that an adaptive map adapts to the view and keeps within a memory that is set.
Measured: pixels near an exact shadow's edge (two pixels on either side) whose answer is not the exact one, for uniform
maps and for adaptive maps under a budget that holds their tiles and their page table. The uniform map that is as good
gives the equivalent resolution: between measured sizes by a straight line in logarithms, beyond the largest one by the
law of a hard test, that wrong pixels fall with the length of a texel.

One scene is no law: every built-in scene is measured too, smaller and under fewer budgets, against the uniform map that
the budget itself would hold, and the claim says on how many of them the adaptive map is better.

How to read it: on the left both kinds over their bytes; the shaded band is the factor of 16 in memory. In the middle
the resolution of the uniform map that is as good as each budget, next to the map that the budget itself would hold; the
finest tiles are the texels across a uniform map of the finest texels that the budget came to hold. On the right, for
every scene, wrong pixels of the adaptive map over those of the uniform map of the same memory: better is left of 1, and
none at all stands at 0.01.
"""

import itertools
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from experiments.adaptive_views import KIB, Stage, Wrong, check_view
from experiments.base import Claim
from experiments.claiming import all_true
from shadowjax._checks import require, require_int
from shadowjax.plotting import PALETTE, label, new_figure, styled
from shadowjax.scenes import SCENES, make_scene


@dataclass(frozen=True)
class Config:
    """Settings.

    Attributes:
        scene: Name of a built-in scene.
        num_triangles: About how many triangles it has.
        height: Pixels down, ≥ 24.
        resolutions: Sides of the uniform maps, rising, texels.
        budgets_kib: Memory of the adaptive maps, rising, KiB.
        texels_per_pixel: Texels asked for along a pixel.
        tile_size: Texels along a tile, a power of two.
        factor: Memory of a uniform map over that of the largest budget, ≥ 1: which of them is claimed to be no better.
        other_scenes: Built-in scenes that are compared with the uniform map of the same memory, at their default size.
        other_height: Pixels down in these, ≥ 24.
        other_budgets_kib: Memory of their maps, rising, each that of a square map of whole texels.
    """

    scene: str = "colonnade"
    num_triangles: int = 8000
    height: int = 360
    resolutions: tuple[int, ...] = (256, 512, 1024, 2048, 4096, 8192)
    budgets_kib: tuple[int, ...] = (256, 512, 1024, 2048, 4096, 8192, 16384)
    texels_per_pixel: float = 8.0
    tile_size: int = 16
    factor: float = 16.0
    other_scenes: tuple[str, ...] = tuple(SCENES)
    other_height: int = 120
    other_budgets_kib: tuple[int, ...] = (256, 1024)

    def __post_init__(self):
        check_view(self.scene, self.num_triangles, self.height)
        for scene in self.other_scenes:
            check_view(scene, 1, self.other_height)
        square = all(math.isqrt(KIB * budget // 4) ** 2 * 4 == KIB * budget for budget in self.other_budgets_kib)
        require(square, f"other_budgets_kib must hold square maps, such as 256 or 1024; got {self.other_budgets_kib}")
        for values, name in ((self.resolutions, "resolutions"), (self.budgets_kib, "budgets_kib")):
            rises = len(values) > 1 and all(b > a for a, b in itertools.pairwise(values))
            require(rises, f"{name} must be two or more that rise; got {values}")
            require_int(min(values), name, 1)
        largest = 4 * self.resolutions[-1] ** 2 / (KIB * self.budgets_kib[-1])
        require(
            1 <= self.factor <= largest,
            f"factor must lie between 1 and {largest:g}, the memory of the largest uniform map over the largest budget",
        )


@dataclass(frozen=True)
class Compared:
    """One scene under uniform and adaptive maps of the same memory.

    Attributes:
        near: Pixels near an edge.
        uniform: Wrong ones among them for the uniform map of each budget.
        adaptive: For the adaptive map.
    """

    near: int
    uniform: tuple[int, ...]
    adaptive: tuple[int, ...]

    @property
    def ratio(self) -> np.ndarray:
        """Wrong pixels of adaptive maps over those of uniform ones; 1 where neither has any."""
        uniform, adaptive = np.asarray(self.uniform, float), np.asarray(self.adaptive, float)
        return np.where((uniform == 0) & (adaptive == 0), 1.0, adaptive / np.maximum(uniform, 0.5))

    @property
    def wins(self) -> bool:
        """Whether the adaptive map is better at every budget."""
        return bool((np.asarray(self.adaptive) < np.asarray(self.uniform)).all())


@dataclass(frozen=True)
class Result:
    """Wrong pixels.

    Attributes:
        config: The settings.
        near: Pixels near an edge.
        uniform: Of every uniform map.
        adaptive: Of every budget.
        held: Bytes that every adaptive map holds.
        resident: Tiles that it came to hold.
        finest: Texels across at the finest level among them.
        equivalent: Side of the uniform map that is as good.
        compared: Index of the smallest uniform map of at least `factor` times the largest budget.
        others: Every other scene.
    """

    config: Config
    near: int
    uniform: tuple[Wrong, ...]
    adaptive: tuple[Wrong, ...]
    held: tuple[int, ...]
    resident: tuple[int, ...]
    finest: tuple[int, ...]
    equivalent: np.ndarray
    compared: int
    others: Mapping[str, Compared]


def equivalent_resolution(resolutions: np.ndarray, wrong: np.ndarray, found: np.ndarray) -> np.ndarray:
    """Side of the uniform map with a given number of wrong pixels.

    Args:
        resolutions: Sides of measured maps, rising.
        wrong: Their wrong pixels; made to fall before they are read.
        found: Wrong pixels of other maps.
    """
    falling = np.maximum(np.minimum.accumulate(wrong.astype(float)), 0.5)
    wanted = np.maximum(found.astype(float), 0.5)
    inside = np.exp(np.interp(-np.log(wanted), -np.log(falling), np.log(resolutions)))
    return np.where(wanted < falling[-1], resolutions[-1] * falling[-1] / wanted, inside)


def run(config: Config) -> Result:
    """Look once; cast every map and count."""
    stage = Stage(config.scene, config.num_triangles, config.height)
    uniform = tuple(stage.uniform(resolution) for resolution in config.resolutions)
    adaptive, held, resident, finest = [], [], [], []
    for budget in config.budgets_kib:
        shadows = stage.adaptive(budget, tile_size=config.tile_size, texels_per_pixel=config.texels_per_pixel)
        adaptive.append(stage.wrong(shadows))
        held.append(shadows.map_bytes)
        resident.append(shadows.map.store.num_resident)
        finest.append(config.tile_size << int(np.max(np.asarray(shadows.map.store.keys)[:, 0])))
    sides = np.asarray(config.resolutions, float)
    found = [np.array([one.near for one in many]) for many in (uniform, adaptive)]
    wanted = config.factor * KIB * config.budgets_kib[-1]
    return Result(
        config, int(stage.near.sum()), uniform, tuple(adaptive), tuple(held), tuple(resident), tuple(finest),
        equivalent_resolution(sides, *found), int(np.flatnonzero(4 * sides**2 >= wanted)[0]),
        on_scenes(config),
    )  # fmt: skip


def on_scenes(config: Config) -> dict[str, Compared]:
    """Both kinds of map on every other scene; meshes are filled up to one size."""
    meshes = [make_scene(name).mesh for name in config.other_scenes]
    filled = (
        max((mesh.vertices.shape[0] for mesh in meshes), default=0),
        max((mesh.faces.shape[0] for mesh in meshes), default=0),
    )
    return {name: compare(config, name, filled) for name in config.other_scenes}


def compare(config: Config, scene: str, filled: tuple[int, int]) -> Compared:
    """Both kinds of map on one scene."""
    stage, uniform, adaptive = Stage(scene, None, config.other_height, filled=filled), [], []
    for budget in config.other_budgets_kib:
        uniform.append(stage.uniform(math.isqrt(KIB * budget // 4)).near)
        shadows = stage.adaptive(budget, tile_size=config.tile_size, texels_per_pixel=config.texels_per_pixel)
        adaptive.append(stage.wrong(shadows).near)
    return Compared(int(stage.near.sum()), tuple(uniform), tuple(adaptive))


def claims(result: Result) -> tuple[Claim, ...]:
    """The number to reach, and what memory buys."""
    config, near = result.config, np.array([one.near for one in result.adaptive])
    uniform = np.array([one.near for one in result.uniform])
    budgets = KIB * np.asarray(config.budgets_kib)
    side = config.resolutions[result.compared]
    own = np.sqrt(budgets / 4)
    return (
        Claim(f"{config.budgets_kib[-1]} KiB of tiles are as good as a uniform map of {side}²,"
              f" {4 * side**2 / budgets[-1]:g} times their memory",
              bool(near[-1] <= uniform[result.compared]), f"{near[-1]} wrong pixels near edges",
              f"at most {uniform[result.compared]}"),
        all_true(f"on {config.scene}, every budget beats the uniform map that it would hold", result.equivalent > own,
                 "budgets"),
        _on_scenes(result),
        all_true("tiles and page table keep within the budget", np.asarray(result.held) <= budgets, "budgets"),
        all_true("wrong pixels do not rise with memory, but for three in a hundred",
                 near[1:] <= 1.03 * near[:-1] + 2, "steps"),
        Claim("the finest tiles are finer than any uniform map of that memory",
              result.finest[-1] > own[-1], f"{result.finest[-1]} texels across", f"more than {own[-1]:.0f}"),
    )  # fmt: skip


def _on_scenes(result: Result) -> Claim:
    """On how many scenes the adaptive map is better at every budget, and on which it is not."""
    wins = [scene for scene, one in result.others.items() if one.wins]
    rest = [
        f"{scene} ({', '.join(f'{a} to {u}' for a, u in zip(one.adaptive, one.uniform, strict=True))} wrong pixels)"
        for scene, one in result.others.items()
        if not one.wins
    ]
    budgets = " and ".join(str(budget) for budget in result.config.other_budgets_kib)
    return Claim(
        f"at {budgets} KiB the adaptive map beats the uniform map of its memory on most scenes measured",
        2 * len(wins) > len(result.others),
        f"on {len(wins)} of {len(result.others)}" + (f"; not on {', '.join(rest)}" if rest else ""),
        "more than half of them",
    )


def numbers(result: Result) -> dict[str, Any]:
    """Both curves."""
    config = result.config
    return {
        "near_edges": result.near, "resolutions": config.resolutions, "uniform": result.uniform,
        "budgets_kib": config.budgets_kib, "adaptive": result.adaptive, "held_bytes": result.held,
        "resident_tiles": result.resident, "finest_across": result.finest,
        "equivalent_resolution": result.equivalent, "other_scenes": result.others,
    }  # fmt: skip


@styled
def draw(result: Result) -> Figure:
    """Wrong pixels over memory, and equivalent resolution."""
    config = result.config
    figure, axes = new_figure(13.2, 4.6, 1, 3)
    left, right, scenes = axes[0]
    mib = np.asarray(config.resolutions, float) ** 2 * 4 / KIB**2
    budgets = np.asarray(config.budgets_kib) / KIB
    share = [100 * np.array([one.near for one in many]) / result.near for many in (result.uniform, result.adaptive)]
    left.plot(mib, share[0], "o-", color=PALETTE[0], markersize=5, label="uniform map")
    left.plot(budgets, share[1], "s-", color=PALETTE[1], markersize=5, label="adaptive map")
    left.axvspan(budgets[-1], config.factor * budgets[-1], color="#d9d9d9", alpha=0.5, linewidth=0)
    left.set_xscale("log", base=2)
    left.set_yscale("log")
    label(left, "memory, MiB", "wrong pixels near edges, %", "Error against memory")
    left.legend(loc="lower left")
    right.plot(budgets, result.equivalent, "s-", color=PALETTE[1], markersize=5, label="as good as a uniform map of")
    right.plot(budgets, result.finest, "^:", color=PALETTE[2], markersize=5, label="finest tiles")
    right.plot(budgets, np.sqrt(budgets * KIB**2 / 4), "--", color="#4d4d4d", label="a uniform map in this memory")
    right.axhline(config.resolutions[-1], color="#8c8c8c", linewidth=0.8)
    right.annotate("largest measured", (budgets[0], config.resolutions[-1]), (0, 3), textcoords="offset points",
                   fontsize=8, color="#4d4d4d")  # fmt: skip
    right.set_xscale("log", base=2)
    right.set_yscale("log", base=2)
    label(right, "memory, MiB", "texels across", "Equivalent resolution")
    right.legend(loc="lower right")
    names = list(result.others)
    place = np.arange(len(names))[::-1]
    for index, budget in enumerate(config.other_budgets_kib):
        ratios = [max(float(result.others[name].ratio[index]), 1e-2) for name in names]
        scenes.plot(ratios, place, "os^D"[index % 4], color=PALETTE[1 + index], markersize=5, label=f"{budget} KiB")
    scenes.axvline(1, color="#4d4d4d", linewidth=0.8)
    scenes.set_xscale("log")
    scenes.set_yticks(place, names, fontsize=7.5)
    label(scenes, "wrong pixels, adaptive over uniform", "", "Every scene, same memory")
    scenes.legend(loc="upper left")
    return figure
