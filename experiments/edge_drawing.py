"""Drawings of edge detection: small maps with marked edge texels, and rates over the direction of the edge."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from matplotlib.axes import Axes

from shadowjax.plotting import PALETTE, label, series_style, styled

SEEN, MISSED = PALETTE[0], PALETTE[1]
SHOWN = 13  # texels along each side of a small map


class SeenMap(NamedTuple):
    """A depth map, its edge texels, and the texels whose depths differ."""

    depth: Float[np.ndarray, "rows cols"]
    edge: Bool[np.ndarray, "rows cols"]
    seen: Bool[np.ndarray, "rows cols"]


@styled
def draw_maps(row: Sequence[Axes], maps: Mapping[str, SeenMap], name: str, with_titles: bool) -> None:
    """One small map a policy: occluder in grey, edge texels dotted where they see the edge and crossed where not.

    Args:
        row: As many axes as there are maps.
        maps: Policy → map.
        name: Of the shape.
        with_titles: Whether policies are named above.
    """
    for spot, (policy, whole) in zip(row, maps.items(), strict=True):
        first = (whole.depth.shape[0] - SHOWN) // 2
        depth, edge, seen = (part[first : first + SHOWN, first : first + SHOWN] for part in whole)
        spot.imshow(np.where(depth < whole.depth.max(), 0.72, 0.97), cmap="gray", vmin=0, vmax=1)
        for marked, marker, color in ((edge & seen, "o", SEEN), (edge & ~seen, "x", MISSED)):
            rows, cols = np.nonzero(marked)
            spot.plot(cols, rows, marker, color=color, markersize=3.4, markeredgewidth=1.3)
        spot.grid(False)
        spot.set_xticks([])
        spot.set_yticks([])
        if with_titles:
            spot.set_title(policy.replace(", ", ",\n"), fontsize=8.5, loc="center", fontweight="normal")
    row[0].set_ylabel(name, fontsize=8.5)


@styled
def draw_rates(spot: Axes, angles_deg: np.ndarray, rates: Mapping[str, np.ndarray], title: str) -> None:
    """Share of edge texels that see the edge over its direction; equal curves share one line and one name."""
    groups: list[tuple[list[str], np.ndarray]] = []
    for name, rate in rates.items():
        same = next((names for names, other in groups if np.array_equal(rate, other)), None)
        if same is None:
            groups.append(([name], rate))
        else:
            same.append(name)
    for index, (names, rate) in enumerate(groups):
        style = series_style(index)
        spot.plot(
            np.append(angles_deg, 180.0), 100 * np.append(rate, rate[0]), color=style["color"], marker=style["marker"],
            markevery=(index, max(1, len(angles_deg) // 9)), markersize=4.5, linewidth=1.5, label=" = ".join(names),
        )  # fmt: skip
    spot.set_xticks([0, 30, 60, 90, 120, 150, 180])
    spot.set_ylim(-4, 104)
    label(spot, "direction of the edge (degrees from the rows)", "", title)
