"""Hierarchical minima: the smallest depth of aligned blocks, as depth hardware keeps it, and why it aliases."""

import equinox as eqx
import jax.numpy as jnp

from shadowjax._checked import checked
from shadowjax._checks import require
from shadowjax._types import Array, Float
from shadowjax.filters.multi_depth import DepthPolicy

Depth = Float[Array, "rows cols"]
Planes = Float[Array, "n rows cols"]


@checked
def block_minimum(depth: Depth, size: int) -> Depth:
    """The smallest depth of each aligned size × size block, at every texel of the block; blocks may be cut at the edge.

    Args:
        depth: Depth map.
        size: Texels along a side of a block, ≥ 1.
    """
    rows, cols = depth.shape
    # −rows % size texels repeat the edge, so that blocks cut at the edge keep their own minimum.
    padded = jnp.pad(depth, ((0, -rows % size), (0, -cols % size)), mode="edge")
    # Axes 1 and 3 run within a block.
    blocks = padded.reshape(padded.shape[0] // size, size, padded.shape[1] // size, size)
    smallest = jnp.min(blocks, axis=(1, 3))
    return jnp.repeat(jnp.repeat(smallest, size, axis=0), size, axis=1)[:rows, :cols]


class HierarchicalMinimum(DepthPolicy):
    """Keeps the minima of the aligned blocks that a texel lies in: a policy that fails, kept to show how.

    Blocks are fixed to the map, so tones follow a regular grid instead of the edge: severe aliasing.

    Attributes:
        block_sizes: Texels along a side of each level's blocks, ≥ 2; (2, 4) are the groups of 4 and 16 of the hardware.

    Source: mdsm, section 5.2.4 (the Hyper-Z experiment).
    """

    block_sizes: tuple[int, ...] = eqx.field(static=True, default=(2, 4))

    def __check_init__(self) -> None:
        require(
            len(self.block_sizes) > 0 and all(isinstance(size, int) and size >= 2 for size in self.block_sizes),
            f"block_sizes must be integers of at least 2, one or more; got {self.block_sizes}",
        )

    def planes(self, depth: Depth) -> Planes:
        """The depth and one minimum for each level."""
        return jnp.stack([depth, *(block_minimum(depth, size) for size in self.block_sizes)])

    @property
    def num_depths(self) -> int:
        """One, and one for each level."""
        return 1 + len(self.block_sizes)

    @property
    def radius(self) -> float:
        """From one side of the largest block to the other."""
        return float(max(self.block_sizes) - 1)
