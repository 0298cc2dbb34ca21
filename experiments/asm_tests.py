"""asm, depth or polygon id: what each test gets wrong over the bias, and what the hybrid repairs.

The source asks first whether a texel sees the receiver's own polygon (Hourcade's test) and, where it does not, compares
depths. It says that the hybrid is better than either alone: ids fail along edges between polygons, depths need a
tolerance that is hard to choose.

Measured: pixels that differ from the exact shadow, dark ones and lit ones apart, for the three tests read from *one*
adaptive map, over the bias. Neighbouring triangles of one plane count as one polygon. Ids take two bytes for every
texel next to four of depth, so the depth test is also measured with tiles that fill the same memory without them.

How to read it: a test that needs no tolerance is flat. On the left dark pixels that should be lit (speckles, dark
seams), in the middle lit pixels that should be dark, on the right both together.
"""

import itertools
from dataclasses import dataclass
from typing import Any

import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure

from experiments.adaptive_views import Stage, Wrong, check_view
from experiments.base import Claim
from experiments.claiming import all_true
from shadowjax._checks import require, require_int
from shadowjax.bias.rule import Bias
from shadowjax.plotting import PALETTE, label, new_figure, styled
from shadowjax.plotting.style import legend_below
from shadowjax.techniques.adaptive import TESTS, AdaptiveShadows

SAME_MEMORY = "depth, same memory"


@dataclass(frozen=True)
class Config:
    """Settings.

    Attributes:
        scene: Name of a built-in scene.
        num_triangles: About how many triangles it has.
        height: Pixels down, ≥ 24.
        budget_kib: Memory of tiles, ids and page table, KiB.
        texels_per_pixel: Texels asked for along a pixel.
        biases: Slope bias in texels, rising from 0.
    """

    scene: str = "colonnade"
    num_triangles: int = 8000
    height: int = 360
    budget_kib: int = 4096
    texels_per_pixel: float = 8.0
    biases: tuple[float, ...] = (0.0, 0.125, 0.25, 0.5, 1.0, 2.0, 4.0)

    def __post_init__(self):
        check_view(self.scene, self.num_triangles, self.height)
        require_int(self.budget_kib, "budget_kib", 1)
        rises = len(self.biases) > 2 and all(b > a for a, b in itertools.pairwise(self.biases))
        require(rises and min(self.biases) == 0, "biases must be three or more that rise from 0")


@dataclass(frozen=True)
class Result:
    """Wrong pixels.

    Attributes:
        config: The settings.
        valid: Pixels that can be lit.
        wrong: Test → wrong pixels at every bias.
    """

    config: Config
    valid: int
    wrong: dict[str, tuple[Wrong, ...]]

    def of(self, name: str, what: str) -> np.ndarray:
        """One count of a test at every bias."""
        return np.array([getattr(one, what) for one in self.wrong[name]])


def run(config: Config) -> Result:
    """Build two maps, read one of them three ways."""
    stage = Stage(config.scene, config.num_triangles, config.height)
    options = {"texels_per_pixel": config.texels_per_pixel}
    full = stage.adaptive(config.budget_kib, test="hybrid", **options)
    lean = stage.adaptive(config.budget_kib, **options)
    readings = [(name, stage.technique(config.budget_kib, test=name, **options), full) for name in TESTS]
    wrong = {}
    for name, technique, built in [*readings, (SAME_MEMORY, lean.technique, lean)]:
        biased = (Bias(jnp.asarray(value, jnp.float32), "slope") for value in config.biases)
        shadows = [AdaptiveShadows(technique, built.mesh, built.polygons, built.map, bias) for bias in biased]
        wrong[name] = tuple(stage.wrong(one) for one in shadows)
    return Result(config, int(stage.valid.sum()), wrong)


def claims(result: Result) -> tuple[Claim, ...]:
    """What each test needs."""
    dark, lit, total = ({name: result.of(name, what) for name in result.wrong} for what in ("dark", "lit", "total"))
    least = {name: int(counts.min()) for name, counts in total.items()}
    return (
        Claim("ids need no tolerance: every bias gives the same answers", len(set(total["id"])) == 1,
              f"{len(set(total['id']))} different counts", "1"),
        Claim("without a bias the hybrid keeps less than half of the speckles of depth",
              2 * dark["hybrid"][0] < dark["depth"][0], f"{dark['hybrid'][0]}", f"below half of {dark['depth'][0]}"),
        all_true("the hybrid darkens no more than either alone",
                 dark["hybrid"] <= np.minimum(dark["id"], dark["depth"]), "biases"),
        all_true("and lights no fewer wrongly: a texel says lit if either test does",
                 lit["hybrid"] >= np.maximum(lit["id"], lit["depth"]), "biases"),
        Claim("at its best bias the hybrid is better than ids and than depth at theirs, on the same map",
              least["hybrid"] < min(least["id"], least["depth"]), f"{least['hybrid']} wrong pixels",
              f"less than {least['id']} and {least['depth']}"),
        Claim("the worst bias costs the hybrid less than half of what it costs depth",
              2 * total["hybrid"].max() < total["depth"].max(), f"{total['hybrid'].max()} wrong pixels",
              f"less than half of {total['depth'].max()}"),
    )  # fmt: skip


def numbers(result: Result) -> dict[str, Any]:
    """All counts."""
    return {"valid": result.valid, "biases": result.config.biases, "wrong": result.wrong}


@styled
def draw(result: Result) -> Figure:
    """Dark, lit and all wrong pixels over the bias."""
    figure, axes = new_figure(10.8, 4.0, 1, 3)
    titles = {"dark": "Dark, should be lit", "lit": "Lit, should be dark", "total": "Wrong"}
    for spot, (what, title) in zip(axes[0], titles.items(), strict=True):
        for index, name in enumerate(result.wrong):
            shown = np.maximum(100 * result.of(name, what) / result.valid, 50 / result.valid)
            style = "--" if name == SAME_MEMORY else "-"
            spot.plot(result.config.biases, shown, style, marker="os^D"[index], markersize=5, color=PALETTE[index],
                      label=name)  # fmt: skip
        spot.set_xscale("symlog", linthresh=0.125, base=2)
        spot.set_yscale("log")
        label(spot, "slope bias, texels", "pixels, %", title)
    legend_below(figure, axes[0, 1], columns=4)
    return figure
