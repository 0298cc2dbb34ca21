"""Layouts of the figures: an empty one to divide, and a picture next to close-ups of its details."""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from experiments.pictures import CloseUp
from shadowjax.plotting import PALETTE, new_figure, show_image, styled
from shadowjax.plotting.style import MUTED

FRAMES = (PALETTE[0], PALETTE[1], PALETTE[2])


def empty_figure(width: float, height: float) -> Figure:
    """A figure of that size in inches, to be divided into parts."""
    figure, _ = new_figure(width, height)
    figure.clear()
    return figure


def mark_x(spot: Axes, x: float, text: str, align: str = "left", top: float = 0.98, color: str = MUTED) -> None:
    """A dashed vertical line with its name along it.

    Args:
        spot: Where to draw.
        x: Position.
        text: The name.
        align: The side of the line on which the name stands, "left" or "right" of it.
        top: Height at which the name ends, as a share of the axes.
        color: Of line and name.
    """
    spot.axvline(x, color=color, linewidth=1.0, linestyle=(0, (4, 3)), zorder=0)
    aside, anchor = (-3, "right") if align == "left" else (3, "left")
    spot.annotate(
        text, (x, top), (aside, 0), xycoords=("data", "axes fraction"), textcoords="offset points", va="top", ha=anchor,
        rotation=90, fontsize=7.5, color=color,
    )  # fmt: skip


def outline(spot: Axes, part: CloseUp, image: np.ndarray, color: str) -> None:
    """Frame a close-up in the picture it belongs to."""
    height, width = image.shape[:2]
    x, y, half = part.x, part.y, part.size / 2
    across = np.array([x - half, x + half, x + half, x - half, x - half]) * width - 0.5
    down = np.array([y - half, y - half, y + half, y + half, y - half]) * height - 0.5
    spot.plot(across, down, color=color, linewidth=1.6)


@styled
def draw_details(
    whole: np.ndarray,
    parts: Sequence[CloseUp],
    rows: Sequence[Mapping[str, np.ndarray]],
    captions: Mapping[str, str],
    columns: int,
    note: str = "",
) -> tuple[Figure, list[dict[str, Axes]]]:
    """A picture on the left with framed parts; each part's close-ups on the right, framed in the same colour.

    Args:
        whole: The picture, (rows, cols, 3) in [0, 1].
        parts: What the close-ups show.
        rows: For each part, name → close-up.
        captions: Name → what to look at; written below the last part's.
        columns: Close-ups side by side.
        note: Below the picture.

    Returns:
        The figure, and for each part name → axes.
    """
    lines_each = -(-len(rows[0]) // columns)
    num_lines = lines_each * len(rows)
    aspect = whole.shape[0] / whole.shape[1]
    cell = 2.5
    height = num_lines * (cell * aspect + 0.42) + 0.1
    left_width = min(height / aspect, 5.4)
    figure = empty_figure(left_width + columns * cell, height)
    left, right = np.ravel(figure.subfigures(1, 2, squeeze=False, width_ratios=[left_width, columns * cell]))
    spot = left.subplots()
    show_image(spot, whole, "", note)
    grid = right.subplots(num_lines, columns, squeeze=False)
    found: list[dict[str, Axes]] = []
    for index, (part, images) in enumerate(zip(parts, rows, strict=True)):
        color = FRAMES[index % len(FRAMES)]
        outline(spot, part, whole, color)
        lines = grid[index * lines_each : (index + 1) * lines_each]
        found.append(dict(zip(images, lines.flat, strict=False)))
        for unused in lines.flat[len(images) :]:
            unused.set_axis_off()
        for name, axes in found[-1].items():
            show_image(axes, images[name], name if index == 0 else "", captions[name] if index == len(rows) - 1 else "")
            for side in axes.spines.values():
                side.set(visible=True, color=color, linewidth=1.6)
    return figure, found
