"""The exact shadow test of many points at one light: an irregular depth buffer, points in cells, triangles drawn."""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import lax

from shadowjax._numerics import map_in_chunks
from shadowjax._types import Array, Bool, Float, Points, UInt
from shadowjax.geometry.light_space import LightSpace
from shadowjax.geometry.mesh import Mesh
from shadowjax.rays.grid._project import Vertices, place
from shadowjax.rays.grid._shadow_queries import (
    LANES,
    SAMPLES,
    SPAN,
    ShadowQueries,
    blocked_key,
    box_around,
    cell_counts,
    cells_of,
    project,
    touching,
    widened,
)
from shadowjax.rays.grid._tiles import (
    CHUNK,
    HALF,
    SET_UP,
    Index,
    classify,
    cover_test,
    general_cover,
    held_back,
    in_groups,
    less,
    more,
    number,
    put,
    set_up,
)
from shadowjax.rays.grid._visible_pairs import blocked_by_pairs
from shadowjax.rays.plane_map import Box
from shadowjax.rays.ray_grid import RayGrid

# Points that are sorted together, at least, and for each triangle: every part walks through all triangles, but a small
# one lies in the cache.
POINTS, POINTS_PER_TRIANGLE = 1 << 19, 1
# Parts whose points are projected together. More need so much memory that the system hands it out, and clears it, in
# every call.
PARTS = 2
# Points that one iteration of a sort moves: its own cost is that of a point.
AT_ONCE = 4
# Points whose bounds one iteration compares: fewer, and the compiler does not see that they are one operation.
SWEEP = 32


class Sorted(NamedTuple):
    """Points in the order of their cells, row after row, in lines of `LANES` that know no cells.

    Attributes:
        begin: The first point of each cell; one more number ends the last.
        reach: The greatest limit of the points in `SPAN` cells right and down from each.
        u, v, limit: Numbers of the points, and room for a line more.
    """

    begin: UInt[Array, "cells_and_1"]
    reach: Float[Array, "rows cols"]
    u: Float[Array, "room"]
    v: Float[Array, "room"]
    limit: Float[Array, "room"]


