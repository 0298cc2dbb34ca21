"""The exact shadow test of many points at one light: an irregular depth buffer, points in cells, triangles drawn."""

import math
from collections.abc import Callable
from typing import NamedTuple

import jax.numpy as jnp
from jax import lax

from shadowjax._types import Array, Bool, Float, UInt
from shadowjax.geometry.mesh import Mesh
from shadowjax.rays._grid_project import place, view
from shadowjax.rays._grid_tiles import (
    CHUNK,
    SMALL,
    Index,
    classify,
    cover,
    from_tiles,
    general_cover,
    in_groups,
    less,
    line,
    number,
    put,
    to_tiles,
)
from shadowjax.rays.light_space import LightSpace
from shadowjax.rays.plane_map import Box
from shadowjax.rays.ray_grid import RayGrid

# Points tested together, in the order they come: neighbours in an image lie close in the light's plane too.
LANES = 16
# The most cells along a side, over which the points are spread.
MOST_CELLS = 1024


class Lists(NamedTuple):
    """Which groups of points have one in each cell.

    Attributes:
        begin: Where each cell's list begins in `groups`; one more number ends the last.
        groups: Indices of groups, cell after cell.
    """

    begin: UInt[Array, "cells_and_1"]
    groups: UInt[Array, "pairs"]


