"""mdsm, figures 4.7 to 4.11: which choices of extra depths see a shadow edge, for every direction of the edge.

The source argues with sketches: a second depth from a fixed or random neighbour can miss an edge (4.7), the largest or
smallest depth of the neighbourhood cannot (4.8), and four or more depths on a ring see it (4.9, 4.11) unless the
geometry changes too abruptly for the samples (4.10).

Measured: straight edges of every direction and sub-texel position, drawn into depth maps exactly, go through the
package's own policies. An edge texel has a texel of the other kind among its 8 neighbours; it sees the edge if at least
two of its n depths differ, for only then can a composite test return a tone between lit and dark. The rate is the share
of edge texels that see the edge. A maximum can differ only on the occluder's own texels and a minimum only behind
them, so these two are judged on that side, all others on both. Strips one texel wide and a lone texel stand for 4.10.

Found, beyond the source: rings with fewer than 8 samples miss up to half of the texels already along straight edges,
not only at abrupt geometry, though some texel of every edge does see it; and more samples are not always better: the
four of a 5-SM, all along the axes, see less on average than the three of a 4-SM. A ring of radius 2 sees straight edges
better and loses thin strips, as figure 4.10 warns.

How to read it: in the small maps (grey: occluder) dots are edge texels that see the edge and crosses those that miss
it. Below, the rate over the direction of the edge; curves that coincide are drawn once.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from experiments.base import Claim
from experiments.edge_drawing import MISSED, SEEN, SeenMap, draw_maps, draw_rates
from experiments.edge_maps import POLICIES, detected, differing_share, edge_texels, lone_texel, occluder_maps
from experiments.layout import empty_figure
from shadowjax._checks import require, require_int
from shadowjax.plotting import styled

SURE = ("2-SM max", "2-SM min", "3-SM min/max", "9-SM ring")
SPARSE = ("4-SM ring", "5-SM ring", "6-SM ring")
SHAPES = ("straight edge", "strip")


@dataclass(frozen=True)
class Config:
    """Settings.

    Attributes:
        map_size: Texels along each side of a map, odd, ≥ 17.
        angle_step_deg: Between directions of edges, degrees; divides 90.
        num_offsets: Sub-texel positions of each edge, ≥ 1.
        strip_width: Of the thin occluder, texels, ≥ 1 (thinner ones can vanish from the map altogether).
        picture_angle_deg: Direction of the edges in the small maps, degrees.
        seed: Of the stochastic policy.
    """

    map_size: int = 33
    angle_step_deg: float = 2.5
    num_offsets: int = 8
    strip_width: float = 1.0
    picture_angle_deg: float = 15.0
    seed: int = 0

    def __post_init__(self):
        require_int(self.map_size, "map_size", 17)
        require(self.map_size % 2 == 1, f"map_size must be odd, so that one texel is the middle; got {self.map_size}")
        require_int(self.num_offsets, "num_offsets", 1)
        require(self.strip_width >= 1, f"strip_width must be at least 1 texel; got {self.strip_width}")
        steps = 90 / self.angle_step_deg if self.angle_step_deg > 0 else 0.5
        require(abs(steps - round(steps)) < 1e-9, f"angle_step_deg must divide 90; got {self.angle_step_deg}")


@dataclass(frozen=True)
class Result:
    """Rates by policy; arrays run over the directions.

    Attributes:
        config: What it was run with.
        angles_deg: Directions of edges, degrees from the rows.
        rates: Shape → policy → share of edge texels that see it.
        found: Shape → policy → share of edges that some texel sees.
        random_excess: The stochastic policy's share on straight edges less what chance gives, and its standard error.
        lone: Policy → how many of the 8 neighbours of a lone occluder texel see it.
        pictures: Shape → policy → one map with what its edge texels see.
    """

    config: Config
    angles_deg: np.ndarray
    rates: Mapping[str, Mapping[str, np.ndarray]]
    found: Mapping[str, Mapping[str, np.ndarray]]
    random_excess: tuple[float, float]
    lone: Mapping[str, int]
    pictures: Mapping[str, Mapping[str, SeenMap]]


def run(config: Config) -> Result:
    """Measure all policies on all shapes."""
    angles = np.arange(0.0, 180.0, config.angle_step_deg)
    offsets = (np.arange(config.num_offsets) + 0.5) / config.num_offsets
    widths: dict[str, float | None] = {SHAPES[0]: None, SHAPES[1]: config.strip_width}

    def drawn(shape: str, angle_deg: float, where: np.ndarray) -> np.ndarray:
        return occluder_maps(config.map_size, angle_deg, where, widths[shape])

    # All maps of a policy go through it together: first the lone texel, then each shape with its picture in front.
    maps = {
        shape: np.concatenate(
            [drawn(shape, config.picture_angle_deg, offsets[:1]), *(drawn(shape, angle, offsets) for angle in angles)]
        )
        for shape in SHAPES
    }
    lone_map = lone_texel(config.map_size)
    rates: dict[str, dict[str, np.ndarray]] = {shape: {} for shape in SHAPES}
    found: dict[str, dict[str, np.ndarray]] = {shape: {} for shape in SHAPES}
    pictures: dict[str, dict[str, SeenMap]] = {shape: {} for shape in SHAPES}
    lone, excess = {}, (0.0, 0.0)
    for name, policy in POLICIES.items():
        sees = detected(policy, np.concatenate([lone_map, *maps.values()]), config.seed)
        lone[name] = int((sees[:1] & edge_texels(lone_map, "far")).sum())
        for shape, seen in zip(SHAPES, np.split(sees[1:], len(SHAPES)), strict=True):
            edge = edge_texels(maps[shape], policy.side)
            pictures[shape][name] = SeenMap(maps[shape][0], edge[0], seen[0])
            edge, seen = edge[1:], (seen & edge)[1:]
            per_edge = seen.reshape(angles.size, config.num_offsets, -1).sum(-1)
            rates[shape][name] = per_edge.sum(-1) / edge.reshape(angles.size, -1).sum(-1)
            found[shape][name] = (per_edge > 0).mean(-1)
            if name == "stochastic" and shape == SHAPES[0]:
                chance = differing_share(maps[shape][1:])[edge]
                error = np.sqrt((chance * (1 - chance)).sum()) / chance.size
                excess = (float(seen.sum() / chance.size - chance.mean()), float(error))
    return Result(config, angles, rates, found, excess, lone, pictures)


def _spread(rate: np.ndarray) -> str:
    return f"{100 * rate.min():.0f} to {100 * rate.max():.0f} %"


def claims(result: Result) -> tuple[Claim, ...]:
    """What sees an edge, what does not, and where the source's sketches say too much or too little."""
    straight, strip = (result.rates[shape] for shape in SHAPES)
    sure = min(rates[name].min() for rates in (straight, strip) for name in SURE)
    along, fixed = result.angles_deg == 0, straight["fixed"]
    off, error = result.random_excess
    sparse = {name: straight[name] for name in SPARSE}
    found = min(result.found[SHAPES[0]][name].min() for name in SPARSE)
    means = {name: float(rate.mean()) for name, rate in straight.items()}
    wide = "4-SM ring, radius 2"
    lone = {name: result.lone[name] for name in (*SPARSE, "9-SM ring")}
    return (
        Claim(
            "max, min, min/max and the full ring see every straight edge and strip at every texel and direction",
            bool(sure == 1), f"{100 * sure:.1f} % at worst", "100 %",
        ),
        Claim(
            "a fixed neighbour never sees an edge along its offset, and at most half of the texels of any other",
            bool(fixed[along].max() == 0 and fixed.max() <= 0.5 and fixed[~along].min() > 0), _spread(fixed),
            "0 % along the offset, at most 50 %",
        ),
        Claim(
            "a random neighbour sees an edge as often as neighbours differ: less than half of the texels, everywhere",
            bool(abs(off) <= 4 * error and straight["stochastic"].max() < 0.5),
            f"{_spread(straight['stochastic'])}, {off / error:+.1f} standard errors from the expected mean",
            "below 50 %, within 4 standard errors",
        ),
        Claim(
            "rings of 4- to 6-SM see every straight edge somewhere",
            bool(found == 1), f"{100 * found:.0f} % of edges", "100 %",
        ),
        Claim(
            "corrected: they miss texels already along straight edges, not only at abrupt geometry",
            all(rate.min() < 1 for rate in sparse.values()),
            ", ".join(f"{name} {_spread(rate)}" for name, rate in sparse.items()), "less than 100 % at some direction",
        ),
        Claim(
            "more samples are not always better: the 5-SM's, along the axes, see less than the 4-SM's",
            means["5-SM ring"] < means["4-SM ring"] < means["6-SM ring"],
            ", ".join(f"{name} {100 * means[name]:.1f} %" for name in SPARSE), "5-SM < 4-SM < 6-SM on average",
        ),
        Claim(
            "a lone texel is seen by exactly n − 1 of its 8 neighbours",
            all(count == int(name[0]) - 1 for name, count in lone.items()),
            ", ".join(f"{name} {count}" for name, count in lone.items()), "3, 4, 5, 8",
        ),
        Claim(
            "a wider ring sees straight edges better and thin strips worse",
            bool(means[wide] > means["4-SM ring"] and strip[wide].mean() < strip["4-SM ring"].mean()),
            f"{100 * means[wide]:.0f} % of straight edges, {100 * strip[wide].mean():.0f} % of strips",
            f"more than {100 * means['4-SM ring']:.0f} %, less than {100 * strip['4-SM ring'].mean():.0f} %",
        ),
    )  # fmt: skip


