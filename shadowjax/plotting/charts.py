"""Charts: lines, labelled scatter (error against cost), bars, and histograms of tones."""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, MaxNLocator

from shadowjax._checked import checked
from shadowjax.plotting.style import INK, MUTED, PALETTE, RULE, label, legend_below, new_figure, series_style, styled

Numbers = Sequence[float] | np.ndarray


@checked
@styled
def lines(
    series: Mapping[str, tuple[Numbers, Numbers]],
    x: str,
    y: str,
    title: str = "",
    *,
    log_x: bool = False,
    log_y: bool = False,
    marks: Mapping[str, float] | None = None,
    width: float = 6.4,
    height: float = 3.8,
) -> Figure:
    """Lines over one pair of axes.

    Args:
        series: Name to (x values, y values).
        x: Name of the x axis with its unit.
        y: Name of the y axis with its unit.
        title: Over the chart.
        log_x: Logarithmic x axis.
        log_y: Logarithmic y axis.
        marks: Name to x value of vertical reference lines.
        width: Inches.
        height: Inches.
    """
    figure, axes = new_figure(width, height)
    spot = axes[0, 0]
    for index, (name, (across, up)) in enumerate(series.items()):
        style = series_style(index)
        if len(across) > 24:
            style["marker"] = ""
        spot.plot(np.asarray(across), np.asarray(up), label=name, **style)
    if log_x:
        spot.set_xscale("log")
    if log_y:
        spot.set_yscale("log")
    for name, value in (marks or {}).items():
        spot.axvline(value, color=MUTED, linewidth=1.0, linestyle=(0, (4, 3)))
        spot.annotate(
            name, (value, 1.0), (3, -3), xycoords=("data", "axes fraction"), textcoords="offset points",
            rotation=90, va="top", fontsize=8, color=MUTED,
        )  # fmt: skip
    label(spot, x, y, title)
    legend_below(figure, spot, columns=min(4, len(series)))
    return figure


@checked
@styled
def scatter(
    points: Mapping[str, tuple[float, float]],
    x: str,
    y: str,
    title: str = "",
    *,
    front: Sequence[str] = (),
    chosen: str | None = None,
    log_x: bool = False,
    log_y: bool = False,
    width: float = 6.4,
    height: float = 4.2,
) -> Figure:
    """Named points; those of `front` are joined, the chosen one stands out.

    Args:
        points: Name to (x, y).
        x: Name of the x axis with its unit.
        y: Name of the y axis with its unit.
        title: Over the chart.
        front: Names of the points that no other beats in both (the Pareto front).
        chosen: Name of the recommended point.
        log_x: Logarithmic x axis, marked at powers of two.
        log_y: Logarithmic y axis.
        width: Inches.
        height: Inches.
    """
    figure, axes = new_figure(width, height)
    spot = axes[0, 0]
    if log_x:
        spot.set_xscale("log", base=2)
        spot.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    if log_y:
        spot.set_yscale("log")
    along = sorted(front, key=lambda name: points[name][0])
    spot.plot([points[n][0] for n in along], [points[n][1] for n in along], color=RULE, linewidth=2.5, zorder=1)
    for name, (across, up) in points.items():
        is_chosen, on_front = name == chosen, name in front
        color = PALETTE[1] if is_chosen else PALETTE[0] if on_front else "#9aa3b2"
        spot.plot([across], [up], "o", color=color, markersize=9 if is_chosen else 6.5, zorder=3)
    spot.margins(0.12)
    figure.draw_without_rendering()
    name_points(figure, spot, points, chosen)
    label(spot, x, y, title)
    return figure


