"""Triangles that cross the start of the rays or leave a map's region, made ready for the general test."""

from typing import NamedTuple

import jax.numpy as jnp
from jax import lax

from shadowjax._types import Array, Float, Int, Scalar, UInt
from shadowjax.rays.grid._project import Vertices, View, miss_key, project
from shadowjax.rays.ray import TRIANGLE_ROUNDINGS
from shadowjax.rays.ray_grid import RayGrid

# Row of `General.numbers` with the least key of a triangle.
LEAST_KEY = 11
# Candidates from a triangle's three corners, from three edges on five sides, and from the region's four corners.
SIDES = 5

Corners = Float[Array, "3 n"]


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
    grid: RayGrid,
    table: View,
    world: Float[Array, "vertices 3"],
    vertices: Vertices,
    corners: UInt[Array, "n 3"],
    held_back: bool = False,
) -> General:
    """Set triangles up for the general test, with a box of cells that holds what of them the region shows.

    Corners in front are divided by w, exactly as in `place`, so that a neighbour there compares the same numbers.
    Corners behind stay homogeneous.

    Args:
        grid, table: The view.
        world: Vertices of the mesh.
        vertices: The same in the view.
        corners: Indices of the triangles' corners.
        held_back: Whether keys are farther by what rounding leaves unknown of them, so that a triangle blocks nothing
            that may lie on it; see `key_rounding`. A plane that holds the source of the rays, to rounding, blocks none.
    """
    parallel = grid.space.is_parallel
    x, y, w = project(grid, world[corners.T.reshape(-1)]).reshape(3, 3, -1)
    u, v, key = vertices.plane[:, corners.T.reshape(-1)].reshape(3, 3, -1)
    w = jnp.ones_like(w) if parallel else w
    beyond = miss_key(world.dtype)
    ahead = key < beyond
    # Begin with a corner in front: the key is extended over the plane from there.
    # Rotation of the corners that puts one in front first; rolling keeps their sense.
    turns = jnp.where(ahead[0], 0, jnp.where(ahead[1], 1, 2))
    gathered = jnp.stack([x, y, w, u, v, key])
    later, last = jnp.roll(gathered, -1, axis=1), jnp.roll(gathered, -2, axis=1)
    x, y, w, u, v, key = lax.optimization_barrier(jnp.where(turns == 0, gathered, jnp.where(turns == 1, later, last)))
    ahead = key < beyond
    test_x, test_y, test_w = jnp.where(ahead, u, x), jnp.where(ahead, v, y), jnp.where(ahead, jnp.ones_like(w), w)
    if parallel:
        along_u, along_v = _slopes(x, y, key)
        low, high = jnp.min(key, axis=0), jnp.max(key, axis=0)
        floor = jnp.full_like(low, table.least)
    else:
        # The plane n·(x, y, w) = V through the corners, divided by V·w: 1/w = (n_x·u + n_y·v + n_w)/V, so the key −1/w
        # is affine in (u, v) with the slopes −n_x/V and −n_y/V.
        a, b = ([part[k] - part[0] for part in (x, y, w)] for k in (1, 2))
        normal = a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]
        volume = normal[0] * x[0] + normal[1] * y[0] + normal[2] * w[0]
        inverse = jnp.where(volume == 0, 0.0, -1 / jnp.where(volume == 0, 1.0, volume))
        along_u, along_v = normal[0] * inverse, normal[1] * inverse
        in_front = ahead[0] & ahead[1] & ahead[2]
        # Where the plane of the triangle passes behind the light its key is positive, which no start is.
        low = jnp.where(in_front, jnp.min(key, axis=0), -1 / table.nearest)
        high = jnp.where(in_front, jnp.max(key, axis=0), 0.0)
        floor = jnp.full_like(low, -beyond)
        if held_back:
            parts = [jnp.abs(n * p[0]) for n, p in zip(normal, (x, y, w), strict=True)]
            doubt = TRIANGLE_ROUNDINGS * jnp.finfo(x.dtype).eps * (parts[0] + parts[1] + parts[2])
            # The key is proportional to 1/V: as V is uncertain, the key is taken closer to 0, which is farther from the
            # light.
            known = jnp.maximum(1 - doubt / jnp.where(volume == 0, jnp.ones_like(volume), jnp.abs(volume)), 0)
            known = jnp.where(volume == 0, jnp.zeros_like(known), known)
            key, along_u, along_v, low, high = (known * part for part in (key, along_u, along_v, low, high))
    if held_back:
        # A corner behind the light is at no place.
        places = jnp.where(ahead, jnp.abs(u) + jnp.abs(v), jnp.zeros_like(u))
        reach = jnp.max(places, axis=0)
        doubt = key_rounding(parallel, reach, key[0], key[0], along_u, along_v, high - low)
        key, low, high = key + doubt, low + doubt, high + doubt
    numbers = [part[k] for k in range(3) for part in (test_x, test_y)]
    numbers += [test_w[1], test_w[2], key[0], along_u, along_v, low, high, floor]
    return General(jnp.stack(numbers), _clipped_box(grid, table, jnp.stack([x, y, w])))


