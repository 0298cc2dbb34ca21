"""Pictures as arrays: signed differences in colour, magnified crops, and where a shadow edge is worth looking at."""

import numpy as np
from jaxtyping import Bool, Float
from scipy import ndimage

from shadowjax._checked import checked
from shadowjax._checks import require, require_int
from shadowjax.plotting.style import DIFFERENCE

Image = Float[np.ndarray, "rows cols"]
ColorImage = Float[np.ndarray, "rows cols 3"]
Window = tuple[slice, slice]


@checked
def difference_pixels(
    test: Image, reference: Image, mask: Bool[np.ndarray, "rows cols"] | None = None, backdrop: ColorImage | None = None
) -> ColorImage:
    """Where a visibility image is wrong, and which way, in colour.

    Args:
        test: Visibility in [0, 1].
        reference: Reference visibility.
        mask: Pixels that count; others show the backdrop alone.
        backdrop: Picture shown pale and grey behind, to see where one is.

    Returns:
        RGB: blue where the test is too dark (false shadow), orange-red where it is too bright (false light).
    """
    test, reference = np.asarray(test, float), np.asarray(reference, float)
    require(test.shape == reference.shape, f"images must have one shape; got {test.shape} and {reference.shape}")
    signed = test - reference if mask is None else np.where(mask, test - reference, 0.0)
    paper = np.full((*test.shape, 3), 0.97)
    if backdrop is not None:
        grey = np.asarray(backdrop, float).mean(axis=-1)
        paper = np.broadcast_to((0.80 + 0.18 * grey)[..., None], paper.shape)
    # −1 … 1 onto the colour map's 0 … 1; faint errors fade into the paper.
    colored = np.asarray(DIFFERENCE(0.5 + 0.5 * np.clip(signed, -1, 1)))[..., :3]
    strength = np.clip(3.0 * np.abs(signed), 0, 1)[..., None]
    return strength * colored + (1 - strength) * paper


@checked
def enlarge(image: np.ndarray, factor: int) -> np.ndarray:
    """Each pixel as a block of factor × factor pixels, so that single tones can be seen."""
    factor = require_int(factor, "enlargement factor", 1)
    return np.repeat(np.repeat(image, factor, axis=0), factor, axis=1)


@checked
def edge_window(visibility: Image, mask: Bool[np.ndarray, "rows cols"], height: int = 36, width: int = 48) -> Window:
    """The window of an image that shows the most shadow edge among pixels that count.

    Edges between lit and dark count, weighted towards windows with as much light as shadow; a window full of fine
    detail is worth less than one clean edge, so the count saturates.

    Args:
        visibility: Reference visibility.
        mask: Valid receivers; others are no edges.
        height: Rows of the window; at most the image's.
        width: Columns of the window; at most the image's.

    Returns:
        Slices of rows and columns. The middle of the image where there is no edge.
    """
    lit = np.asarray(visibility) >= 0.5
    valid = np.asarray(mask, bool)
    rows, cols = lit.shape
    height, width = min(height, rows), min(width, cols)
    edge = np.zeros(lit.shape)
    edge[1:] += (lit[1:] != lit[:-1]) & valid[1:] & valid[:-1]
    edge[:, 1:] += (lit[:, 1:] != lit[:, :-1]) & valid[:, 1:] & valid[:, :-1]

    def sums(image: np.ndarray) -> np.ndarray:
        """Sum over the window that starts at every pixel from which it fits."""
        # A summed-area table: each window's sum from four of its entries.
        total = np.pad(np.cumsum(np.cumsum(image, axis=0), axis=1), ((1, 0), (1, 0)))
        return total[height:, width:] - total[:-height, width:] - total[height:, :-width] + total[:-height, :-width]

    share = sums(valid.astype(float)) / (height * width)
    bright = sums((lit & valid).astype(float)) / np.maximum(sums(valid.astype(float)), 1)
    length = np.minimum(sums(edge) / (1.5 * width), 1.0)
    # Length saturates, valid pixels count twice over, and √(p(1 − p)) is largest for as much light as shadow.
    score = length * share**2 * (bright * (1 - bright)) ** 0.5
    # A little smoothing keeps the choice from hanging on a pixel.
    score = ndimage.uniform_filter(score, size=3, mode="nearest")
    if score.max() <= 0:
        row, col = (rows - height) // 2, (cols - width) // 2
    else:
        row, col = (int(index) for index in np.unravel_index(int(score.argmax()), score.shape))
    return slice(row, row + height), slice(col, col + width)


@checked
def outlined(image: ColorImage, window: Window, color: tuple[float, float, float] = (0.84, 0.37, 0.0)) -> ColorImage:
    """Copy of a picture with the border of a window drawn on it, one pixel wide."""
    result = np.array(image, copy=True)
    rows, cols = window
    top, bottom, left, right = rows.start, rows.stop - 1, cols.start, cols.stop - 1
    for edge in ((top, cols), (bottom, cols), (rows, left), (rows, right)):
        result[edge] = color
    return result
