"""mdsm, equations 5.6 and 5.7, figures 5.6 to 5.8: when does a multi-depth map with a smaller filter cost less?

The source counts depth fetches: PCF with k taps costs f·k for f fragments (eq. 5.3), a 2-SM costs q per texel once and
then fewer taps (eq. 5.5), so it pays above f = q·h·w/r, where r is the number of taps saved (eq. 5.6). It times quads
over the whole screen: on one graphics card the lines cross, though not where predicted (figure 5.6), on a newer one
they do not cross within the plot (figure 5.8).

Measured: q and k are counted on the package's own functions, by changing one depth at a time and looking at what
changes. Then the same fragments as the source's, layers of quads that cover the map, are shaded on this machine's
processor in several turns, in which the filters alternate; a straight line through each filter's processor times gives
a time per fragment for each turn. What is compared is its ratio to another filter's within one turn: the median of the
turns, and the range that holds four fifths of them. Where that range is wider than a fifth of the median, the machine
was not quiet enough, and no time is claimed. The right chart enlarges the origin, as figure 5.7 does: there the fixed
cost of the 2-SM shows.

Found: the counts are as predicted. A second depth is no free channel of a texel here but one more read and one more
test, so 2-SM + PCF 2 × 2 pays 8 of them against 9, not 4 against 9; and building the 2-SM reads memory in order, which
costs less than as many scattered fetches. Replacing 16 taps by 4 may pay even where each pixel of a picture as large as
the map is shaded once: the source says that this never happens at equal sizes, but eq. 5.7 allows it whenever r exceeds
q. Whether and where lines cross on a clock is this machine's answer at this moment, and stands here only when turns
agree.

How to read it: lines are predictions on the left and fits on the right, markers are counts and least times.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from experiments.base import Claim
from experiments.fragment_cost import BLOCK, NINE, SETUPS, SIXTEEN, TWO, count_reads, measure
from experiments.layout import mark_x
from shadowjax._checks import require, require_int
from shadowjax._types import Float
from shadowjax.plotting import label, new_figure, series_style, styled
from shadowjax.theory.cost import (
    crossover_fragments,
    first_cheaper_fragments,
    lookup_fetches,
    multi_depth_fetches,
    size_ratio_threshold,
)

WIDEST = 0.2  # range of the ratios of turns over their median, for which a time is claimed
NEIGHBOURS = 9  # q of the source: the 3 × 3 neighbourhood


@dataclass(frozen=True)
class Config:
    """Settings.

    Attributes:
        map_size: Texels along each side of the map, a multiple of 64.
        most_layers: Largest number of quads over the whole map, ≥ 1.
        steps: Numbers of fragments tried between 0 and that, ≥ 3.
        turns: Times each is measured, ≥ 2.
    """

    map_size: int = 512
    most_layers: float = 3.0
    steps: int = 9
    turns: int = 9

    def __post_init__(self):
        require_int(self.map_size, "map_size", 64)
        require(self.map_size % 64 == 0, f"map_size must be a multiple of 64; got {self.map_size}")
        require(self.most_layers >= 1, f"most_layers must be at least 1; got {self.most_layers}")
        require_int(self.steps, "steps", 3)
        require_int(self.turns, "turns", 2)


@dataclass(frozen=True)
class Result:
    """Counts and times.

    Attributes:
        texels: h·w.
        build: Texels read for one texel of the 2-SM.
        taps: Setup → texels read for one fragment.
        depths: Setup → depths read for one fragment.
        fragments: Numbers of fragments.
        predicted: Setup → fetches by eqs 5.3 and 5.5 with q = 9 and k of the filter's size.
        counted: Setup → fetches with the counts above.
        times: Setup → processor time in every turn, seconds.
    """

    texels: int
    build: int
    taps: Mapping[str, int]
    depths: Mapping[str, int]
    fragments: np.ndarray
    predicted: Mapping[str, np.ndarray]
    counted: Mapping[str, np.ndarray]
    times: Mapping[str, Float[np.ndarray, "turns blocks"]]

    @property
    def least(self) -> Mapping[str, np.ndarray]:
        """Setup → least time of each number of fragments."""
        return {name: seconds.min(axis=0) for name, seconds in self.times.items()}

    @property
    def slopes(self) -> Mapping[str, np.ndarray]:
        """Setup → seconds per fragment in every turn."""
        return {name: np.array([slope_of(self.fragments, turn)[0] for turn in t]) for name, t in self.times.items()}

    def ratio(self, name: str, other: str) -> "Spread":
        """Time per fragment of one filter over that of another, turn by turn."""
        return Spread.of(self.slopes[name] / self.slopes[other])

    @property
    def steady(self) -> bool:
        """Whether turns agree well enough for times to be claimed."""
        return all(self.ratio(TWO, plain).width < WIDEST for plain in (NINE, SIXTEEN))

    @property
    def fixed(self) -> float:
        """Seconds that the 2-SM costs before the first fragment."""
        return max(0.0, float(np.median(self.times[TWO][:, 0] - self.times[NINE][:, 0])))

    def crossing(self, plain: str) -> float | None:
        """Fragments above which the 2-SM is faster than a plain map; None where turns do not agree that it ever is."""
        gain = self.slopes[plain] - self.slopes[TWO]
        return self.fixed / float(np.median(gain)) if Spread.of(gain).low > 0 else None


@dataclass(frozen=True)
class Spread:
    """The median of some turns, and the range that holds four fifths of them."""

    median: float
    low: float
    high: float

    @classmethod
    def of(cls, values: np.ndarray) -> "Spread":
        """From one value a turn."""
        low, median, high = np.quantile(values, [0.1, 0.5, 0.9])
        return cls(float(median), float(low), float(high))

    @property
    def width(self) -> float:
        """The range over the median."""
        return (self.high - self.low) / abs(self.median)

    def __str__(self) -> str:
        return f"{100 * self.median:.0f} % ({100 * self.low:.0f} to {100 * self.high:.0f} %)"


def run(config: Config) -> Result:
    """Count, then measure."""
    texels, size = config.map_size**2, config.map_size
    close = np.linspace(0.0, 0.12, 4)  # of a layer: the enlarged origin
    layers = np.unique(np.concatenate([close, np.linspace(0.0, config.most_layers, config.steps)]))
    blocks = np.unique(np.round(layers * texels / BLOCK).astype(int))
    fragments = blocks * BLOCK
    build, taps, depths = count_reads()

    def fetches(neighbours: int, name: str, num_taps: int) -> np.ndarray:
        if SETUPS[name][1] == 1:
            return np.array([lookup_fetches(int(f), num_taps) for f in fragments])
        return np.array([multi_depth_fetches(size, size, neighbours, int(f), num_taps) for f in fragments])

    times = measure(size, blocks, config.turns)
    return Result(
        texels, build, taps, depths, fragments,
        predicted={name: fetches(NEIGHBOURS, name, setup[0] ** 2) for name, setup in SETUPS.items()},
        counted={name: fetches(build, name, taps[name]) for name in SETUPS},
        times=times,
    )  # fmt: skip


def slope_of(fragments: np.ndarray, seconds: np.ndarray) -> tuple[float, float]:
    """Slope of the line from the first time through the others, whose variance grows with f, and its standard error."""
    count, extra = fragments[1:].astype(float), seconds[1:] - seconds[0]
    slope = extra.sum() / count.sum()
    spread = np.sum((extra - slope * count) ** 2 / count) / (count.size - 1)
    return float(slope), float(np.sqrt(spread / count.sum()))


def _where(result: Result, plain: str) -> str:
    crossing = result.crossing(plain)
    if not result.steady:
        return "turns differ too much for a claim"
    if crossing is not None:
        return f"2-SM pays from about {crossing / 1e3:.2g} thousand fragments on"
    return "2-SM never pays" if result.ratio(TWO, plain).low > 1 else "no difference beyond noise, no crossing"


def claims(result: Result) -> tuple[Claim, ...]:
    """The counts are the source's; the times of this machine are not, and why."""
    size = round(result.texels**0.5)
    saved = {name: SETUPS[name][0] ** 2 - SETUPS[TWO][0] ** 2 for name in (NINE, SIXTEEN)}
    first = {name: first_cheaper_fragments(size, size, NEIGHBOURS, r) for name, r in saved.items()}

    def cheaper(name: str, f: int) -> bool:
        return result.build * result.texels + f * result.taps[TWO] < f * result.taps[name]

    turning = all(cheaper(name, f) and not cheaper(name, f - 1) for name, f in first.items())
    ratios = {name: size_ratio_threshold(NEIGHBOURS, r) for name, r in saved.items()}
    return (
        Claim(
            "functions read 9 texels for a texel of the 2-SM, and 9, 4 and 16 for a fragment",
            result.build == NEIGHBOURS and all(result.taps[name] == k**2 for name, (k, _) in SETUPS.items()),
            f"{result.build}; " + ", ".join(str(count) for count in result.taps.values()), "9; 9, 4, 16",
        ),
        Claim(
            "counted fetches equal eqs 5.3 and 5.5 at every number of fragments",
            all((result.counted[name] == result.predicted[name]).all() for name in SETUPS),
            f"{result.fragments.size} numbers of fragments", "all equal",
        ),
        Claim(
            "the 2-SM's counted fetches are fewer from eq. 5.6's first whole number on, and not before", turning,
            ", ".join(f"{name} {f}" for name, f in first.items()),
            ", ".join(f"above {float(crossover_fragments(size, size, NEIGHBOURS, r)):.1f}" for r in saved.values()),
        ),
        Claim(
            "corrected: eq. 5.7 can hold at equal sizes: q/r is 1.8 for 9 → 4 taps but 0.75 for 16 → 4",
            ratios[NINE] > 1 > ratios[SIXTEEN], ", ".join(f"{float(ratio):g}" for ratio in ratios.values()),
            "one above and one below 1",
        ),
        Claim(
            "a second depth is a second read: a fragment of 2-SM + PCF 2 × 2 reads 8 depths against 9",
            (result.depths[TWO], result.depths[NINE]) == (8, 9), f"{result.depths[TWO]} and {result.depths[NINE]}",
            "8 and 9",
        ),
        *(_timed_claims(result) if result.steady else ()),
    )  # fmt: skip


