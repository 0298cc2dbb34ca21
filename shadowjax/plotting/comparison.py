"""A comparison at a glance: error, memory and time of every technique, the least error at the top."""

from collections.abc import Iterable
from typing import Any

from matplotlib.figure import Figure

from shadowjax._checked import checked
from shadowjax._checks import require
from shadowjax.plotting.style import PALETTE, label, new_figure, styled


@checked
@styled
def comparison(table: Iterable[Any], title: str = "", width: float = 10.4) -> Figure:
    """Three charts with a bar for each technique: error of received light, bytes kept, and milliseconds.

    Args:
        table: Of `compare`, or records of it.
        title: Over the left chart, plain text.
        width: Inches; the height follows the number of techniques.

    Raises:
        ValueError: If there is no record.
    """
    records = sorted(table, key=lambda record: record.light_rmse, reverse=True)
    require(len(records) > 0, "a comparison needs at least one record; got none")
    figure, axes = new_figure(width, 1.1 + 0.26 * len(records), 1, 3, sharey=True)
    places = range(len(records))
    error, memory, time = axes[0]
    error.barh(places, [100 * record.light_rmse for record in records], color=PALETTE[0])
    memory.barh(places, [record.stored_bytes / 1024 for record in records], color=PALETTE[1])
    built = [record.build_ms for record in records]
    time.barh(places, built, color=PALETTE[2], label="maps")
    time.barh(places, [record.visibility_ms for record in records], left=built, color=PALETTE[3], label="lookup")
    error.set_yticks(list(places))
    # names of one's own may hold dollar signs
    error.set_yticklabels([record.technique for record in records], parse_math=False)
    error.set_title(title, parse_math=False)
    label(error, "error of received light (%)")
    label(memory, "maps and volumes (KiB)")
    label(time, "build and lookup (ms)")
    time.legend(frameon=False, loc="upper right")
    for spot in axes[0]:
        spot.margins(y=0.02)
    return figure


__all__ = ["comparison"]
