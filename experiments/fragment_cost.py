"""What a fragment costs: reads counted on the package's own functions, and processor time of layers of fragments."""

import time
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np

from shadowjax._types import Array, Float
from shadowjax.filters.multi_depth import max_neighbour, single
from shadowjax.filters.pcf import percentage_closer
from shadowjax.theory.cost import count_build_fetches, count_lookup_fetches, dependence

BLOCK = 4096  # fragments shaded together
SETUPS = {"PCF 3 × 3": (3, 1), "2-SM + PCF 2 × 2": (2, 2), "PCF 4 × 4": (4, 1)}  # taps along an axis, depths
NINE, TWO, SIXTEEN = SETUPS
RECEIVER = 1.5  # depth of every fragment; stored depths lie evenly between 1 and 2


def lookup_fragments(planes: Float[Array, "n rows cols"], first: Array, count: int, kernel_size: int) -> Array:
    """Visibility of consecutive fragments of quads that cover the map, row by row, again and again."""
    rows, cols = planes.shape[1:]
    index = (first + jnp.arange(count, dtype=jnp.int32)) % (rows * cols)
    # A little off the texels' middles, as pixels of a camera would be.
    x, y = (index % cols).astype(jnp.float32) + 0.7, (index // cols).astype(jnp.float32) + 0.6
    depth = jnp.full(count, RECEIVER, jnp.float32)
    return percentage_closer(planes, jnp.stack([x, y], -1), depth, kernel_size, border="clamp")


@partial(jax.jit, static_argnums=(2, 3))
def shade_layers(depth: Float[Array, "rows cols"], num_blocks: Array, kernel_size: int, num_depths: int) -> Array:
    """Build the map of 1 or 2 depths and sum the visibility of `num_blocks` blocks of fragments."""
    planes = single(depth) if num_depths == 1 else max_neighbour(depth)

    def block(index: Array, total: Array) -> Array:
        return total + lookup_fragments(planes, index * BLOCK, BLOCK, kernel_size).sum()

    return jax.lax.fori_loop(jnp.int32(0), num_blocks, block, jnp.sum(planes[-1, :1, :1]))


def count_reads() -> tuple[int, dict[str, int], dict[str, int]]:
    """Texels per texel of the 2-SM, then texels and depths per fragment of every setup, on the real functions."""
    size = 8
    values = 1 + (np.random.default_rng(0).permutation(2 * size**2) + 0.5) / (2 * size**2)
    planes = jnp.asarray(values.reshape(2, size, size), jnp.float32)
    middle = jnp.int32((size // 2) * size + size // 2)
    taps, depths = {}, {}
    for name, (kernel_size, num_depths) in SETUPS.items():
        look = partial(lookup_fragments, first=middle, count=1, kernel_size=kernel_size)
        taps[name] = count_lookup_fetches(look, planes[:num_depths])
        depths[name] = int(dependence(look, planes[:num_depths]).sum(axis=1).max())
    return count_build_fetches(max_neighbour, planes[0]), taps, depths


def measure(map_size: int, blocks: np.ndarray, turns: int) -> dict[str, Float[np.ndarray, "turns blocks"]]:
    """Processor time of every setup and number of blocks in every turn, seconds.

    Setups alternate within a turn, so that what else the machine does falls on all of them: their ratios within a turn
    say more than their times do.
    """
    depth = jnp.asarray(1 + np.random.default_rng(1).random((map_size, map_size)), jnp.float32)
    times = {name: np.full((turns, blocks.size), np.inf) for name in SETUPS}
    for turn in range(-1, turns):  # the first compiles
        for index, number in enumerate(blocks):
            num_blocks = jnp.int32(number)
            # Without fragments a run is short, and its time, the fixed cost, hides easily: try it more often.
            for name, setup in list(SETUPS.items()) * (8 if number == 0 else 1):
                start = time.process_time()
                jax.block_until_ready(shade_layers(depth, num_blocks, *setup))
                seconds = time.process_time() - start
                if turn >= 0:
                    times[name][turn, index] = min(times[name][turn, index], seconds)
    return times