def _timed_claims(result: Result) -> tuple[Claim, ...]:
    """What the clock says, where turns agree."""
    nine, sixteen = result.ratio(TWO, NINE), result.ratio(TWO, SIXTEEN)
    once = int(np.abs(result.fragments - result.texels).argmin())
    equal = Spread.of(result.times[TWO][:, once] / result.times[SIXTEEN][:, once])
    fetches = float(np.median(result.slopes[NINE])) * result.texels
    return (
        Claim(
            f"this machine, 9 → 4 taps: {_where(result, NINE)}; the gain per fragment falls short of the model's",
            nine.low > 4 / 9, f"time per fragment {nine} of PCF 3 × 3's", "more than the model's 44 %", timed=True,
        ),
        Claim(
            "this machine: building the 2-SM costs less than the fetches it is counted as",
            result.fixed < fetches, f"{1e3 * result.fixed:.2f} ms",
            f"less than {1e3 * fetches:.2f} ms for as many fetches in filters", timed=True,
        ),
        Claim(
            f"this machine, 16 → 4 taps: {_where(result, SIXTEEN)}; at equal sizes the 2-SM is faster",
            equal.high < 1, f"time per fragment {sixteen}, of one layer {equal} of PCF 4 × 4's", "less than 100 %",
            timed=True,
        ),
    )  # fmt: skip


