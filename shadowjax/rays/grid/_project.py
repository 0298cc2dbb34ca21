"""A grid's view of a mesh: vertices on its plane, keys that order hits, the cells a vertex bounds, tables of cells."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import jax.numpy as jnp
from jax import lax

from shadowjax._types import Array, Float, Int, Scalar
from shadowjax.geometry.light_space import LightSpace
from shadowjax.rays.plane_map import affine_box, region_corners, region_sides
from shadowjax.rays.ray_grid import RayGrid

# Nearest w that a perspective view divides by, in units of the depth up to which a view sees.
NEAREST = 1e-6

# Rows of a vertex's bounds: first and last column, first and last row that a triangle with this corner may touch.
FIRST_COL, LAST_COL, FIRST_ROW, LAST_ROW = range(4)


def miss_key(dtype: Any) -> float:
    """A key beyond every hit, finite."""
    return float(jnp.finfo(dtype).max) / 4


class Vertices(NamedTuple):
    """Vertices in the coordinates of a view.

    Attributes:
        plane: Rows u, v and key. The key orders hits along a ray and is affine over a triangle on the plane: depth for
            parallel rays, −1/w for rays through a point; `miss_key` for a vertex at or behind that point.
        bounds: Rows of the cells that a triangle's box is made of, see `FIRST_COL`. The box of a triangle is the least
            first and the largest last of its corners. A corner that needs the general test (before the start of the
            rays, or where the plane map is not regular) has `general_mark` as its firsts; one before the start also as
            its lasts, which shows triangles that lie wholly there.
    """

    plane: Float[Array, "3 vertices"]
    bounds: Int[Array, "4 vertices"]


class View(NamedTuple):
    """What the caster knows about a grid before it looks at triangles.

    Attributes:
        u, v: Plane coordinates of the cells' centres: (cols,) and (rows,) for an affine map, else (rows, cols).
        start: Key of the far limit at every cell, (rows, cols).
        sides: Half-spaces of (x, y, w) that hold the grid's region, with w ≥ `nearest` as the last.
        corners: Plane positions of the region's corners, (4, 2).
        nearest: Smallest w that is divided by; 1 for parallel rays.
        least: Smallest w that counts: where the rays start.
        margin: Rounding of a grid position, cells, along columns and rows.
    """

    u: Array
    v: Array
    start: Float[Array, "rows cols"]
    sides: Float[Array, "5 3"]
    corners: Float[Array, "4 2"]
    nearest: Scalar
    least: Scalar
    margin: Float[Array, "2"]


def bounds_dtype(grid: RayGrid) -> Any:
    """Integers that hold every index of a cell: short ones halve what the loops read."""
    return jnp.int16 if max(grid.num_rows, grid.num_cols) < 2**15 - 2 else jnp.int32


def general_mark(dtype: Any) -> int:
    """The first cell of a corner that needs the general test."""
    return int(jnp.iinfo(dtype).min)


def project(grid: RayGrid, vertices: Float[Array, "vertices 3"]) -> Float[Array, "3 vertices"]:
    """Rows x, y, w of vertices: at (x/w, y/w) on the plane; for parallel rays, at (x, y), and w is depth."""
    return jnp.stack(coordinates(grid.space, [vertices[:, axis] for axis in range(3)]))


def coordinates(space: LightSpace, points: Sequence[Float[Array, "n"]]) -> tuple[Array, Array, Array]:
    """As `project`, of points given as three arrays x, y, z.

    Sums are written out: a matrix product is slower here and may run at a lower precision on an accelerator.
    """
    origin = space.source
    offset = [points[axis] - origin[axis] for axis in range(3)]
    x, y, w = (offset[0] * row[0] + offset[1] * row[1] + offset[2] * row[2] for row in space.rows)
    return x, y, w


def place(grid: RayGrid, table: View, vertices: Float[Array, "vertices 3"]) -> Vertices:
    """Plane positions, keys and bounds of vertices."""
    projected = project(grid, vertices)
    x, y, w = projected
    beyond = miss_key(x.dtype)
    if grid.space.is_parallel:
        plane, ahead = projected, w >= table.least
    else:
        ahead = w >= table.nearest
        safe = jnp.where(ahead, w, jnp.ones_like(w))
        plane = jnp.stack([x / safe, y / safe, jnp.where(ahead, -1 / safe, beyond)])
    box = affine_box(grid.plane_map)
    if box is not None:
        scale = grid.resolution / (box.upper - box.lower)
        col, row = (plane[0] - box.lower[0]) * scale[0], (plane[1] - box.lower[1]) * scale[1]
        regular = ahead
    else:
        at = jnp.stack([plane[0], plane[1]], axis=-1)
        cell = grid.plane_map.forward(at) * grid.resolution
        col, row = cell[:, 0], cell[:, 1]
        regular = ahead & grid.plane_map.regular(at)
    dtype = bounds_dtype(grid)
    mark = jnp.asarray(general_mark(dtype), dtype)

    def ends(position: Array, margin: Scalar, count: int) -> tuple[Array, Array]:
        # Cell i has its centre at i + ½: the first centre at or after a position is ⌈p − ½⌉, the last at or before it
        # ⌊p − ½⌋.
        first = jnp.clip(jnp.ceil(position - 0.5 - margin), 0, count).astype(dtype)
        last = jnp.clip(jnp.floor(position - 0.5 + margin), -1, count - 1).astype(dtype)
        return jnp.where(regular, first, mark), jnp.where(ahead, last, mark)

    bounds = jnp.stack([*ends(col, table.margin[0], grid.num_cols), *ends(row, table.margin[1], grid.num_rows)])
    # One copy of each in memory: otherwise every read computes the projection again.
    return lax.optimization_barrier(Vertices(plane, bounds))


def view(grid: RayGrid) -> View:
    """Tables of the grid: plane coordinates and far limit of every cell, the region's sides, the rounding of a cell."""
    dtype = grid.far.dtype
    plane_map, rows, cols = grid.plane_map, grid.num_rows, grid.num_cols
    if affine_box(plane_map) is not None:
        s = (jnp.arange(cols, dtype=dtype) + 0.5) / cols
        t = (jnp.arange(rows, dtype=dtype) + 0.5) / rows
        u = plane_map.inverse(jnp.stack([s, jnp.zeros_like(s)], axis=-1))[:, 0]
        v = plane_map.inverse(jnp.stack([jnp.zeros_like(t), t], axis=-1))[:, 1]
        squared = u[None, :] ** 2 + v[:, None] ** 2
    else:
        plane = plane_map.inverse(grid.centres())
        u, v = plane[..., 0], plane[..., 1]
        squared = u**2 + v**2
    parallel = grid.space.is_parallel
    # At distance far along the ray w = far/|(u, v, 1)|, so the key −1/w is −|(u, v, 1)|/far.
    start = jnp.broadcast_to(grid.far, (rows, cols)) if parallel else -jnp.sqrt(1 + squared) / grid.far
    # A hit exactly at the limit counts: start a few roundings beyond it.
    start = start + 4 * jnp.finfo(dtype).eps * jnp.abs(start)
    # The region's four sides and w ≥ nearest: five half-spaces of homogeneous plane coordinates.
    corners = region_corners(plane_map, dtype)
    near_side = jnp.stack([jnp.zeros((), dtype), jnp.zeros((), dtype), jnp.ones((), dtype)])
    sides = jnp.concatenate([region_sides(corners), near_side[None]])
    extent = jnp.max(corners, axis=0) - jnp.min(corners, axis=0)
    away = jnp.max(jnp.abs(corners), axis=0) / jnp.where(extent > 0, extent, 1.0)
    margin = jnp.finfo(dtype).eps * grid.resolution * (16 + 16 * away)
    parallel = grid.space.is_parallel
    nearest = jnp.ones((), dtype) if parallel else NEAREST * grid.seen_or_far + jnp.finfo(dtype).tiny
    least = jnp.zeros((), dtype) if parallel else nearest
    return lax.stop_gradient(View(u, v, start, sides, corners, nearest, least, margin))


def depth_of_key(grid: RayGrid, table: View, key: Float[Array, "rows cols"]) -> Float[Array, "rows cols"]:
    """Distance along each cell's unit ray from the key of its nearest hit; `far` where nothing came nearer."""
    missed = key >= table.start
    if grid.space.is_parallel:
        return jnp.where(missed, grid.far, key)
    return jnp.where(missed, grid.far, _along(table) / jnp.where(missed, 1.0, -key))


def key_of_depth(grid: RayGrid, table: View, depth: Float[Array, "rows cols"]) -> Float[Array, "rows cols"]:
    """Key of a distance along each cell's unit ray: the inverse of `depth_of_key`; finite, also at no distance."""
    if grid.space.is_parallel:
        return depth
    along = _along(table)
    # Nearer than half of the nearest w lies no hit.
    return -along / jnp.maximum(depth, 0.5 * table.nearest * along)


def _along(table: View) -> Float[Array, "rows cols"]:
    """Distance along each cell's ray for a unit of w, for rays through a point."""
    u, v = (table.u[None, :], table.v[:, None]) if table.u.ndim == 1 else (table.u, table.v)
    return jnp.sqrt(1 + u * u + v * v)
