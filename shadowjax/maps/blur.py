"""Separable blurs of any odd size: weights of Gaussian and box, borders, and the sum along both axes of a map."""

from typing import Annotated

import jax
import jax.numpy as jnp
import numpy as np

from shadowjax._checked import checked
from shadowjax._checks import NOT_NEGATIVE, concrete, require, require_choice, require_int
from shadowjax._types import Array, Float, ScalarLike
from shadowjax.maps.sampling import BORDERS, read_texels

KERNELS = ("gaussian", "box")
# Of the taps along one axis.
Weights = Float[Array, "taps"] | np.ndarray


@checked
def gaussian_weights(size: int, sigma: ScalarLike | None = None) -> Weights:
    """Weights of a sampled Gaussian along one axis; they add up to 1.

    Args:
        size: Number of taps, odd, ≥ 1.
        sigma: Standard deviation, texels, > 0; a fifth of the size if None (1.4 for the 7 × 7 of the source).

    Returns:
        Of NumPy; of JAX, and differentiable, where sigma is traced.

    Raises:
        ValueError: If the size is even or less than 1, or sigma is not positive.

    Source: filtering, section 3.2 (a 7 × 7 Gaussian, one axis after the other).
    """
    radius = kernel_radius(size)
    sigma = size / 5 if sigma is None else sigma
    known = concrete(sigma)
    require(
        known is None or bool(np.isfinite(known) and known > 0), f"sigma of a Gaussian must be positive; got {sigma}"
    )
    offsets = np.arange(-radius, radius + 1)
    if known is not None:
        # Known widths give NumPy weights, which compile into the program as constants.
        weights = np.exp(-0.5 * (offsets / known) ** 2)
    else:
        weights = jnp.exp(-0.5 * (jnp.asarray(offsets, jnp.result_type(sigma)) / sigma) ** 2)
    return weights / weights.sum()


@checked
def box_weights(size: int) -> np.ndarray:
    """Equal weights along one axis; they add up to 1.

    Args:
        size: Number of taps, odd, ≥ 1.

    Raises:
        ValueError: If the size is even or less than 1.
    """
    kernel_radius(size)
    return np.full(size, 1 / size)


@checked
def kernel_weights(kernel: str, size: int, sigma: ScalarLike | None = None) -> Weights:
    """Weights of a named kernel (`KERNELS`) along one axis."""
    require_choice(kernel, "kernel", KERNELS)
    return box_weights(size) if kernel == "box" else gaussian_weights(size, sigma)


@checked
def kernel_radius(size: int) -> int:
    """(size − 1)/2 of a centred kernel.

    Raises:
        ValueError: If the size is even: its centre would lie between texels and shift the map by half a texel.
    """
    require_int(size, "kernel size", 1)
    require(size % 2 == 1, f"a blur kernel needs an odd size, so that it has a centre; got {size}, use {size + 1}")
    return (size - 1) // 2


@checked
def known_weights(weights: Weights) -> Weights:
    """Of NumPy where they are known, so that programs hold them as numbers."""
    known = concrete(weights)
    return weights if known is None else known


@checked
def extend(
    depth: Float[Array, "rows cols"], width: Annotated[int, NOT_NEGATIVE], border: str, outside: Float[Array, ""]
) -> Float[Array, "more_rows more_cols"]:
    """The map with `width` more texels on every side.

    Args:
        depth: Any map.
        width: Texels to add, ≥ 0.
        border: What lies there: "lit" puts `outside`, "clamp" repeats the edge, "octahedral" continues across folds.
        outside: Value beyond a "lit" border.
    """
    require_choice(border, "border", BORDERS)
    if width == 0:
        return depth
    if border == "octahedral":
        num_rows, num_cols = depth.shape
        col, row = jnp.meshgrid(
            jnp.arange(-width, num_cols + width, dtype=jnp.int32), jnp.arange(-width, num_rows + width, dtype=jnp.int32)
        )
        return read_texels(depth[None], col, row, border)[0]
    if border == "clamp":
        return jnp.pad(depth, width, mode="edge")
    return jnp.pad(depth, width, constant_values=outside.astype(depth.dtype))


@checked
def blur(planes: Float[Array, "n more_rows more_cols"], weights: Weights) -> Float[Array, "n rows cols"]:
    """Weighted mean along both axes, where the whole kernel fits: the result is `len(weights) − 1` texels smaller.

    Shifted copies are added up, one axis after the other; on a CPU this is some thirty times faster than a convolution.

    Args:
        planes: Maps, extended beforehand (`extend`) by half the kernel.
        weights: Of an odd number of taps along one axis.
    """
    kernel_radius(len(weights))
    weights = known_weights(weights)
    if len(weights) == 1:
        return planes * jnp.asarray(weights[0], planes.dtype)
    across = _sum_along(planes, weights, 2)
    # Without the barrier both sums fuse into one that reads size² texels for each result.
    return _sum_along(jax.lax.optimization_barrier(across), weights, 1)


def _sum_along(planes: Array, weights: Weights, axis: int) -> Array:
    # Slice i holds tap i of every result: the blur is a weighted sum of shifted slices.
    length = planes.shape[axis] - len(weights) + 1
    require(length > 0, f"a kernel of {len(weights)} taps does not fit into a map of {planes.shape[axis]} texels")
    parts = [jax.lax.slice_in_dim(planes, i, i + length, axis=axis) for i in range(len(weights))]
    weighted = [part * jnp.asarray(weight, planes.dtype) for part, weight in zip(parts, weights, strict=True)]
    return sum(weighted[1:], weighted[0])
