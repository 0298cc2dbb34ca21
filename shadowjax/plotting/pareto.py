"""Error against memory and against time, side by side: every technique a point, the best joined by a line."""

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter

from shadowjax._checked import checked
from shadowjax.plotting.charts import name_points
from shadowjax.plotting.style import MUTED, PALETTE, RULE, label, new_figure, styled


@checked
def front(costs: Sequence[float], errors: Sequence[float]) -> list[int]:
    """Indices of the points that no other beats in both, by rising cost."""
    best, found = np.inf, []
    # By rising cost, the least error first: a point is on the front if it beats the errors of all cheaper ones.
    for index in np.lexsort((errors, costs)):
        if errors[index] < best:
            found.append(int(index))
            best = errors[index]
    return found


@checked
@styled
def pareto(records: Iterable[Any], title: str = "", width: float = 10.4, height: float = 4.8) -> Figure:
    """Two charts over one axis of error; those on the fronts are named, the rest are grey.

    Args:
        records: Of `evaluate.compare`; techniques without a map are left out, but for the time of the exact ones.
        title: Over the left chart, plain text.
        width: Inches.
        height: Inches.
    """
    records = list(records)
    mapped = [record for record in records if record.map_bytes > 0]
    figure, axes = new_figure(width, height, 1, 2, sharey=True)
    names = [record.technique for record in mapped]
    errors = [100 * max(record.light_rmse, 1e-6) for record in mapped]
    memory = [record.map_bytes / 2**20 for record in mapped]
    times = [record.build_ms + record.visibility_ms for record in mapped]
    _panel(figure, axes[0, 0], names, memory, errors)
    _panel(figure, axes[0, 1], names, times, errors)
    label(axes[0, 0], "map memory (MiB)", "RMS error of received light (%)")
    axes[0, 0].set_title(title, parse_math=False)  # the name of a file may hold dollar signs
    label(axes[0, 1], "build and lookup of one picture (ms)")
    for exact in (one for one in records if one.map_bytes == 0):
        time = exact.build_ms + exact.visibility_ms
        name = "exact shadow rays" if exact.technique == "exact" else exact.technique.replace("-", " ")
        axes[0, 1].axvline(time, color=MUTED, linewidth=1.0, linestyle=(0, (4, 3)))
        axes[0, 1].annotate(
            name, (time, 1.0), (-3, -3), xycoords=("data", "axes fraction"),
            textcoords="offset points", rotation=90, va="top", ha="right", fontsize=8, color=MUTED,
        )  # fmt: skip
    return figure


def _panel(figure: Figure, spot: Axes, names: list[str], costs: list[float], errors: list[float]) -> None:
    """One chart."""
    spot.set_xscale("log")
    spot.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    best = front(costs, errors)
    spot.plot([costs[i] for i in best], [errors[i] for i in best], color=RULE, linewidth=2.5, zorder=1)
    for index, (cost, error) in enumerate(zip(costs, errors, strict=True)):
        color = PALETTE[0] if index in best else "#9aa3b2"
        spot.plot([cost], [error], "o", color=color, markersize=6.5 if index in best else 4.5, zorder=3)
    spot.margins(0.12)
    figure.draw_without_rendering()
    worst = int(np.argmax(errors)) if errors else 0
    shown = sorted({*best, worst}) if errors else []
    name_points(figure, spot, {names[i]: (costs[i], errors[i]) for i in shown}, None)
