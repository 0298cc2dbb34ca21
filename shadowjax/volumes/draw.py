"""Counting on an image: each region is drawn over the tiles of points that its outline can reach."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import lax

from shadowjax._checked import checked
from shadowjax._numerics import one_by_one, rotate
from shadowjax._types import Array, Bool, Float, Int, UInt
from shadowjax.rays.grid._tiles import HALF, ROWS, SMALL, Index, from_tiles, line, number, to_tiles
from shadowjax.volumes.regions import Regions, count_regions, weighted_first

# How much wider than computed an outline is taken, relative to its distance from the image's middle.
MARGIN = 1e-4


class Spans(NamedTuple):
    """Which tiles of a row of tiles can hold a coordinate: bounds that only grow along the row.

    Attributes:
        highest: Largest coordinate of any tile up to this one.
        lowest: Smallest coordinate of any tile from this one on.
    """

    highest: Float[Array, "n"]
    lowest: Float[Array, "n"]

    @checked
    def tiles(self, low: Float[Array, "m"], high: Float[Array, "m"]) -> tuple[Int[Array, "m"], Int[Array, "m"]]:
        """First and last tile that can meet each interval; the last before the first where none can."""
        first = jnp.searchsorted(self.highest, low, side="left")
        last = jnp.searchsorted(self.lowest, high, side="right") - 1
        return first.astype(jnp.int32), last.astype(jnp.int32)


@checked
def count_image(
    regions: Regions,
    points: Float[Array, "rows cols 3"],
    counts: Bool[Array, "rows cols"],
    frame: Float[Array, "3 3"],
) -> Int[Array, "rows cols"]:
    """As `count_regions`, for points of which neighbours in the image are neighbours as the eye sees them.

    Any points give the right count. The fewer tiles a region's outline can reach, the faster; for an image that the
    eye sees those are the tiles of the outline's bounding rectangle. Accelerators test every pair instead.

    Args:
        regions: Relative to an eye.
        points: Relative to the same eye.
        counts: Points that matter; the others get any number.
        frame: Rows right, up, forward of the image.
    """
    if jax.default_backend() != "cpu":
        return count_regions(regions, points)
    return _count(*lax.stop_gradient((regions, points, counts, frame)))


@one_by_one
def _count(regions: Regions, points: Array, counts: Array, frame: Array) -> Array:
    regions, num = weighted_first(regions)
    rows, cols = points.shape[:2]
    across, down = _spans(rotate(points, frame), counts)
    low, high = _outlines(rotate(regions.corners, frame))
    first_col, last_col = across.tiles(low[0], high[0])
    # Row 0 is the top of the image.
    first_row, last_row = down.tiles(-high[1], -low[1])
    # Regions without a tile or a weight go to the end of the list and are never visited.
    drawn = (first_col <= last_col) & (first_row <= last_row) & (jnp.arange(low.shape[1], dtype=jnp.int32) < num)
    order = jnp.argsort(~drawn, stable=True)

    def halves(first: Array, last: Array) -> Array:
        return (first.astype(jnp.uint32) << 16) | last.astype(jnp.uint32)

    k = regions.sides.shape[1]
    numbers = regions.planes.reshape(-1, 4 * k)[order].T
    # What a loop step reads of a region lies in one column: tile ranges as two halves of a word, sides as bits.
    bits = jnp.sum(regions.sides.astype(jnp.uint32) << jnp.arange(k, dtype=jnp.uint32), axis=1, dtype=jnp.uint32)
    weights = lax.bitcast_convert_type(regions.weights, jnp.uint32)
    work = jnp.stack([halves(first_row, last_row), halves(first_col, last_col), bits, weights])[:, order]
    lines = [to_tiles(points[..., axis], SMALL) for axis in range(3)]
    numbers, work, lines = lax.optimization_barrier((numbers, work, lines))
    total = _walk(-(-cols // SMALL), numbers, work, jnp.sum(drawn, dtype=jnp.uint32), *lines)
    return from_tiles(total, rows, cols)


def _walk(
    num_cols: int,
    numbers: Float[Array, "planes4 n"],
    work: UInt[Array, "4 n"],
    present: Index,
    x: Float[Array, "tiles lanes"],
    y: Float[Array, "tiles lanes"],
    z: Float[Array, "tiles lanes"],
) -> Int[Array, "tiles lanes"]:
    """Test listed regions against the points of their tiles, in one flat loop: a loop within it would be dispatched."""

    def step(state: tuple) -> tuple:
        total, w, row, col = state
        index = row * num_cols + col
        px, py, pz = line(x, index), line(y, index), line(z, index)
        bits = number(work, 2, w)
        wrong = jnp.zeros(px.shape, bool)
        for k in range(numbers.shape[0] // 4):
            a, b, c, d = (number(numbers, 4 * k + i, w) for i in range(4))
            # A point is outside as soon as one plane has it on the wrong side.
            wrong |= (a * px + b * py + c * pz + d >= 0) ^ ((bits >> k) & 1 == 1)
        weight = lax.bitcast_convert_type(number(work, 3, w), jnp.int32)
        added = line(total, index) + jnp.where(wrong, 0, weight)
        total = lax.dynamic_update_slice(total, added, (index, jnp.uint32(0)), allow_negative_indices=False)
        rows, cols = number(work, 0, w), number(work, 1, w)
        # On to the next tile of the row, the next row of the region's tiles, or the first tile of the next region.
        ends = col >= (cols & HALF)
        done = ends & (row >= (rows & HALF))
        w = w + done.astype(jnp.uint32)
        row = jnp.where(done, number(work, 0, w) >> 16, row + ends.astype(jnp.uint32))
        col = jnp.where(done, number(work, 1, w) >> 16, jnp.where(ends, cols >> 16, col + 1))
        return total, w, row, col

    begin = jnp.zeros(x.shape, jnp.int32), jnp.uint32(0), number(work, 0, 0) >> 16, number(work, 1, 0) >> 16
    return lax.while_loop(lambda state: state[1] < present, step, begin)[0]


def _spans(seen: Float[Array, "rows cols 3"], counts: Bool[Array, "rows cols"]) -> tuple[Spans, Spans]:
    """Tiles across and down, by the image coordinates of the points in them; a point not in front may be anywhere."""
    endless = jnp.asarray(jnp.inf, seen.dtype)
    in_front = seen[..., 2] > 0
    depth = jnp.where(in_front, seen[..., 2], 1)
    spans = []
    for axis, sign, side in ((1, 1, SMALL), (0, -1, ROWS)):
        # Image coordinates grow along the row of tiles: x to the right, −y downwards.
        value = sign * seen[..., 1 - axis] / depth
        low = jnp.where(counts, jnp.where(in_front, value, -endless), endless)
        high = jnp.where(counts, jnp.where(in_front, value, endless), -endless)
        low, high = jnp.min(low, axis=1 - axis), jnp.max(high, axis=1 - axis)
        spare = -low.shape[0] % side
        low = jnp.min(jnp.pad(low, (0, spare), constant_values=jnp.inf).reshape(-1, side), axis=1)
        high = jnp.max(jnp.pad(high, (0, spare), constant_values=-jnp.inf).reshape(-1, side), axis=1)
        # Made monotone along the row: then both ends of any interval are found by binary search.
        spans.append(Spans(lax.cummax(high), lax.cummin(low, reverse=True)))
    return spans[0], spans[1]


def _outlines(corners: Float[Array, "n 4 3"]) -> tuple[Float[Array, "2 n"], Float[Array, "2 n"]]:
    """Bounds in the image of the part of each convex cone that lies in front of the eye."""
    endless = jnp.asarray(jnp.inf, corners.dtype)
    in_front = corners[..., 2] > 0
    place = corners[..., :2] / jnp.where(in_front, corners[..., 2], 1)[..., None]
    low = jnp.min(jnp.where(in_front[..., None], place, endless), axis=1)
    high = jnp.max(jnp.where(in_front[..., None], place, -endless), axis=1)
    for i in range(4):
        for j in range(i):
            # Between a corner in front and one that is not, the outline runs off to infinity.
            leaves = in_front[:, i] != in_front[:, j]
            a, b = corners[:, i], corners[:, j]
            sign = jnp.where(in_front[:, i], 1, -1)[:, None]
            # Direction in which the projected edge leaves the image as its depth falls to 0.
            towards = sign * (b[:, :2] * a[:, 2:] - a[:, :2] * b[:, 2:])
            low = jnp.where(leaves[:, None] & (towards < 0), -endless, low)
            high = jnp.where(leaves[:, None] & (towards > 0), endless, high)
    some = jnp.any(in_front, axis=1)[:, None]
    low, high = jnp.where(some, low, endless), jnp.where(some, high, -endless)
    finite_low, finite_high = (jnp.where(jnp.isfinite(part), part, 0) for part in (low, high))
    low, high = low - MARGIN * (1 + jnp.abs(finite_low)), high + MARGIN * (1 + jnp.abs(finite_high))
    return low.T, high.T
