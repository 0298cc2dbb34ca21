"""mdsm, figure 5.2: the hard test, the composite test, and 16 taps against a 2-SM with 9.

The source shows a detail of its scene 5.1 (a) four times: (a) shadow test on a traditional map, (b) composite test on a
2-SM, both unfiltered and with the attenuations of 3 × 3 pixels written out, (c) the first filtered with PCF 4 × 4,
(d) the second filtered with PCF 3 × 3, and notes how alike (c) and (d) are.

Measured, on a scene of the same kind and with the maximum of the neighbourhood as second depth: the tones of every
picture, all of them multiples of 1/(nk), and the root mean square differences between pictures over all pixels that
can be lit. "Alike" means that (c) and (d) differ less from each other than either does from its unfiltered map.

How to read it: the frame on the left is the detail on the right, with the pixels of one camera. The tables hold
attenuations, 0 lit and 1 in shadow, of the pixels in the small frames.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from experiments.base import Claim, Unsuitable
from experiments.layout import draw_details
from experiments.pictures import (
    CloseUp,
    Image,
    Mask,
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
from shadowjax.plotting import PALETTE, styled

FILTERS: dict[str, Filter] = {
    "(a) hard test": Hard(),
    "(b) 2-SM": MultiDepth(Neighbourhood("max")),
    "(c) PCF 4 × 4": PercentageCloser(4),
    "(d) 2-SM + PCF 3 × 3": MultiDepth(Neighbourhood("max"), 3),
}
A, B, C, D = FILTERS


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

    scene: str = "smooth-and-abrupt"
    num_triangles: int = 2000
    resolution: int = 256
    width: int = 480
    height: int = 360
    detail: tuple[float, float, float] = (0.245, 0.55, 0.2)
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
        differences: (filter, filter) → root mean square difference over valid receivers.
        brightness: Filter → mean visibility of valid receivers.
        least_gain: Least visibility of (b) minus that of (a).
        whole: The picture, shaded with (d).
        details: Filter → the detail, shaded.
        block: Row and column of the upper left pixel of the 3 × 3 pixels.
        attenuations: (a) and (b) → attenuations of those pixels.
        part: Where the detail lies.
    """

    tones: Mapping[str, int]
    even: Mapping[str, bool]
    soft: Mapping[str, float]
    differences: Mapping[tuple[str, str], float]
    brightness: Mapping[str, float]
    least_gain: float
    whole: np.ndarray
    details: Mapping[str, np.ndarray]
    block: tuple[int, int]
    attenuations: Mapping[str, Image]
    part: CloseUp


def telling_block(hard: Image, composite: Image, valid: Mask) -> tuple[int, int]:
    """Upper left of the 3 × 3 pixels nearest to the middle that hold 0 and 1 in one picture, and ½ too in the other.

    Raises:
        Unsuitable: If there are none: the detail shows no shadow edge.
    """

    def blocks(image: np.ndarray) -> np.ndarray:
        return np.lib.stride_tricks.sliding_window_view(image, (3, 3))

    has = [(blocks(composite) == tone).any((-2, -1)) for tone in (0.0, 0.5, 1.0)]
    share = blocks(hard).mean((-2, -1))
    good = np.logical_and.reduce([*has, blocks(valid).all((-2, -1)), share > 0.3, share < 0.7])
    if not good.any():
        raise Unsuitable(
            "the detail shows no shadow edge: no 3 × 3 pixels hold lit, half lit and dark; move it or take fewer pixels"
        )
    rows, cols = np.nonzero(good)
    away = (rows - good.shape[0] / 2) ** 2 + (cols - good.shape[1] / 2) ** 2
    return int(rows[away.argmin()]), int(cols[away.argmin()])


def run(config: Config) -> Result:
    """Cast the map once, look at it through every filter."""
    stage = Stage(config.scene, config.num_triangles, config.resolution)
    view = stage.view(config.width, config.height)
    seen = {name: stage.visibility(filter_, view) for name, filter_ in FILTERS.items()}
    part = CloseUp(*config.detail)
    near = stage.view(config.detail_width, round(config.detail_width * config.height / config.width), part)
    details = {name: stage.visibility(filter_, near) for name, filter_ in FILTERS.items()}
    row, col = telling_block(details[A], details[B], near.valid)
    return Result(
        tones={name: tone_count(image, view.valid) for name, image in seen.items()},
        even={name: lit_steps(seen[name], filter_) for name, filter_ in FILTERS.items()},
        soft={name: soft_share(image, view.valid) for name, image in seen.items()},
        differences={(a, b): difference(seen[a], seen[b], view.valid) for a in FILTERS for b in FILTERS if a < b},
        brightness={name: float(image[view.valid].mean()) for name, image in seen.items()},
        least_gain=float((seen[B] - seen[A])[view.valid].min()),
        whole=stage.shaded(view, seen[D]),
        details={name: stage.shaded(near, image) for name, image in details.items()},
        block=(row, col),
        attenuations={name: 1 - details[name][row : row + 3, col : col + 3] for name in (A, B)},
        part=part,
    )


