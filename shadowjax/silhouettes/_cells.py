"""Straight segments over a grid: which cells each crosses, and the exact area of a cell that lies beyond it."""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import lax

from shadowjax._types import Array, Bool, Float, Int

# Distance of a place next to a segment, in roots of the dtype's rounding, cells: far enough to be distinct from it.
BESIDE = 32.0


class Crossings(NamedTuple):
    """Pairs of a segment and a cell that it crosses, in the order of segments; the first `num` take room.

    Attributes:
        segment: Index of the segment.
        cell: Index of the cell, row by row.
        first: Where the segment enters the cell, as part of its length.
        last: Where it leaves.
        present: Whether the pair is one. Each column that a segment crosses has room for two cells.
        num: Room that all pairs take; more than there is where it overflows.
    """

    segment: Int[Array, "n"]
    cell: Int[Array, "n"]
    first: Float[Array, "n"]
    last: Float[Array, "n"]
    present: Bool[Array, "n"]
    num: Int[Array, ""]


def crossings(
    start: Float[Array, "segments 2"],
    end: Float[Array, "segments 2"],
    present: Bool[Array, "segments"],
    shape: tuple[int, int],
    capacity: int,
) -> Crossings:
    """Cells that segments cross; no gradient.

    Args:
        start: (x, y) of one end, cells.
        end: (x, y) of the other.
        present: Segments that count.
        shape: Rows and columns of the grid.
        capacity: Room for pairs.
    """
    start, end = lax.stop_gradient((start, end))
    change = end - start
    size = jnp.asarray([shape[1], shape[0]], start.dtype)
    # Liang–Barsky clipping to the grid: parameters at which each axis enters and leaves [0, size]. An axis along which
    # the segment does not move holds for all of it or, as the empty interval [2, −1], for none.
    still = change == 0
    safe = jnp.where(still, jnp.ones_like(change), change)
    one, two = -start / safe, (size - start) / safe
    within = (start >= 0) & (start < size)
    low = jnp.where(still, jnp.where(within, 0.0, 2.0), jnp.minimum(one, two))
    high = jnp.where(still, jnp.where(within, 1.0, -1.0), jnp.maximum(one, two))
    enter = jnp.maximum(jnp.max(low, axis=-1), 0.0)
    leave = jnp.minimum(jnp.min(high, axis=-1), 1.0)
    # u runs along the axis that the segment covers more of: over one column of u, v changes by one cell at most.
    swap = jnp.abs(change[:, 1]) > jnp.abs(change[:, 0])

    def uv(vector: Array) -> tuple[Array, Array]:
        return jnp.where(swap, vector[:, 1], vector[:, 0]), jnp.where(swap, vector[:, 0], vector[:, 1])

    (u, v), (du, dv) = uv(start), uv(change)
    at_enter, at_leave = u + enter * du, u + leave * du
    # u runs along rows where axes are swapped, so its number of columns is the grid's rows.
    last_column = jnp.where(swap, *size[::-1]) - 1
    begin = jnp.clip(jnp.floor(jnp.minimum(at_enter, at_leave)), 0, last_column).astype(jnp.int32)
    finish = jnp.clip(jnp.floor(jnp.maximum(at_enter, at_leave)), 0, last_column).astype(jnp.int32)
    counts = jnp.where(present & (enter < leave), 2 * (finish - begin + 1), 0)
    # Segments of any length take as many rows as they need of one array of fixed size: no loop, no padding per segment.
    segment, within_segment, count = spread(counts, capacity)

    u, v, du, dv, enter, leave, begin, swap = (part[segment] for part in (u, v, du, dv, enter, leave, begin, swap))
    # Two rows a column: the cell before the grid line that v crosses there, and the one after it, if it crosses one.
    column = begin + within_segment // 2
    step = jnp.where(du == 0, jnp.ones_like(du), du)
    sides = [(column.astype(u.dtype) + k - u) / step for k in (0, 1)]
    first = jnp.maximum(jnp.minimum(*sides), enter)
    last = jnp.minimum(jnp.maximum(*sides), leave)
    at_first, at_last = v + first * dv, v + last * dv
    lower, upper = jnp.minimum(at_first, at_last), jnp.maximum(at_first, at_last)
    # The one grid line of v that can lie strictly between both ends.
    border = jnp.ceil(lower)
    splits = (lower < border) & (border < upper)
    cut = jnp.clip((border - v) / jnp.where(dv == 0, jnp.ones_like(dv), dv), first, last)
    second = within_segment % 2 == 1
    first, last = (
        jnp.where(second, cut, first),
        jnp.where(second, last, jnp.where(splits, cut, last)),
    )
    # From the middle of the piece: its ends lie on grid lines, where rounding may decide for either cell.
    row = jnp.floor(v + 0.5 * (first + last) * dv)
    row = jnp.clip(row, 0, jnp.where(swap, *size) - 1).astype(jnp.int32)
    # Back to row-major cell numbers.
    cell = jnp.where(swap, column * shape[1] + row, row * shape[1] + column)
    exists = (jnp.arange(capacity, dtype=jnp.int32) < count) & (first < last) & (splits | ~second)
    return Crossings(segment, jnp.where(exists, cell, 0), first, last, exists, count)


