"""Points as the rays of one light: their places on its plane, the keys at which they end, the cells they lie in."""

from typing import Any

import jax.numpy as jnp
from jax import lax

from shadowjax._numerics import FACING_ROUNDINGS
from shadowjax._types import Array, Bool, Float, UInt
from shadowjax.geometry.light_space import LEAST_FORWARD, LightSpace
from shadowjax.rays.caster import RECEIVER_ROUNDINGS
from shadowjax.rays.grid._project import View, coordinates, miss_key, view
from shadowjax.rays.grid._tiles import more
from shadowjax.rays.plane_map import Box
from shadowjax.rays.ray_grid import RayGrid

# Points that are tested together, and the points that a cell holds on average.
LANES, FILL = 16, 4
# Points that speak for all of them: where they are, how near to the light.
SAMPLES = 255
# The most cells along a side.
MOST_CELLS = 1024
# Cells along the sides of a box, at most, for a triangle to be compared with all points in it at once.
SPAN = 8

# Points as rays of the light, in parts: u, v, and the key at which each ends.
ShadowQueries = tuple[Float[Array, "parts points"], Float[Array, "parts points"], Float[Array, "parts points"]]


def blocked_key(dtype: Any) -> Array:
    """The limit of a point that nothing can block, or that is blocked already: below every key."""
    return jnp.asarray(-jnp.finfo(dtype).max, dtype)


