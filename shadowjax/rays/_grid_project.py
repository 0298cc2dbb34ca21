"""A grid's view of a mesh: plane coordinates of vertices, keys that order hits, tables of the cells."""

from typing import Any, NamedTuple

import jax.numpy as jnp
from jax import lax

from shadowjax._types import Array, Float, Int, Scalar
from shadowjax.rays.light_space import DirectionalSpace, LightSpace, PerspectiveSpace
from shadowjax.rays.plane_map import Box, PlaneMap
from shadowjax.rays.ray_grid import RayGrid

# Nearest w that a perspective view divides by, in units of the farthest coordinate of the scene.
NEAREST = 1e-6

Triple = tuple[Array, Array, Array]

_ONE_AXIS = lax.GatherDimensionNumbers(offset_dims=(), collapsed_slice_dims=(0,), start_index_map=(0,))


def take(array: Array, index: Int[Array, "n"]) -> Array:
    """array[index] for indices known to be in range, without the wrap of negative ones that slows a gather down."""
    return lax.gather(array, index[:, None], _ONE_AXIS, (1,), mode="promise_in_bounds")


def never(dtype: Any) -> float:
    """A key beyond every hit, finite."""
    return float(jnp.finfo(dtype).max) / 4


def is_projective(space: LightSpace) -> bool:
    """Whether the space maps straight lines to straight lines, so that a triangle on its plane is a triangle."""
    return isinstance(space, DirectionalSpace | PerspectiveSpace)


class Vertices(NamedTuple):
    """Vertices in the coordinates of a view.

    Attributes:
        x, y, w: Homogeneous plane coordinates; the plane position is (x/w, y/w).
        plane: Plane position as the complex number u + iv, so that one gather fetches both.
        cell: Grid position likewise; None for an affine plane map, where it follows from `plane`.
        key: What orders hits along a ray and is affine over a triangle: depth for parallel rays, −1/w for rays through
            a point. `never` for a vertex at or behind that point.
    """

    x: Float[Array, "vertices"]
    y: Float[Array, "vertices"]
    w: Float[Array, "vertices"]
    plane: Array
    cell: Array | None
    key: Float[Array, "vertices"]


class View(NamedTuple):
    """What the caster knows about a grid before it looks at triangles.

    Attributes:
        u, v: Plane coordinates of the cells' centres: (cols,) and (rows,) for an affine map, else (rows, cols).
        start: Key of the far limit at every cell, (rows, cols).
        sides: Half-spaces of (x, y, w) that hold the grid's region, with w ≥ `nearest` as the last.
        corners: Plane positions of the region's corners, (4, 2).
        nearest: Smallest w that is divided by; 1 for parallel rays.
        margin: Rounding of a grid position, cells, along columns and rows.
    """

    u: Array
    v: Array
    start: Float[Array, "rows cols"]
    sides: Float[Array, "5 3"]
    corners: Float[Array, "4 2"]
    nearest: Scalar
    margin: Float[Array, "2"]


def project(grid: RayGrid, vertices: Float[Array, "vertices 3"]) -> tuple[Vertices, Scalar]:
    """Vertices in view coordinates, and the smallest w that counts as in front.

    Sums are written out: a matrix product is slower here and may run at a lower precision on an accelerator.
    """
    space = grid.space
    assert isinstance(space, DirectionalSpace | PerspectiveSpace)
    origin = space.origin if isinstance(space, DirectionalSpace) else space.position
    offset = [vertices[:, axis] - origin[axis] for axis in range(3)]
    local = [offset[0] * row[0] + offset[1] * row[1] + offset[2] * row[2] for row in space.frame]
    beyond = never(vertices.dtype)
    if isinstance(space, DirectionalSpace):
        x, y, depth = local[0], local[2], -local[1]
        w = jnp.ones_like(x)
        nearest = jnp.ones((), x.dtype)
        plane, key = lax.complex(x, y), depth
    else:
        x, y, w = local
        farthest = jnp.max(jnp.stack([jnp.max(jnp.abs(part)) for part in local]))
        nearest = NEAREST * farthest + jnp.finfo(x.dtype).tiny
        ahead = w >= nearest
        safe = jnp.where(ahead, w, jnp.ones_like(w))
        plane, key = lax.complex(x / safe, y / safe), jnp.where(ahead, -1 / safe, beyond)
    cell = None
    if not isinstance(grid.plane_map, Box):
        position = grid.plane_map.forward(jnp.stack([plane.real, plane.imag], axis=-1)) * grid.resolution
        sides = _sides(grid.plane_map, x.dtype)
        inside = key < beyond
        for a, b, c in sides:
            inside &= a * plane.real + b * plane.imag + c >= 0
        cell = lax.complex(jnp.where(inside, position[:, 0], beyond), position[:, 1])
    # One copy of each in memory: otherwise every gather computes the projection again.
    made = lax.optimization_barrier(Vertices(x, y, w, plane, cell, key))
    return made, nearest


