"""The search for a processor: triangles in loops over small tiles of cells, each updated in place."""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import jax.numpy as jnp
from jax import lax

from shadowjax._checks import require
from shadowjax._types import Array, Bool, Float, Int, UInt
from shadowjax.geometry.mesh import Mesh
from shadowjax.rays.grid._general import generalise, key_rounding
from shadowjax.rays.grid._project import FIRST_COL, FIRST_ROW, LAST_COL, LAST_ROW, Vertices, View, general_mark
from shadowjax.rays.grid._store import Buffers, finish, merge, packs, start
from shadowjax.rays.ray_grid import RayGrid

# XLA compiles a loop to one piece of machine code while an iteration touches less than about 1 kB; beyond that it
# dispatches every operation of every iteration, fifty times slower. A tile of 4 × 4 numbers keeps below and lies in one
# line of the cache; for depth alone 4 × 8 do too, and are fewer for triangles of more than a few cells.
ROWS, NARROW, SMALL, WIDE = 4, 1, 4, 8
# Cells for each triangle from which wide tiles are faster.
SPARSE = 4
# Triangles classed together: few enough that their list stays in the cache.
CHUNK = 8192
# Triangles for the general test set up together.
GROUP = 128
HALF = 0xFFFF
# Numbers of a triangle that the test of a cell asks for: one line of the cache in 32 bits.
SET_UP = 16

Index = UInt[Array, ""]


class Tiles(NamedTuple):
    """Plane coordinates of the cells of tiles.

    Attributes:
        u: Of every column of tiles for an affine map, else of every tile.
        v: Of every row of tiles for an affine map, else of every tile.
        num_rows, num_cols: Tiles down and across.
        width: Cells across a tile, a power of 2; `ROWS` cells down.
        floor: Least key of every cell that counts, a line for every tile; None if all count.
    """

    u: Float[Array, "n lanes"]
    v: Float[Array, "m lanes"]
    num_rows: int
    num_cols: int
    width: int
    floor: Float[Array, "n lanes"] | None = None

    def at(self, row: Index, col: Index) -> tuple[Index, Array, Array]:
        """Index of a tile, and the coordinates of its cells, one line each."""
        index = row * self.num_cols + col
        affine = self.u.shape[0] != self.num_rows * self.num_cols
        return index, line(self.u, col if affine else index), line(self.v, row if affine else index)

    def counts(self, index: Index, keys: Array, inside: Array) -> Array:
        """Which hits of a tile reach the floor."""
        return inside if self.floor is None else inside & (keys >= line(self.floor, index))


def number(array: Array, *index: Index | int) -> Array:
    """One number of an array, at an index known to be in range."""
    start = [jnp.uint32(i) if isinstance(i, int) else i for i in index]
    return lax.dynamic_slice(array, start, (1,) * array.ndim, allow_negative_indices=False).reshape(())


def line(array: Array, index: Index) -> Array:
    """One row of an array as (1, columns)."""
    return lax.dynamic_slice(array, (index, jnp.uint32(0)), (1, array.shape[1]), allow_negative_indices=False)


def put(array: Array, value: Array, *index: Index | int) -> Array:
    """The array with one number replaced, in place within a loop."""
    start = [jnp.uint32(i) if isinstance(i, int) else i for i in index]
    return lax.dynamic_update_slice(array, value.reshape((1,) * array.ndim), start, allow_negative_indices=False)


def less(a: Array, b: Array) -> Array:
    """The lesser of two numbers that are not NaN: one instruction, where `minimum` takes four to look for NaN."""
    return jnp.where(a < b, a, b)


def more(a: Array, b: Array) -> Array:
    """The greater of two numbers that are not NaN."""
    return jnp.where(a > b, a, b)