def project(
    space: LightSpace, points: Float[Array, "given 3"], normals: Array | None, num_parts: int, multiple: int
) -> tuple[ShadowQueries, Bool[Array, "parts points"], Float[Array, ""]]:
    """The rays of points: `caster.shadow_rays` on the light's plane, without an array of three numbers a point.

    Args:
        space: All rays of one light, which map straight lines to straight lines.
        points: Where light may arrive.
        normals: Their unit normals; None for points that face the light.
        num_parts: Parts that the points are cut into.
        multiple: Points of a part are a multiple of it; those added block nothing and do not face the light.

    Returns:
        Place on the light's plane and key at which the ray ends, `blocked_key` where no triangle may block it: such
        points face away or lie behind the light. Which face the light. And the least distance of some points along the
        view of the light: the `far` of a grid, which does not see what is nearer than a millionth of it.
    """
    parts = [points[:, axis] for axis in range(3)]
    if space.is_parallel:
        towards = [jnp.broadcast_to(x, parts[0].shape) for x in -space.rows[2]]
    else:
        towards = [space.source[axis] - part for axis, part in enumerate(parts)]
    if normals is None:
        away = jnp.sqrt(towards[0] * towards[0] + towards[1] * towards[1] + towards[2] * towards[2])
        side = [part / jnp.where(away > 0, away, jnp.ones_like(away)) for part in towards]
    else:
        side = [normals[:, axis] for axis in range(3)]
    # `faces_light` for a direction of any length.
    cosine = towards[0] * side[0] + towards[1] * side[1] + towards[2] * side[2]
    length = jnp.sqrt(towards[0] * towards[0] + towards[1] * towards[1] + towards[2] * towards[2])
    facing = cosine > FACING_ROUNDINGS * float(jnp.finfo(points.dtype).eps) * length
    off = [jnp.abs(part * raised) for part, raised in zip(parts, side, strict=True)]
    gap = RECEIVER_ROUNDINGS * jnp.finfo(points.dtype).eps * (off[0] + off[1] + off[2])
    x, y, w = coordinates(space, [part + gap * raised for part, raised in zip(parts, side, strict=True)])
    nearest = jnp.ones_like(w[0])
    if space.is_parallel:
        u, v, limit, counts = x, y, w, facing
    else:
        # The sums once, not in each of what follows: it would keep other steps in memory.
        x, y, w, facing = lax.optimization_barrier((x, y, w, facing))
        away = jnp.sqrt(x * x + y * y + w * w)
        reached = w > LEAST_FORWARD * away
        safe = jnp.where(reached, w, jnp.ones_like(w))
        u, v, limit, counts = x / safe, y / safe, -1 / safe, facing & reached
        some, known = (x[:: -(-x.size // SAMPLES)] for x in (w, counts))
        farthest = jnp.max(jnp.where(known, some, jnp.zeros_like(some)))
        nearest = jnp.min(jnp.where(known, some, jnp.full_like(some, jnp.finfo(w.dtype).max)))
        # A point at the light itself must not make its plane so wide that products leave the range of numbers.
        nearest = jnp.clip(nearest, 1e-6 * farthest, jnp.where(farthest > 0, farthest, 1.0))
    limit = jnp.where(counts, limit, blocked_key(limit.dtype))
    length = -(-max(u.size, 1) // (num_parts * multiple)) * multiple

    def split(x: Array, spare: Any) -> Array:
        return jnp.pad(x, (0, num_parts * length - x.size), constant_values=spare).reshape(num_parts, length)

    u, v, limit, facing = split(u, 0), split(v, 0), split(limit, blocked_key(limit.dtype)), split(facing, False)
    # One copy in memory: otherwise every loop that reads them computes the projection again.
    return *lax.optimization_barrier(((u, v, limit), facing)), nearest


def cell_counts(num_points: int) -> tuple[int, int]:
    """Rows and columns of cells for that many points: more columns, since the points of a row are tested in one run."""
    num_cells = max(num_points // FILL, 1)
    rows, cols = (min(MOST_CELLS, 1 << ((num_cells.bit_length() - k) // 2)) for k in (1, 0))
    return rows, cols


def box_around(lowest: Float[Array, "2"], highest: Float[Array, "2"]) -> Box:
    """A box that holds places between two corners, none on its border, with no side of 0; any if there are none."""
    dtype = lowest.dtype
    some = lowest <= highest
    lowest, highest = jnp.where(some, lowest, 0.0), jnp.where(some, highest, 1.0)
    wider = 1e-3 * (highest - lowest) + 1e-6 * (jnp.abs(lowest) + jnp.abs(highest)) + jnp.finfo(dtype).tiny ** 0.25
    return Box(lowest - wider, highest + wider)


def cells_of(
    box: Box,
    shape: tuple[int, int],
    u: Float[Array, "points"],
    v: Float[Array, "points"],
    limit: Float[Array, "points"],
) -> UInt[Array, "points"]:
    """The cell of each point, row after row; those that nothing can block have one of their own beyond the last."""
    rows, cols = shape
    scale = jnp.asarray([cols, rows], u.dtype) / (box.upper - box.lower)
    col, row = (
        jnp.clip(jnp.floor((x - box.lower[axis]) * scale[axis]), 0, (cols, rows)[axis] - 1)
        for axis, x in enumerate((u, v))
    )
    cell = row.astype(jnp.uint32) * jnp.uint32(cols) + col.astype(jnp.uint32)
    return lax.optimization_barrier(jnp.where(limit > blocked_key(limit.dtype), cell, jnp.uint32(rows * cols)))


def touching(grid: RayGrid) -> View:
    """A grid's view in which a triangle's box holds every cell that it touches, not only those with their centres.

    Parallel rays have no start there: whatever lies on the way to the light blocks it.
    """
    table = view(grid)
    parallel = grid.space.is_parallel
    least = jnp.full_like(table.least, -miss_key(table.least.dtype)) if parallel else table.least
    return table._replace(margin=table.margin + 0.5, least=least)


def widened(most: Float[Array, "rows cols"]) -> Float[Array, "rows cols"]:
    """The greatest of each cell and of the next `SPAN` - 1 to its right and below."""
    none = blocked_key(most.dtype)
    for axis in range(2):
        shift = 1
        # Windows double: the greatest of 2k cells is the greater of two of k, so SPAN cells take log₂ SPAN steps.
        while shift < min(SPAN, most.shape[axis]):
            pads = [(0, shift) if k == axis else (0, 0) for k in range(2)]
            rest = jnp.pad(lax.slice_in_dim(most, shift, None, axis=axis), pads, constant_values=none)
            most, shift = more(most, rest), 2 * shift
    return lax.optimization_barrier(most)
