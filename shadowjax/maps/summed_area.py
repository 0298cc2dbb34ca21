"""Summed-area tables in double-word sums: the mean over any box from sixteen reads, precise in float32 at 4096²."""

import jax
import jax.numpy as jnp

from shadowjax._checked import checked
from shadowjax._types import Array, Float, Int

# A number as an unevaluated sum of two of the dtype: about twice its digits.
Pair = tuple[Array, Array]


# Sums of all texels above and to the left, rounded, and what rounding took away; the first row and column are 0.
Table = tuple[Float[Array, "n more_rows more_cols"], Float[Array, "n more_rows more_cols"]]


def _two_sum(a: Array, b: Array) -> Pair:
    """a + b and its rounding error, exactly (Knuth)."""
    total = a + b
    # What of b arrived in the total; the rest of both is the error, without any branch on sizes.
    from_b = total - a
    return total, (a - (total - from_b)) + (b - from_b)


def _add(a: Pair, b: Pair) -> Pair:
    # Double-double addition: the exact error of the high parts joins the low ones, then both are made disjoint again.
    total, error = _two_sum(a[0], b[0])
    rest = error + (a[1] + b[1])
    high = total + rest
    return high, rest - (high - total)


def _subtract(a: Pair, b: Pair) -> Pair:
    return _add(a, (-b[0], -b[1]))


@checked
def summed_area_table(planes: Float[Array, "n rows cols"]) -> Table:
    """Sums over all boxes that start at the first texel, each kept as two numbers.

    A plain table rounds sums to its dtype, so the mean of a small box far from the origin is lost: a 4096² map has
    sums 10⁷ times a texel, as many as float32 has digits. A table demands precision, it does not save it.

    Args:
        planes: Maps of one size.

    Returns:
        The sums, rounded, and what rounding took away: entry (i, j) of their sum is over rows < i and columns < j.

    Source: filtering, eq. 2.10 (inclusive; here entry (i, j) sums the texels *before* row i and column j).
    """
    # Prefix sums along columns, then rows; pairs add associatively but for their last digits.
    pair = (planes, jnp.zeros_like(planes))
    for axis in (2, 1):
        pair = jax.lax.associative_scan(_add, pair, axis=axis)
    high, low = (jnp.pad(part, ((0, 0), (1, 0), (1, 0))) for part in pair)
    return high, low


@checked
def box_sum(
    table: Table,
    lower: tuple[Int[Array, "*points"], Int[Array, "*points"]],
    upper: tuple[Int[Array, "*points"], Int[Array, "*points"]],
) -> Float[Array, "n *points"]:
    """Sum of the texels lower ≤ (column, row) < upper of every plane, from four reads.

    Args:
        table: From `summed_area_table`.
        lower: First column and row, inside the map.
        upper: Column and row after the last, at most the map's size.
    """
    (left, top), (right, bottom) = lower, upper
    corners = [[_entry(table, col, row) for col in (left, right)] for row in (top, bottom)]
    # Nearly equal large sums are subtracted first; the low parts bring back the digits that they lose.
    difference = _subtract(_subtract(corners[1][1], corners[1][0]), _subtract(corners[0][1], corners[0][0]))
    return difference[0] + difference[1]


def _entry(table: Table, col: Array, row: Array) -> Pair:
    num_planes, _, num_cols = table[0].shape
    index = row * num_cols + col
    high, low = (part.reshape(num_planes, -1)[:, index] for part in table)
    return high, low


@checked
def read_box_mean(
    table: Table, position: Float[Array, "*points 2"], size: Float[Array, "*points 2"]
) -> list[Float[Array, "*points"]]:
    """Mean of every plane over a box, texels at its sides counted in part. A box of one texel is a bilinear read.

    Args:
        table: From `summed_area_table`.
        position: (x, y) of the box's centre, texels, centres at +½.
        size: Width and height, texels, > 0; what lies outside the map does not count, unless all does: then the
            nearest texel does.

    Returns:
        One array for each plane.
    """
    num_rows, num_cols = (length - 1 for length in table[0].shape[1:])
    axes = [_box_along(position[..., i], size[..., i], length) for i, length in enumerate((num_cols, num_rows))]
    (cols, col_parts, width), (rows, row_parts, height) = axes
    # Sums of boxes anchored at the first of each axis' four lines; only then fractions, so that nothing large cancels.
    entries = [[_entry(table, col, row) for col in cols] for row in rows]
    along_rows = []
    for line in entries[1:]:
        boxes = []
        for k in range(1, 4):
            # Sum from line 0 to this row and from line 0 to column k: four entries of the table.
            box = _subtract(_subtract(line[k], line[0]), _subtract(entries[0][k], entries[0][0]))
            boxes.append(box[0] + box[1])
        along_rows.append(_cut(boxes, col_parts))
    return list(_cut(along_rows, row_parts) / (width * height))


def _box_along(centre: Array, size: Array, length: int) -> tuple[list[Array], tuple[Array, Array], Array]:
    """The lines of the table round both ends of an interval, the fractions between them, and the interval's length."""
    # At least one texel's sliver of the map, so that the mean exists.
    sliver = 1e-3
    # The interval is cut to the map: what lies outside does not count.
    start = jnp.clip(centre - 0.5 * size, 0.0, length - sliver)
    end = jnp.maximum(jnp.clip(centre + 0.5 * size, 0.0, float(length)), start + sliver)
    first = jnp.clip(jnp.floor(start), 0, length - 1).astype(jnp.int32)
    last = jnp.clip(jnp.floor(end), 0, length - 1).astype(jnp.int32)
    parts = (start - first.astype(start.dtype), end - last.astype(end.dtype))
    return [first, first + 1, last, last + 1], parts, end - start


def _cut(values: list[Array], parts: tuple[Array, Array]) -> Array:
    """Integral between two ends, from the anchored sums at lines 1, 2 and 3 (that of line 0 is 0)."""
    next_to_first, last, beyond = values
    # The integral is linear between lines: F(end) − F(start), with F = 0 on line 0.
    return last + parts[1] * (beyond - last) - parts[0] * next_to_first


@checked
def read_summed_area(
    table: Table, position: Float[Array, "*points 2"], size: Float[Array, "*points 2"]
) -> Float[Array, "n *points"]:
    """The planes of `read_box_mean` in one array; arguments as there."""
    return jnp.stack(read_box_mean(table, position, size))
