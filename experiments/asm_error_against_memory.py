"""asm, adaptive shadow maps: wrong pixels against memory, beside uniform maps of any size.

The source gives no numbers: it says that an adaptive map adapts to the view and keeps within a memory that is set.
Measured: pixels near an exact shadow's edge (two pixels on either side) whose answer is not the exact one, for uniform
maps and for adaptive maps under a budget that holds their tiles and their page table. The uniform map that is as good
gives the equivalent resolution: between measured sizes by a straight line in logarithms, beyond the largest one by the
law of a hard test, that wrong pixels fall with the length of a texel.

How to read it: on the left both kinds over their bytes; the shaded band is the factor of 16 in memory. On the right
the resolution of the uniform map that is as good as each budget, beside the map that the budget itself would hold; the
finest tiles are the texels across a uniform map of the finest texels that the budget came to hold.
"""

import itertools
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from experiments.adaptive_views import KIB, Stage, Wrong, check_view
from experiments.base import Claim
from experiments.claiming import all_true
from shadowjax._checks import require, require_int
from shadowjax.plotting import PALETTE, label, new_figure, styled


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
    """

    scene: str = "colonnade"
    num_triangles: int = 8000
    height: int = 360
    resolutions: tuple[int, ...] = (256, 512, 1024, 2048, 4096, 8192)
    budgets_kib: tuple[int, ...] = (256, 512, 1024, 2048, 4096, 8192, 16384)
    texels_per_pixel: float = 8.0
    tile_size: int = 16
    factor: float = 16.0

    def __post_init__(self):
        check_view(self.scene, self.num_triangles, self.height)
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
    )  # fmt: skip


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
        all_true("every budget beats the uniform map that it would hold", result.equivalent > own, "budgets"),
        all_true("tiles and page table keep within the budget", np.asarray(result.held) <= budgets, "budgets"),
        all_true("wrong pixels do not rise with memory, but for three in a hundred",
                 near[1:] <= 1.03 * near[:-1] + 2, "steps"),
        Claim("the finest tiles are finer than any uniform map of that memory",
              result.finest[-1] > own[-1], f"{result.finest[-1]} texels across", f"more than {own[-1]:.0f}"),
    )  # fmt: skip


def numbers(result: Result) -> dict[str, Any]:
    """Both curves."""
    config = result.config
    return {
        "near_edges": result.near, "resolutions": config.resolutions, "uniform": result.uniform,
        "budgets_kib": config.budgets_kib, "adaptive": result.adaptive, "held_bytes": result.held,
        "resident_tiles": result.resident, "finest_across": result.finest,
        "equivalent_resolution": result.equivalent,
    }  # fmt: skip


@styled
def draw(result: Result) -> Figure:
    """Wrong pixels over memory, and equivalent resolution."""
    config = result.config
    figure, axes = new_figure(9.6, 4.3, 1, 2)
    left, right = axes[0]
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
    return figure
