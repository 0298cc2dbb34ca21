"""The page table of an adaptive map: which tile answers at a position, in arrays of fixed size, found under jit."""

import jax.numpy as jnp
import numpy as np

from shadowjax._checked import Checked
from shadowjax._checks import require
from shadowjax._types import Array, Float, Int
from shadowjax.partitions.adaptive.tile_tree import END, place_of, span_of

LEVEL_BITS = 4  # a level is at most 15
# Bytes of one interval, and of all that a tile can add: the interval that it takes and the one that it cuts off.
INTERVAL_BYTES = 8
TILE_BYTES = 2 * INTERVAL_BYTES


class PageTable(Checked):
    """The finest resident tile at every place, as intervals of the Z-order curve.

    Along the curve a tile of a quadtree is an interval, and the intervals of two tiles are nested or disjoint. "The
    finest tile that holds this place" is then constant between at most 2K + 1 sorted numbers for K tiles, so a binary
    search finds it: no pointers, no walk down a tree, and no array changes its shape when tiles come and go.

    Attributes:
        starts: First place of each interval, rising; spare ones lie beyond the curve.
        pages: Slot of the interval's tile, times 16, plus its level.
    """

    starts: Int[Array, "intervals"]
    pages: Int[Array, "intervals"]

    def find(self, square: Float[Array, "*points 2"]) -> tuple[Int[Array, "*points"], Int[Array, "*points"]]:
        """Slot and level of the finest resident tile at positions (s, t) of the unit square."""
        place = place_of(square)
        index = jnp.searchsorted(self.starts, place.reshape(-1), side="right") - 1
        page = self.pages[index].reshape(place.shape)
        return page >> LEVEL_BITS, page & ((1 << LEVEL_BITS) - 1)

    @property
    def num_bytes(self) -> int:
        """Bytes of the table."""
        return self.starts.nbytes + self.pages.nbytes

    @classmethod
    def of(cls, keys: Int[np.ndarray, "slots 3"]) -> "PageTable":
        """The table of resident tiles; host-side.

        Args:
            keys: Level, x and y of the tile in each slot; level −1 where the slot is empty.

        Raises:
            ValueError: If the tiles do not cover the square: some place would have no answer.
        """
        slots = np.flatnonzero(keys[:, 0] >= 0)
        first, last = span_of(keys[slots])
        bounds = np.unique(np.concatenate([first, last]))
        # One page for every stretch between neighbouring bounds, overwritten by finer tiles.
        page = np.full(len(bounds), -1, np.int64)
        begin, end = np.searchsorted(bounds, first), np.searchsorted(bounds, last)
        for level in np.unique(keys[slots, 0]):  # finer tiles over coarser ones; those of one level never meet
            chosen = keys[slots, 0] == level
            # All tiles of a level at once: the intervals begin … end of each, written out one after the other.
            length = (end - begin)[chosen]
            offset = np.arange(length.sum()) - np.repeat(np.cumsum(length) - length, length)
            page[np.repeat(begin[chosen], length) + offset] = np.repeat((slots[chosen] << LEVEL_BITS) | level, length)
        covered = len(bounds) > 1 and bounds[0] == 0 and bounds[-1] == END and bool((page[:-1] >= 0).all())
        require(covered, "resident tiles must cover the unit square: keep every tile of the coarsest level")
        # Neighbouring intervals of one tile are one: the fewest numbers, however tiles came about.
        kept = np.flatnonzero(np.append(True, page[1:-1] != page[:-2]))
        starts = np.full(2 * len(keys) + 1, END, np.int32)
        pages = np.zeros(2 * len(keys) + 1, np.int32)
        starts[: len(kept)], pages[: len(kept)] = bounds[:-1][kept], page[:-1][kept]
        return cls(jnp.asarray(starts), jnp.asarray(pages))


__all__ = ["INTERVAL_BYTES", "LEVEL_BITS", "TILE_BYTES", "PageTable"]