def to_tiles(image: Array, width: int) -> Array:
    """An image as lines of tiles, (tiles, cells of a tile); the last cells repeat to fill whole tiles."""
    rows, cols = image.shape
    image = jnp.pad(image, [(0, -rows % ROWS), (0, -cols % width)], mode="edge")
    blocks = image.reshape(image.shape[0] // ROWS, ROWS, image.shape[1] // width, width)
    return blocks.transpose(0, 2, 1, 3).reshape(-1, ROWS * width)


def from_tiles(lines: Array, rows: int, cols: int) -> Array:
    """The image that `to_tiles` took apart."""
    width = lines.shape[1] // ROWS
    down, across = -(-rows // ROWS), -(-cols // width)
    blocks = lines.reshape(down, across, ROWS, width).transpose(0, 2, 1, 3)
    return blocks.reshape(down * ROWS, across * width)[:rows, :cols]


def tiles_of(grid: RayGrid, table: View, width: int, floor: Array | None = None) -> Tiles:
    """Tables of a grid's tiles."""
    down, across = -(-grid.num_rows // ROWS), -(-grid.num_cols // width)
    require(
        max(down, across) <= HALF + 1,
        f"a grid of {grid.num_rows} × {grid.num_cols} cells is too large for one search; cast it in bands of rows, "
        "see `shadowjax.rays.bands`",
    )
    if table.u.ndim == 1:
        u, v = jnp.tile(table.u, (ROWS, 1)), jnp.tile(table.v[:, None], (1, width))
    else:
        u, v = table.u, table.v
    u, v = lax.optimization_barrier((to_tiles(u, width), to_tiles(v, width)))
    # In memory, as u and v are: otherwise every tile would compute it again.
    lines = None if floor is None else lax.optimization_barrier(to_tiles(floor, width))
    return Tiles(u, v, down, across, width, lines)


def tile_width(dtype: Any, with_face: bool, is_sparse: bool) -> int:
    """Cells across a tile, such that an iteration stays below the limit of a loop compiled whole."""
    if with_face and not packs(dtype, with_face):
        return NARROW
    return (WIDE if is_sparse and not with_face else SMALL) * 4 // dtype.itemsize


def search_tiles(
    grid: RayGrid, table: View, mesh: Mesh, vertices: Vertices, with_face: bool, floor: Array | None = None
) -> tuple[Array, Array | None]:
    """Key of the nearest hit of every cell, and its face (−1 for none) if asked for.

    Time grows with triangles and with the tiles of their boxes; no list can overflow. With a floor (rows, cols), only
    keys from there on count.
    """
    num_cells = grid.num_rows * grid.num_cols
    width = tile_width(table.start.dtype, with_face, SPARSE * mesh.num_faces < num_cells)
    tiles = tiles_of(grid, table, width, floor)
    corners = lax.bitcast_convert_type(mesh.faces.astype(jnp.int32), jnp.uint32)
    num_faces = mesh.num_faces
    size = min(CHUNK, num_faces)
    zero = jnp.uint32(0)

    def chunk(k: Index, state: tuple) -> tuple:
        buffers, *lists = state
        first = k * size
        listed = classify(
            vertices.bounds, corners, (ROWS, width), first, less(num_faces - first, jnp.uint32(size)), *lists
        )
        work, count, rest, num_rest = listed
        buffers = _draw(tiles, vertices.plane, corners, work, count, buffers)
        buffers = _draw_general(grid, table, tiles, mesh, vertices, corners, rest, num_rest, buffers)
        return buffers, work, rest

    state = (
        start(to_tiles(table.start, width), with_face),
        jnp.zeros((3, size), jnp.uint32),
        jnp.zeros(size, jnp.uint32),
    )
    buffers, *_ = lax.fori_loop(zero, jnp.uint32(-(-num_faces // size)), chunk, state)
    keys, found = finish(buffers, with_face, table.start.dtype)
    rows, cols = grid.num_rows, grid.num_cols
    return from_tiles(keys, rows, cols), None if found is None else from_tiles(found, rows, cols)


def classify(
    bounds: Int[Array, "4 vertices"],
    corners: UInt[Array, "faces 3"],
    tile: tuple[int, int],
    first: Index,
    count: Index,
    work: UInt[Array, "3 n"],
    rest: UInt[Array, "n"],
) -> tuple[Array, Index, Array, Index]:
    """List the triangles of a chunk whose box holds a cell's centre, with their tiles; and those for the general test.

    Every triangle is written at the end of both lists; the ends move only past those that belong there.

    Args:
        bounds: Cells that the corners bound.
        corners: Corners of all triangles.
        tile: Rows and columns of a tile, powers of 2.
        first: First triangle of the chunk.
        count: Triangles in it.
        work: Room for the first list.
        rest: Room for the second.

    Returns:
        Rows face, first and last row, first and last column (of tiles, as two halves of a number); how many; and the
        faces for the general test, with their number.
    """
    mark = jnp.asarray(general_mark(bounds.dtype), bounds.dtype)
    zero = jnp.zeros((), bounds.dtype)

    def step(i: Index, state: tuple) -> tuple:
        work, end, rest, num_rest = state
        face = first + i
        ids = [number(corners, face, k) for k in range(3)]
        box = [[number(bounds, side, k) for k in ids] for side in range(4)]
        first_col, first_row = (less(less(*box[side][:2]), box[side][2]) for side in (FIRST_COL, FIRST_ROW))
        last_col, last_row = (more(more(*box[side][:2]), box[side][2]) for side in (LAST_COL, LAST_ROW))
        general = first_col == mark
        first_col, first_row = more(first_col, zero), more(first_row, zero)
        listed = ~general & (last_col >= first_col) & (last_row >= first_row)
        other = general & (last_col != mark)
        rows, cols = pair(first_row, last_row, tile[0]), pair(first_col, last_col, tile[1])
        work = put(put(put(work, face, 0, end), rows, 1, end), cols, 2, end)
        rest = put(rest, face, num_rest)
        return work, end + listed.astype(jnp.uint32), rest, num_rest + other.astype(jnp.uint32)

    return lax.fori_loop(jnp.uint32(0), count, step, (work, jnp.uint32(0), rest, jnp.uint32(0)))


def pair(first: Array, last: Array, side: int) -> Array:
    """First and last tile of a range of cells, as two halves of one number."""
    shift = side.bit_length() - 1
    return ((first.astype(jnp.uint32) >> shift) << 16) | (last.astype(jnp.uint32) >> shift)


def _draw(
    tiles: Tiles,
    plane: Float[Array, "3 vertices"],
    corners: UInt[Array, "faces 3"],
    work: UInt[Array, "3 n"],
    count: Index,
    buffers: Buffers,
) -> Buffers:
    """Draw listed triangles tile by tile, in one flat loop: a loop within a loop would be dispatched."""

    def step(state: tuple) -> tuple:
        buffers, w, row, col = state
        face = number(work, 0, w)
        index, u, v = tiles.at(row, col)
        keys, inside = cover(plane, corners, face, u, v)
        buffers = merge(buffers, index, keys, tiles.counts(index, keys, inside), face)
        return buffers, *_following(work, w, row, col)

    begin = number(work, 1, 0) >> 16, number(work, 2, 0) >> 16
    return lax.while_loop(lambda state: state[1] < count, step, (buffers, jnp.uint32(0), *begin))[0]


def _following(work: UInt[Array, "3 n"], w: Index, row: Index, col: Index) -> tuple[Index, Index, Index]:
    """The tile after this one in the box of a listed triangle, or the first of the next triangle."""
    rows, cols = number(work, 1, w), number(work, 2, w)
    ends = col >= (cols & HALF)
    done = ends & (row >= (rows & HALF))
    w = w + done.astype(jnp.uint32)
    row = jnp.where(done, number(work, 1, w) >> 16, row + ends.astype(jnp.uint32))
    col = jnp.where(done, number(work, 2, w) >> 16, jnp.where(ends, cols >> 16, col + 1))
    return w, row, col


def turns(x: Sequence[Array], y: Sequence[Array]) -> Bool[Array, "..."]:
    """Whether corners relative to the ray turn one way all round it: the edge rule, see `ray.edge_test`.

    Both ways hold where every edge ties: the triangle is seen edge-on or has no area, which counts as a miss. One that
    is edge-on to a rounding may tie along the whole line of its edges: callers add that the ray `spans` its corners.
    """
    one, two = [x[i] * y[i - 2] for i in range(3)], [y[i] * x[i - 2] for i in range(3)]
    right = (one[0] >= two[0]) & (one[1] >= two[1]) & (one[2] >= two[2])
    left = (one[0] <= two[0]) & (one[1] <= two[1]) & (one[2] <= two[2])
    return right ^ left


def spans(x: list[Array], y: list[Array]) -> Bool[Array, "..."]:
    """Whether the ray lies in the bounding rectangle of corners relative to it."""
    within = [(less(less(*p[:2]), p[2]) <= 0) & (more(more(*p[:2]), p[2]) >= 0) for p in (x, y)]
    return within[0] & within[1]


def cover(
    plane: Float[Array, "3 vertices"], corners: UInt[Array, "faces 3"], face: Index, u: Array, v: Array
) -> tuple[Array, Array]:
    """Keys of a triangle over the cells of a tile, never beyond those of its corners, and where it is hit."""
    return cover_test(set_up(plane, corners, face), u, v)


def set_up(plane: Float[Array, "3 vertices"], corners: UInt[Array, "faces 3"], face: Index) -> list[Array]:
    """The `SET_UP` numbers of a triangle that `cover_test` asks for.

    u and v of its corners, their bounds (u, then v), the corner of greatest key (u, v, key), the key's slopes, the
    least key.
    """
    ids = [number(corners, face, k) for k in range(3)]
    x, y, key = ([number(plane, axis, k) for k in ids] for axis in range(3))
    determinant = (x[1] - x[0]) * (y[2] - y[0]) - (x[2] - x[0]) * (y[1] - y[0])
    inverse = 1 / jnp.where(determinant == 0, jnp.ones_like(determinant), determinant)
    first, second = key[1] - key[0], key[2] - key[0]
    along_u = (first * (y[2] - y[0]) - second * (y[1] - y[0])) * inverse
    along_v = (second * (x[1] - x[0]) - first * (x[2] - x[0])) * inverse
    # From the corner of greatest key: seen from a point, a corner close to it has a key so large that what is added to
    # it later would lose its digits.
    base_x, base_y, base = x[0], y[0], key[0]
    for k in (1, 2):
        farther = key[k] > base
        base_x, base_y, base = (jnp.where(farther, a, b) for a, b in ((x[k], base_x), (y[k], base_y), (key[k], base)))
    bounds = [better(better(*part[:2]), part[2]) for part in (x, y) for better in (less, more)]
    return [*x, *y, *bounds, base_x, base_y, base, along_u, along_v, less(less(key[0], key[1]), key[2])]


def held_back(numbers: Sequence[Array], parallel: bool) -> list[Array]:
    """As `set_up`, with keys farther by what rounding leaves unknown of them: see `generalise`."""
    least_u, most_u, least_v, most_v, base_x, base_y, base, along_u, along_v, low = numbers[6:]
    reach = jnp.abs(least_u) + jnp.abs(most_u) + jnp.abs(least_v) + jnp.abs(most_v)
    doubt = key_rounding(parallel, reach, low, base, along_u, along_v, base - low)
    return [*numbers[:10], base_x, base_y, base + doubt, along_u, along_v, low + doubt]


def cover_test(numbers: Sequence[Array], u: Array, v: Array) -> tuple[Array, Array]:
    """As `cover`, from the numbers of `set_up`."""
    x, y = numbers[:3], numbers[3:6]
    least_u, most_u, least_v, most_v, base_x, base_y, base, along_u, along_v, low = numbers[6:]
    keys = base - along_u * (base_x - u) - along_v * (base_y - v)
    # `spans`, by the corners' own bounds: four comparisons a cell.
    within = (u >= least_u) & (u <= most_u) & (v >= least_v) & (v <= most_v)
    return less(more(keys, low), base), turns([corner - u for corner in x], [corner - v for corner in y]) & within


def _draw_general(
    grid: RayGrid,
    table: View,
    tiles: Tiles,
    mesh: Mesh,
    vertices: Vertices,
    corners: UInt[Array, "faces 3"],
    rest: UInt[Array, "n"],
    count: Index,
    buffers: Buffers,
) -> Buffers:
    """Draw the triangles that need the general test, set up in groups: usually none."""

    def draw(work: Array, numbers: Array, present: Index, buffers: Buffers) -> Buffers:
        def step(state: tuple) -> tuple:
            buffers, w, row, col = state
            index, u, v = tiles.at(row, col)
            keys, inside = general_cover(numbers, w, u, v)
            buffers = merge(buffers, index, keys, tiles.counts(index, keys, inside), number(work, 0, w))
            return buffers, *_following(work, w, row, col)

        state = buffers, jnp.uint32(0), number(work, 1, 0) >> 16, number(work, 2, 0) >> 16
        return lax.while_loop(lambda state: state[1] < present, step, state)[0]

    return in_groups(grid, table, mesh, vertices, corners, (ROWS, tiles.width), rest, count, draw, buffers)


def in_groups(
    grid: RayGrid,
    table: View,
    mesh: Mesh,
    vertices: Vertices,
    corners: UInt[Array, "faces 3"],
    tile: tuple[int, int],
    rest: UInt[Array, "n"],
    count: Index,
    draw: Callable,
    buffers: Any,
    held_back: bool = False,
) -> Any:
    """Set listed triangles up for the general test, a group at a time, and draw each group.

    Args:
        grid, table, mesh, vertices, corners: The view and what is in it.
        tile: Rows and columns of a tile.
        rest: Faces for the general test, of which `count` count.
        count: How many.
        draw: Work (rows face, rows and columns of tiles), numbers, how many of them, buffers → buffers.
        buffers: What is drawn into.
        held_back: As in `generalise`.
    """
    size = min(GROUP, rest.shape[0])

    def group(g: Index, buffers: Any) -> Any:
        # The last group starts early rather than reading past the end; drawing a triangle twice changes nothing.
        first = less(g * size, jnp.uint32(rest.shape[0] - size))
        faces = lax.dynamic_slice(rest, (first,), (size,), allow_negative_indices=False)
        made = generalise(grid, table, mesh.vertices, vertices, corners[faces], held_back)
        first_row, last_row, first_col, last_col = made.cells
        holds = (first_row <= last_row) & (first_col <= last_col) & (jnp.arange(size, dtype=jnp.uint32) < count - first)
        # Those without a cell go to the end of the list.
        order = jnp.argsort(~holds, stable=True)
        work = jnp.stack([faces, pair(first_row, last_row, tile[0]), pair(first_col, last_col, tile[1])])[:, order]
        numbers, work = lax.optimization_barrier((made.numbers[:, order], work))
        return draw(work, numbers, jnp.sum(holds, dtype=jnp.uint32), buffers)

    return lax.fori_loop(jnp.uint32(0), (count + (size - 1)) // size, group, buffers)


def general_cover(numbers: Float[Array, "14 n"], index: Index, u: Array, v: Array) -> tuple[Array, Array]:
    """As `cover`, for a triangle with corners that may lie behind the light; numbers as in `General`."""
    return general_test([number(numbers, k, index) for k in range(numbers.shape[0])], u, v)


def general_test(numbers: Sequence[Array], u: Array, v: Array) -> tuple[Array, Array]:
    """Keys over cells and where they are hit, from the fourteen numbers of `General`, one triangle or many."""
    x0, y0, x1, y1, x2, y2, w1, w2, key, along_u, along_v, low, high, floor = numbers
    x, y = [x0 - u, x1 - u * w1, x2 - u * w2], [y0 - v, y1 - v * w1, y2 - v * w2]
    keys = (key - along_u * x[0]) - along_v * y[0]
    return less(more(keys, low), high), turns(x, y) & spans(x, y) & (keys >= floor)
