"""The exact shadow test of many points at one light: an irregular depth buffer, points in cells, triangles drawn."""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax.numpy as jnp
from jax import lax

from shadowjax._numerics import map_in_chunks
from shadowjax._types import Array, Bool, Float, Points, UInt
from shadowjax.geometry.mesh import Mesh
from shadowjax.rays._grid_general import LEAST_KEY
from shadowjax.rays._grid_project import coordinates, place, view
from shadowjax.rays._grid_tiles import (
    CHUNK,
    HALF,
    Index,
    classify,
    cover,
    general_cover,
    in_groups,
    less,
    more,
    number,
    put,
)
from shadowjax.rays.caster import surface_gap
from shadowjax.rays.light_space import LEAST_FORWARD, DirectionalSpace, LightSpace, PerspectiveSpace
from shadowjax.rays.plane_map import Box
from shadowjax.rays.ray_grid import RayGrid

# Points that are tested together, and the points that a cell holds on average.
LANES, FILL = 16, 4
# Points that are sorted together, at least, and for each triangle: every chunk walks through all triangles. Many points
# at once need so much memory that the system hands it out, and clears it, in every call.
POINTS, POINTS_PER_TRIANGLE = 1 << 19, 4
# The most cells along a side.
MOST_CELLS = 1024
# Cells of a row over which a triangle is compared with all points at once.
SPAN = 4
# What a line of points holds: plane positions and limits.
U, V, LIMIT, PARTS = 0, LANES, 2 * LANES, 3 * LANES


class Asked(NamedTuple):
    """Points as rays of the light.

    Attributes:
        u, v: Place of each ray on the light's plane.
        limit: The key at which it ends.
        counts: Points that a triangle may block; the others face away or lie behind the light.
        facing: Points that face the light.
    """

    u: Float[Array, "points"]
    v: Float[Array, "points"]
    limit: Float[Array, "points"]
    counts: Bool[Array, "points"]
    facing: Bool[Array, "points"]


class Sorted(NamedTuple):
    """Points in the order of their cells, row after row, in lines of `LANES` that know no cells.

    Attributes:
        begin: The first point of each cell; one more number ends the last.
        most: The greatest limit of the points in each cell.
        lines: Numbers of the points, one line after the other: `LANES` u, `LANES` v, `LANES` limits.
        place: Where the limit of each point is in `lines`.
    """

    begin: UInt[Array, "cells_and_1"]
    most: Float[Array, "cells"]
    lines: Float[Array, "numbers"]
    place: UInt[Array, "points"]


def lit(
    mesh: Mesh, space: LightSpace, points: Points, normals: Points | None, far: Float[Array, ""]
) -> Bool[Array, "*points"]:
    """Whether each point faces the light and no triangle meets its ray before it.

    All rays belong to one light, so the points are sorted into the cells of a grid on its plane, and every triangle is
    tested against the points of the cells that its box touches. Time grows with points, and with the pairs of triangles
    and lines of points that share a cell; nothing can overflow.

    Args:
        mesh: Everything that casts shadows.
        space: Rays of one light, which map straight lines to straight lines.
        points: Where light may arrive.
        normals: Their unit normals; None for points that face the light.
        far: A depth beyond the scene.

    Source: alias-free shadow maps and the irregular z-buffer, as cited by mdsm.
    """
    shape = points.shape[:-1]
    gap = surface_gap(mesh)

    def search(points: Array, normals: Array | None = None) -> Array:
        asked = _project(space, points, normals, gap)
        return asked.facing & ~_blocked(mesh, space, asked, far)

    given = (points,) if normals is None else (points, normals)
    given = tuple(x.reshape(-1, 3) for x in given)
    size = max(POINTS, POINTS_PER_TRIANGLE * mesh.num_faces)
    return map_in_chunks(lambda x: search(*x), given, size).reshape(shape)


def _project(space: LightSpace, points: Float[Array, "points 3"], normals: Array | None, gap: Array) -> Asked:
    """The rays of points: `shadow_limits`, without an array of three numbers a point on the way."""
    parts = [points[:, axis] for axis in range(3)]
    if isinstance(space, DirectionalSpace):
        to_source = [jnp.broadcast_to(number, parts[0].shape) for number in space.frame[1]]
    else:
        assert isinstance(space, PerspectiveSpace)
        towards = [space.position[axis] - part for axis, part in enumerate(parts)]
        away = jnp.sqrt(towards[0] * towards[0] + towards[1] * towards[1] + towards[2] * towards[2])
        to_source = [part / jnp.where(away > 0, away, jnp.ones_like(away)) for part in towards]
    side = to_source if normals is None else [normals[:, axis] for axis in range(3)]
    facing = to_source[0] * side[0] + to_source[1] * side[1] + to_source[2] * side[2] > 0
    x, y, w = coordinates(space, [part + gap * raised for part, raised in zip(parts, side, strict=True)])
    if isinstance(space, DirectionalSpace):
        u, v, limit = x, y, w - gap
        counts = facing & (limit > 0)
    else:
        length = jnp.sqrt(x * x + y * y + w * w)
        reached = w > LEAST_FORWARD * length
        safe = jnp.where(reached, w, jnp.ones_like(w))
        u, v, limit = x / safe, y / safe, length - gap
        counts = facing & reached & (limit > 0)
        limit = -jnp.sqrt(1 + u * u + v * v) / jnp.where(counts, limit, jnp.ones_like(limit))
    # One copy in memory: otherwise every loop that reads them computes the projection again.
    return lax.optimization_barrier(Asked(u, v, limit, counts, facing))