@checked
def name_points(figure: Figure, spot, points: Mapping[str, tuple[float, float]], chosen: str | None) -> None:
    """Write each name next to its point, moved up or down where names would collide."""
    pixel = {name: spot.transData.transform(point) for name, point in points.items()}
    point = figure.dpi / 72  # of type, in pixels
    line, char, aside = 11.0 * point, 5.0 * point, 7.0 * point
    box = spot.get_window_extent()
    # Left, right and height of what is there already: the markers, then the names written so far.
    taken = [(px - 0.4 * line, px + 0.4 * line, py) for px, py in pixel.values()]
    for name, (px, py) in sorted(pixel.items(), key=lambda item: -item[1][1]):
        span = char * len(name)
        leftwards = px + aside + span > box.x1
        left = px - aside - span if leftwards else px + aside
        height = py
        # By half lines, alternately up and down, until no name or marker is in the way.
        steps = [0.0, *(sign * k * line * 0.5 for k in range(1, 25) for sign in (-1, 1))]
        for step in steps:
            height = py + step
            clear = 0.85 * line
            free = all(left > b or left + span < a or abs(height - at) >= clear for a, b, at in taken)
            inside = box.y0 + 0.4 * line < height < box.y1 - 0.4 * line
            if free and inside:
                break
        taken.append((left, left + span, height))
        spot.annotate(
            name, points[name], ((-aside if leftwards else aside) / point, (height - py) / point),
            textcoords="offset points", ha="right" if leftwards else "left", va="center", fontsize=8.5,
            color=INK, fontweight="bold" if name == chosen else "normal",
            arrowprops={"arrowstyle": "-", "color": RULE, "linewidth": 0.7, "shrinkA": 0, "shrinkB": 3}
            if abs(height - py) > 0.7 * line else None,
        )  # fmt: skip


@checked
@styled
def bars(
    values: Mapping[str, float], x: str, title: str = "", *, formatted: str = "{:.3g}", width: float = 6.4
) -> Figure:
    """Horizontal bars with their values written out, first on top.

    Args:
        values: Name to value, ≥ 0.
        x: Name of the value axis with its unit.
        title: Over the chart.
        formatted: How a value is written.
        width: Inches.
    """
    figure, axes = new_figure(width, 0.9 + 0.3 * len(values))
    spot = axes[0, 0]
    spot.barh(list(values), list(values.values()), color=PALETTE[0], height=0.62)
    spot.invert_yaxis()
    spot.grid(axis="y", visible=False)
    largest = max(values.values(), default=1.0) or 1.0
    for index, value in enumerate(values.values()):
        spot.text(value + 0.01 * largest, index, formatted.format(value), va="center", fontsize=8.5)
    spot.set_xlim(0, 1.15 * largest)
    label(spot, x, title=title)
    return figure


@checked
@styled
def tone_histogram(
    visibilities: Mapping[str, np.ndarray],
    bounds: Mapping[str, int | None],
    title: str = "",
    *,
    columns: int = 3,
    width: float = 9.0,
) -> Figure:
    """How often each tone occurs, one panel for each technique, dark to bright; fully lit and dark are left out.

    Args:
        visibilities: Name to the visibilities of valid receivers, any shape, in [0, 1].
        bounds: Name to the number of tones possible; None where they are a continuum.
        title: Over the whole.
        columns: Panels in a row.
        width: Inches.
    """
    columns = min(columns, len(visibilities))
    rows = -(-len(visibilities) // columns)
    figure, axes = new_figure(width, 1.55 * rows + 0.4, rows, columns)
    for spot in axes.flat[len(visibilities) :]:
        spot.set_axis_off()
    for spot, (name, values) in zip(axes.flat, visibilities.items(), strict=False):
        values = np.asarray(values, float).ravel()
        between = values[(values > 1e-4) & (values < 1 - 1e-4)]
        bound = bounds.get(name)
        if bound is None:
            counts, edges = np.histogram(between, bins=32, range=(0, 1))
            spot.bar(edges[:-1] + 0.5 / 32, counts, width=1 / 36, color=PALETTE[0])
        else:
            # Tones are multiples of 1/(bound − 1): their whole numbers, without fully dark and fully lit.
            steps = np.round(between * (bound - 1)).astype(int)
            counts = np.bincount(steps, minlength=bound)[1 : bound - 1]
            spot.bar(np.arange(1, bound - 1) / (bound - 1), counts, width=min(0.6 / bound, 0.05), color=PALETTE[0])
        spot.set_xlim(0, 1)
        spot.set_ylim(bottom=0)
        spot.yaxis.set_major_locator(MaxNLocator(3, integer=True))
        if not between.size:
            spot.text(0.5, 0.5, "no tone between", transform=spot.transAxes, ha="center", color=MUTED, fontsize=8.5)
            spot.set_yticks([])
        spot.grid(axis="x", visible=False)
        spot.set_title(name, fontsize=9)
    for spot in axes.flat[max(0, len(visibilities) - columns) : len(visibilities)]:
        spot.set_xlabel("visibility")
    for row in axes:
        row[0].set_ylabel("pixels")
    if title:
        figure.suptitle(title, x=0.01, ha="left", fontweight="bold")
    return figure
