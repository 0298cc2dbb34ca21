"""Figures that hold pictures: captioned grids, depth maps with a colour bar, signed difference maps."""

from collections.abc import Sequence

import jax
import numpy as np
from jaxtyping import Bool, Float
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from shadowjax._checked import checked
from shadowjax._checks import require
from shadowjax.plotting.pixels import difference_pixels
from shadowjax.plotting.style import DEPTH, DIFFERENCE, MUTED, new_figure, styled

Image = Float[np.ndarray, "rows cols"]


@checked
@styled
def show_image(axes: Axes, image: np.ndarray | jax.Array, title: str = "", caption: str = "") -> None:
    """One picture in given axes: pixels as they are, no ticks, title above, caption below.

    Args:
        axes: Where to draw.
        image: (rows, cols) greys or (rows, cols, 3) colours, in [0, 1]; row 0 is drawn at the top.
        title: Short name.
        caption: What to look at.
    """
    axes.imshow(np.clip(np.asarray(image, float), 0, 1), cmap="gray", vmin=0, vmax=1, interpolation="nearest")
    axes.set_xticks([])
    axes.set_yticks([])
    axes.grid(False)
    for side in axes.spines.values():
        side.set_visible(False)
    axes.set_title(title, fontsize=9.5)
    if caption:
        axes.set_xlabel(caption, fontsize=8, color=MUTED)


@checked
@styled
def image_grid(
    images: Sequence[np.ndarray | jax.Array],
    titles: Sequence[str],
    captions: Sequence[str] = (),
    columns: int = 3,
    width: float = 9.0,
    heading: str = "",
) -> Figure:
    """Pictures of one size in rows, each with its title and caption.

    Args:
        images: Greys or colours in [0, 1], all of the same shape.
        titles: One for each picture.
        captions: One for each picture, or none at all.
        columns: Pictures in a row, at most.
        width: Of the figure, inches.
        heading: Over the whole.

    Raises:
        ValueError: If numbers of pictures, titles and captions differ.
    """
    require(len(images) > 0, "an image grid needs at least one picture")
    require(
        len(images) == len(titles) and len(captions) in (0, len(images)),
        f"{len(images)} pictures need as many titles and captions; got {len(titles)} and {len(captions)}",
    )
    columns = min(columns, len(images))
    rows = -(-len(images) // columns)
    aspect = images[0].shape[0] / images[0].shape[1]
    cell = width / columns
    height = rows * (cell * aspect + 0.30 + (0.22 if captions else 0.0)) + (0.35 if heading else 0.0)
    figure, axes = new_figure(width, height, rows, columns)
    for index, spot in enumerate(axes.flat):
        if index < len(images):
            show_image(spot, images[index], titles[index], captions[index] if captions else "")
        else:
            spot.set_axis_off()
    if heading:
        figure.suptitle(heading, x=0.01, ha="left", fontweight="bold", fontsize=11)
    return figure


@checked
@styled
def depth_map(
    depth: Image,
    is_hit: Bool[np.ndarray, "rows cols"] | None = None,
    title: str = "",
    unit: str = "world units",
    width: float = 5.2,
) -> Figure:
    """A shadow map as the light sees it: depth in colour with a bar, misses in grey.

    Args:
        depth: Distance along each light ray, `depth[t_index, s_index]`.
        is_hit: Where a surface was met; everywhere if None.
        title: Over the picture.
        unit: Unit of depth.
        width: Of the figure, inches.
    """
    depth = np.asarray(depth, float)
    known = np.isfinite(depth) if is_hit is None else np.asarray(is_hit, bool)
    shown = np.ma.masked_array(depth, ~known)
    low, high = (float(shown.min()), float(shown.max())) if known.any() else (0.0, 1.0)
    figure, axes = new_figure(width, 0.86 * width * depth.shape[0] / depth.shape[1] + 0.3)
    spot = axes[0, 0]
    spot.set_facecolor("#c9ced6")
    # Near is bright: the order in which light meets surfaces.
    picture = spot.imshow(shown, cmap=f"{DEPTH}_r", vmin=low, vmax=max(high, low + 1e-12))
    spot.grid(False)
    spot.set(xlabel="s (texels)", ylabel="t (texels)", title=title)
    figure.colorbar(picture, ax=spot, label=f"depth along the light ray ({unit})", fraction=0.046, pad=0.02)
    return figure


@checked
@styled
def difference_map(
    test: Image,
    reference: Image,
    mask: Bool[np.ndarray, "rows cols"] | None = None,
    title: str = "",
    width: float = 5.2,
) -> Figure:
    """Signed error of a visibility image with a labelled bar; see `difference_pixels`.

    Args:
        test: Visibility in [0, 1].
        reference: Reference visibility.
        mask: Pixels that count.
        title: Over the picture.
        width: Of the figure, inches.
    """
    figure, axes = new_figure(width, 0.86 * width * test.shape[0] / test.shape[1] + 0.3)
    show_image(axes[0, 0], difference_pixels(test, reference, mask), title)
    bar = figure.colorbar(
        ScalarMappable(Normalize(-1, 1), DIFFERENCE),
        ax=axes[0, 0],
        fraction=0.046,
        pad=0.02,
        ticks=[-1, -0.5, 0, 0.5, 1],
    )
    bar.set_label("visibility − exact (− false shadow, + false light)")
    return figure