def claims(result: Result) -> tuple[Claim, ...]:
    """Tones of each picture, and that 9 taps over two depths look like 16 over one."""
    tones, off = result.tones, result.differences
    unlike = min(off[A, C], off[A, D])
    return (
        Claim("the hard test gives two tones", tones[A] == 2, f"{tones[A]}", "2"),
        Claim("the composite test of a 2-SM adds a third", tones[B] == 3, f"{tones[B]}", "3"),
        Claim("PCF 4 × 4 stays within its tones", tones[C] <= 17, f"{tones[C]}", "at most 17"),
        Claim("2-SM + PCF 3 × 3 stays within its tones", tones[D] <= 19, f"{tones[D]}", "at most 19"),
        Claim("9 taps over two depths give more tones than 16 over one", tones[D] > tones[C], f"{tones[D]}",
              f"more than {tones[C]}"),
        Claim("every visibility is a whole number of lit tests over nk", all(result.even.values()),
              ", ".join(f"{name[:3]} {verdict}" for name, verdict in result.even.items()), "all true"),
        Claim("(c) and (d) differ less from each other than either from the hard test", off[C, D] < unlike,
              f"RMS {off[C, D]:.4f}", f"less than {unlike:.4f}"),
        Claim("beyond: (d) is nearer to the unfiltered (b) than to (c)", off[B, D] < off[C, D],
              f"RMS {off[B, D]:.4f}", f"less than {off[C, D]:.4f}"),
        Claim("a maximum only turns dark tests lit: no pixel of (b) is darker than in (a)", result.least_gain == 0,
              f"least change {result.least_gain:+.1f}", "0"),
        Claim("so (d) is brighter than (c) on average", result.brightness[D] > result.brightness[C],
              f"mean visibility {result.brightness[D]:.4f}", f"more than {result.brightness[C]:.4f}"),
        Claim("the 3 × 3 pixels hold 0 and 1 in (a), and ½ as well in (b)",
              set(result.attenuations[A].flat) == {0, 1} and set(result.attenuations[B].flat) == {0, 0.5, 1},
              " and ".join(str(sorted({float(x) for x in table.flat})) for table in result.attenuations.values()),
              "[0, 1] and [0, 0.5, 1]"),
    )  # fmt: skip


def numbers(result: Result) -> dict[str, Any]:
    """Tones, differences and the tables."""
    return {
        "tones": result.tones, "soft_share": result.soft, "mean_visibility": result.brightness,
        "attenuations": result.attenuations,
        "rms_differences": {f"{a} | {b}": value for (a, b), value in result.differences.items()},
    }  # fmt: skip


@styled
def draw(result: Result) -> Figure:
    """The picture on the left, its detail four times on the right."""
    captions = {name: f"{tones} tones" for name, tones in result.tones.items()}
    captions[C] += f"; RMS difference to (d) {result.differences[C, D]:.3f}"
    captions[D] += f"; to (a) {result.differences[A, D]:.3f}"
    figure, (spots,) = draw_details(result.whole, [result.part], [result.details], captions, columns=2)
    for name in (A, B):
        _mark(spots[name], result.block, result.attenuations[name])
    return figure


def _mark(spot: Axes, block: tuple[int, int], table: Image) -> None:
    """Frame 3 × 3 pixels and write their attenuations into a corner."""
    row, col = block
    spot.add_patch(Rectangle((col - 0.5, row - 0.5), 3, 3, fill=False, edgecolor=PALETTE[1], linewidth=1.6))
    inset = spot.inset_axes((0.66, 0.04, 0.31, 0.41))
    inset.imshow(1 - table, cmap="gray", vmin=0, vmax=1)
    for (i, j), value in np.ndenumerate(table):
        inset.text(j, i, f"{value:g}", ha="center", va="center", fontsize=8, color="white" if value > 0.4 else "black")
    inset.set(xticks=[], yticks=[])
    inset.grid(False)
    for side in inset.spines.values():
        side.set(visible=True, color=PALETTE[1], linewidth=1.6)