def _blocked(mesh: Mesh, space: LightSpace, asked: Asked, far: Float[Array, ""]) -> Bool[Array, "points"]:
    """Whether a triangle meets the ray of each point at its limit or before; never for points that do not count."""
    dtype = asked.limit.dtype
    num_cells = max(asked.limit.size // FILL, 1)
    side = min(MOST_CELLS, 1 << ((num_cells.bit_length() - 1) // 2))
    box = _bounding_box(asked)
    grid = RayGrid(space, box, far, side, side)
    # A triangle may touch a cell without reaching its centre.
    table = view(grid)
    table = table._replace(margin=table.margin + 0.5)
    vertices = place(grid, table, mesh.vertices)
    corners = lax.bitcast_convert_type(mesh.faces.astype(jnp.int32), jnp.uint32)
    scale = side / (box.upper - box.lower)
    col, row = (
        jnp.clip(jnp.floor((part - box.lower[axis]) * scale[axis]), 0, side - 1).astype(jnp.uint32)
        for axis, part in enumerate((asked.u, asked.v))
    )
    # Points that do not count have a cell of their own beyond the last.
    cell = jnp.where(asked.counts, row * jnp.uint32(side) + col, jnp.uint32(side * side))
    begin, most, lines, places = _sorted(cell, (asked.u, asked.v, asked.limit), side * side)
    reach = _widened(most.reshape(side, side))
    num_faces = mesh.num_faces
    size = min(CHUNK, num_faces)

    def chunk(k: Index, state: tuple) -> tuple:
        lines, *room = state
        first = k * size
        count = less(num_faces - first, jnp.uint32(size))
        work, present, rest, num_rest = classify(vertices.bounds, corners, (1, 1), first, count, *room)

        def test(w: Index, u: Array, v: Array) -> tuple[Array, Array]:
            return cover(vertices.plane, corners, number(work, 0, w), u, v)

        def least(w: Index) -> Array:
            keys = [number(vertices.plane, 2, number(corners, number(work, 0, w), k)) for k in range(3)]
            return less(less(keys[0], keys[1]), keys[2])

        lines = _walk(begin, reach, test, least, work, present, lines)

        def draw_general(work: Array, numbers: Array, present: Index, lines: Array) -> Array:
            def test(w: Index, u: Array, v: Array) -> tuple[Array, Array]:
                return general_cover(numbers, w, u, v)

            return _walk(begin, reach, test, lambda w: number(numbers, LEAST_KEY, w), work, present, lines)

        lines = in_groups(grid, table, mesh, vertices, corners, (1, 1), rest, num_rest, draw_general, lines)
        return lines, work, rest

    state = lines, jnp.zeros((3, size), jnp.uint32), jnp.zeros(size, jnp.uint32)
    lines, *_ = lax.fori_loop(jnp.uint32(0), jnp.uint32(-(-num_faces // size)), chunk, state)
    return asked.counts & (lines[places] == _done(dtype))


def _done(dtype: Any) -> Array:
    """The limit of a blocked point: below every key."""
    return jnp.asarray(-jnp.finfo(dtype).max, dtype)


def _bounding_box(asked: Asked) -> Box:
    """A box on the plane that holds all points that count, none on its border, with no side of 0."""
    dtype = asked.u.dtype
    most = jnp.asarray(jnp.finfo(dtype).max, dtype)
    some = jnp.any(asked.counts)

    def extreme(part: Array, worst: Array, better: Callable) -> Array:
        # Not `min` and `max`: XLA hands those to a library, which reads masked copies of the points from memory.
        found = lax.reduce(jnp.where(asked.counts, part, worst), worst, better, (0,))
        return jnp.where(some, found, jnp.where(worst > 0, 0.0, 1.0).astype(dtype))

    where = (asked.u, asked.v)
    lowest = jnp.stack([extreme(part, most, less) for part in where])
    highest = jnp.stack([extreme(part, -most, more) for part in where])
    wider = 1e-3 * (highest - lowest) + 1e-6 * (jnp.abs(lowest) + jnp.abs(highest)) + jnp.finfo(dtype).tiny ** 0.25
    return Box(lowest - wider, highest + wider)


def _sorted(cell: UInt[Array, "points"], numbers: tuple[Array, Array, Array], num_cells: int) -> Sorted:
    """Sort points by cell, by counting; those of cell `num_cells`, which is not asked for, come last."""
    num_points = cell.size

    def count(i: Index, tally: Array) -> Array:
        at = number(cell, i)
        return put(tally, number(tally, at) + jnp.uint32(1), at)

    tally = lax.fori_loop(jnp.uint32(0), jnp.uint32(num_points), count, jnp.zeros(num_cells + 1, jnp.uint32))
    ends = jnp.cumsum(tally, dtype=jnp.uint32)
    begin = jnp.concatenate([jnp.zeros(1, jnp.uint32), ends[:-1]])

    def enter(i: Index, state: tuple) -> tuple:
        lines, following, most, places = state
        at = number(cell, i)
        # Read back what was written: that orders the updates, or XLA would copy whole arrays.
        following = put(following, number(following, at) + jnp.uint32(1), at)
        rank = number(following, at) - jnp.uint32(1)
        place = rank // LANES * PARTS + rank % LANES
        for part, offset in zip(numbers, (U, V, LIMIT), strict=True):
            lines = put(lines, number(part, i), place + offset)
        most = put(most, more(number(most, at), number(numbers[2], i)), at)
        return lines, following, most, put(places, place + LIMIT, i)

    # An empty row of cells may look at the line after the last.
    room = jnp.zeros((num_points // LANES + 1) * PARTS, numbers[0].dtype)
    dtype = numbers[0].dtype
    none = jnp.full(num_cells + 1, _done(dtype))
    state = room, begin, none, jnp.zeros(num_points, jnp.uint32)
    lines, _, most, places = lax.fori_loop(jnp.uint32(0), jnp.uint32(num_points), enter, state)
    return Sorted(begin, most[:-1], lines, places)


def _widened(most: Float[Array, "side side"]) -> Float[Array, "side side"]:
    """The greatest of each cell and of the next `SPAN` - 1 to its right."""
    shift = 1
    while shift < min(SPAN, most.shape[1]):
        rest = jnp.pad(most[:, shift:], [(0, 0), (0, shift)], constant_values=_done(most.dtype))
        most, shift = jnp.maximum(most, rest), 2 * shift
    return most


def _walk(
    begin: UInt[Array, "cells_and_1"],
    reach: Float[Array, "side side"],
    test: Callable[[Index, Array, Array], tuple[Array, Array]],
    least: Callable[[Index], Array],
    work: UInt[Array, "3 n"],
    present: Index,
    lines: Float[Array, "numbers"],
) -> Float[Array, "numbers"]:
    """Test listed triangles against the points of the cells of their boxes, in one flat loop over lines.

    The cells of a box's row follow one another, and so do their points. A row whose points all lie before a triangle
    is left at once: most triangles that no light reaches are.

    Args:
        begin: First point of each cell.
        reach: Greatest limit of the points from each cell on, from `_widened`.
        test: Triangle in the list, plane positions → keys, and where it is hit.
        least: Triangle in the list → least key of its corners.
        work: The list: face, first and last row, first and last column.
        present: How many are listed.
        lines: Points.
    """
    side = reach.shape[0]
    done_limit = _done(lines.dtype)

    def read(lines: Array, at: Index) -> Array:
        return lax.dynamic_slice(lines, (at,), (LANES,), allow_negative_indices=False)

    def enter(w: Index, row: Index) -> Index:
        return number(begin, row * side + (number(work, 2, w) >> 16)) // LANES

    def step(state: tuple) -> tuple:
        lines, w, row, k = state
        at = k * PARTS
        old = read(lines, at + LIMIT)
        # A line shows points of other cells too, which is no harm: any test of any pair is true.
        keys, inside = test(w, read(lines, at + U), read(lines, at + V))
        # A blocked point's limit falls below every key. The lesser of two numbers: a masked store would stall.
        fallen = jnp.where(inside & (keys <= old), done_limit, old)
        new = jnp.where(fallen < old, fallen, old)
        lines = lax.dynamic_update_slice(lines, new, (at + LIMIT,), allow_negative_indices=False)
        first, last = number(work, 2, w) >> 16, number(work, 2, w) & HALF
        hidden = (last - first < SPAN) & (least(w) > number(reach, row, first))
        leaves = hidden | ((k + 1) * LANES >= number(begin, row * side + last + 1))
        done = leaves & (row >= (number(work, 1, w) & HALF))
        w = w + done.astype(jnp.uint32)
        row = jnp.where(done, number(work, 1, w) >> 16, row + leaves.astype(jnp.uint32))
        return lines, w, row, jnp.where(leaves, enter(w, row), k + 1)

    row = number(work, 1, 0) >> 16
    state = lines, jnp.uint32(0), row, enter(jnp.uint32(0), row)
    return lax.while_loop(lambda state: state[1] < present, step, state)[0]
