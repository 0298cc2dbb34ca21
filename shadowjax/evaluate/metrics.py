"""Image metrics against a reference: errors, structural similarity, false light and shadow, distance of edges."""

import functools
import importlib
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool
from scipy import ndimage

from shadowjax._checked import checked
from shadowjax._checks import require
from shadowjax._numerics import safe_sqrt
from shadowjax._types import Array, ArrayLike, Float, Scalar, as_float_array

SSIM_WIDTH, SSIM_SIGMA = 11, 1.5  # window of Wang et al. 2004
SSIM_K1, SSIM_K2 = 0.01, 0.03


def _pair(test: ArrayLike, reference: ArrayLike) -> tuple[Array, Array]:
    test, reference = as_float_array(test), as_float_array(reference)
    require(test.shape == reference.shape, f"images must have one shape; got {test.shape} and {reference.shape}")
    return test, jnp.asarray(reference, dtype=test.dtype)


def _mean(values: Array, mask: ArrayLike | None) -> Array:
    """Mean over the pixels of a mask (all if None, 0 if none); a mask of pixels spreads over channels."""
    if mask is None:
        return jnp.mean(values)
    weight = jnp.asarray(mask)
    require(
        weight.shape == values.shape[: weight.ndim],
        f"mask must have the image's rows and columns {values.shape[:2]}; got {weight.shape}",
    )
    weight = weight.reshape(weight.shape + (1,) * (values.ndim - weight.ndim))
    weight = jnp.broadcast_to(weight.astype(values.dtype), values.shape)
    return jnp.sum(values * weight) / jnp.maximum(jnp.sum(weight), 1)


@checked
def rmse(test: ArrayLike, reference: ArrayLike, mask: ArrayLike | None = None) -> Scalar:
    """Root of the mean squared difference over the pixels of a mask.

    Args:
        test: Image, (rows, cols) or (rows, cols, channels).
        reference: Image of the same shape.
        mask: Valid receivers, (rows, cols); all if None.
    """
    a, b = _pair(test, reference)
    return safe_sqrt(_mean((a - b) ** 2, mask))


@checked
def mean_abs_error(test: ArrayLike, reference: ArrayLike, mask: ArrayLike | None = None) -> Scalar:
    """Mean absolute difference over the pixels of a mask; for visibility it is `false_lit` + `false_shadow`."""
    a, b = _pair(test, reference)
    return _mean(jnp.abs(a - b), mask)


@checked
def psnr(test: ArrayLike, reference: ArrayLike, mask: ArrayLike | None = None, peak: float = 1.0) -> Scalar:
    """Peak signal-to-noise ratio in dB; equal images give the dtype's ceiling (139 in float32, 313 in float64)."""
    require(peak > 0, f"peak must be positive; got {peak}")
    a, b = _pair(test, reference)
    floor = float(jnp.finfo(a.dtype).eps) ** 2
    return -10 * jnp.log10(jnp.maximum(_mean(((a - b) / peak) ** 2, mask), floor))


@checked
def false_lit(test: ArrayLike, reference: ArrayLike, mask: ArrayLike | None = None) -> Scalar:
    """Area fraction that is lit and should not be; partly lit pixels count by the excess. Input: visibilities."""
    a, b = _pair(test, reference)
    return _mean(jnp.maximum(a - b, 0), mask)


@checked
def false_shadow(test: ArrayLike, reference: ArrayLike, mask: ArrayLike | None = None) -> Scalar:
    """Area fraction that is in shadow and should not be; partly lit pixels count by the lack. Input: visibilities."""
    return false_lit(reference, test, mask)


def _blur(image: Float[Array, "rows cols channels"]) -> Float[Array, "inner_rows inner_cols channels"]:
    """Gaussian window of SSIM where it fits entirely; sums of slices, so that no dtype is lowered by a convolution."""
    offset = np.arange(SSIM_WIDTH) - SSIM_WIDTH // 2
    weights = np.exp(-(offset**2) / (2 * SSIM_SIGMA**2))
    taps = [float(weight) for weight in weights / weights.sum()]
    rows, cols = image.shape[0] - SSIM_WIDTH + 1, image.shape[1] - SSIM_WIDTH + 1
    # The window is separable: down the rows first, then across the columns.
    down = sum((tap * image[i : i + rows] for i, tap in enumerate(taps)), start=jnp.zeros_like(image[:rows]))
    return sum((tap * down[:, i : i + cols] for i, tap in enumerate(taps)), start=jnp.zeros_like(down[:, :cols]))


@functools.partial(jax.jit, static_argnames="peak")
def _similarity(
    a: Float[Array, "rows cols channels"], b: Float[Array, "rows cols channels"], peak: float
) -> Float[Array, "inner_rows inner_cols channels"]:
    """Luminance times contrast and structure of every window."""
    # Variances do not change under a shift; around the middle of the range they lose the least to rounding.
    middle = peak / 2
    a, b = a - middle, b - middle
    mean_a, mean_b, square_a, square_b, product = jnp.split(
        _blur(jnp.concatenate([a, b, a * a, b * b, a * b], axis=-1)), 5, axis=-1
    )
    c1, c2 = (SSIM_K1 * peak) ** 2, (SSIM_K2 * peak) ** 2
    # Wang et al., eq. 13: contrast and structure with C₃ = C₂/2, then luminance.
    structure = (2 * (product - mean_a * mean_b) + c2) / (square_a - mean_a**2 + square_b - mean_b**2 + c2)
    mean_a, mean_b = mean_a + middle, mean_b + middle
    return structure * (2 * mean_a * mean_b + c1) / (mean_a**2 + mean_b**2 + c1)


