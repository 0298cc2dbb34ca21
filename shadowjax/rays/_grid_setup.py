"""A chunk of triangles made ready for the loops: orientation, slope of the key, box of cells, and class of work."""

from typing import NamedTuple

import jax.numpy as jnp
from jax import lax

from shadowjax._types import Array, Bool, Float, Int
from shadowjax.rays._grid_project import Triple, Vertices, View, highest, lowest, never, slopes, span, take
from shadowjax.rays.light_space import DirectionalSpace
from shadowjax.rays.plane_map import Box
from shadowjax.rays.ray_grid import RayGrid

# Candidates from a triangle's three corners, from three edges on five sides, and from the region's four corners.
SIDES = 5


class Ready(NamedTuple):
    """A chunk of triangles on the plane; arrays of one number a triangle.

    Attributes:
        x, y: Plane coordinates of the corners, counter-clockwise unless `unsure`.
        key: Key at the first corner.
        along_u, along_v: Derivative of the key on the plane.
        low, high: Bounds of the key over the corners; a hit's key is clamped to them.
        first_row, last_row, first_col, last_col: Cells whose centres the box of the triangle holds.
        empty: No cell can be hit.
        general: Needs the general test: crosses the near limit or the region's border, or its orientation is unsure.
    """

    x: Triple
    y: Triple
    key: Array
    along_u: Array
    along_v: Array
    low: Array
    high: Array
    first_row: Array
    last_row: Array
    first_col: Array
    last_col: Array
    empty: Array
    general: Array


class General(NamedTuple):
    """Triangles for the general test, whose corners may lie behind the light.

    Attributes:
        numbers: Corners (x, y) × 3, w of the second and third (the first has 1), key at the first, its slopes, the
            bounds it is clamped to, and the key below which it is no hit: (14, n).
        cells: First and last row, first and last column: (4, n).
    """

    numbers: Float[Array, "14 n"]
    cells: Int[Array, "4 n"]


def prepare(grid: RayGrid, table: View, vertices: Vertices, faces: Int[Array, "3 n"]) -> Ready:
    """Set a chunk of triangles up; every step is elementwise over the chunk."""
    plane = [take(vertices.plane, corner) for corner in faces]
    keys = [take(vertices.key, corner) for corner in faces]
    # Kept apart from what follows: fused into it, every result would gather its corners again.
    plane, keys = lax.optimization_barrier((plane, keys))
    x0, x1, x2 = (corner.real for corner in plane)
    y0, y1, y2 = (corner.imag for corner in plane)
    k0, k1, k2 = keys
    one, two = (x1 - x0) * (y2 - y0), (x2 - x0) * (y1 - y0)
    determinant = one - two
    eps = jnp.finfo(k0.dtype).eps
    unsure = jnp.abs(determinant) <= 16 * eps * (jnp.abs(one) + jnp.abs(two))
    swap = determinant < 0
    x = x0, jnp.where(swap, x2, x1), jnp.where(swap, x1, x2)
    y = y0, jnp.where(swap, y2, y1), jnp.where(swap, y1, y2)
    key = k0, jnp.where(swap, k2, k1), jnp.where(swap, k1, k2)
    along_u, along_v = slopes(x, y, key, jnp.abs(determinant))
    low, high = lowest(key), highest(key)
    beyond = never(k0.dtype)
    behind = high >= beyond
    if isinstance(grid.space, DirectionalSpace):
        reached, special = high >= 0, low < 0
    else:
        reached, special = low < beyond, behind
    if vertices.cell is None:
        assert isinstance(grid.plane_map, Box)
        origin = grid.plane_map.lower
        scale = grid.resolution / (grid.plane_map.upper - origin)
        ends_x = (lowest(x) - origin[0]) * scale[0], (highest(x) - origin[0]) * scale[0]
        ends_y = (lowest(y) - origin[1]) * scale[1], (highest(y) - origin[1]) * scale[1]
        first_col, last_col = span(jnp.minimum(*ends_x), jnp.maximum(*ends_x), table.margin[0], grid.num_cols)
        first_row, last_row = span(jnp.minimum(*ends_y), jnp.maximum(*ends_y), table.margin[1], grid.num_rows)
        general = special
        off = ~behind & ((last_col < first_col) | (last_row < first_row))
    else:
        cell = [take(vertices.cell, corner) for corner in faces]
        s: Triple = (cell[0].real, cell[1].real, cell[2].real)
        t: Triple = (cell[0].imag, cell[1].imag, cell[2].imag)
        first_col, last_col = span(lowest(s), highest(s), table.margin[0], grid.num_cols)
        first_row, last_row = span(lowest(t), highest(t), table.margin[1], grid.num_rows)
        general = special | (highest(s) >= beyond)
        least, most = jnp.min(table.corners, axis=0), jnp.max(table.corners, axis=0)
        beside = (highest(x) < least[0]) | (lowest(x) > most[0]) | (highest(y) < least[1]) | (lowest(y) > most[1])
        off = jnp.where(general, ~behind & beside, (last_col < first_col) | (last_row < first_row))
    # A triangle with two corners in one place is a line there and back: its neighbours cover it.
    folded = ((x0 == x1) & (y0 == y1)) | ((x1 == x2) & (y1 == y2)) | ((x2 == x0) & (y2 == y0))
    empty = off | ~reached | (folded & ~behind)
    return Ready(
        x, y, key[0], along_u, along_v, low, high,
        first_row, last_row, first_col, last_col,
        empty, (general | unsure) & ~empty,
    )  # fmt: skip