def key_rounding(
    parallel: bool, reach: Array, low: Array, high: Array, along_u: Array, along_v: Array, span: Array
) -> Array:
    """What rounding leaves unknown of a triangle's key: as `ray.depth_rounding`, on the plane of a view.

    Args:
        parallel: Whether the key is depth, else −1/w.
        reach: Plane coordinates of the corners, the sum of the largest.
        low, high: Least and greatest key of the corners.
        along_u, along_v: Slopes of the key.
        span: How far keys of the triangle differ at most.
    """
    slope = jnp.abs(along_u) + jnp.abs(along_v)
    size = jnp.abs(low) + jnp.abs(high)
    # Places seen from a point are quotients, off by a rounding of the longest part of an offset over w.
    reach = (TRIANGLE_ROUNDINGS * jnp.finfo(span.dtype).eps) * (reach + (size if parallel else 1))
    sideways = reach * slope
    return (reach if parallel else reach * size) + jnp.where(sideways < span, sideways, span)


def _slopes(x: Corners, y: Corners, key: Corners) -> tuple[Array, Array]:
    """Derivative of the key along u and v over a triangle; 0 where it has no area."""
    # Cramer's rule for the two slopes; a triangle seen edge-on divides by 1 in place of 0, so gradients stay finite.
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


def _clipped_box(grid: RayGrid, table: View, a: Float[Array, "3 3 n"]) -> Int[Array, "4 n"]:
    """First and last row, first and last column of what the region shows of triangles, one cell wider.

    A triangle clipped to the region has its corners among: the triangle's corners inside the region, its edges'
    crossings with the region's sides, and the region's corners that it covers. Those are axes of arrays here, not
    steps of a program, which compiles several times faster.

    Args:
        grid: The rays.
        table: Its view.
        a: Rows x, y, w of the three corners of each triangle.
    """
    sides = table.sides.at[-1, 2].set(1 / table.nearest)
    offsets = jnp.zeros_like(sides[:, 0]).at[-1].set(-1.0)
    b = jnp.roll(a, -1, axis=1)
    # Distances of corners, and of the next corners, from the sides: corners × sides × triangles.
    from_a = offsets[:, None] + sum(sides[:, axis, None] * a[axis][:, None] for axis in range(3))
    from_b = jnp.roll(from_a, -1, axis=0)
    from_a, from_b = lax.optimization_barrier((from_a, from_b))
    # Rounding may lose a corner that lies on two sides; let it lie a little outside.
    slack = 1e3 * jnp.finfo(a.dtype).eps
    reach = slack * (jnp.max(jnp.abs(table.corners)) + 1)
    corner_shows = jnp.all(from_a >= -reach * jnp.abs(a[2])[:, None], axis=1)

    share = from_a / _nonzero(from_a - from_b)
    cross = a[:, :, None] + share * (b - a)[:, :, None]
    share, cross = lax.optimization_barrier((share, cross))
    # Of every crossing, the distance from each side but the one it lies on.
    there = from_a[:, None] + share[:, :, None] * (from_b - from_a)[:, None]
    own = jnp.eye(SIDES, dtype=bool)[:, :, None]
    within = jnp.all(own | (there >= -reach * jnp.abs(cross[2])[:, :, None]), axis=2)
    crosses = ((from_a < 0) != (from_b < 0)) & within

    # Corners of the region × corners of triangles × triangles.
    u, v = table.corners[:, :1], table.corners[:, 1:]
    # A corner (u, v) of the region is covered where the triangle turns one way all round it, homogeneously.
    rx, ry = a[0] - u[..., None] * a[2], a[1] - v[..., None] * a[2]
    one, two = rx * jnp.roll(ry, -1, axis=1), ry * jnp.roll(rx, -1, axis=1)
    doubt = slack * (jnp.abs(one) + jnp.abs(two))
    covered = jnp.all(one >= two - doubt, axis=1) | jnp.all(one <= two + doubt, axis=1)

    valid = jnp.concatenate([corner_shows, crosses.reshape(3 * SIDES, -1), covered])
    cross = cross.reshape(3, 3 * SIDES, -1)
    valid = lax.optimization_barrier(valid)
    w_all = _nonzero(jnp.concatenate([a[2], cross[2]]))
    at = jnp.stack([
        jnp.concatenate([jnp.concatenate([a[axis], cross[axis]]) / w_all, jnp.broadcast_to(place, covered.shape)])
        for axis, place in enumerate((u, v))
    ], axis=-1)  # fmt: skip
    # What is not inside may be anywhere; put it on a corner before it is mapped.
    cell = grid.plane_map.forward(jnp.where(valid[..., None], at, table.corners[0])) * grid.resolution
    beyond = miss_key(a.dtype)
    first = jnp.min(jnp.where(valid[..., None], cell, beyond), axis=0)
    last = jnp.max(jnp.where(valid[..., None], cell, -beyond), axis=0)
    rows = _span(first[:, 1], last[:, 1], 1 + table.margin[1], grid.num_rows)
    cols = _span(first[:, 0], last[:, 0], 1 + table.margin[0], grid.num_cols)
    return jnp.stack([*rows, *cols])


def _nonzero(value: Array) -> Array:
    return jnp.where(value == 0, jnp.ones_like(value), value)