def _region(plane_map: PlaneMap, dtype: Any) -> Float[Array, "4 2"]:
    """Plane positions of the corners of the unit square, in order round it."""
    return plane_map.inverse(jnp.asarray([[0, 0], [1, 0], [1, 1], [0, 1]], dtype))


def _sides(plane_map: PlaneMap, dtype: Any) -> Float[Array, "4 3"]:
    """Lines (a, b, c) with a u + b v + c ≥ 0 inside the region, which has straight sides, and unit (a, b)."""
    corners = _region(plane_map, dtype)
    middle = jnp.mean(corners, axis=0)
    following = jnp.roll(corners, -1, axis=0)
    a, b = corners[:, 1] - following[:, 1], following[:, 0] - corners[:, 0]
    # Offsets from a corner on the line, not the cross product of two positions, which cancels far from the origin.
    c = -(a * corners[:, 0] + b * corners[:, 1])
    towards = a * (middle[0] - corners[:, 0]) + b * (middle[1] - corners[:, 1])
    length = jnp.sqrt(a * a + b * b)
    scale = jnp.where(towards < 0, -1.0, 1.0).astype(length.dtype) / jnp.where(length > 0, length, 1.0)
    return jnp.stack([a * scale, b * scale, c * scale], axis=-1)


def view(grid: RayGrid, nearest: Scalar) -> View:
    """Tables of the grid: plane coordinates and far limit of every cell, the region's sides, the rounding of a cell."""
    dtype = grid.far.dtype
    plane_map, rows, cols = grid.plane_map, grid.num_rows, grid.num_cols
    if isinstance(plane_map, Box):
        s = (jnp.arange(cols, dtype=dtype) + 0.5) / cols
        t = (jnp.arange(rows, dtype=dtype) + 0.5) / rows
        size = plane_map.upper - plane_map.lower
        u, v = plane_map.lower[0] + s * size[0], plane_map.lower[1] + t * size[1]
        squared = u[None, :] ** 2 + v[:, None] ** 2
    else:
        plane = plane_map.inverse(grid.centres())
        u, v = plane[..., 0], plane[..., 1]
        squared = u**2 + v**2
    if isinstance(grid.space, DirectionalSpace):
        start = jnp.broadcast_to(grid.far, (rows, cols))
    else:
        start = -jnp.sqrt(1 + squared) / grid.far
    # A hit exactly at the limit counts: start a few roundings beyond it.
    start = start + 4 * jnp.finfo(dtype).eps * jnp.abs(start)
    corners = _region(plane_map, dtype)
    near_side = jnp.stack([jnp.zeros((), dtype), jnp.zeros((), dtype), jnp.ones((), dtype)])
    sides = jnp.concatenate([_sides(plane_map, dtype), near_side[None]])
    extent = jnp.max(corners, axis=0) - jnp.min(corners, axis=0)
    away = jnp.max(jnp.abs(corners), axis=0) / jnp.where(extent > 0, extent, 1.0)
    margin = jnp.finfo(dtype).eps * grid.resolution * (16 + 16 * away)
    return lax.stop_gradient(View(u, v, start, sides, corners, nearest, margin))


def depth_of_key(grid: RayGrid, table: View, key: Float[Array, "rows cols"]) -> Float[Array, "rows cols"]:
    """Distance along each cell's unit ray from the key of its nearest hit; `far` where nothing came nearer."""
    missed = key >= table.start
    if isinstance(grid.space, DirectionalSpace):
        return jnp.where(missed, grid.far, key)
    u, v = (table.u[None, :], table.v[:, None]) if table.u.ndim == 1 else (table.u, table.v)
    along = jnp.sqrt(1 + u * u + v * v)
    return jnp.where(missed, grid.far, along / jnp.where(missed, 1.0, -key))


def lowest(values: Triple) -> Array:
    """The least of three arrays."""
    return jnp.minimum(jnp.minimum(values[0], values[1]), values[2])


def highest(values: Triple) -> Array:
    """The greatest of three arrays."""
    return jnp.maximum(jnp.maximum(values[0], values[1]), values[2])


def span(low: Array, high: Array, margin: Scalar, count: int) -> tuple[Int[Array, "..."], Int[Array, "..."]]:
    """First and last cell whose centre lies between two grid positions; first > last if there is none."""
    first = jnp.clip(jnp.ceil(low - 0.5 - margin), 0, count)
    last = jnp.clip(jnp.floor(high - 0.5 + margin), -1, count - 1)
    return first.astype(jnp.int32), last.astype(jnp.int32)


def slopes(x: Triple, y: Triple, key: Triple, determinant: Array) -> tuple[Array, Array]:
    """Derivative of the key along u and v over a triangle; 0 where the determinant is."""
    inverse = jnp.where(determinant == 0, 0.0, 1 / jnp.where(determinant == 0, 1.0, determinant))
    first, second = key[1] - key[0], key[2] - key[0]
    along_u = (first * (y[2] - y[0]) - second * (y[1] - y[0])) * inverse
    along_v = (second * (x[1] - x[0]) - first * (x[2] - x[0])) * inverse
    return along_u, along_v
