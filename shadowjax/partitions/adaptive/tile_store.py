"""Slots of a fixed tile memory: last use, benefit, and LRU eviction by benefit."""

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from shadowjax._checked import Checked, checked
from shadowjax._checks import require
from shadowjax._types import Array, Int
from shadowjax.partitions.adaptive.page_table import INTERVAL_BYTES, TILE_BYTES
from shadowjax.partitions.adaptive.tile_tree import tiles_of_level

EMPTY = -1


class Placed(NamedTuple):
    """What became of tiles that asked for a slot.

    Attributes:
        store: The store afterwards.
        keys: Tiles that got a slot.
        slots: Where.
        num_evicted: Tiles that left for them.
        num_refused: Tiles that found no slot.
    """

    store: "TileStore"
    keys: Int[np.ndarray, "placed 3"]
    slots: Int[np.ndarray, "placed"]
    num_evicted: int
    num_refused: int


class TileStore(Checked):
    """The slots of an adaptive map. Values never change: every step makes a new store.

    Attributes:
        keys: Level, x and y of the tile in each slot; level −1 where it is empty.
        last_used: Frame in which a pixel last read each tile.
        benefit: Pixels that each tile was made for.
        frame: Frames looked at.
        num_pinned: Leading slots that never change: the coarsest level, which always answers.
    """

    keys: Int[Array, "slots 3"]
    last_used: Int[Array, "slots"]
    benefit: Int[Array, "slots"]
    frame: Int[Array, ""]
    num_pinned: int = eqx.field(static=True)

    @classmethod
    def create(cls, num_slots: int, base_level: int) -> "TileStore":
        """A store that holds the tiles of the coarsest level alone.

        Args:
            num_slots: Tiles that fit.
            base_level: The coarsest level, which has 4^level tiles.

        Raises:
            ValueError: If these do not fit.
        """
        base = tiles_of_level(base_level)
        require(
            len(base) <= num_slots,
            f"the budget holds {num_slots} tiles, but level {base_level} alone has {len(base)}: raise budget_bytes, or "
            "lower base_level or tile_size",
        )
        keys = np.zeros((num_slots, 3), np.int32)
        keys[:, 0] = EMPTY
        keys[: len(base)] = base
        none = jnp.zeros(num_slots, jnp.int32)
        return cls(jnp.asarray(keys), none, none, jnp.zeros((), jnp.int32), len(base))

    @property
    def num_resident(self) -> int:
        """Tiles that are held."""
        return int(np.sum(np.asarray(self.keys)[:, 0] >= 0))

    def used(self, slots: Int[np.ndarray, "pixels"]) -> "TileStore":
        """The store after another frame, whose pixels read these slots; no tile is worth more than its pixels."""
        frame = int(self.frame) + 1
        readers = np.bincount(slots, minlength=len(self.keys))
        last_used = np.where(readers > 0, frame, self.last_used).astype(np.int32)
        worth = np.where(readers > 0, np.minimum(self.benefit, readers), self.benefit).astype(np.int32)
        changed = jnp.asarray(last_used), jnp.asarray(worth), jnp.asarray(frame, jnp.int32)
        return eqx.tree_at(lambda s: (s.last_used, s.benefit, s.frame), self, changed)

    def place(self, keys: Int[np.ndarray, "tiles 3"], benefit: Int[np.ndarray, "tiles"]) -> Placed:
        """Find slots for new tiles, the most wanted first.

        An empty slot is taken first, then the one that has been unused for longest. Once every slot was used in this
        frame, a tile leaves only for one of greater benefit, the one of least benefit first.

        Args:
            keys: Tiles that are not held, in the order of their claim.
            benefit: Pixels that each is made for.

        Source: asm, removal of nodes.
        """
        held, last_used, worth = np.array(self.keys), np.array(self.last_used), np.array(self.benefit)
        frame = int(self.frame)
        empty, idle = held[:, 0] == EMPTY, last_used < frame
        # Empty slots first, then by last use, then by worth; all slots used in this frame tie on last use.
        order = np.lexsort((worth, np.where(idle, last_used, frame), ~empty))
        order = order[order >= self.num_pinned]
        slots, kept, evicted, next_ = [], [], 0, 0
        for index in range(len(keys)):
            if next_ == len(order):
                break
            slot = order[next_]
            if not (empty[slot] or idle[slot] or worth[slot] < benefit[index]):
                continue  # a later tile may be worth more: claims are by benefit for cost
            slots.append(slot)
            kept.append(index)
            evicted += int(not empty[slot])
            next_ += 1
        taken, chosen = np.asarray(slots, np.int32), np.asarray(kept, np.int32)
        held[taken], worth[taken], last_used[taken] = keys[chosen], benefit[chosen], frame
        arrays = jnp.asarray(held), jnp.asarray(last_used), jnp.asarray(worth)
        store = eqx.tree_at(lambda s: (s.keys, s.last_used, s.benefit), self, arrays)
        return Placed(store, keys[chosen], taken, evicted, len(keys) - len(chosen))


@checked
def slots_in(budget_bytes: int, texels: int, texel_bytes: int) -> int:
    """Tiles that a budget holds together with their page table.

    Args:
        budget_bytes: Bytes for all of it.
        texels: Of a tile.
        texel_bytes: Of a texel.
    """
    return max(0, (budget_bytes - INTERVAL_BYTES) // (texels * texel_bytes + TILE_BYTES))


__all__ = ["EMPTY", "Placed", "TileStore", "slots_in"]
