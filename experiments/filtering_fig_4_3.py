"""filtering, figure 4.3: PCF, VSM, CSM, XCSM and ESM over one map, next to the exact shadow.

The source shows five pictures: PCF with a constant bias, and the others with a 7 × 7 Gaussian. It sees a gap under
things in PCF (peter-panning), light bleeding in VSM, wrong intensity at contact in all but PCF, and finds XCSM close to
CSM.

Measured on the same depth map: error of visibility; light in the umbra, away from every edge; and the width of soft
edges. With the bias that theory asks for instead of a constant, PCF shows no gap wider than its kernel. VSM bleeds, as
said; the clamp of the registered technique is left out here. XCSM's picture is *not* close to CSM's: its edges are
hard.

How to read it: in the close-ups look for light inside the shadow (VSM), for pale contact (CSM, ESM), and for steps
along edges (XCSM).
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from scipy import ndimage

from experiments.base import Claim, Unsuitable
from experiments.layout import draw_details
from experiments.pictures import CloseUp, Stage, check_pictures
from shadowjax.filters.base import Filter
from shadowjax.filters.convolution import Convolution, MeanDepthConvolution
from shadowjax.filters.exponential import Exponential
from shadowjax.filters.pcf import PercentageCloser
from shadowjax.filters.variance import Variance
from shadowjax.plotting import styled

FILTERS: dict[str, Filter] = {
    "PCF 3 × 3": PercentageCloser(3),
    "VSM": Variance(),
    "CSM": Convolution(),
    "XCSM": MeanDepthConvolution(),
    "ESM": Exponential(),
}
EXACT = "exact"


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
        detail_width: Pixels across the detail, ≥ 16.
        margin: Pixels between the umbra that is measured and the nearest edge, ≥ 1.
    """

    scene: str = "colonnade"
    num_triangles: int = 4000
    resolution: int = 512
    width: int = 480
    height: int = 360
    detail: tuple[float, float, float] = (0.5, 0.62, 0.3)
    detail_width: int = 160
    margin: int = 5

    def __post_init__(self):
        sizes = self.resolution, self.width, self.height, self.detail_width
        check_pictures(self.scene, self.num_triangles, *sizes, self.detail)


@dataclass(frozen=True)
class Result:
    """Pictures and what they measure.

    Attributes:
        error: Filter → root mean square error of visibility.
        umbra: Filter → mean light in the umbra.
        soft: Filter → share of valid receivers with a visibility between 0.15 and 0.85: ringing does not count.
        unlike: Root mean square difference of CSM and XCSM.
        whole: The picture with exact shadows.
        details: Name → close-up.
        part: Where it lies.
    """

    error: Mapping[str, float]
    umbra: Mapping[str, float]
    soft: Mapping[str, float]
    unlike: float
    whole: np.ndarray
    details: Mapping[str, np.ndarray]
    part: CloseUp


def run(config: Config) -> Result:
    """One map, five filters, two views."""
    stage = Stage(config.scene, config.num_triangles, config.resolution)
    view = stage.view(config.width, config.height)
    seen = {name: stage.visibility(filter_, view) for name, filter_ in FILTERS.items()}
    size = 2 * config.margin + 1
    inside = ndimage.maximum_filter(np.where(view.valid, view.exact, 1.0), size, mode="nearest") == 0
    if not inside.any():
        raise Unsuitable("no umbra is wider than the margin; lower margin, or raise width and height")
    part = CloseUp(*config.detail)
    near = stage.view(config.detail_width, round(config.detail_width * config.height / config.width), part)
    details = {name: stage.shaded(near, stage.visibility(filter_, near)) for name, filter_ in FILTERS.items()}

    def off(a: np.ndarray, b: np.ndarray) -> float:
        return float(np.sqrt(np.mean((a - b)[view.valid] ** 2)))

    return Result(
        {name: off(value, view.exact) for name, value in seen.items()},
        {name: float(value[inside].mean()) for name, value in seen.items()},
        {name: float(((value > 0.15) & (value < 0.85))[view.valid].mean()) for name, value in seen.items()},
        off(seen["CSM"], seen["XCSM"]), stage.shaded(view, view.exact),
        {EXACT: stage.shaded(near, near.exact), **details}, part,
    )  # fmt: skip


def claims(result: Result) -> tuple[Claim, ...]:
    """Who bleeds, who is soft, who is like whom."""
    umbra, soft, error = result.umbra, result.soft, result.error
    return (
        Claim(
            "PCF lets hardly any light into the umbra",
            umbra["PCF 3 × 3"] < 0.05,
            f"{umbra['PCF 3 × 3']:.4f}",
            "less than 0.05",
        ),
        Claim(
            "VSM bleeds more than PCF",
            umbra["VSM"] > 2 * umbra["PCF 3 × 3"] + 1e-4,
            f"{umbra['VSM']:.4f}",
            f"more than twice {umbra['PCF 3 × 3']:.4f}",
        ),
        Claim(
            "VSM bleeds more than CSM and XCSM",
            umbra["VSM"] > max(umbra["CSM"], umbra["XCSM"]),
            ", ".join(f"{name} {value:.4f}" for name, value in umbra.items()),
            "VSM larger than both",
        ),
        Claim(
            "refuted: XCSM's edges are harder than CSM's",
            soft["XCSM"] < 0.8 * soft["CSM"],
            f"{100 * soft['XCSM']:.2f} % of pixels are soft",
            f"less than 0.8 · {100 * soft['CSM']:.2f} %",
        ),
        Claim(
            "the two differ by as much as CSM from the truth, or nearly",
            result.unlike > 0.3 * error["CSM"],
            f"RMS {result.unlike:.4f}",
            f"more than 0.3 · {error['CSM']:.4f}",
        ),
    )


def numbers(result: Result) -> dict[str, Any]:
    """Errors, umbra and softness."""
    return {"rmse": result.error, "umbra_light": result.umbra, "soft_share": result.soft, "csm_xcsm_rms": result.unlike}


@styled
def draw(result: Result) -> Figure:
    """The picture on the left, its detail six times on the right."""
    captions = {name: f"error {result.error[name]:.3f}, umbra {100 * result.umbra[name]:.1f} % lit" for name in FILTERS}
    captions[EXACT] = "one shadow ray a pixel"
    return draw_details(result.whole, [result.part], [result.details], captions, columns=3)[0]
