"""mdsm, figure 5.3: PCF over one depth against smaller PCF over three, where shadows change abruptly.

The source compares (a) PCF 3 × 3 with (c) 3-SM + PCF 2 × 2, and (b) PCF 4 × 4 with (d) 3-SM + PCF 3 × 3, on a scene
with sudden changes; it finds each pair alike, counts at most 10 tones in (a) and 13 in (c), and sees small bright spots
in (c) that (a) has lost. It explains them by the smaller filter, whose effect stays closer to the edge (section 5.2.1).

Measured, on a plant's shadow, with the smallest and the largest depth of the 3 × 3 neighbourhood: tones and root mean
square differences; and on ideal maps how far from a straight edge a filter still gives tones, and how bright it leaves
square lit spots of 1 to 6 texels.

Found: tones and likeness are as the source says. Spots of 1 and 2 texels do stay brighter in (c), those of 4 and more
are darker, and the explanation is wrong: a 3-SM + PCF 2 × 2 reads (2 + 2)² texels and reaches 1.5 texels beyond an edge
between texels, PCF 3 × 3 only 1; it softens more pixels, not fewer. The smallest spots stay bright because the largest
depth of a neighbourhood makes lit spots grow; the smallest depth makes dark ones grow as much.

How to read it: look at the lit gaps between the leaves' shadows, in (a) against (c) and in (b) against (d).
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from experiments.base import Claim
from experiments.ideal_edge import edge_reach, spot_visibility
from experiments.layout import draw_details
from experiments.pictures import (
    CloseUp,
    Stage,
    check_pictures,
    difference,
    lit_steps,
    soft_share,
    tone_count,
)
from shadowjax.filters.base import Filter
from shadowjax.filters.hard import Hard
from shadowjax.filters.multi_depth import MultiDepth, Neighbourhood
from shadowjax.filters.pcf import PercentageCloser
from shadowjax.plotting import styled

FILTERS: dict[str, Filter] = {
    "(a) PCF 3 × 3": PercentageCloser(3),
    "(b) PCF 4 × 4": PercentageCloser(4),
    "(c) 3-SM + PCF 2 × 2": MultiDepth(Neighbourhood("min-max"), 2),
    "(d) 3-SM + PCF 3 × 3": MultiDepth(Neighbourhood("min-max"), 3),
}
A, B, C, D = FILTERS
HARD, EXACT = "hard test", "exact"
SIDES = range(1, 7)  # of ideal lit spots, texels


@dataclass(frozen=True)
class Config:
    """Settings.

    Attributes:
        scene: Name of a built-in scene.
        num_triangles: About how many triangles it has.
        resolution: Texels along each side of the map, ≥ 1.
        width: Pixels across the picture, ≥ 16.
        height: Pixels down, ≥ 12.
        detail: Middle and height of the detail, shares of the picture (x from the left, y from the top, height).
        detail_width: Pixels across the detail, ≥ 16; as many down as the picture's shape asks for.
    """

    scene: str = "plant"
    num_triangles: int = 2000
    resolution: int = 256
    width: int = 480
    height: int = 360
    detail: tuple[float, float, float] = (0.36, 0.54, 0.2)
    detail_width: int = 120

    def __post_init__(self):
        sizes = self.resolution, self.width, self.height, self.detail_width
        check_pictures(self.scene, self.num_triangles, *sizes, self.detail)


@dataclass(frozen=True)
class Result:
    """Pictures and what they measure.

    Attributes:
        tones: Filter → tones counted over valid receivers of the whole picture.
        even: Filter → whether each visibility there is a multiple of 1/(nk).
        soft: Filter → share of valid receivers with a tone between lit and dark.
        differences: (filter, filter) → root mean square difference over valid receivers; the hard test included.
        spots: Filter → mean visibility of square lit spots of 1, 2, … texels.
        reach: Filter → distance from an ideal edge up to which there are tones, texels.
        whole: The picture, shaded with (d).
        details: Filter → the detail, shaded.
        part: Where the detail lies.
    """

    tones: Mapping[str, int]
    even: Mapping[str, bool]
    soft: Mapping[str, float]
    differences: Mapping[tuple[str, str], float]
    spots: Mapping[str, np.ndarray]
    reach: Mapping[str, float]
    whole: np.ndarray
    details: Mapping[str, np.ndarray]
    part: CloseUp


def run(config: Config) -> Result:
    """Cast the map once, look at it through every filter."""
    stage = Stage(config.scene, config.num_triangles, config.resolution)
    view = stage.view(config.width, config.height)
    every = {HARD: Hard(), **FILTERS}
    seen = {name: stage.visibility(filter_, view) for name, filter_ in every.items()}
    part = CloseUp(*config.detail)
    near = stage.view(config.detail_width, round(config.detail_width * config.height / config.width), part)
    details = {name: stage.shaded(near, stage.visibility(filter_, near)) for name, filter_ in every.items()}
    return Result(
        tones={name: tone_count(seen[name], view.valid) for name in FILTERS},
        even={name: lit_steps(seen[name], filter_) for name, filter_ in FILTERS.items()},
        soft={name: soft_share(seen[name], view.valid) for name in FILTERS},
        differences={(a, b): difference(seen[a], seen[b], view.valid) for a in every for b in every if a < b},
        spots={name: np.array([spot_visibility(filter_, side) for side in SIDES]) for name, filter_ in FILTERS.items()},
        reach={name: edge_reach(filter_) for name, filter_ in FILTERS.items()},
        whole=stage.shaded(view, seen[D]),
        details={EXACT: stage.shaded(near, near.exact), **details},
        part=part,
    )


def claims(result: Result) -> tuple[Claim, ...]:
    """The source's bounds and likeness; its bright spots; and its explanation, put right."""
    tones, off, soft, reach, spots = result.tones, result.differences, result.soft, result.reach, result.spots
    bounds = {A: 10, B: 17, C: 13, D: 28}

    def alike(one: str, other: str) -> Claim:
        unlike = min(off[one, HARD], off[other, HARD])
        return Claim(
            f"{one[:3]} and {other[:3]} differ less from each other than either from the hard test",
            off[one, other] < unlike, f"RMS {off[one, other]:.4f}", f"less than {unlike:.4f}",
        )  # fmt: skip

    gain = spots[C] - spots[A]
    predicted = {name: filter_.reach - 0.5 for name, filter_ in FILTERS.items()}
    return (
        Claim(
            "tones stay within 10, 17, 13 and 28", all(tones[name] <= bounds[name] for name in FILTERS),
            ", ".join(f"{name[:3]} {count}" for name, count in tones.items()), "10, 17, 13, 28 at most",
        ),
        Claim("(c) gives more tones than (a)", tones[C] > tones[A], f"{tones[C]}", f"more than {tones[A]}"),
        Claim(
            "every visibility is a whole number of lit tests over nk", all(result.even.values()),
            ", ".join(f"{name[:3]} {verdict}" for name, verdict in result.even.items()), "all true",
        ),
        alike(A, C),
        alike(B, D),
        Claim(
            "lit spots of 1 and 2 texels stay brighter in (c) than in (a), and all of them in (d) than in (b)",
            bool((gain[:2] > 0).all() and (spots[D] > spots[B]).all()),
            ", ".join(f"{side}: {spots[C][side - 1]:.2f} against {spots[A][side - 1]:.2f}" for side in (1, 2)),
            "(c) > (a), (d) > (b)",
        ),
        Claim(
            "corrected: lit spots of 4 texels and more are darker in (c) than in (a)", bool((gain[3:] < 0).all()),
            f"{spots[C][3]:.2f} against {spots[A][3]:.2f} at 4 texels", "(c) < (a)",
        ),
        Claim(
            "corrected: (c) reaches half a texel farther from an edge than (a), not less far",
            reach[C] == reach[A] + 0.5 and reach == predicted, f"{reach[C]:g} texels against {reach[A]:g}",
            f"{predicted[C]:g} and {predicted[A]:g}",
        ),
        Claim(
            "corrected: (c) softens more pixels than (a), not fewer", soft[C] > soft[A],
            f"{100 * soft[C]:.2f} %", f"more than {100 * soft[A]:.2f} %",
        ),
    )  # fmt: skip


def numbers(result: Result) -> dict[str, Any]:
    """Tones, differences, spots and reach."""
    return {
        "tones": result.tones, "soft_share": result.soft, "spot_sides_texels": list(SIDES),
        "visibility_of_lit_spots": result.spots, "reach_texels": result.reach,
        "rms_differences": {f"{a} | {b}": value for (a, b), value in result.differences.items()},
    }  # fmt: skip


@styled
def draw(result: Result) -> Figure:
    """The picture on the left, its detail six times on the right."""
    captions = {
        name: f"{count} tones; a spot of 1 texel stays {result.spots[name][0]:.2f} lit"
        for name, count in result.tones.items()
    }
    captions |= {EXACT: "one shadow ray a pixel", HARD: "2 tones"}
    order = (EXACT, A, B, HARD, C, D)
    details = {name: result.details[name] for name in order}
    return draw_details(result.whole, [result.part], [details], captions, columns=3)[0]
