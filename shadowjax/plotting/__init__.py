"""Pictures; the only importer of matplotlib. Figures are objects: nothing here touches pyplot's global state.

Charts and grids of pictures come back as `Figure`; turn one into bytes with `figure_png`, or many into an animation
with `gif_bytes`, and write those with `shadowjax.io.write_bytes`. Arrays of pixels come from `pixels` and are written
with `shadowjax.io.write_png`.
"""

from shadowjax.plotting.animation import gif_bytes
from shadowjax.plotting.charts import bars, lines, scatter, tone_histogram
from shadowjax.plotting.comparison import comparison
from shadowjax.plotting.images import depth_map, difference_map, image_grid, show_image
from shadowjax.plotting.pareto import pareto
from shadowjax.plotting.pixels import difference_pixels, edge_window, enlarge, outlined
from shadowjax.plotting.style import MARKERS, PALETTE, Figure, figure_png, label, new_figure, series_style, styled

__all__ = [
    "MARKERS", "PALETTE", "Figure", "bars", "comparison", "depth_map", "difference_map", "difference_pixels",
    "edge_window", "enlarge", "figure_png", "gif_bytes", "image_grid", "label", "lines", "new_figure", "outlined",
    "pareto", "scatter", "series_style", "show_image", "styled", "tone_histogram",
]  # fmt: skip
