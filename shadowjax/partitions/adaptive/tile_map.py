"""Adaptive shadow maps: a quadtree of small maps in a fixed memory, read through a page table."""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from shadowjax._checked import Checked, checked
from shadowjax._checks import require, require_int
from shadowjax._numerics import far_away
from shadowjax._types import Array, Bool, Float, Int, UInt
from shadowjax.geometry.mesh import Mesh
from shadowjax.partitions.adaptive.page_table import PageTable
from shadowjax.partitions.adaptive.tile_store import EMPTY, TileStore, slots_in
from shadowjax.partitions.adaptive.tile_tree import MAX_LEVEL, cast_tiles
from shadowjax.rays.caster import Caster
from shadowjax.rays.ray_grid import RayGrid

# Tiles cast together: one compiled function serves every step.
BATCH = 16
# The most texels across at the finest level: float32 places a position among 2²⁴, and texels need a share of that.
MOST_ACROSS = 1 << 20

Polygons = Int[Array, "slots rows cols"] | UInt[Array, "slots rows cols"]


class Texels(NamedTuple):
    """What receivers read.

    Attributes:
        slot: Slot of the tile that answers.
        level: Its level: texels are 2^level times finer than the map of level 0.
        depth: Stored depth; beyond everything outside the map.
        polygon: Polygon that the texel sees, −1 (or the largest number of an unsigned type) for none; None if the map
            keeps none.
        centre: (s, t) of the texel's centre.
    """

    slot: Int[Array, "*points"]
    level: Int[Array, "*points"]
    depth: Float[Array, "*points"]
    polygon: Array | None
    centre: Float[Array, "*points 2"]


class AdaptiveMap(Checked):
    """Tiles of one size from several levels of a quadtree, in slots.

    Attributes:
        grid: The map of level 0, one tile over everything; level l splits it into 4^l tiles.
        depth: Depth of every texel, world units, one tile a slot.
        polygon: Number of the polygon that every texel sees; None if it is not kept.
        table: Finds the finest tile at a position.
        store: Says which tile lies in which slot.
    """

    grid: RayGrid
    depth: Float[Array, "slots rows cols"]
    polygon: Polygons | None
    table: PageTable
    store: TileStore

    @property
    def tile_size(self) -> int:
        """Texels along each side of a tile."""
        return self.depth.shape[-1]

    @property
    def num_bytes(self) -> int:
        """Bytes of all slots and of the page table, used or not."""
        kept = 0 if self.polygon is None else self.polygon.nbytes
        return self.depth.nbytes + kept + self.table.num_bytes

    def cells(self, level: Int[Array, "*points"]) -> Float[Array, "*points"]:
        """2^level."""
        return (jnp.ones_like(level) << level).astype(self.depth.dtype)

    def read(self, square: Float[Array, "*points 2"]) -> Texels:
        """The texel of the finest tile at positions (s, t), found through the page table.

        Args:
            square: Positions in the unit square; those outside read a depth beyond everything.
        """
        slot, level = self.table.find(square)
        across = (self.cells(level) * self.tile_size)[..., None]
        texel = jnp.minimum(jnp.floor(jnp.clip(square, 0, 1) * across), across - 1)
        # Tiles have a power of two of texels: the low bits of a texel's number are its place in its tile.
        index = texel.astype(jnp.int32) & (self.tile_size - 1)
        flat = (slot * self.tile_size + index[..., 1]) * self.tile_size + index[..., 0]
        outside = jnp.any((square < 0) | (square > 1), axis=-1)
        depth = jnp.where(outside, far_away(self.depth.dtype), self.depth.reshape(-1)[flat])
        polygon = None if self.polygon is None else self.polygon.reshape(-1)[flat]
        return Texels(slot, level, depth, polygon, (jax.lax.stop_gradient(texel) + 0.5) / across)

    def with_tiles(
        self,
        caster: Caster,
        mesh: Mesh,
        polygons: Int[Array, "faces"],
        store: TileStore,
        keys: Int[np.ndarray, "tiles 3"],
        slots: Int[np.ndarray, "tiles"],
    ) -> "AdaptiveMap":
        """The map with some slots cast anew.

        Args:
            caster: Casts each tile's rays.
            mesh: Everything that casts shadows.
            polygons: Polygon of each face.
            store: What lies where afterwards.
            keys: Tiles to cast.
            slots: Where each goes.
        """
        depth, polygon = self.depth, self.polygon
        for first in range(0, len(keys), BATCH):
            part, where = keys[first : first + BATCH], slots[first : first + BATCH]
            spare = BATCH - len(part)
            part = np.concatenate([part, np.repeat(part[:1], spare, axis=0)])
            where = np.concatenate([where, np.full(spare, len(store.keys))]).astype(np.int32)  # dropped
            found = cast_tiles(caster, mesh, self.grid, jnp.asarray(part))
            depth, polygon = _stored(depth, polygon, polygons, jnp.asarray(where), *found)
        table = PageTable.of(np.asarray(store.keys))
        return AdaptiveMap(self.grid, depth, polygon, table, store)

    def recast(self, caster: Caster, mesh: Mesh, polygons: Int[Array, "faces"]) -> "AdaptiveMap":
        """Every tile cast anew at a fixed structure, under jit too: for a moved mesh, and for gradients by it."""
        keys = jnp.where(self.store.keys[:, :1] == EMPTY, 0, self.store.keys)
        depth, face = cast_tiles(caster, mesh, self.grid, keys)
        polygon = None if self.polygon is None else _numbered(polygons, face, self.polygon.dtype)
        return AdaptiveMap(self.grid, depth, polygon, self.table, self.store)


