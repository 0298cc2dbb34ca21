"""Figure style: a palette that colour-blind readers can distinguish, quiet axes, and export to PNG bytes."""

from collections.abc import Callable, Sequence
from functools import wraps
from io import BytesIO
from typing import Any, ParamSpec, TypeVar

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure

from shadowjax._checked import checked

INK, MUTED, RULE, PAPER = "#1d2330", "#5c6575", "#d8dce3", "#ffffff"

# Okabe and Ito's colours, yellow left out: it vanishes on paper.
PALETTE = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#e69f00", "#4d4d4d")
MARKERS = ("o", "s", "^", "D", "v", "P", "X")

# Signed visibility errors: blue is too dark, orange-red too bright, nothing in between; equal lightness at equal size.
TOO_DARK, TOO_BRIGHT = (0.05, 0.33, 0.66), (0.80, 0.30, 0.00)
DIFFERENCE = LinearSegmentedColormap.from_list(
    "shadowjax.difference", [TOO_DARK, (0.55, 0.73, 0.90), (0.97, 0.97, 0.97), (0.98, 0.72, 0.48), TOO_BRIGHT]
)
DEPTH = "cividis"

_SETTINGS: dict[str, Any] = {
    "font.size": 9.0,
    "axes.titlesize": 10.0,
    "axes.titlelocation": "left",
    "axes.titleweight": "bold",
    "axes.labelsize": 9.0,
    "axes.labelcolor": INK,
    "axes.edgecolor": MUTED,
    "axes.linewidth": 0.8,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.axisbelow": True,
    "axes.grid": True,
    "grid.color": RULE,
    "grid.linewidth": 0.6,
    "xtick.color": MUTED,
    "ytick.color": MUTED,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
    "xtick.labelsize": 8.5,
    "ytick.labelsize": 8.5,
    "text.color": INK,
    "legend.frameon": False,
    "legend.fontsize": 8.5,
    "figure.facecolor": PAPER,
    "savefig.facecolor": PAPER,
    "image.interpolation": "nearest",
    "image.resample": False,
    "svg.hashsalt": "shadowjax",
    "lines.linewidth": 1.8,
    "lines.markersize": 5.0,
}

_Args = ParamSpec("_Args")
_Result = TypeVar("_Result")


@checked
def styled(draw: Callable[_Args, _Result]) -> Callable[_Args, _Result]:
    """Decorator: artists made inside take the project's settings, whatever the user's own are."""

    @wraps(draw)
    def drawing(*args: _Args.args, **kwargs: _Args.kwargs) -> _Result:
        settings: Any = {**mpl.rcParamsDefault, "backend": mpl.rcParams["backend"], **_SETTINGS}
        with mpl.rc_context(settings):
            return draw(*args, **kwargs)

    return drawing


@checked
@styled
def new_figure(
    width: float = 6.4, height: float = 4.0, rows: int = 1, cols: int = 1, **subplots: Any
) -> tuple[Figure, np.ndarray]:
    """An empty figure, no global state touched, whose parts never overlap.

    Args:
        width: Inches.
        height: Inches.
        rows: Rows of axes.
        cols: Columns of axes.
        subplots: Further arguments of matplotlib's `Figure.subplots`.

    Returns:
        The figure, and its axes as an array (rows, cols).
    """
    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure, figure.subplots(rows, cols, squeeze=False, **subplots)


@checked
def label(axes: Axes, x: str = "", y: str = "", title: str = "") -> None:
    """Names of the axes, with units, and a title."""
    axes.set_xlabel(x)
    axes.set_ylabel(y)
    axes.set_title(title)


@checked
def legend_below(figure: Figure, axes: Axes, columns: int = 4) -> None:
    """The legend of `axes` under the whole figure, where it hides nothing."""
    handles, labels = axes.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=columns)


@checked
def series_style(index: int) -> dict[str, Any]:
    """Colour and marker of the series with that number; both differ between neighbours."""
    return {"color": PALETTE[index % len(PALETTE)], "marker": MARKERS[index % len(MARKERS)]}


@checked
@styled
def figure_png(figure: Figure, dots_per_inch: float = 144.0) -> bytes:
    """A figure as the bytes of a PNG file, without date or version: the same figure gives the same bytes.

    Args:
        figure: Any figure made here.
        dots_per_inch: Resolution.
    """
    stream = BytesIO()
    figure.savefig(stream, format="png", dpi=dots_per_inch, metadata={"Software": None})
    return stream.getvalue()


@checked
def spread(values: Sequence[float], gap: float) -> list[float]:
    """Positions as near to `values` as they can be with `gap` between neighbours: labels that do not collide."""
    order = np.argsort(np.asarray(values, float), kind="stable")
    placed = np.asarray(values, float)[order].copy()
    for _ in range(100):
        overlap = gap - np.diff(placed)
        if not (overlap > 1e-9).any():
            break
        # Both neighbours give way by half; repeated until nothing overlaps.
        push = np.maximum(overlap, 0) / 2
        placed[:-1] -= push
        placed[1:] += push
    result = np.empty_like(placed)
    result[order] = placed
    return result.tolist()
