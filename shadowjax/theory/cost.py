"""Cost of shadow maps in depth fetches: the multi-depth source's model, its crossover, and counts on real arrays."""

import math
from collections.abc import Callable
from fractions import Fraction
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool

from shadowjax._checked import checked
from shadowjax._checks import require, require_int
from shadowjax._types import Array, Float

Number = int | float | Fraction


@checked
def scene_cost(num_fragments: Number, transform: Number, fetch: Number, test: Number, num_taps: int = 1) -> Number:
    """f·(transform + k·(fetch + test)): cost of shadowing a scene with a plain map and a filter of k taps.

    Args:
        num_fragments: f, fragments that the scene generates, hidden ones included.
        transform: Cost of taking a fragment to light space, any unit.
        fetch: Cost of one depth fetch.
        test: Cost of one shadow test.
        num_taps: k; 1 is the unfiltered map.

    Source: mdsm, eqs 5.1 (k = 1) and 5.2.
    """
    return num_fragments * (transform + require_int(num_taps, "number of taps", 1) * (fetch + test))


@checked
def lookup_fetches(num_fragments: Number, num_taps: int) -> Number:
    """f·k: fetches of a scene with a filter of k taps. Source: mdsm, eq. 5.3."""
    return num_fragments * require_int(num_taps, "number of taps", 1)


@checked
def build_fetches(height: int, width: int, neighbours: int) -> int:
    """h·w·q: fetches that build a multi-depth map whose texels look at q neighbours. Source: mdsm, eq. 5.4."""
    texels = require_int(height, "map height", 1) * require_int(width, "map width", 1)
    return texels * require_int(neighbours, "number of neighbours", 1)


@checked
def multi_depth_fetches(height: int, width: int, neighbours: int, num_fragments: Number, num_taps: int) -> Number:
    """h·w·q + f·k: fetches of a scene with a multi-depth map and a filter of k taps. Source: mdsm, eq. 5.5."""
    return build_fetches(height, width, neighbours) + lookup_fetches(num_fragments, num_taps)


@checked
def crossover_fragments(height: int, width: int, neighbours: int, saved_taps: int) -> Fraction:
    """q·h·w/r: the multi-depth map is cheaper above this number of fragments.

    Args:
        height: Rows of the map.
        width: Columns of the map.
        neighbours: q, depths that each texel of the map looks at when it is built.
        saved_taps: r ≥ 1, taps that the plain map's filter has and the multi-depth map's does not need.

    Source: mdsm, eq. 5.6.
    """
    saved = require_int(saved_taps, "saved taps", 1)
    return Fraction(build_fetches(height, width, neighbours), saved)


@checked
def first_cheaper_fragments(height: int, width: int, neighbours: int, saved_taps: int) -> int:
    """Smallest whole number of fragments at which the multi-depth map is strictly cheaper. Source: mdsm, eq. 5.6."""
    return math.floor(crossover_fragments(height, width, neighbours, saved_taps)) + 1


@checked
def size_ratio_threshold(neighbours: int, saved_taps: int) -> Fraction:
    """q/r: with each pixel shaded once, the multi-depth map is cheaper when image area / map area exceeds this.

    Below 1 it is cheaper even at equal sizes (q < r, such as 16 taps replaced by 4), which the source's text denies.

    Source: mdsm, eq. 5.7.
    """
    return Fraction(require_int(neighbours, "number of neighbours", 1), require_int(saved_taps, "saved taps", 1))


@checked
def dependence(
    function: Callable[[Float[Array, "..."]], Any], depth: Float[Array, "..."]
) -> Bool[np.ndarray, "outputs inputs"]:
    """Which depths each output of a function really reads, found by moving one depth at a time.

    Args:
        function: From a depth map to an array whose leading axes are the outputs; values behind a comparison count too,
            since each depth is moved far up and far down.
        depth: The map at which to look; its values must differ, so that no output hides behind a tie.

    Returns:
        Whether output i changes when depth j does. Outputs and depths in row-major order.
    """
    flat = depth.ravel()
    require(flat.size <= 4096, f"dependence moves every depth in turn: at most 4096 of them, got {flat.size}")
    # Beyond every depth of the map on both sides: a moved depth changes the outcome of any comparison it enters.
    far = 2 * (jnp.max(jnp.abs(flat)) + 1)
    indices = jnp.arange(flat.size, dtype=jnp.int32)

    @jax.jit
    def changed(flat: Array, far: Array) -> Array:
        def one(index: Array, value: Array) -> Array:
            return jnp.asarray(function(jnp.where(indices == index, value, flat).reshape(depth.shape)))

        # One program for the map itself (index −1 moves nothing) and for both moves of every depth.
        every = jnp.concatenate([jnp.full((1,), -1, jnp.int32), indices, indices])
        values = jnp.concatenate([far[None], jnp.full(flat.shape, far), jnp.full(flat.shape, -far)])
        outputs = jax.lax.map(lambda move: one(*move), (every, values))
        moved = outputs[1:].reshape(2, flat.size, -1)
        return jnp.any(moved != outputs[0].reshape(-1), axis=0)

    found = changed(flat, far)
    return np.asarray(found).T


@checked
def count_build_fetches(
    build: Callable[[Float[Array, "rows cols"]], Float[Array, "planes rows cols"]], depth: Float[Array, "rows cols"]
) -> int:
    """Depths that a multi-depth policy reads for one texel inside the map: the q of mdsm, eq. 5.4, counted.

    Args:
        build: A policy of `shadowjax.filters.multi_depth`.
        depth: A map with distinct depths, large enough to hold a whole neighbourhood.
    """
    planes = int(jnp.asarray(build(depth)).shape[0])
    reads = dependence(build, depth).reshape(planes, depth.size, depth.size)
    return int(reads.any(axis=0).sum(axis=1).max())


@checked
def count_lookup_fetches(
    visibility: Callable[[Float[Array, "planes rows cols"]], Float[Array, "..."]],
    planes: Float[Array, "planes rows cols"],
) -> int:
    """Texels that one lookup of a filter reads: the k of mdsm, eq. 5.3, counted.

    A texel's n depths are one fetch, as they lie in the channels of one texel.

    Args:
        visibility: Filtered visibility of receivers as a function of the planes; receivers lie between all depths.
        planes: Depths of the map.
    """
    reads = dependence(visibility, planes)
    texels = reads.reshape(reads.shape[0], planes.shape[0], -1).any(axis=1)
    return int(texels.sum(axis=1).max())