def generalise(grid: RayGrid, table: View, vertices: Vertices, faces: Int[Array, "3 n"]) -> General:
    """Set triangles up for the general test, with a box of cells that holds what of them the region shows.

    Corners in front are divided by w, exactly as in `prepare`, so that a neighbour there compares the same numbers.
    Corners behind stay homogeneous.
    """
    parts = vertices.x, vertices.y, vertices.w, vertices.plane, vertices.key
    gathered = [[take(part, corner) for corner in faces] for part in parts]
    beyond = never(vertices.key.dtype)
    ahead = [key < beyond for key in gathered[4]]
    # Begin with a corner in front: the key is extended over the plane from there.
    turns = jnp.where(ahead[0], 0, jnp.where(ahead[1], 1, 2))

    def turned(values: list[Array]) -> Triple:
        a, b, c = values
        pick = [jnp.where(turns == 0, p, jnp.where(turns == 1, q, r)) for p, q, r in ((a, b, c), (b, c, a), (c, a, b))]
        return pick[0], pick[1], pick[2]

    x, y, w, plane, key = (turned(part) for part in gathered)
    ahead = turned(ahead)
    test_x = [jnp.where(a, p.real, q) for a, p, q in zip(ahead, plane, x, strict=True)]
    test_y = [jnp.where(a, p.imag, q) for a, p, q in zip(ahead, plane, y, strict=True)]
    test_w = [jnp.where(a, jnp.ones_like(q), q) for a, q in zip(ahead, w, strict=True)]
    if isinstance(grid.space, DirectionalSpace):
        determinant = (x[1] - x[0]) * (y[2] - y[0]) - (x[2] - x[0]) * (y[1] - y[0])
        along_u, along_v = slopes(x, y, key, determinant)
        low, high, floor = lowest(key), highest(key), jnp.zeros_like(key[0])
    else:
        a, b = (x[1] - x[0], y[1] - y[0], w[1] - w[0]), (x[2] - x[0], y[2] - y[0], w[2] - w[0])
        normal = a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]
        volume = normal[0] * x[0] + normal[1] * y[0] + normal[2] * w[0]
        inverse = jnp.where(volume == 0, 0.0, -1 / jnp.where(volume == 0, 1.0, volume))
        along_u, along_v = normal[0] * inverse, normal[1] * inverse
        in_front = ahead[0] & ahead[1] & ahead[2]
        # Where the plane of the triangle passes behind the light its key is positive, which no start is.
        low = jnp.where(in_front, lowest(key), -1 / table.nearest)
        high = jnp.where(in_front, highest(key), 0.0)
        floor = jnp.full_like(low, -beyond)
    numbers = [n for pair in zip(test_x, test_y, strict=True) for n in pair]
    numbers += [test_w[1], test_w[2], key[0], along_u, along_v, low, high, floor]
    return General(jnp.stack(numbers), _clipped_box(grid, table, x, y, w))


