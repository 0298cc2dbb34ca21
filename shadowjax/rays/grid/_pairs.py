"""The search for an accelerator: pairs of triangle and tile in windows of one size, and a scatter of the least."""

import jax.numpy as jnp
from jax import lax

from shadowjax._types import Array, Bool, Float, Int
from shadowjax.geometry.mesh import Mesh
from shadowjax.rays.grid._general import General, generalise
from shadowjax.rays.grid._project import Vertices, View, miss_key
from shadowjax.rays.grid._store import Buffers, finish, start, words
from shadowjax.rays.grid._tiles import ROWS, SMALL, from_tiles, general_test, tiles_of, to_tiles
from shadowjax.rays.ray_grid import RayGrid

# Triangles set up together, and pairs tested together: enough to fill an accelerator, few enough to bound memory.
CHUNK = 1 << 16
WINDOW = 1 << 17


def search_pairs(
    grid: RayGrid, table: View, mesh: Mesh, vertices: Vertices, with_face: bool, floor: Array | None = None
) -> tuple[Array, Array | None]:
    """As `_tiles.search_tiles`, without loops over triangles.

    Every triangle takes the general test. A chunk's pairs are counted, and windows of a fixed number of pairs are
    worked on until all are done, so nothing can overflow. Depth agrees with the other search to a few roundings, ties
    between equal keys go to the lowest face.
    """
    tiles = tiles_of(grid, table, SMALL, floor)
    affine = tiles.u.shape[0] != tiles.num_rows * tiles.num_cols
    num_faces = mesh.num_faces
    chunk, window = min(CHUNK, num_faces), WINDOW

    def add_chunk(k: Array, buffers: Buffers) -> Buffers:
        first, made, holds = set_up_chunk(grid, table, mesh, vertices, k, chunk)
        first_row, last_row, first_col, last_col = made.cells
        top, left = first_row // ROWS, first_col // SMALL
        down = jnp.where(holds, last_row // ROWS - top + 1, 0)
        across = jnp.where(holds, last_col // SMALL - left + 1, 0)
        # Pair number → triangle: the running count of tiles, searched by halves (`owners`).
        ends = jnp.cumsum(down * across, dtype=jnp.int32)

        def add_window(j: Array, buffers: Buffers) -> Buffers:
            pair = j * window + jnp.arange(window, dtype=jnp.int32)
            triangle, within = owners(ends, pair)
            # Tiles of a triangle's box in reading order; past the last pair all go to tile 0 and miss there.
            row = top[triangle] + within // jnp.maximum(across[triangle], 1)
            col = left[triangle] + within % jnp.maximum(across[triangle], 1)
            index = jnp.where(pair < ends[-1], row * tiles.num_cols + col, 0)
            u, v = tiles.u[col if affine else index], tiles.v[row if affine else index]
            keys, inside = general_test(list(made.numbers[:, triangle, None]), u, v)
            inside &= (pair < ends[-1])[:, None]
            if tiles.floor is not None:
                inside &= keys >= tiles.floor[index]
            keys = jnp.where(inside, keys, jnp.asarray(miss_key(keys.dtype), keys.dtype))
            return _scatter(buffers, index, keys, first + triangle)

        return lax.fori_loop(jnp.int32(0), -(-ends[-1] // window), add_window, buffers)

    buffers = start(to_tiles(table.start, SMALL), with_face)
    buffers = lax.fori_loop(jnp.int32(0), jnp.int32(-(-num_faces // chunk)), add_chunk, buffers)
    keys, found = finish(buffers, with_face, table.start.dtype)
    rows, cols = grid.num_rows, grid.num_cols
    return from_tiles(keys, rows, cols), None if found is None else from_tiles(found, rows, cols)


def set_up_chunk(
    grid: RayGrid, table: View, mesh: Mesh, vertices: Vertices, k: Array, size: int, held_back: bool = False
) -> tuple[Int[Array, ""], General, Bool[Array, "n"]]:
    """First triangle of the chunk number `k`, its triangles for the general test, and which have a cell.

    The last chunk starts early: drawing a triangle twice changes nothing. `held_back` as in `generalise`.
    """
    first = jnp.minimum(k * size, mesh.num_faces - size)
    corners = lax.bitcast_convert_type(mesh.faces.astype(jnp.int32), jnp.uint32)
    part = lax.dynamic_slice(corners, (first, jnp.int32(0)), (size, 3))
    made = generalise(grid, table, mesh.vertices, vertices, part, held_back)
    first_row, last_row, first_col, last_col = made.cells
    return first, made, (first_row <= last_row) & (first_col <= last_col)


def owners(ends: Int[Array, "n"], index: Int[Array, "window"]) -> tuple[Int[Array, "window"], Int[Array, "window"]]:
    """Which of several groups, given by where they end, each index falls into, and its place there."""
    owner = jnp.minimum(jnp.searchsorted(ends, index, side="right"), ends.size - 1).astype(jnp.int32)
    return owner, index - jnp.where(owner > 0, ends[owner - 1], 0)


def _scatter(buffers: Buffers, tile: Int[Array, "n"], keys: Float[Array, "n lanes"], face: Int[Array, "n"]) -> Buffers:
    """Keep the nearest of what tiles hold and of their new hits; of equally near ones the lowest face."""
    lanes = keys.shape[1]
    cell = (tile[:, None] * lanes + jnp.arange(lanes, dtype=jnp.int32)).reshape(-1, 1)
    numbers = lax.ScatterDimensionNumbers((), (0,), (0,))

    def least(buffer: Array, values: Array) -> Array:
        flat = lax.scatter_min(buffer.reshape(-1), cell, values.reshape(-1), numbers, mode="promise_in_bounds")
        return flat.reshape(buffer.shape)

    if len(buffers) == 2:
        old, owners = buffers
        new = least(old, keys)
        # Where a nearer key came, the former owner has lost; then the lowest face of those with the least key.
        owners = jnp.where(new < old, jnp.iinfo(jnp.int32).max, owners)
        wins = keys == new.reshape(-1)[cell[:, 0]].reshape(keys.shape)
        return new, least(owners, jnp.where(wins, face[:, None], jnp.iinfo(jnp.int32).max))
    packed = buffers[0].dtype != keys.dtype
    return (least(buffers[0], words(keys, jnp.broadcast_to(face[:, None], keys.shape)) if packed else keys),)
