"""Triangles that cross the start of the rays or leave a map's region, made ready for the general test."""

from typing import NamedTuple

import jax.numpy as jnp

from shadowjax._types import Array, Bool, Float, Int, Scalar, UInt
from shadowjax.rays._grid_project import Vertices, View, never, project
from shadowjax.rays.light_space import DirectionalSpace
from shadowjax.rays.ray_grid import RayGrid

# Candidates from a triangle's three corners, from three edges on five sides, and from the region's four corners.
SIDES = 5

Triple = tuple[Array, Array, Array]


class General(NamedTuple):
    """Triangles for the general test, whose corners may lie behind the light.

    Attributes:
        numbers: Corners (x, y) × 3, w of the second and third (the first has 1), key at the first, its slopes, the
            bounds it is clamped to, and the key below which it is no hit: (14, n).
        cells: First and last row, first and last column: (4, n).
    """

    numbers: Float[Array, "14 n"]
    cells: Int[Array, "4 n"]


def generalise(
    grid: RayGrid, table: View, world: Float[Array, "vertices 3"], vertices: Vertices, corners: UInt[Array, "n 3"]
) -> General:
    """Set triangles up for the general test, with a box of cells that holds what of them the region shows.

    Corners in front are divided by w, exactly as in `place`, so that a neighbour there compares the same numbers.
    Corners behind stay homogeneous.
    """
    parallel = isinstance(grid.space, DirectionalSpace)
    projected = [project(grid, world[corners[:, k]]) for k in range(3)]
    placed = [vertices.plane[:, corners[:, k]] for k in range(3)]
    gathered = [[*rows] for rows in zip(*projected, strict=True)] + [[*rows] for rows in zip(*placed, strict=True)]
    if parallel:
        gathered[2] = [jnp.ones_like(w) for w in gathered[2]]
    beyond = never(world.dtype)
    ahead = [key < beyond for key in gathered[5]]
    # Begin with a corner in front: the key is extended over the plane from there.
    turns = jnp.where(ahead[0], 0, jnp.where(ahead[1], 1, 2))

    def turned(values: list[Array]) -> Triple:
        a, b, c = values
        pick = [jnp.where(turns == 0, p, jnp.where(turns == 1, q, r)) for p, q, r in ((a, b, c), (b, c, a), (c, a, b))]
        return pick[0], pick[1], pick[2]

    x, y, w, u, v, key = (turned(part) for part in gathered)
    ahead = turned(ahead)
    test_x = [jnp.where(a, p, q) for a, p, q in zip(ahead, u, x, strict=True)]
    test_y = [jnp.where(a, p, q) for a, p, q in zip(ahead, v, y, strict=True)]
    test_w = [jnp.where(a, jnp.ones_like(q), q) for a, q in zip(ahead, w, strict=True)]
    if parallel:
        along_u, along_v = _slopes(x, y, key)
        low, high, floor = _lowest(key), _highest(key), jnp.zeros_like(key[0])
    else:
        a, b = (x[1] - x[0], y[1] - y[0], w[1] - w[0]), (x[2] - x[0], y[2] - y[0], w[2] - w[0])
        normal = a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]
        volume = normal[0] * x[0] + normal[1] * y[0] + normal[2] * w[0]
        inverse = jnp.where(volume == 0, 0.0, -1 / jnp.where(volume == 0, 1.0, volume))
        along_u, along_v = normal[0] * inverse, normal[1] * inverse
        in_front = ahead[0] & ahead[1] & ahead[2]
        # Where the plane of the triangle passes behind the light its key is positive, which no start is.
        low = jnp.where(in_front, _lowest(key), -1 / table.nearest)
        high = jnp.where(in_front, _highest(key), 0.0)
        floor = jnp.full_like(low, -beyond)
    numbers = [n for pair in zip(test_x, test_y, strict=True) for n in pair]
    numbers += [test_w[1], test_w[2], key[0], along_u, along_v, low, high, floor]
    return General(jnp.stack(numbers), _clipped_box(grid, table, x, y, w))


def _lowest(values: Triple) -> Array:
    return jnp.minimum(jnp.minimum(values[0], values[1]), values[2])


def _highest(values: Triple) -> Array:
    return jnp.maximum(jnp.maximum(values[0], values[1]), values[2])


def _slopes(x: Triple, y: Triple, key: Triple) -> tuple[Array, Array]:
    """Derivative of the key along u and v over a triangle; 0 where it has no area."""
    determinant = (x[1] - x[0]) * (y[2] - y[0]) - (x[2] - x[0]) * (y[1] - y[0])
    inverse = jnp.where(determinant == 0, 0.0, 1 / jnp.where(determinant == 0, 1.0, determinant))
    first, second = key[1] - key[0], key[2] - key[0]
    along_u = (first * (y[2] - y[0]) - second * (y[1] - y[0])) * inverse
    along_v = (second * (x[1] - x[0]) - first * (x[2] - x[0])) * inverse
    return along_u, along_v


def _span(low: Array, high: Array, margin: Scalar, count: int) -> tuple[Int[Array, "..."], Int[Array, "..."]]:
    """First and last cell whose centre lies between two grid positions; first > last if there is none."""
    first = jnp.clip(jnp.ceil(low - 0.5 - margin), 0, count)
    last = jnp.clip(jnp.floor(high - 0.5 + margin), -1, count - 1)
    return first.astype(jnp.int32), last.astype(jnp.int32)


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
    rows = _span(ends[2], ends[3], 1 + table.margin[1], grid.num_rows)
    cols = _span(ends[0], ends[1], 1 + table.margin[0], grid.num_cols)
    return jnp.stack([*rows, *cols])


def _nonzero(value: Array) -> Array:
    return jnp.where(value == 0, jnp.ones_like(value), value)