def _clipped_box(grid: RayGrid, table: View, x: Triple, y: Triple, w: Triple) -> Int[Array, "4 n"]:
    """First and last row, first and last column of what the region shows of triangles, one cell wider.

    A triangle clipped to the region has its corners among: the triangle's corners inside the region, its edges'
    crossings with the region's sides, and the region's corners that it covers.
    """
    sides = table.sides.at[-1, 2].set(1 / table.nearest)
    sides = jnp.concatenate([sides, jnp.zeros_like(sides[:, :1])], axis=1).at[-1, 3].set(-1.0)
    distance = [[a * p + b * q + c * r + d for a, b, c, d in sides] for p, q, r in zip(x, y, w, strict=True)]
    # Rounding may lose a corner that lies on two sides; let it lie a little outside.
    slack = 1e3 * jnp.finfo(w[0].dtype).eps
    reach = jnp.max(jnp.abs(table.corners)) + 1

    def inside(values: list[Array], scale: Array) -> Bool[Array, "n"]:
        ok = values[0] >= -slack * scale
        for value in values[1:]:
            ok &= value >= -slack * scale
        return ok

    points: list[tuple[Array, Array, Array]] = []
    for i in range(3):
        points.append((x[i] / _nonzero(w[i]), y[i] / _nonzero(w[i]), inside(distance[i], reach * jnp.abs(w[i]))))
        j = (i + 1) % 3
        for m in range(SIDES):
            da, db = distance[i][m], distance[j][m]
            s = da / _nonzero(da - db)
            cross = [p[i] + s * (p[j] - p[i]) for p in (x, y, w)]
            there = [a + s * (b - a) for k, (a, b) in enumerate(zip(distance[i], distance[j], strict=True)) if k != m]
            crosses = ((da < 0) != (db < 0)) & inside(there, reach * jnp.abs(cross[2]))
            points.append((cross[0] / _nonzero(cross[2]), cross[1] / _nonzero(cross[2]), crosses))
    for u, v in table.corners:
        rx, ry = [p - u * r for p, r in zip(x, w, strict=True)], [q - v * r for q, r in zip(y, w, strict=True)]
        right = left = jnp.ones_like(w[0], dtype=bool)
        for i in range(3):
            one, two = rx[i] * ry[(i + 1) % 3], ry[i] * rx[(i + 1) % 3]
            doubt = slack * (jnp.abs(one) + jnp.abs(two))
            right, left = right & (one >= two - doubt), left & (one <= two + doubt)
        points.append((jnp.broadcast_to(u, w[0].shape), jnp.broadcast_to(v, w[0].shape), right | left))
    beyond = never(w[0].dtype)
    ends = [jnp.full_like(w[0], beyond), jnp.full_like(w[0], -beyond)] * 2
    for u, v, valid in points:
        # What is not inside may be anywhere; put it on a corner before it is mapped.
        at = jnp.stack([jnp.where(valid, u, table.corners[0, 0]), jnp.where(valid, v, table.corners[0, 1])], axis=-1)
        cell = grid.plane_map.forward(at) * grid.resolution
        for axis in range(2):
            ends[2 * axis] = jnp.where(valid, jnp.minimum(ends[2 * axis], cell[:, axis]), ends[2 * axis])
            ends[2 * axis + 1] = jnp.where(valid, jnp.maximum(ends[2 * axis + 1], cell[:, axis]), ends[2 * axis + 1])
    rows = span(ends[2], ends[3], 1 + table.margin[1], grid.num_rows)
    cols = span(ends[0], ends[1], 1 + table.margin[0], grid.num_cols)
    return jnp.stack([*rows, *cols])


def _nonzero(value: Array) -> Array:
    return jnp.where(value == 0, jnp.ones_like(value), value)
