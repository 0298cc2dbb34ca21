"""Moving pictures: figures or arrays of pixels as the bytes of one GIF."""

from collections.abc import Sequence
from io import BytesIO

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image

from shadowjax._checked import checked
from shadowjax._checks import require, require_int
from shadowjax.plotting.style import styled

MOST_BYTES = 300_000
COLORS = 64

Frame = Figure | np.ndarray


@checked
@styled
def frame_pixels(frame: Frame, dots_per_inch: float = 80.0) -> np.ndarray:
    """One frame as (rows, cols, 3) bytes.

    Args:
        frame: A figure; or (rows, cols) greys or (rows, cols, 3) colours, uint8 or floats in [0, 1] (clipped).
        dots_per_inch: Resolution of a figure.

    Raises:
        ValueError: If an array is no picture or not finite.
    """
    if isinstance(frame, Figure):
        frame.set_dpi(dots_per_inch)
        canvas = FigureCanvasAgg(frame)
        canvas.draw()
        return np.array(canvas.buffer_rgba())[..., :3]
    array = np.asarray(frame)
    is_picture = array.size > 0 and (array.ndim == 2 or (array.ndim == 3 and array.shape[-1] == 3))
    require(is_picture, f"a frame has shape (rows, cols) or (rows, cols, 3); got {array.shape}")
    if array.dtype != np.uint8:
        array = array.astype(np.float64)
        require(bool(np.isfinite(array).all()), "a frame must be finite; some values are NaN or infinite")
        array = np.round(255 * np.clip(array, 0.0, 1.0)).astype(np.uint8)
    return array if array.ndim == 3 else np.repeat(array[..., None], 3, axis=-1)


@checked
def gif_bytes(
    frames: Sequence[Frame], milliseconds: int = 120, rest: int = 1500, most_bytes: int = MOST_BYTES
) -> bytes:
    """Frames as the bytes of a GIF file that repeats for ever; the same frames give the same bytes.

    Args:
        frames: At least two, all of one size; see `frame_pixels`. All share one palette.
        milliseconds: How long each is shown, in steps of 10.
        rest: How long the last one is shown.
        most_bytes: What the file may take.

    Raises:
        ValueError: If there are fewer than two frames, their sizes differ, or the file takes too much.
    """
    require(len(frames) >= 2, f"an animation needs at least two frames; got {len(frames)}")
    require_int(milliseconds, "milliseconds", 10)
    require_int(rest, "rest", 10)
    pixels = [frame_pixels(frame) for frame in frames]
    sizes = sorted({one.shape[:2] for one in pixels})
    require(len(sizes) == 1, f"all frames must have one size; got {sizes}")
    # A palette of its own for each frame would make colours flicker.
    palette = Image.fromarray(np.concatenate(pixels)).quantize(COLORS, dither=Image.Dither.NONE)
    first, *others = (
        Image.fromarray(one).quantize(COLORS, palette=palette, dither=Image.Dither.NONE) for one in pixels
    )
    stream = BytesIO()
    first.save(
        stream, "GIF", save_all=True, append_images=others, loop=0, optimize=False,
        duration=[milliseconds] * len(others) + [rest],
    )  # fmt: skip
    size = stream.tell()
    require(size <= most_bytes, f"the animation takes {size} bytes of {most_bytes}; give fewer or smaller frames")
    return stream.getvalue()


__all__ = ["COLORS", "MOST_BYTES", "Frame", "frame_pixels", "gif_bytes"]
