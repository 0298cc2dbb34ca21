"""Tiles of a quadtree over a light's unit square: keys, places on the Z-order curve, and the rays of each."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from shadowjax._checked import checked
from shadowjax._types import Array, Float, Int
from shadowjax.geometry.mesh import Mesh
from shadowjax.rays.caster import Caster
from shadowjax.rays.plane_map import Box
from shadowjax.rays.ray_grid import RayGrid

# Finest level a tile can have: two coordinates of 15 bits make one number of 30.
MAX_LEVEL = 15
SIDE = 1 << MAX_LEVEL
# One more than the last place on the curve.
END = 1 << (2 * MAX_LEVEL)

_STEPS = ((8, 0x00FF00FF), (4, 0x0F0F0F0F), (2, 0x33333333), (1, 0x55555555))


@checked
def interleaved(x: Any, y: Any) -> Any:
    """Z-order number of integer coordinates in [0, 2¹⁵): the bits of y and x in turn, those of x last.

    Args:
        x: int32 array of NumPy or JAX.
        y: The same.
    """
    # Each step moves half of the remaining bits apart, until a zero lies between any two.
    for shift, mask in _STEPS:
        x, y = (x | (x << shift)) & mask, (y | (y << shift)) & mask
    return x | (y << 1)


@checked
def deinterleaved(place: Any) -> tuple[Any, Any]:
    """The coordinates of a Z-order number."""
    # Even bits are x, odd ones y; each step closes half of the gaps, `interleaved` backwards.
    x, y = place & 0x55555555, (place >> 1) & 0x55555555
    for shift, mask in ((1, 0x33333333), (2, 0x0F0F0F0F), (4, 0x00FF00FF), (8, 0x0000FFFF)):
        x, y = (x | (x >> shift)) & mask, (y | (y >> shift)) & mask
    return x, y


@checked
def place_of(square: Float[Array, "*points 2"]) -> Int[Array, "*points"]:
    """Place on the curve of positions in the unit square, at the finest level; those outside take the nearest cell."""
    cell = jnp.clip(jnp.floor(jnp.clip(square, 0, 1) * SIDE).astype(jnp.int32), 0, SIDE - 1)
    return interleaved(cell[..., 0], cell[..., 1])


@checked
def span_of(keys: Int[np.ndarray, "tiles 3"]) -> tuple[Int[np.ndarray, "tiles"], Int[np.ndarray, "tiles"]]:
    """First place of each tile on the curve and the one after its last: a tile is an interval, and intervals nest.

    Args:
        keys: Level, x and y of each tile: column and row among the 2^level of its level.
    """
    # Every finer level adds two bits to a place.
    shift = 2 * (MAX_LEVEL - keys[:, 0])
    start = interleaved(keys[:, 1], keys[:, 2]) << shift
    return start, start + (1 << shift)


@checked
def tiles_of_level(level: int) -> Int[np.ndarray, "tiles 3"]:
    """Keys of all 4^level tiles of a level, along the curve."""
    x, y = deinterleaved(np.arange(4**level, dtype=np.int32))
    return np.stack([np.full_like(x, level), x, y], axis=-1)


@checked
def tile_grid(grid: RayGrid, key: Int[Array, "3"]) -> RayGrid:
    """The rays of one tile: as many as the whole grid has, over the tile's part of it.

    Args:
        grid: The map of level 0. Its plane map must keep the sides of the square straight and evenly divided, as
            uniform maps do.
        key: Level, x and y.
    """
    # A tile of level l is 2⁻ˡ of the square; its corners through the plane map are its box.
    size = 1 / (jnp.ones((), jnp.int32) << key[0]).astype(grid.far.dtype)
    lower = key[1:].astype(grid.far.dtype) * size
    box = Box(grid.plane_map.inverse(lower), grid.plane_map.inverse(lower + size))
    return eqx.tree_at(lambda g: g.plane_map, grid, box)


@checked
@eqx.filter_jit
def cast_tiles(
    caster: Caster, mesh: Mesh, grid: RayGrid, keys: Int[Array, "tiles 3"]
) -> tuple[Float[Array, "tiles rows cols"], Int[Array, "tiles rows cols"]]:
    """Depth and face of every texel of some tiles, one tile after the other; differentiable at fixed keys.

    Args:
        caster: Casts each tile; the size of a tile is that of `grid`, so one compiled function serves every level.
        mesh: Everything that casts shadows.
        grid: The map of level 0.
        keys: Level, x and y of each tile.
    """

    def cast(key: Int[Array, "3"]) -> tuple[Array, Array]:
        hit = caster.closest_on_grid(mesh, tile_grid(grid, key))
        return hit.depth, hit.face

    return jax.lax.map(cast, keys)


__all__ = [
    "END", "MAX_LEVEL", "SIDE", "cast_tiles", "deinterleaved", "interleaved", "place_of", "span_of", "tile_grid",
    "tiles_of_level",
]  # fmt: skip
