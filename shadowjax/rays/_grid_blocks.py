"""The search for a processor: triangles in loops over small blocks of cells, updated in place."""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax.numpy as jnp
from jax import lax

from shadowjax._types import Array, Bool, Int
from shadowjax.rays._grid_project import Vertices, View, never, take
from shadowjax.rays._grid_setup import General, Ready, generalise, prepare
from shadowjax.rays.ray_grid import RayGrid

# Triangles set up together: few enough that their numbers stay in the cache.
CHUNK = 8192
# Triangles for the general test set up together.
GROUP = 128
# XLA compiles a loop to plain machine code while an iteration touches less than about 1 kB; beyond that it dispatches
# every iteration, ten times slower. These blocks keep below.
SMALL = 4
TILE = {False: (4, 8), True: (4, 4)}
GENERAL_TILE = {False: (8, 8), True: (4, 4)}
PAD = 8

# Classes of work, rows of the sorted order.
SKIP, TINY, SINGLE, TILED, GENERAL = range(5)


class Loops(NamedTuple):
    """What every loop of one chunk reads.

    Attributes:
        table: The view; its tables of cell centres padded to at least `PAD` rows and columns.
        with_face: Whether the buffer holds faces beside keys: static.
        first: Index of the chunk's first triangle.
    """

    table: View
    with_face: bool
    first: Array


