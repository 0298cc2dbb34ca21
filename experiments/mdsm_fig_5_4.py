"""mdsm, figure 5.4: curved shadow edges on curved ground, PCF over one depth against PCF 3 × 3 over two and three.

The source shows two details each of a traditional map with PCF, a 2-SM with PCF 3 × 3 and a 3-SM with PCF 3 × 3, and
finds them alike. Its text says that the traditional map was filtered with 4 (2 × 2) samples, its caption says 16
(4 × 4); only one can be meant.

Measured, on two details of a scene of the same kind: the tones, and the root mean square difference of either PCF from
the multi-depth pictures. PCF 4 × 4 is the nearer one by far, in both details and against both multi-depth maps; with
PCF 2 × 2 the edges would not look alike. The caption is right.

How to read it: each row is a framed part of the picture on the left. Compare the second column with the last two; the
first is what the text would have us compare.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from experiments.base import Claim
from experiments.layout import draw_details
from experiments.pictures import CloseUp, Stage, check_pictures, difference, lit_steps, tone_count
from shadowjax.filters.base import Filter
from shadowjax.filters.hard import Hard
from shadowjax.filters.multi_depth import MultiDepth, Neighbourhood
from shadowjax.filters.pcf import PercentageCloser
from shadowjax.plotting import styled

FILTERS: dict[str, Filter] = {
    "PCF 2 × 2 (text)": PercentageCloser(2),
    "PCF 4 × 4 (caption)": PercentageCloser(4),
    "2-SM + PCF 3 × 3": MultiDepth(Neighbourhood("max"), 3),
    "3-SM + PCF 3 × 3": MultiDepth(Neighbourhood("min-max"), 3),
}
TEXT, CAPTION, TWO, THREE = FILTERS
HARD, WHOLE = "hard test", "picture"
PARTS = ("upper detail", "lower detail")


@dataclass(frozen=True)
class Config:
    """Settings.

    Attributes:
        scene: Name of a built-in scene.
        num_triangles: About how many triangles it has.
        resolution: Texels along each side of the map, ≥ 1.
        width: Pixels across the picture, ≥ 16.
        height: Pixels down, ≥ 12.
        upper: Middle and height of the first detail, shares of the picture (x from the left, y from the top, height).
        lower: The same of the second.
        detail_width: Pixels across a detail, ≥ 16; as many down as the picture's shape asks for.
    """

    scene: str = "curved-bodies"
    num_triangles: int = 2000
    resolution: int = 256
    width: int = 480
    height: int = 360
    upper: tuple[float, float, float] = (0.43, 0.43, 0.2)
    lower: tuple[float, float, float] = (0.67, 0.615, 0.2)
    detail_width: int = 120

    def __post_init__(self):
        sizes = self.resolution, self.width, self.height, self.detail_width
        check_pictures(self.scene, self.num_triangles, *sizes, self.upper, self.lower)


@dataclass(frozen=True)
class Result:
    """Pictures and what they measure.

    Attributes:
        tones: Filter → tones counted over valid receivers of the whole picture.
        even: Filter → whether each visibility there is a multiple of 1/(nk).
        differences: View → (filter, filter) → root mean square difference over valid receivers.
        whole: The picture, shaded with the 3-SM.
        details: For each detail, filter → shaded.
        parts: Where the details lie.
    """

    tones: Mapping[str, int]
    even: Mapping[str, bool]
    differences: Mapping[str, Mapping[tuple[str, str], float]]
    whole: np.ndarray
    details: tuple[Mapping[str, np.ndarray], ...]
    parts: tuple[CloseUp, ...]


def run(config: Config) -> Result:
    """Cast the map once, look at it through every filter."""
    stage = Stage(config.scene, config.num_triangles, config.resolution)
    parts = (CloseUp(*config.upper), CloseUp(*config.lower))
    detail_height = round(config.detail_width * config.height / config.width)
    views = {WHOLE: stage.view(config.width, config.height)}
    views |= {
        name: stage.view(config.detail_width, detail_height, part) for name, part in zip(PARTS, parts, strict=True)
    }
    every = {HARD: Hard(), **FILTERS}
    seen = {
        where: {name: stage.visibility(filter_, view) for name, filter_ in every.items()}
        for where, view in views.items()
    }
    return Result(
        tones={name: tone_count(seen[WHOLE][name], views[WHOLE].valid) for name in FILTERS},
        even={name: lit_steps(seen[WHOLE][name], filter_) for name, filter_ in FILTERS.items()},
        differences={
            where: {(a, b): difference(images[a], images[b], views[where].valid) for a in every for b in every}
            for where, images in seen.items()
        },
        whole=stage.shaded(views[WHOLE], seen[WHOLE][THREE]),
        details=tuple({name: stage.shaded(views[part], seen[part][name]) for name in FILTERS} for part in PARTS),
        parts=parts,
    )


def claims(result: Result) -> tuple[Claim, ...]:
    """Tones, likeness, and which of text and caption is right."""
    bounds = {TEXT: 5, CAPTION: 17, TWO: 19, THREE: 28}
    pairs = [(where, many) for where in result.differences for many in (TWO, THREE)]
    text = [result.differences[where][TEXT, many] for where, many in pairs]
    caption = [result.differences[where][CAPTION, many] for where, many in pairs]
    hard = [min(result.differences[where][one, HARD] for one in (CAPTION, many)) for where, many in pairs]
    gain = min(a / b for a, b in zip(text, caption, strict=True))
    return (
        Claim(
            "tones stay within 5, 17, 19 and 28", all(result.tones[name] <= bounds[name] for name in FILTERS),
            ", ".join(str(count) for count in result.tones.values()), "5, 17, 19, 28 at most",
        ),
        Claim(
            "every visibility is a whole number of lit tests over nk", all(result.even.values()),
            ", ".join(str(verdict) for verdict in result.even.values()), "all true",
        ),
        Claim(
            "PCF 4 × 4 and either multi-depth picture differ less from each other than from the hard test",
            all(a < b for a, b in zip(caption, hard, strict=True)),
            "RMS " + ", ".join(f"{value:.4f}" for value in caption), "less than " + ", ".join(f"{v:.4f}" for v in hard),
        ),
        Claim(
            "the caption's PCF 4 × 4 is nearer to both multi-depth pictures than the text's PCF 2 × 2, in every view",
            gain > 1, f"{gain:.2f} times nearer at least", "more than 1",
        ),
    )  # fmt: skip


def numbers(result: Result) -> dict[str, Any]:
    """Tones and differences."""
    return {
        "tones": result.tones,
        "rms_differences": {
            where: {f"{a} | {b}": value for (a, b), value in values.items() if a < b}
            for where, values in result.differences.items()
        },
    }


@styled
def draw(result: Result) -> Figure:
    """The picture on the left, a row of close-ups for each detail on the right."""
    off = result.differences[WHOLE]
    captions = {
        name: f"{result.tones[name]} tones; differs by\n{off[name, TWO]:.3f} to 2-SM, {off[name, THREE]:.3f} to 3-SM"
        for name in (TEXT, CAPTION)
    } | {name: f"{result.tones[name]} tones" for name in (TWO, THREE)}
    return draw_details(result.whole, result.parts, result.details, captions, columns=4)[0]