def blocked(
    mesh: Mesh,
    space: LightSpace,
    u: Float[Array, "groups lanes"],
    v: Float[Array, "groups lanes"],
    limit: Float[Array, "groups lanes"],
    counts: Bool[Array, "groups lanes"],
    far: Float[Array, ""],
) -> Bool[Array, "groups lanes"]:
    """Whether a triangle meets the ray of each point before a limit.

    All rays belong to one light, so the points are put into the cells of a grid on its plane and every triangle is
    tested against the points of the cells that its box touches. Time grows with points, and with the pairs of
    triangles and groups of points that share a cell; lists have room for the worst case.

    Args:
        mesh: Everything that casts shadows.
        space: Rays of one light, which map straight lines to straight lines.
        u, v: Plane position of each point's ray.
        limit: Key at which each ray ends; a triangle at the limit blocks.
        counts: Points to be tested; the others are never blocked.
        far: A depth beyond the scene.

    Source: alias-free shadow maps and the irregular z-buffer, as cited by mdsm.
    """
    num_points = limit.size
    # As many cells as groups of points; more where triangles are smaller than that.
    num_cells = max(num_points // LANES, mesh.num_faces // 4, 1)
    side = min(MOST_CELLS, 1 << ((num_cells.bit_length() - 1) // 2))
    most = jnp.finfo(limit.dtype).max
    some = jnp.any(counts)
    lowest = jnp.stack([jnp.where(some, jnp.min(jnp.where(counts, part, most)), 0.0) for part in (u, v)])
    highest = jnp.stack([jnp.where(some, jnp.max(jnp.where(counts, part, -most)), 1.0) for part in (u, v)])
    # A little wider, so that no point lies on the border and no side is 0.
    wider = 1e-3 * (highest - lowest) + 1e-6 * (jnp.abs(lowest) + jnp.abs(highest)) + jnp.finfo(far.dtype).tiny ** 0.25
    box = Box(lowest - wider, highest + wider)
    grid = RayGrid(space, box, far, side, side)
    # A triangle may touch a cell without reaching its centre.
    table = view(grid)
    table = table._replace(margin=table.margin + 0.5)
    vertices = place(grid, table, mesh.vertices)
    corners = lax.bitcast_convert_type(mesh.faces.astype(jnp.int32), jnp.uint32)
    scale = side / (box.upper - box.lower)
    col, row = (
        jnp.clip(jnp.floor((part - box.lower[axis]) * scale[axis]), 0, side - 1).astype(jnp.uint32)
        for axis, part in enumerate((u, v))
    )
    cell = row * jnp.uint32(side) + col
    lists = _lists(cell, counts, side * side)
    beyond = jnp.asarray(-jnp.finfo(limit.dtype).max, limit.dtype)
    u, v, limit = lax.optimization_barrier((u, v, jnp.where(counts, limit, beyond)))
    num_faces = mesh.num_faces
    size = min(CHUNK, num_faces)

    def draw(test: Callable, work: Array, present: Index, limit: Array) -> Array:
        return _walk(side, lists, u, v, test, work, present, limit)

    def chunk(k: Index, state: tuple) -> tuple:
        limit, *room = state
        first = k * size
        count = less(num_faces - first, jnp.uint32(size))
        work, present, rest, num_rest = classify(vertices.bounds, corners, (1, 1), first, count, *room)

        def test(w: Index, u: Array, v: Array) -> tuple[Array, Array]:
            return cover(vertices.plane, corners, number(work, 0, w), u, v)

        limit = draw(test, work, present, limit)

        def draw_general(work: Array, numbers: Array, present: Index, limit: Array) -> Array:
            return draw(lambda w, u, v: general_cover(numbers, w, u, v), work, present, limit)

        limit = in_groups(grid, table, mesh, vertices, corners, (1, 1), rest, num_rest, draw_general, limit)
        return limit, work, rest

    state = limit, jnp.zeros((3, size), jnp.uint32), jnp.zeros(size, jnp.uint32)
    limit, *_ = lax.fori_loop(jnp.uint32(0), jnp.uint32(-(-num_faces // size)), chunk, state)
    return counts & (limit == beyond)


def to_lines(values: Array, is_image: bool) -> Array:
    """Values of points as lines of `LANES`: blocks of an image, or as they come; the last are repeated to fill up."""
    if is_image:
        return to_tiles(values, SMALL)
    flat = values.reshape(-1)
    return jnp.pad(flat, (0, -flat.size % LANES), mode="edge").reshape(-1, LANES)


def from_lines(lines: Array, shape: tuple[int, ...], is_image: bool) -> Array:
    """The values that `to_lines` took apart."""
    return from_tiles(lines, *shape) if is_image else lines.reshape(-1)[: math.prod(shape)].reshape(shape)


def _lists(cell: UInt[Array, "groups lanes"], counts: Bool[Array, "groups lanes"], num_cells: int) -> Lists:
    """Sort the pairs of group and cell by cell: a group enters the list of each cell that one of its points is in."""
    num_groups = cell.shape[0]
    # A lane speaks for its cell if no earlier lane of the group does. Lanes are rows here, so that groups are vectors.
    lanes, counting = lax.optimization_barrier((cell.T, counts.T))
    bits = jnp.zeros(num_groups, jnp.uint32)
    for k in range(LANES):
        speaks = counting[k]
        for j in range(k):
            speaks &= ~(counting[j] & (lanes[j] == lanes[k]))
        bits |= speaks.astype(jnp.uint32) << k
    bits, flat = lax.optimization_barrier((bits, cell.reshape(1, -1)))
    zero, one = jnp.uint32(0), jnp.uint32(1)

    def following(g: Index, left: UInt[Array, ""]) -> tuple[Index, Array]:
        """Drop the lowest bit; after the last one take the next group."""
        left = left & (left - one)
        done = (left == zero).astype(jnp.uint32)
        g = g + done
        return g, jnp.where(done == one, number(bits, less(g, jnp.uint32(num_groups - 1))), left)

    def where(g: Index, left: UInt[Array, ""]) -> Index:
        """Cell of the lowest bit."""
        lane = lax.population_count((left & (~left + one)) - one)
        return number(flat, 0, less(g * LANES + lane, jnp.uint32(flat.size - 1)))

    def count(state: tuple) -> tuple:
        g, left, tally = state
        at = where(g, left)
        return *following(g, left), put(tally, number(tally, at) + less(left, one), at)

    begin = zero, number(bits, 0)
    tally = jnp.zeros(num_cells, jnp.uint32)
    *_, tally = lax.while_loop(lambda state: state[0] < num_groups, count, (*begin, tally))
    ends = jnp.cumsum(tally, dtype=jnp.uint32)
    starts = jnp.concatenate([jnp.zeros(1, jnp.uint32), ends])

    def enter(state: tuple) -> tuple:
        g, left, next_, groups = state
        at, added = where(g, left), less(left, one)
        # Read back what was written: that orders the two updates, or XLA would copy the whole table.
        next_ = put(next_, number(next_, at) + added, at)
        groups = put(groups, g, number(next_, at) - added)
        return *following(g, left), next_, groups

    room = jnp.zeros(cell.size + 1, jnp.uint32)
    *_, groups = lax.while_loop(lambda state: state[0] < num_groups, enter, (*begin, starts[:-1], room))
    return Lists(starts, groups)


def _walk(
    side: int,
    lists: Lists,
    u: Float[Array, "groups lanes"],
    v: Float[Array, "groups lanes"],
    test: Callable[[Index, Array, Array], tuple[Array, Array]],
    work: UInt[Array, "3 n"],
    present: Index,
    limit: Float[Array, "groups lanes"],
) -> Float[Array, "groups lanes"]:
    """Test listed triangles against the groups of the cells of their boxes, in one flat loop."""
    done_limit = jnp.asarray(-jnp.finfo(limit.dtype).max, limit.dtype)

    def enter(w: Index, row: Index, col: Index) -> Index:
        return number(lists.begin, row * side + col)

    def step(state: tuple) -> tuple:
        limit, w, row, col, k = state
        end = number(lists.begin, row * side + col + 1)
        # An empty cell shows the group of the next one, which is no harm: any test of any pair is true.
        group = number(lists.groups, k)
        old = line(limit, group)
        keys, inside = test(w, line(u, group), line(v, group))
        # A blocked point's limit falls below every key. The lesser of two numbers: a masked store would stall.
        fallen = jnp.where(inside & (keys <= old), done_limit, old)
        limit = lax.dynamic_update_slice(
            limit, jnp.where(fallen < old, fallen, old), (group, jnp.uint32(0)), allow_negative_indices=False
        )
        rows, cols = number(work, 1, w), number(work, 2, w)
        leaves = k + 1 >= end
        ends = leaves & (col >= (cols & 0xFFFF))
        done = ends & (row >= (rows & 0xFFFF))
        w = w + done.astype(jnp.uint32)
        row = jnp.where(done, number(work, 1, w) >> 16, row + ends.astype(jnp.uint32))
        col = jnp.where(done, number(work, 2, w) >> 16, jnp.where(ends, cols >> 16, col + leaves.astype(jnp.uint32)))
        return limit, w, row, col, jnp.where(leaves, enter(w, row, col), k + 1)

    row, col = number(work, 1, 0) >> 16, number(work, 2, 0) >> 16
    state = limit, jnp.uint32(0), row, col, enter(jnp.uint32(0), row, col)
    return lax.while_loop(lambda state: state[1] < present, step, state)[0]
