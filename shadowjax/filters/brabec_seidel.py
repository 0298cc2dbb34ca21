"""Brabec and Seidel's four depths a texel: cast four times, or cast once and handed on to the neighbours."""

import jax.numpy as jnp

from shadowjax._checked import checked
from shadowjax._checks import require
from shadowjax._types import Array, Float
from shadowjax.filters.base import Filter, Lookup
from shadowjax.filters.hard import is_lit
from shadowjax.filters.multi_depth import DepthPolicy, shifted
from shadowjax.maps.sampling import read_texels, texel_index

Depth = Float[Array, "rows cols"]
Planes = Float[Array, "n rows cols"]
# A texel holds 2 × 2 samples of the cast map.
Samples = Float[Array, "n texel_rows texel_cols"]

# (row, column) of a texel's four samples among the cast cells, and of the neighbours that hand on their depth.
CELLS = ((0, 0), (0, 1), (1, 0), (1, 1))


@checked
def gather_samples(depth: Depth) -> Samples:
    """Four maps of half the size, shifted against each other by half of their texel: the samples of 2 × 2 blocks.

    Raises:
        ValueError: If a side of the map is odd.
    """
    rows, cols = depth.shape
    require(rows % 2 == 0 and cols % 2 == 0, f"blocks of 2 × 2 samples need even sides; got a map of {rows} × {cols}")
    # The cells of one place in all 2 × 2 blocks are one of the four shifted maps.
    return jnp.stack([depth[row::2, col::2] for row, col in CELLS])


class Supersampled(Filter):
    """Four depths a texel from four casts shifted by half a texel, and one test against each.

    It is a map of twice the resolution along each axis, of which a lookup reads the texel's four samples: five tones.

    Source: mdsm, section 3.5, on Brabec and Seidel 2001, first variant.
    """

    def prepare(self, depth: Depth) -> Samples:
        """The four samples of each texel."""
        return gather_samples(depth)

    def visibility(self, planes: Samples, lookup: Lookup) -> Float[Array, "*points"]:
        """Share of the four samples that are lit."""
        # Positions count cast cells, of which a texel has two along each axis.
        position = lookup.position / self.cast_factor
        col, row = texel_index(position[..., 0]), texel_index(position[..., 1])
        stored = read_texels(planes, col, row, lookup.border)
        count = jnp.zeros(lookup.depth.shape, planes.dtype)
        for depth, (d_row, d_col) in zip(stored, CELLS, strict=True):
            # Each sample at its own cell, for filters that follow the receiver's plane.
            receiver = lookup.depth_at(2 * col + d_col, 2 * row + d_row)
            count = count + is_lit(depth, receiver, lookup.bias).astype(planes.dtype)
        return count / len(CELLS)

    @property
    def num_planes(self) -> int:
        """Four."""
        return 4

    @property
    def num_tones(self) -> int:
        """Five."""
        return 5

    @property
    def num_fetches(self) -> int:
        """Four depths of one texel."""
        return 4

    @property
    def reach(self) -> float:
        """In cast cells, of which a texel has two along an axis: from one side of it to the farther sample."""
        return 1.5

    @property
    def cast_factor(self) -> int:
        """Two samples a texel along an axis."""
        return 2


class PropagatedNeighbours(DepthPolicy):
    """Four depths a texel from one cast: its own and those that its neighbours to the right and below hand on.

    One pass over the map instead of three more casts; the composite test at the middle of the four reads the depths of
    a 2 × 2 PCF.

    Source: mdsm, section 3.5, on Brabec and Seidel 2001, second variant.
    """

    def planes(self, depth: Depth) -> Planes:
        """The texel and three neighbours."""
        return jnp.stack([shifted(depth, row, col) for row, col in CELLS])

    @property
    def num_depths(self) -> int:
        """Four."""
        return 4

    @property
    def radius(self) -> float:
        """One texel, to one side."""
        return 1.0

    @property
    def centroid(self) -> tuple[float, float]:
        """The corner that the four texels share."""
        return 0.5, 0.5

    @property
    def spread(self) -> float:
        """Half a texel to every side."""
        return 0.5