def numbers(result: Result) -> dict[str, Any]:
    """Counts, times and crossings."""
    return {
        "texels": result.texels, "texels_read_per_built_texel": result.build, "texels_read_per_fragment": result.taps,
        "depths_read_per_fragment": result.depths, "fragments": result.fragments, "fetches": result.counted,
        "seconds": result.least, "seconds_per_fragment_by_turn": result.slopes, "turns_agree": result.steady,
        "measured_crossing_fragments": {name: result.crossing(name) for name in (NINE, SIXTEEN)},
    }  # fmt: skip


@styled
def draw(result: Result) -> Figure:
    """Fetches, times, and times near the origin."""
    figure, axes = new_figure(11.5, 4.3, 1, 3)
    left, middle, right = axes[0]
    thousands, close = result.fragments / 1e3, result.fragments <= 0.14 * result.texels
    for index, name in enumerate(SETUPS):
        style = series_style(index)
        color, marker = style["color"], style["marker"]
        left.plot(thousands, result.predicted[name] / 1e6, color=color)
        left.plot(thousands, result.counted[name] / 1e6, marker, color=color, markersize=4.5, label=name)
        least = result.least[name]
        slope, start = slope_of(result.fragments, least)[0], least[0]
        milliseconds = 1e3 * least
        middle.plot(thousands, 1e3 * (start + slope * result.fragments), color=color, linewidth=1.2)
        middle.plot(thousands, milliseconds, marker, color=color, markersize=4.5)
        right.plot(thousands[close], milliseconds[close], color=color, marker=marker, markersize=4.5, linewidth=1.2)
    size = round(result.texels**0.5)
    for name in (NINE, SIXTEEN):
        crossover = float(crossover_fragments(size, size, NEIGHBOURS, SETUPS[name][0] ** 2 - 4))
        mark_x(left, crossover / 1e3, f"pays above {crossover:.0f}\nagainst {name}")
    label(left, "fragments (thousands)", "depth fetches (millions)", "Counted, on eqs 5.3 and 5.5")
    label(middle, "fragments (thousands)", "processor time (ms)", "Measured on this machine")
    label(right, "fragments (thousands)", "processor time (ms)", "Measured, near the origin")
    middle.set_ylim(top=1.35e3 * max(float(seconds.max()) for seconds in result.least.values()))  # room for the text
    for spot in (left, middle, right):
        spot.set_ylim(bottom=0)
        spot.set_xlim(left=-0.02 * spot.get_xlim()[1])
    lines = [f"against {name}:\n{_where(result, name)}" for name in (NINE, SIXTEEN)]
    middle.text(0.03, 0.98, "\n".join(lines), transform=middle.transAxes, va="top", fontsize=7.5)
    handles, names = left.get_legend_handles_labels()
    figure.legend(handles, names, loc="outside lower center", ncols=3)
    return figure