def _numbered(polygons: Int[Array, "faces"], face: Int[Array, "*cells"], dtype: jnp.dtype) -> Array:
    """Polygon of each face; the type's own −1 for a miss."""
    number = jnp.where(face >= 0, polygons[jnp.maximum(face, 0)], -1)
    return number.astype(dtype)


@eqx.filter_jit
def _stored(
    depth: Array, polygon: Array | None, polygons: Array, slots: Array, cast_depth: Array, face: Array
) -> tuple[Array, Array | None]:
    kept = None if polygon is None else polygon.at[slots].set(_numbered(polygons, face, polygon.dtype), mode="drop")
    return depth.at[slots].set(cast_depth, mode="drop"), kept


@checked
def empty_map(
    grid: RayGrid,
    budget_bytes: int,
    base_level: int | None,
    num_polygons: int | None,
    finest_level: int = MAX_LEVEL,
) -> AdaptiveMap:
    """Slots for as many tiles as a budget holds, page table included; nothing is cast yet.

    Args:
        grid: The map of level 0; its side is the size of a tile, a power of two.
        budget_bytes: Bytes for everything that lookups read.
        base_level: The coarsest level, which stays; None takes the finest that fills at most a quarter of the slots.
        num_polygons: How many polygons there are; None keeps no numbers.
        finest_level: No tile is finer, so none of the coarsest level either.

    Raises:
        ValueError: If the budget cannot hold the coarsest level, or a size is out of range.
    """
    size, dtype = grid.num_rows, grid.far.dtype
    require(size & (size - 1) == 0, f"tile_size must be a power of two; got {size}")
    kind = None if num_polygons is None else jnp.uint16 if num_polygons < 0xFFFF else jnp.int32
    texel_bytes = dtype.itemsize + (0 if kind is None else jnp.dtype(kind).itemsize)
    slots = slots_in(require_int(budget_bytes, "budget_bytes", 1), size * size, texel_bytes)
    require(
        slots > 0,
        f"a budget of {budget_bytes} bytes holds no tile of {size} × {size} texels of {texel_bytes} bytes with its "
        "page table: raise budget_bytes or lower tile_size",
    )
    if base_level is None:
        base_level = min(finest_level, max(0, (max(1, slots // 4).bit_length() - 1) // 2))
    store = TileStore.create(slots, require_int(base_level, "base_level", 0))
    depth = jnp.zeros((slots, size, size), dtype)
    polygon = None if kind is None else jnp.zeros((slots, size, size), kind)
    return AdaptiveMap(grid, depth, polygon, PageTable.of(np.asarray(store.keys)), store)


@checked
def straddles(
    map_: AdaptiveMap,
    square: Float[Array, "*points 2"],
    depth: Float[Array, "*points"],
    gradient: Float[Array, "*points 2"],
) -> Bool[Array, "*points"]:
    """Whether the receiver lies at a discontinuity: of the four texels around it some are before it, some are not.

    The test at the receiver is that of one of the four. If all agree, no edge that the map can show passes between.
    Each texel is held against the receiver's own plane at the texel's centre, so that a slope is no discontinuity; and
    no bias is applied, since that of a coarse texel would hide what stands close to the receiver.

    Args:
        map_: Tiles.
        square: Positions (s, t) of receivers.
        depth: Their depths, less their rounding.
        gradient: Change of the receiver's plane in depth for one texel of level 0 along s and t, world units.
    """
    own = map_.read(square)
    step = 1 / (map_.cells(own.level) * map_.tile_size)[..., None]
    # Towards the nearer neighbour along each axis: these three and the own texel surround the receiver.
    side = jnp.where(square < own.centre, -step, step)

    def blocks(texel: Texels) -> Bool[Array, "*points"]:
        plane = depth + jnp.sum(gradient * (texel.centre - square) * map_.tile_size, axis=-1)
        return plane > texel.depth

    around = [blocks(own)]
    for move in ((1, 0), (0, 1), (1, 1)):
        around.append(blocks(map_.read(square + side * jnp.asarray(move, square.dtype))))
    before = jnp.stack(around)
    return jnp.any(before, axis=0) & ~jnp.all(before, axis=0)


__all__ = [
    "BATCH", "MAX_LEVEL", "MOST_ACROSS", "AdaptiveMap", "Polygons", "Texels", "empty_map", "straddles",
]  # fmt: skip
