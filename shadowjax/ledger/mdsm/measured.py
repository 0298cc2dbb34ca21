"""Measurements for the ledger on the package's own multi-depth maps: binary windows, policies, filtered visibility."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from shadowjax._types import Array, default_dtype
from shadowjax.filters import multi_depth
from shadowjax.filters.hard import composite_test
from shadowjax.filters.pcf import percentage_closer
from shadowjax.theory.tones import count_tones
from shadowjax.theory.windows import kernel_width

SHADOW, RECEIVER, LIT = 1.0, 1.5, 2.0  # depths of occluder texels, receivers and lit texels
BATCHES = (1024, 65536)


def planes(depth: Float[Array, "rows cols"], policy: str, include_centre: bool = True) -> Float[Array, "n rows cols"]:
    """The planes that a named policy makes of a depth map."""
    if policy == "1-SM":
        return multi_depth.single(depth)
    if policy == "2-SM max":
        return multi_depth.max_neighbour(depth, include_centre=include_centre)
    if policy == "2-SM min":
        return multi_depth.min_neighbour(depth, include_centre=include_centre)
    if policy == "3-SM min/max":
        return multi_depth.min_max_neighbours(depth, include_centre=include_centre)
    raise ValueError(f"no such policy: {policy!r}")


def visibility(
    stored: Float[Array, "n rows cols"], position: Float[Array, "*points 2"], width: int
) -> Float[Array, "*points"]:
    """Filtered visibility of receivers at positions in texels, through the package's own K × K filter."""
    points = position.shape[:-1]
    receiver = jnp.full(points, RECEIVER, dtype=stored.dtype)
    return percentage_closer(stored, position.astype(stored.dtype), receiver, width)


@functools.partial(jax.jit, static_argnames=("policy", "width", "include_centre"))
def window_visibility(
    windows: Float[Array, "batch rows cols"], policy: str, width: int, include_centre: bool = True
) -> Float[Array, "batch"]:
    """Visibility of one receiver in the middle of each window, whose texels hold depths."""
    # The window's middle: one texel of neighbourhood, then half the kernel.
    middle = jnp.full((1, 2), 1.5 + (width - 1) / 2, dtype=windows.dtype)

    def one(depth: Float[Array, "rows cols"]) -> Array:
        return visibility(planes(depth, policy, include_centre), middle, width)[0]

    return jax.vmap(one)(windows)


def depths(lit: Bool[np.ndarray, "..."]) -> Float[Array, "..."]:
    """Depth map whose lit texels lie behind the receivers and whose other texels lie in front."""
    return jnp.asarray(np.where(lit, LIT, SHADOW), dtype=default_dtype())


@functools.partial(jax.jit, static_argnames="policy")
def policy_planes(depth: Float[Array, "rows cols"], policy: str) -> Float[Array, "n rows cols"]:
    """`planes`, compiled."""
    return planes(depth, policy)


@jax.jit
def attenuation(stored: Float[Array, "n *points"]) -> Float[Array, "*points"]:
    """The package's composite test of receivers against given depths."""
    return 1 - composite_test(stored, jnp.full(stored.shape[1:], RECEIVER, dtype=stored.dtype))


def count_window_tones(
    lit: Bool[np.ndarray, "batch rows cols"], num_taps: int, policy: str, include_centre: bool = True
) -> int:
    """Distinct visibilities that the package's filter gives over windows of lit texels.

    Copies of the first window fill the batch up to one of few sizes, so that few programs are compiled.
    """
    size = next(size for size in BATCHES if size >= len(lit))
    batch = np.concatenate([lit, np.broadcast_to(lit[:1], (size - len(lit), *lit.shape[1:]))])
    return count_tones(window_visibility(depths(batch), policy, kernel_width(num_taps), include_centre))


def all_windows(side: int) -> Bool[np.ndarray, "windows rows cols"]:
    """Every binary window of side × side texels; at most 4 × 4."""
    index = np.arange(2 ** (side * side), dtype=np.uint32)
    return ((index[:, None] >> np.arange(side * side, dtype=np.uint32)) & 1).astype(bool).reshape(-1, side, side)


def map_visibility(lit: Bool[np.ndarray, "rows cols"], num_taps: int, policy: str) -> Float[Array, "inner_r inner_c"]:
    """Filtered visibility of a receiver over every texel whose whole kernel lies inside a map of lit texels."""
    width = kernel_width(num_taps)
    rows, cols = lit.shape
    y, x = np.mgrid[: rows - width + 1, : cols - width + 1] + (width - 1) / 2 + 0.5
    position = jnp.asarray(np.stack([x, y], axis=-1), dtype=default_dtype())
    return _filtered(depths(lit), position, policy, width)


@functools.partial(jax.jit, static_argnames=("policy", "width"))
def _filtered(
    depth: Float[Array, "rows cols"], position: Float[Array, "*points 2"], policy: str, width: int
) -> Float[Array, "*points"]:
    return visibility(planes(depth, policy), position, width)