def search_blocks(
    grid: RayGrid, table: View, vertices: Vertices, faces: Int[Array, "faces 3"], with_face: bool
) -> tuple[Array, Array | None]:
    """Key of the nearest hit of every cell, and its face (−1 for none) if asked for.

    Time grows with triangles and with the cells of their boxes. Keys and faces share one buffer: two buffers in one
    loop would be copied in every iteration.
    """
    num_faces = faces.shape[0]
    chunk = min(CHUNK, num_faces)
    num_chunks = -(-num_faces // chunk)
    # Padding triangles have their corners in one place, which the set-up skips.
    corners = jnp.concatenate([faces, jnp.zeros((num_chunks * chunk - num_faces, 3), faces.dtype)]).T
    rows, cols = grid.num_rows, grid.num_cols
    pad_rows, pad_cols = max(0, PAD - rows), max(0, PAD - cols)
    whole = [(0, pad_rows), (0, pad_cols)]
    start = jnp.pad(table.start, whole, mode="edge")
    u = jnp.pad(table.u, whole[1:] if table.u.ndim == 1 else whole, mode="edge")
    v = jnp.pad(table.v, whole[:1] if table.v.ndim == 1 else whole, mode="edge")
    table = table._replace(u=u, v=v)
    buffer = start
    if with_face:
        bits = lax.bitcast_convert_type(start, _bits(start))
        buffer = jnp.stack([bits, jnp.full_like(bits, -1)])

    def step(k: Array, buffer: Array) -> Array:
        part = lax.dynamic_slice(corners, (jnp.int32(0), k * chunk), (3, chunk))
        return _chunk(grid, Loops(table, with_face, k * chunk), vertices, part, buffer)

    buffer = lax.fori_loop(jnp.int32(0), jnp.int32(num_chunks), step, buffer)
    if not with_face:
        return buffer[:rows, :cols], None
    keys = lax.bitcast_convert_type(buffer[0, :rows, :cols], start.dtype)
    return keys, buffer[1, :rows, :cols].astype(jnp.int32)


def _bits(array: Array) -> Any:
    return jnp.int32 if array.dtype.itemsize == 4 else jnp.int64


def _chunk(grid: RayGrid, loops: Loops, vertices: Vertices, faces: Int[Array, "3 n"], buffer: Array) -> Array:
    """Add one chunk of triangles to the buffer."""
    ready = lax.optimization_barrier(prepare(grid, loops.table, vertices, faces))
    size = jnp.maximum(ready.last_row - ready.first_row, ready.last_col - ready.first_col) + 1
    tiny = (size <= 2) & ~ready.general & ~ready.empty
    tiny_keys = _tiny_keys(loops.table, ready, tiny, (buffer.shape[-2], buffer.shape[-1]))
    klass = jnp.where(size <= SMALL, SINGLE, TILED)
    klass = jnp.where(ready.general, GENERAL, klass)
    klass = jnp.where(ready.empty | tiny, SKIP, klass)
    klass = jnp.where(tiny & (jnp.min(tiny_keys[2], axis=0) < never(tiny_keys[2].dtype)), TINY, klass)
    order, counts = _sort(klass.astype(jnp.int32))
    numbers = jnp.stack(
        [n for pair in zip(ready.x, ready.y, strict=True) for n in pair]
        + [ready.key, ready.along_u, ready.along_v, ready.low, ready.high]
    )
    cells = jnp.stack([ready.first_row, ready.last_row, ready.first_col, ready.last_col])
    numbers, cells, tiny_keys = lax.optimization_barrier((numbers, cells, tiny_keys))

    def draw_tiny(t: Array, buffer: Array) -> Array:
        i = order[TINY, t]
        keys = lax.dynamic_slice(tiny_keys[2], (jnp.int32(0), i), (4, 1)).reshape(2, 2)
        return _merge(loops, buffer, tiny_keys[0][i], tiny_keys[1][i], keys, keys < never(keys.dtype), i)

    buffer = lax.fori_loop(jnp.int32(0), counts[TINY], draw_tiny, buffer)

    def draw(i: Array, row: Array, col: Array, shape: tuple[int, int], buffer: Array) -> Array:
        keys, inside = _plain_test(loops.table, _column(numbers, i), row, col, shape)
        return _merge(loops, buffer, row, col, keys, inside, i)

    def draw_single(t: Array, buffer: Array) -> Array:
        i = order[SINGLE, t]
        first_row, _, first_col, _ = _column(cells, i)
        row, col = _within(buffer, first_row, first_col, (SMALL, SMALL))
        return draw(i, row, col, (SMALL, SMALL), buffer)

    buffer = lax.fori_loop(jnp.int32(0), counts[SINGLE], draw_single, buffer)

    def draw_tile(t: Array, row: Array, col: Array, buffer: Array) -> Array:
        return draw(order[TILED, t], row, col, TILE[loops.with_face], buffer)

    buffer = _tiles(buffer, counts[TILED], lambda t: _column(cells, order[TILED, t]), draw_tile, TILE[loops.with_face])
    return _draw_general(grid, loops, vertices, faces, order[GENERAL], counts[GENERAL], buffer)


def _sort(klass: Int[Array, "n"]) -> tuple[Int[Array, "classes n"], list[Array]]:
    """Indices of each class, in order, and how many there are: one pass without branches."""
    klass = lax.optimization_barrier(klass)
    count = klass.shape[0]

    def step(i: Array, state: tuple[Array, ...]) -> tuple[Array, ...]:
        order, *counts = state
        which = klass[i]
        place = counts[0]
        for k in range(1, len(counts)):
            place = jnp.where(which == k, counts[k], place)
        order = lax.dynamic_update_slice(order, i.reshape(1, 1), (which, place))
        return (order, *(c + (which == k).astype(jnp.int32) for k, c in enumerate(counts)))

    zero = jnp.int32(0)
    order = jnp.zeros((GENERAL + 1, count), jnp.int32)
    order, *counts = lax.fori_loop(zero, jnp.int32(count), step, (order, *([zero] * (GENERAL + 1))))
    return order, counts


def _tiny_keys(table: View, ready: Ready, tiny: Bool[Array, "n"], shape: tuple[int, int]) -> tuple[Array, Array, Array]:
    """Row and column of a 2 × 2 block for every triangle, and the four keys in it: `never` where it is not hit."""
    row, col = jnp.minimum(ready.first_row, shape[0] - 2), jnp.minimum(ready.first_col, shape[1] - 2)
    row, col = jnp.where(tiny, row, 0), jnp.where(tiny, col, 0)
    blocks = [(down, across) for down in range(2) for across in range(2)]
    if table.u.ndim == 1:
        us, vs = [take(table.u, col + k) for k in range(2)], [take(table.v, row + k) for k in range(2)]
        centres = [(us[across], vs[down]) for down, across in blocks]
    else:
        flat = [(row + down) * shape[1] + col + across for down, across in blocks]
        centres = [(take(table.u.reshape(-1), index), take(table.v.reshape(-1), index)) for index in flat]
    # Gathers stay apart from the arithmetic: a loop that gathers does not become vector instructions.
    row, col, centres = lax.optimization_barrier((row, col, centres))
    keys = []
    for u, v in centres:
        x, y = [corner - u for corner in ready.x], [corner - v for corner in ready.y]
        right, left = _turns(x, y)
        key = jnp.clip(ready.key - ready.along_u * x[0] - ready.along_v * y[0], ready.low, ready.high)
        keys.append(jnp.where(tiny & (right ^ left), key, never(key.dtype)))
    return row, col, jnp.stack(keys)


def _turns(x: list[Array], y: list[Array]) -> tuple[Array, Array]:
    """Whether the corners turn right, or left, all the way round the ray: the edge rule, see `ray.edge_test`.

    Both hold where every edge ties: the triangle is seen edge-on, which counts as a miss.
    """
    one, two = [x[i] * y[i - 2] for i in range(3)], [y[i] * x[i - 2] for i in range(3)]
    right = (one[0] >= two[0]) & (one[1] >= two[1]) & (one[2] >= two[2])
    left = (one[0] <= two[0]) & (one[1] <= two[1]) & (one[2] <= two[2])
    return right, left


def _column(table: Array, index: Array) -> list[Array]:
    """One number of every row, each read by itself: a whole row or column would make a loop's body too large."""
    return [lax.dynamic_slice(table, (jnp.int32(row), index), (1, 1)).reshape(()) for row in range(table.shape[0])]


def _within(buffer: Array, row: Array, col: Array, shape: tuple[int, int]) -> tuple[Array, Array]:
    """Where a block must start to stay inside the buffer."""
    return jnp.minimum(row, buffer.shape[-2] - shape[0]), jnp.minimum(col, buffer.shape[-1] - shape[1])


def _centres(table: View, row: Array, col: Array, shape: tuple[int, int]) -> tuple[Array, Array]:
    """Plane coordinates of the cells of a block, broadcast against each other."""
    if table.u.ndim == 1:
        u, v = lax.dynamic_slice(table.u, (col,), shape[1:]), lax.dynamic_slice(table.v, (row,), shape[:1])
        return u[None, :], v[:, None]
    return lax.dynamic_slice(table.u, (row, col), shape), lax.dynamic_slice(table.v, (row, col), shape)


def _plain_test(
    table: View, numbers: list[Array], row: Array, col: Array, shape: tuple[int, int]
) -> tuple[Array, Array]:
    """Keys of a triangle over a block and where it is hit; the triangle is counter-clockwise, so one side suffices."""
    x0, y0, x1, y1, x2, y2, key, along_u, along_v, low, high = numbers
    u, v = _centres(table, row, col, shape)
    x, y = [x0 - u, x1 - u, x2 - u], [y0 - v, y1 - v, y2 - v]
    inside = (x[0] * y[1] >= y[0] * x[1]) & (x[1] * y[2] >= y[1] * x[2]) & (x[2] * y[0] >= y[2] * x[0])
    return jnp.clip((key - along_u * x[0]) - along_v * y[0], low, high), inside


def _general_test(
    table: View, numbers: list[Array], row: Array, col: Array, shape: tuple[int, int]
) -> tuple[Array, Array]:
    """The same for a triangle of either orientation with corners that may lie behind the light."""
    x0, y0, x1, y1, x2, y2, w1, w2, key, along_u, along_v, low, high, floor = numbers
    u, v = _centres(table, row, col, shape)
    x, y = [x0 - u, x1 - u * w1, x2 - u * w2], [y0 - v, y1 - v * w1, y2 - v * w2]
    right, left = _turns(x, y)
    keys = (key - along_u * x[0]) - along_v * y[0]
    return jnp.clip(keys, low, high), (right ^ left) & (keys >= floor)


def _merge(loops: Loops, buffer: Array, row: Array, col: Array, keys: Array, inside: Array, i: Array) -> Array:
    """Write the hits of a block that are nearer; of equally near ones the lowest face stays."""
    if not loops.with_face:
        old = lax.dynamic_slice(buffer, (row, col), keys.shape)
        return lax.dynamic_update_slice(buffer, jnp.where(inside & (keys < old), keys, old), (row, col))
    zero = jnp.int32(0)
    old = lax.dynamic_slice(buffer, (zero, row, col), (2, *keys.shape))
    old_keys = lax.bitcast_convert_type(old[0], keys.dtype)
    face = (loops.first + i).astype(buffer.dtype)
    better = inside & ((keys < old_keys) | ((keys == old_keys) & (face < old[1])))
    new = jnp.stack([lax.bitcast_convert_type(keys, buffer.dtype), jnp.broadcast_to(face, keys.shape)])
    return lax.dynamic_update_slice(buffer, jnp.where(better[None], new, old), (zero, row, col))


def _tiles(
    buffer: Array,
    count: Array,
    box: Callable[[Array], list[Array]],
    draw: Callable[[Array, Array, Array, Array], Array],
    shape: tuple[int, int],
) -> Array:
    """Draw triangles tile by tile in one flat loop: a loop within a loop would dispatch.

    Args:
        buffer: The cells.
        count: How many triangles.
        box: First and last row, first and last column of triangle t.
        draw: (t, row, column, buffer) → buffer with one tile drawn.
        shape: Rows and columns of a tile.
    """

    def step(state: tuple[Array, ...]) -> tuple[Array, ...]:
        buffer, t, row, col = state
        _, last_row, first_col, last_col = box(t)
        buffer = draw(t, *_within(buffer, row, col, shape), buffer)
        next_col, next_row = col + shape[1], row + shape[0]
        ends = next_col > last_col
        done = ends & (next_row > last_row)
        t = t + done.astype(jnp.int32)
        following = box(t)
        return (
            buffer,
            t,
            jnp.where(done, following[0], jnp.where(ends, next_row, row)),
            jnp.where(done, following[2], jnp.where(ends, first_col, next_col)),
        )

    first = box(jnp.int32(0))
    return lax.while_loop(lambda state: state[1] < count, step, (buffer, jnp.int32(0), first[0], first[2]))[0]


def _draw_general(
    grid: RayGrid, loops: Loops, vertices: Vertices, faces: Array, order: Array, count: Array, buffer: Array
) -> Array:
    """Draw the triangles that need the general test, set up in groups: usually none."""
    size = min(GROUP, faces.shape[1])

    def draw_group(g: Array, buffer: Array) -> Array:
        # The last group starts early rather than reading past the end; drawing a triangle twice changes nothing.
        start = jnp.minimum(g * size, order.shape[0] - size)
        chosen = lax.dynamic_slice(order, (start,), (size,))
        made: General = generalise(grid, loops.table, vertices, jnp.stack([take(corner, chosen) for corner in faces]))
        made, chosen = lax.optimization_barrier((made, chosen))
        present = jnp.minimum(count - start, size)

        def draw(t: Array, row: Array, col: Array, buffer: Array) -> Array:
            keys, inside = _general_test(loops.table, _column(made.numbers, t), row, col, GENERAL_TILE[loops.with_face])
            return _merge(loops, buffer, row, col, keys, inside, chosen[t])

        return _tiles(buffer, present, lambda t: _column(made.cells, t), draw, GENERAL_TILE[loops.with_face])

    groups = (count + size - 1) // size
    return lax.fori_loop(jnp.int32(0), groups, draw_group, buffer)