def lit(mesh: Mesh, space: LightSpace, points: Points, normals: Points | None) -> Bool[Array, "*points"]:
    """Whether each point faces the light and no triangle meets its ray before it.

    All rays belong to one light, so the points are sorted into the cells of a grid on its plane, and every triangle is
    tested against the points of the cells that its box touches. Time grows with points, and with the pairs of triangles
    and lines of points that share a cell; nothing can overflow.

    Args:
        mesh: Everything that casts shadows.
        space: Rays of one light, which map straight lines to straight lines.
        points: Where light may arrive.
        normals: Their unit normals; None for points that face the light.

    Source: alias-free shadow maps and the irregular z-buffer, as cited by mdsm.
    """
    shape = points.shape[:-1]
    # Amid the points, so that what is near them keeps its digits.
    space = space.counted_from(_amid(points.reshape(-1, 3)))
    size = max(POINTS, POINTS_PER_TRIANGLE * mesh.num_faces)
    # Loops over points and triangles are the fastest way on a processor, and hopeless on an accelerator.
    search = _blocked if jax.default_backend() == "cpu" else blocked_by_pairs

    def chunk(points: Array, normals: Array | None = None) -> Array:
        num_parts = max(-(-points.shape[0] // size), 1)
        asked, facing, nearest = project(space, points, normals, num_parts, SWEEP)
        found = facing & ~search(mesh, space, asked, nearest)
        return found.reshape(-1)[: points.shape[0]]

    given = (points,) if normals is None else (points, normals)
    given = tuple(x.reshape(-1, 3) for x in given)
    return map_in_chunks(lambda x: chunk(*x), given, PARTS * size).reshape(shape)


def _amid(points: Float[Array, "n 3"]) -> Float[Array, "3"]:
    """A place amid points: the median of some along each axis."""
    some = points[:: -(-points.shape[0] // SAMPLES)]
    return jnp.sort(some, axis=0)[some.shape[0] // 2]


def _blocked(mesh: Mesh, space: LightSpace, asked: ShadowQueries, far: Float[Array, ""]) -> Bool[Array, "parts points"]:
    """Whether a triangle meets the ray of each point before its limit; never for points that do not count."""
    num_parts, num_points = asked[2].shape
    shape = cell_counts(num_points)

    def part(p: Index, flags: Array) -> Array:
        box = _bounding_box(asked, p)
        u, v, limit = (lax.dynamic_index_in_dim(x, p, keepdims=False) for x in asked)
        cell = cells_of(box, shape, u, v, limit)
        lines, rank = _sorted(cell, asked, shape, p)
        limit = _drawn(mesh, RayGrid(space, box, far, *shape), lines)
        return _marked(flags, cell, rank, lines.begin, limit, p)

    flags = lax.fori_loop(jnp.uint32(0), jnp.uint32(num_parts), part, jnp.zeros(asked[2].shape, jnp.uint8))
    return flags > 0


def _drawn(mesh: Mesh, grid: RayGrid, lines: Sorted) -> Float[Array, "room"]:
    """The limits of points after all triangles have been drawn; `blocked_key` for a blocked one."""
    dtype = lines.limit.dtype
    table = touching(grid)
    vertices = place(grid, table, mesh.vertices)
    corners = lax.bitcast_convert_type(mesh.faces.astype(jnp.int32), jnp.uint32)
    num_faces = mesh.num_faces
    size = min(CHUNK, num_faces)
    parallel = grid.space.is_parallel

    def chunk(k: Index, state: tuple) -> tuple:
        limit, *lists, room = state
        first = k * size
        count = less(num_faces - first, jnp.uint32(size))
        work, present, rest, num_rest = classify(vertices.bounds, corners, (1, 1), first, count, *lists)
        listed, made, num_listed = _prepared(vertices, corners, parallel, lines.reach, work, present, room)

        def draw(w: Index, u: Array, v: Array) -> tuple[Array, Array]:
            return cover_test([number(made, w, k) for k in range(SET_UP)], u, v)

        limit = _walk(lines, draw, listed, num_listed, limit)

        def draw_general(work: Array, numbers: Array, present: Index, limit: Array) -> Array:
            def test(w: Index, u: Array, v: Array) -> tuple[Array, Array]:
                return general_cover(numbers, w, u, v)

            return _walk(lines, test, work, present, limit)

        limit = in_groups(
            grid, table, mesh, vertices, corners, (1, 1), rest, num_rest, draw_general, limit, held_back=True
        )
        return limit, work, rest, (listed, made)

    empty = jnp.zeros((3, size), jnp.uint32)
    state = lines.limit, empty, jnp.zeros(size, jnp.uint32), (empty, jnp.zeros((size, SET_UP), dtype))
    return lax.fori_loop(jnp.uint32(0), jnp.uint32(-(-num_faces // size)), chunk, state)[0]


def _bounding_box(asked: ShadowQueries, part: Index) -> Box:
    """A box on the plane that holds all points that count, none on its border, with no side of 0."""
    dtype = asked[2].dtype
    worst = jnp.full(SWEEP, jnp.finfo(dtype).max, dtype)
    num_lines = jnp.uint32(asked[2].shape[1] // SWEEP)

    def extreme(numbers: Array, worst: Array, better: Callable) -> Array:
        def step(i: Index, found: Array) -> Array:
            at = part, i * SWEEP
            x, limit = (
                lax.dynamic_slice(y, at, (1, SWEEP), allow_negative_indices=False)[0] for y in (numbers, asked[2])
            )
            return better(found, jnp.where(limit > blocked_key(dtype), x, worst))

        return lax.fori_loop(jnp.uint32(0), num_lines, step, worst)

    # Not `min` and `max` of all points: XLA hands those to a library, which reads masked copies from memory.
    lowest = jnp.min(jnp.stack([extreme(x, worst, less) for x in asked[:2]]), axis=1)
    highest = jnp.max(jnp.stack([extreme(x, -worst, more) for x in asked[:2]]), axis=1)
    return box_around(lowest, highest)


def _sorted(
    cell: UInt[Array, "points"], asked: ShadowQueries, grid: tuple[int, int], part: Index
) -> tuple[Sorted, UInt[Array, "points"]]:
    """Sort the points of a part by cell, by counting, and the rank of each in its cell; uncounted ones come last."""
    num_points, num_cells = cell.size, grid[0] * grid[1]
    dtype = asked[2].dtype
    zero, one = jnp.uint32(0), jnp.uint32(1)

    def count(i: Index, state: tuple) -> tuple:
        tally, most, rank = state
        at = number(cell, i)
        # Read back what was written: that orders the updates, or XLA would copy whole arrays.
        tally = put(tally, number(tally, at) + one, at)
        most = put(most, more(number(most, at), number(asked[2], part, i)), at)
        return tally, most, put(rank, number(tally, at) - one, i)

    none = jnp.full(num_cells + 1, blocked_key(dtype))
    state = jnp.zeros(num_cells + 1, jnp.uint32), none, jnp.zeros(num_points, jnp.uint32)
    tally, most, rank = lax.fori_loop(zero, jnp.uint32(num_points), count, state)

    def add(i: Index, state: tuple) -> tuple:
        begin, total = state
        return put(begin, total, i), total + number(tally, i)

    # `cumsum` is slower on a processor.
    state = jnp.zeros(num_cells + 1, jnp.uint32), zero
    begin, _ = lax.fori_loop(zero, jnp.uint32(num_cells + 1), add, state)

    def enter(i: Index, state: tuple) -> tuple:
        for k in range(AT_ONCE):
            point = i * AT_ONCE + k
            # A counting sort: the cell's beginning plus the point's rank in it.
            at = number(begin, number(cell, point)) + number(rank, point)
            state = tuple(put(to, number(of, part, point), at) for to, of in zip(state, asked, strict=True))
        return state

    # An empty row of cells may look at the line after the last.
    room = jnp.zeros(num_points + LANES, dtype)
    lines = lax.fori_loop(zero, jnp.uint32(num_points // AT_ONCE), enter, (room, room, room))
    return Sorted(begin, widened(most[:-1].reshape(grid)), *lines), rank


def _marked(
    flags: UInt[Array, "parts points"],
    cell: UInt[Array, "points"],
    rank: UInt[Array, "points"],
    begin: UInt[Array, "cells_and_1"],
    limit: Float[Array, "room"],
    part: Index,
) -> UInt[Array, "parts points"]:
    """The flags with 1 for the points of a part that are blocked."""
    blocked_limit, num_cells = blocked_key(limit.dtype), jnp.uint32(begin.size - 1)

    def mark(i: Index, flags: Array) -> Array:
        for k in range(AT_ONCE):
            point = i * AT_ONCE + k
            at = number(begin, number(cell, point)) + number(rank, point)
            blocked = (number(limit, at) == blocked_limit) & (number(cell, point) < num_cells)
            flags = put(flags, blocked.astype(jnp.uint8), part, point)
        return flags

    return lax.fori_loop(jnp.uint32(0), jnp.uint32(cell.size // AT_ONCE), mark, flags)


def _prepared(
    vertices: Vertices,
    corners: UInt[Array, "faces 3"],
    parallel: bool,
    reach: Float[Array, "rows cols"],
    work: UInt[Array, "3 n"],
    present: Index,
    room: tuple[UInt[Array, "3 n"], Float[Array, "n 16"]],
) -> tuple[Array, Array, Index]:
    """Drop listed triangles behind all points that their box holds, and set the others up, for each meets many lines.

    Half of a closed body lies behind the surface that its light reaches.

    Args:
        vertices, corners: All triangles.
        parallel: Whether the rays are.
        reach: Greatest limit of the points in `SPAN` cells right and down from each cell.
        work: The list: face, first and last row, first and last column.
        present: How many are listed.
        room: For the shorter list and what `set_up` says of its triangles.

    Returns:
        The list, the numbers, and how many there are.
    """

    def step(w: Index, state: tuple) -> tuple:
        listed, made, end = state
        face, rows, cols = (number(work, k, w) for k in range(3))
        numbers = held_back(set_up(vertices.plane, corners, face), parallel)
        first_row, first_col = rows >> 16, cols >> 16
        # `reach` speaks for SPAN cells each way: a larger box cannot be dropped by it.
        longest = more((rows & HALF) - first_row, (cols & HALF) - first_col)
        shown = (longest >= SPAN) | (numbers[-1] <= number(reach, first_row, first_col))
        for k, value in enumerate(numbers):
            made = put(made, value, end, k)
        for k, value in enumerate((face, rows, cols)):
            listed = put(listed, value, k, end)
        return listed, made, end + shown.astype(jnp.uint32)

    return lax.fori_loop(jnp.uint32(0), present, step, (*room, jnp.uint32(0)))


def _walk(
    lines: Sorted,
    test: Callable[[Index, Array, Array], tuple[Array, Array]],
    work: UInt[Array, "3 n"],
    present: Index,
    limit: Float[Array, "room"],
) -> Float[Array, "room"]:
    """Test listed triangles against the points of the cells of their boxes, in one flat loop over lines.

    The cells of a box's row follow one another, and so do their points.

    Args:
        lines: Points; their positions are read from here.
        test: Triangle in the list, plane positions → keys, and where it is hit.
        work: The list: face, first and last row, first and last column.
        present: How many are listed.
        limit: Limits of the points.
    """
    begin, cols = lines.begin, lines.reach.shape[1]
    done_limit = blocked_key(limit.dtype)

    def read(array: Array, at: Index) -> Array:
        return lax.dynamic_slice(array, (at,), (LANES,), allow_negative_indices=False)

    def enter(w: Index, row: Index) -> Index:
        return number(begin, row * cols + (number(work, 2, w) >> 16))

    def step(state: tuple) -> tuple:
        limit, w, row, at = state
        old = read(limit, at)
        # A line shows points of other cells too, which is no harm: any test of any pair is true.
        keys, inside = test(w, *(read(part, at) for part in (lines.u, lines.v)))
        # A blocked point's limit falls below every key.
        new = jnp.where(inside & (keys <= old), done_limit, old)
        limit = lax.dynamic_update_slice(limit, new, (at,), allow_negative_indices=False)
        last = number(work, 2, w) & HALF
        # The points of the last cell of this row end before the next line.
        leaves = at + LANES >= number(begin, row * cols + last + 1)
        done = leaves & (row >= (number(work, 1, w) & HALF))
        w = w + done.astype(jnp.uint32)
        row = jnp.where(done, number(work, 1, w) >> 16, row + leaves.astype(jnp.uint32))
        return limit, w, row, jnp.where(leaves, enter(w, row), at + LANES)

    row = number(work, 1, 0) >> 16
    state = limit, jnp.uint32(0), row, enter(jnp.uint32(0), row)
    return lax.while_loop(lambda state: state[1] < present, step, state)[0]