def spread(counts: Int[Array, "items"], capacity: int) -> tuple[Int[Array, "n"], Int[Array, "n"], Int[Array, ""]]:
    """Items repeated as often as they count: index of the item, which of its repetitions, and how many in all."""
    counts = counts.astype(jnp.int32)
    # Where each item's repetitions end; its rank is the distance from where they begin.
    ends = jnp.cumsum(counts, dtype=jnp.int32)
    item = jnp.repeat(jnp.arange(counts.shape[0], dtype=jnp.int32), counts, total_repeat_length=capacity)
    return item, jnp.arange(capacity, dtype=jnp.int32) - (ends - counts)[item], ends[-1]


def map_present(function: Callable[[Any], Any], xs: Any, count: Int[Array, ""], chunk: int) -> Any:
    """Apply a function to chunks of rows, and skip those that begin at or after `count`; their results are zeros.

    Args:
        function: Takes and gives arrays with rows along the first axis; its results get no gradient.
        xs: Arrays with as many rows, a multiple of the chunk.
        count: Rows that matter.
        chunk: Rows at once: bounds memory.
    """
    num_rows = jax.tree.leaves(xs)[0].shape[0]
    parts = jax.tree.map(lambda x: x.reshape(num_rows // chunk, chunk, *x.shape[1:]), lax.stop_gradient(xs))
    shapes = jax.eval_shape(function, jax.tree.map(lambda x: x[0], parts))

    def skip(_: Any) -> Any:
        return jax.tree.map(lambda s: jnp.zeros(s.shape, s.dtype), shapes)

    def step(args: tuple) -> Any:
        index, part = args
        return lax.cond(index * chunk < count, function, skip, part)

    out = lax.map(step, (jnp.arange(num_rows // chunk, dtype=jnp.int32), parts))
    return jax.tree.map(lambda y: y.reshape(num_rows, *y.shape[2:]), out)


def room(wanted: int, chunk: int) -> tuple[int, int]:
    """Capacity and chunk for at least `wanted` rows."""
    chunk = min(chunk, wanted)
    return -(-wanted // chunk) * chunk, chunk


def places_beside(
    start: Float[Array, "n 2"], end: Float[Array, "n 2"], at: Float[Array, "n"]
) -> tuple[Float[Array, "n 2"], Float[Array, "n 2"]]:
    """Grid positions just left and right of segments, at a part of their length; left of x lies −y."""
    change = end - start
    length = jnp.sqrt(jnp.sum(change * change, axis=-1))
    # A segment without length has no sides: both places fall on it, without 0/0.
    length = jnp.where(length > 0, length, jnp.ones_like(length))[:, None]
    normal = jnp.stack([-change[:, 1], change[:, 0]], axis=-1) / length
    middle = start + at[:, None] * change
    gap = BESIDE * float(jnp.finfo(start.dtype).eps) ** 0.5
    return middle + gap * normal, middle - gap * normal


@jax.custom_jvp
def area_beyond(
    start: Float[Array, "n 2"],
    end: Float[Array, "n 2"],
    first: Float[Array, "n"],
    last: Float[Array, "n"],
    centre: Float[Array, "n 2"],
) -> Float[Array, "n"]:
    """Signed area of a cell that lies beyond a piece of a segment, seen from the cell's centre; cells.

    Beyond means: on rays from the centre, behind the piece. Positive where the centre lies left of the segment. Summed
    over all pieces in the cell, each times the change of a picture across it, and added to the picture at the centre,
    it gives the picture's mean over the cell: exactly, for any arrangement of straight borders between flat parts.

    Its derivative, forward and reverse, is the integral of the piece's speed across itself, so the ends of a piece
    count only where the border itself ends.

    Args:
        start: One end of the whole segment.
        end: The other.
        first: Where the piece begins, as part of the length.
        last: Where it ends.
        centre: Of the cell, whose sides are 1.
    """
    change = end - start
    a, b = (start + at[:, None] * change - centre for at in (first, last))
    # Wedge from the centre to the border between the rays through a and b, less the triangle of centre, a and b. A
    # border length p spans the area p/4, as the border's distance from the centre is ½.
    turn = _cross(a, b)
    around = _perimeter(b) - _perimeter(a)
    around = around - 4 * jnp.round(around / 4)
    # Close to half a turn the shortest way round is ambiguous; the sign of the triangle says which it is.
    around = jnp.where(
        (turn >= 0) & (around < -1), around + 4, jnp.where((turn < 0) & (around > 1), around - 4, around)
    )
    # Seen from a piece that begins or ends at the centre, nothing lies between its ends.
    tiny = float(jnp.finfo(start.dtype).eps)
    seen = (jnp.max(jnp.abs(a), axis=-1) > tiny) & (jnp.max(jnp.abs(b), axis=-1) > tiny)
    return jnp.where(seen, 0.25 * around, 0.0) - 0.5 * turn


@area_beyond.defjvp
def _area_beyond_jvp(primals: tuple, tangents: tuple) -> tuple[Array, Array]:
    start, end, first, last, _ = primals
    change = end - start
    # A point at part s moves with (1 − s)·start' + s·end'; ∫(1 − s) ds and ∫ s ds over the piece weigh the two.
    of_end = 0.5 * (last * last - first * first)
    of_start = (last - first) - of_end
    speed = _cross(change, tangents[0]) * of_start + _cross(change, tangents[1]) * of_end
    return area_beyond(*primals), speed


def _cross(a: Array, b: Array) -> Array:
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]


def _perimeter(direction: Float[Array, "n 2"]) -> Float[Array, "n"]:
    """Length along the border of a cell, counter-clockwise, up to where a ray from its centre leaves; in [0, 4]."""
    x, y = direction[..., 0], direction[..., 1]
    # Through which pair of sides the ray leaves: left or right where |x| is the larger.
    flat = jnp.abs(x) >= jnp.abs(y)
    along = jnp.where(flat, y, -x)
    depth = jnp.where(flat, x, y)
    ratio = 0.5 * along / jnp.where(depth == 0, jnp.ones_like(depth), depth)
    return ratio + jnp.where(flat, jnp.where(x > 0, 0.5, 2.5), jnp.where(y > 0, 1.5, 3.5)).astype(x.dtype)


def blend(
    base: Float[Array, "planes cells"],
    left: Float[Array, "planes n"],
    right: Float[Array, "planes n"],
    start: Float[Array, "n 2"],
    end: Float[Array, "n 2"],
    piece: tuple[Array, Array, Array, Array],
    num_cols: int,
) -> Float[Array, "planes cells"]:
    """Means over cells, from values at their centres and on both sides of the pieces that cross them.

    Args:
        base: Values at the centres.
        left, right: Values just next to each piece.
        start, end: Ends of the line of each piece.
        piece: Cell of each, its ends as parts of the line, and whether it parts the picture.
        num_cols: Columns of the grid.
    """
    cell, first, last, counts = piece
    dtype = base.dtype
    centre = jnp.stack([cell % num_cols, cell // num_cols], axis=-1).astype(dtype) + 0.5
    area = area_beyond(start, end, first, last, centre)
    # Rounding decides on which side of a piece through it the centre lies: take the side that the area took.
    change = lax.stop_gradient(end - start)
    a, b = (lax.stop_gradient(start) + at[:, None] * change - centre for at in (first, last))
    turn, length = _cross(a, b), jnp.sqrt(jnp.sum((b - a) ** 2, axis=-1))
    near = BESIDE * float(jnp.finfo(dtype).eps) ** 0.5
    through = counts & (jnp.abs(turn) <= near * length) & (jnp.sum(a * b, axis=-1) <= near * near)
    side = jnp.where(turn >= 0, left, right)
    share = jnp.where(counts, area, jnp.zeros_like(area)) * (right - left)
    # Cells whose centre a piece passes through start from the value of that side; several such pieces are averaged.
    moved = jnp.where(through, side - base[:, cell], jnp.zeros_like(side))
    votes = jnp.zeros(base.shape[1], dtype).at[cell].add(through.astype(dtype))
    settled = jnp.zeros_like(base).at[:, cell].add(moved) / jnp.maximum(votes, 1)
    return base + settled + jnp.zeros_like(base).at[:, cell].add(share)