def numbers(result: Result) -> dict[str, Any]:
    """Rates of all policies."""
    return {
        "angles_deg": result.angles_deg, "rates": result.rates, "edges_found": result.found,
        "neighbours_that_see_a_lone_texel": result.lone, "stochastic_excess_and_standard_error": result.random_excess,
    }  # fmt: skip


@styled
def draw(result: Result) -> Figure:
    """Small maps above, rates below."""
    figure = empty_figure(11.0, 7.0)
    top, bottom = np.ravel(figure.subfigures(2, 1, squeeze=False, height_ratios=[1.0, 1.3]))
    spots = top.subplots(len(SHAPES), len(POLICIES), squeeze=False)
    for row, shape in zip(spots, SHAPES, strict=True):
        draw_maps(row, result.pictures[shape], f"{shape}, {result.config.picture_angle_deg:g}°", shape == SHAPES[0])
    charts = bottom.subplots(1, len(SHAPES), sharey=True)
    titles = "Straight edges", f"Strips {result.config.strip_width:g} texel wide"
    for spot, shape, title in zip(charts, SHAPES, titles, strict=True):
        draw_rates(spot, result.angles_deg, result.rates[shape], title)
    charts[0].set_ylabel("edge texels that see the edge (%)")
    handles, names = charts[0].get_legend_handles_labels()
    bottom.legend(handles, names, loc="outside lower center", ncols=4)
    marks = [Line2D([], [], color=color, marker=marker, linestyle="") for color, marker in ((SEEN, "o"), (MISSED, "x"))]
    top.legend(marks, ["edge texel sees the edge", "misses it"], loc="outside lower center", ncols=2)
    return figure
