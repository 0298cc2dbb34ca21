"""filtering, table 4.2: memory of each technique, computed from texture formats.

The source prints 36 numbers "in MB". Measured here: formats give 35 of them, with R32F for depths, RG32F for two
moments, eight RGBA16F and one R32F for convolution maps with M = 16, mip chains on all but the last, and temporary
textures without. The unit is neither 10⁶ nor 2²⁰ bytes but 1024 · 1000, each texture rounded up to whole KiB. One cell
is wrong: the temporary texture of the convolution map at 256², printed 0.512 like the row of variance maps next to it,
is 0.256.

How to read it: dots are printed, lines computed; the cross is the wrong cell.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from experiments.base import Claim
from shadowjax._checks import require_int
from shadowjax.filters.convolution import Convolution, basis_bytes
from shadowjax.filters.exponential_variance import ExponentialVariance
from shadowjax.filters.moment import Moments
from shadowjax.filters.variance import Variance
from shadowjax.plotting import label, new_figure, series_style, styled
from shadowjax.theory import memory

KEPT = ("pcf", "vsm", "csm", "xcsm", "esm")
OURS = {"vsm": Variance(), "evsm4": ExponentialVariance(), "msm": Moments(), "csm": Convolution()}


@dataclass(frozen=True)
class Config:
    """Settings.

    Attributes:
        resolution: Texels along a side at which filters of this package are compared, ≥ 1.
    """

    resolution: int = 1024

    def __post_init__(self):
        require_int(self.resolution, "resolution", 1)


@dataclass(frozen=True)
class Result:
    """Tables.

    Attributes:
        printed: Rows and columns of the source.
        computed: The same from formats.
        wrong: (resolution, column, printed, computed) of cells that differ.
        others: Filter → mebibytes of its planes in textures here.
        resolution: At which the last holds.
    """

    printed: np.ndarray
    computed: np.ndarray
    wrong: list[tuple[int, str, float, float]]
    others: dict[str, float]
    resolution: int


def run(config: Config) -> Result:
    """Compute every cell."""
    table = memory.source_table()
    side = config.resolution
    others = {
        name: sum(t.num_bytes(side) for t in memory.planes_in_formats(filter_.num_planes)) / 2**20
        for name, filter_ in OURS.items()
    }
    return Result(
        np.array([memory.PRINTED_TABLE[size] for size in memory.TABLE_SIZES]),
        np.array([table[size] for size in memory.TABLE_SIZES]),
        memory.wrong_cells(),
        others,
        side,
    )


def claims(result: Result) -> tuple[Claim, ...]:
    """35 cells of 36."""
    good = int((np.abs(result.printed - result.computed) < 5e-4).sum())
    columns = list(memory.TABLE_COLUMNS)
    ratio = result.computed[:, columns.index("csm")] / result.computed[:, columns.index("esm")]
    exact = memory.SOURCE_STORAGE["csm"].num_bytes(2048)
    side = result.resolution
    kept = memory.planes_in_formats(32, 16)
    return (
        Claim("formats give the printed numbers", good == 35, f"{good} cells of {result.printed.size}", "35 of 36"),
        Claim(
            "corrected: CSM's temporary texture at 256² takes 0.256",
            result.wrong == [(256, "csm C", 0.512, 0.256)],
            str(result.wrong),
            "one cell",
        ),
        Claim(
            "a convolution map takes 16.7 times an exponential one",
            bool(((ratio > 16.6) & (ratio < 16.8)).all()),
            f"{ratio.min():.2f} to {ratio.max():.2f}",
            "16.6 to 16.8",
        ),
        Claim(
            "corrected: the unit is 1024 · 1000 bytes",
            abs(exact / 1_024_000 - 365.9) < 0.05,
            f"{exact:,} bytes are {exact / 1_024_000:.1f}",
            "365.9, not 374.7 (10⁶) or 357.3 (2²⁰)",
        ),
        Claim(
            "2M planes of 16 bits are what this package counts",
            sum(t.num_bytes(side) for t in kept) == basis_bytes(16, side, side, 2),
            f"{sum(t.num_bytes(side) for t in kept):,} bytes",
            "the same",
        ),
    )


def numbers(result: Result) -> dict[str, Any]:
    """Both tables."""
    return {
        "columns": memory.TABLE_COLUMNS, "rows": memory.TABLE_SIZES, "printed": result.printed,
        "computed": result.computed, "mebibytes_here": result.others,
    }  # fmt: skip


@styled
def draw(result: Result) -> Figure:
    """Memory over resolution, and of more filters at one resolution."""
    figure, axes = new_figure(9.2, 4.2, 1, 2)
    left, right = axes[0]
    sizes, columns = np.array(memory.TABLE_SIZES), list(memory.TABLE_COLUMNS)
    for index, name in enumerate(("csm", "vsm", "vsm C", "pcf", "esm C")):
        column = columns.index(name)
        style = series_style(index)
        shared = {"pcf": "PCF, XCSM, ESM", "esm C": "blur of CSM, XCSM, ESM", "vsm C": "blur of VSM"}
        shown = shared.get(name, name.upper())
        left.plot(sizes, result.computed[:, column], color=style["color"], label=shown)
        left.plot(sizes, result.printed[:, column], style["marker"], color=style["color"])
    for size, _, printed, _ in result.wrong:
        left.plot([size], [printed], "x", color="#1d2330", markersize=11, markeredgewidth=2, label="wrong cell: 0.512")
    left.set_xscale("log", base=2)
    left.set_yscale("log")
    left.set_xticks(sizes, [f"{size}²" for size in sizes])
    left.legend(fontsize=8)
    label(left, "size of the map (texels)", "memory (1024 · 1000 bytes)", "Printed (marks) and from formats (lines)")
    names = list(result.others)
    right.barh(names, list(result.others.values()), color=series_style(0)["color"], height=0.6)
    for row, value in enumerate(result.others.values()):
        right.text(value, row, f" {value:.0f} MiB", va="center", fontsize=8.5)
    right.invert_yaxis()
    right.set_xlim(0, 1.2 * max(result.others.values()))
    right.grid(axis="y", visible=False)
    label(right, "memory (MiB)", "", f"Here, 32 bits at {result.resolution}², no mip chains")
    return figure