@checked
def ssim(test: ArrayLike, reference: ArrayLike, mask: ArrayLike | None = None, peak: float = 1.0) -> Scalar:
    """Mean structural similarity, 1 for equal images; Gaussian window 11 × 11, σ = 1.5, where it fits in the image.

    Args:
        test: Image, (rows, cols) or (rows, cols, channels), at least 11 × 11.
        reference: Image of the same shape.
        mask: Window centres that count, (rows, cols); all if None.
        peak: Range of the values.

    Source: Wang et al. 2004, eq. 13 and section III-C.
    """
    a, b = _pair(test, reference)
    require(
        a.ndim in (2, 3) and min(a.shape[:2]) >= SSIM_WIDTH,
        f"SSIM needs images of at least {SSIM_WIDTH} × {SSIM_WIDTH} pixels; got shape {a.shape}",
    )
    a, b = (a[..., None], b[..., None]) if a.ndim == 2 else (a, b)
    edge = SSIM_WIDTH // 2
    inner = None if mask is None else jnp.asarray(mask)[edge:-edge, edge:-edge]
    return _mean(_similarity(a, b, peak), inner)


class EdgeDistance(NamedTuple):
    """Distances between the shadow edges of two images, in pixels (texels for maps).

    Args:
        mean: Mean distance of an edge point to the other image's edge, averaged over both directions.
        maximum: Largest of these distances in either direction (Hausdorff).
        misclassified_mean: Mean distance of misclassified pixels to the reference edge; 0 if there are none.
        misclassified_maximum: Largest of these; 0 if there are none.
        num_misclassified: How many pixels are lit in one image and in shadow in the other.
    """

    mean: float
    maximum: float
    misclassified_mean: float
    misclassified_maximum: float
    num_misclassified: int


def _cracks(lit: Bool[np.ndarray, "rows cols"], valid: Bool[np.ndarray, "rows cols"]) -> Bool[np.ndarray, "r c"]:
    """Edges on a grid of half the spacing: pixels at even indices, sides between pixels where one index is odd."""
    grid = np.zeros((2 * lit.shape[0] - 1, 2 * lit.shape[1] - 1), bool)
    # Between rows, then between columns; both pixels must count.
    grid[1::2, ::2] = (lit[1:] != lit[:-1]) & valid[1:] & valid[:-1]
    grid[::2, 1::2] = (lit[:, 1:] != lit[:, :-1]) & valid[:, 1:] & valid[:, :-1]
    return grid


@checked
def edge_distance(
    test: ArrayLike, reference: ArrayLike, mask: ArrayLike | None = None, threshold: float = 0.5
) -> EdgeDistance:
    """Distance between the shadow edges of two visibility images; host-side, exact Euclidean transform.

    An edge is the side between two valid pixels of different class, at its midpoint. Where only one image has an edge
    the distance is the diagonal of the image; where neither has, 0.

    Args:
        test: Visibility, (rows, cols).
        reference: Visibility of the same shape.
        mask: Valid receivers; all if None.
        threshold: A pixel is lit from this visibility on.
    """
    a, b = np.asarray(test), np.asarray(reference)
    require(
        a.ndim == 2 and a.shape == b.shape, f"edge distance needs two images (rows, cols); got {a.shape}, {b.shape}"
    )
    valid = np.ones(a.shape, bool) if mask is None else np.asarray(mask, bool)
    require(valid.shape == a.shape, f"mask must have the image's shape {a.shape}; got {valid.shape}")
    lit_a, lit_b = a >= threshold, b >= threshold
    edges_a, edges_b = _cracks(lit_a, valid), _cracks(lit_b, valid)
    wrong = (lit_a != lit_b) & valid
    diagonal = float(np.hypot(*a.shape))

    def away(edges: Any) -> Any:
        if not edges.any():
            return np.full(edges.shape, diagonal)
        # The grid has half the pixels' spacing.
        return np.asarray(ndimage.distance_transform_edt(~edges)) / 2

    from_a, from_b = away(edges_a), away(edges_b)
    # Distance of every edge point of one image to the nearest edge of the other, both ways.
    there, back = from_b[edges_a], from_a[edges_b]
    parts = [part for part in (there, back) if part.size]
    missed = from_b[::2, ::2][wrong]
    return EdgeDistance(
        mean=float(np.mean([part.mean() for part in parts])) if parts else 0.0,
        maximum=max((float(part.max()) for part in parts), default=0.0),
        misclassified_mean=float(missed.mean()) if missed.size else 0.0,
        misclassified_maximum=float(missed.max()) if missed.size else 0.0,
        num_misclassified=int(wrong.sum()),
    )


@checked
def flip(test: ArrayLike, reference: ArrayLike) -> float | None:
    """Mean FLIP error of two images with values in [0, 1], or None where the package `flip_evaluator` is missing.

    Args:
        test: Image, (rows, cols) or (rows, cols, 3), linear or display values as the caller chooses for both.
        reference: Image of the same shape.
    """
    try:
        evaluator = importlib.import_module("flip_evaluator")
    except ImportError:
        return None
    images = []
    for image in _pair(test, reference):
        pixels = np.clip(np.asarray(image, np.float32), 0, 1)
        images.append(np.ascontiguousarray(np.repeat(pixels[..., None], 3, -1) if pixels.ndim == 2 else pixels))
    return float(evaluator.evaluate(images[1], images[0], "LDR")[1])
