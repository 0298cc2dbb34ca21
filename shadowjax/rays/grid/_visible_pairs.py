"""The exact shadow test for an accelerator: pairs of triangle and line of points in windows of one size."""

import jax.numpy as jnp
from jax import lax

from shadowjax._types import Array, Bool, Float, Int
from shadowjax.geometry.light_space import LightSpace
from shadowjax.geometry.mesh import Mesh
from shadowjax.rays.grid._general import LEAST_KEY
from shadowjax.rays.grid._pairs import CHUNK, WINDOW, owners, set_up_chunk
from shadowjax.rays.grid._project import place
from shadowjax.rays.grid._shadow_queries import (
    LANES,
    SPAN,
    ShadowQueries,
    blocked_key,
    box_around,
    cell_counts,
    cells_of,
    touching,
    widened,
)
from shadowjax.rays.grid._tiles import general_test
from shadowjax.rays.ray_grid import RayGrid

# Runs of lines that are counted together. A run is what one row of cells holds of a triangle's box.
RUNS = 1 << 15


def blocked_by_pairs(
    mesh: Mesh, space: LightSpace, asked: ShadowQueries, far: Float[Array, ""]
) -> Bool[Array, "parts points"]:
    """Whether a triangle meets the ray of each point before its limit; never for points that do not count.

    As the loops of `_visible`, without loops over points or triangles. Points are sorted by their cells into lines
    of `LANES`. Every triangle takes the general test, with the lines of the cells that its box touches. The runs of a
    chunk of triangles are counted, then the pairs of triangle and line of a window of runs, and windows follow until
    all are done, so nothing can overflow.
    """
    return lax.map(lambda numbers: _part(mesh, space, numbers, far), asked)


def _part(
    mesh: Mesh, space: LightSpace, numbers: tuple[Array, Array, Array], far: Float[Array, ""]
) -> Bool[Array, "points"]:
    u, v, limit = numbers
    dtype, num_points = limit.dtype, limit.size
    shape = cell_counts(num_points)
    counts = limit > blocked_key(dtype)
    most = jnp.asarray(jnp.finfo(dtype).max, dtype)
    lowest, highest = (
        jnp.stack([better(jnp.where(counts, x, worst)) for x in (u, v)])
        for better, worst in ((jnp.min, most), (jnp.max, -most))
    )
    box = box_around(lowest, highest)
    cell = cells_of(box, shape, u, v, limit)
    # Sorted by cell, so that each cell's points are the range begin[cell] … begin[cell + 1].
    order = jnp.argsort(cell)
    num_cells = shape[0] * shape[1]
    begin = jnp.searchsorted(cell[order], jnp.arange(num_cells + 1, dtype=jnp.uint32)).astype(jnp.int32)
    reach = jnp.full(num_cells + 1, blocked_key(dtype)).at[cell].max(limit)
    reach = widened(reach[:-1].reshape(shape))
    spare = -num_points % LANES

    # Those added have no limit that a key reaches.
    lines = tuple(
        jnp.pad(x[order], (0, spare), constant_values=value).reshape(-1, LANES)
        for x, value in ((u, 0), (v, 0), (limit, blocked_key(dtype)))
    )
    hits = _hits(mesh, RayGrid(space, box, far, *shape), begin, reach, lines)
    return jnp.zeros(num_points, bool).at[order].set(hits.reshape(-1)[:num_points] > 0)


def _hits(
    mesh: Mesh,
    grid: RayGrid,
    begin: Int[Array, "cells_and_1"],
    reach: Float[Array, "rows cols"],
    lines: tuple[Array, ...],
) -> Int[Array, "lines lanes"]:
    """1 for every point of the lines that some triangle blocks."""
    table = touching(grid)
    vertices = place(grid, table, mesh.vertices)
    num_faces, num_lines = mesh.num_faces, lines[0].shape[0]
    size = min(CHUNK, num_faces)
    # The pairs of a window of runs are counted in 32 bits.
    num_runs = max(min(RUNS, (2**31 - 1) // num_lines), 1)

    def add_chunk(k: Array, hits: Array) -> Array:
        _, made, holds = set_up_chunk(grid, table, mesh, vertices, k, size, held_back=True)
        first_row, last_row, first_col, last_col = made.cells
        row, col = (jnp.where(holds, x, 0) for x in (first_row, first_col))
        # Behind all points around its box a triangle blocks none.
        small = (last_row - first_row < SPAN) & (last_col - first_col < SPAN)
        shows = holds & ~(small & (made.numbers[LEAST_KEY] > reach[row, col]))
        ends = jnp.cumsum(jnp.where(shows, last_row - first_row + 1, 0), dtype=jnp.int32)

        def add_runs(j: Array, hits: Array) -> Array:
            run = j * num_runs + jnp.arange(num_runs, dtype=jnp.int32)
            triangle, within = owners(ends, run)
            start = (first_row[triangle] + within) * grid.num_cols
            present = run < ends[-1]
            bounds = (jnp.where(present, start + x, 0) for x in (first_col[triangle], last_col[triangle] + 1))
            from_point, to_point = (begin[x] for x in bounds)
            first_line = from_point // LANES
            # Lines that a run of points touches, the first and the last in part.
            count = jnp.where(present & (to_point > from_point), (to_point - 1) // LANES - first_line + 1, 0)
            lines_end = jnp.cumsum(count, dtype=jnp.int32)

            def add_pairs(i: Array, hits: Array) -> Array:
                pair = i * WINDOW + jnp.arange(WINDOW, dtype=jnp.int32)
                owner, within = owners(lines_end, pair)
                present = pair < lines_end[-1]
                line = jnp.where(present, first_line[owner] + within, 0)
                u, v, limit = (x[line] for x in lines)
                keys, inside = general_test(list(made.numbers[:, triangle[owner], None]), u, v)
                hit = inside & (keys <= limit) & present[:, None]
                # Several triangles may share a line: the largest of 0 and 1 is their union, in any order.
                return hits.at[line].max(hit.astype(jnp.int32))

            return lax.fori_loop(jnp.int32(0), -(-lines_end[-1] // WINDOW), add_pairs, hits)

        return lax.fori_loop(jnp.int32(0), -(-ends[-1] // num_runs), add_runs, hits)

    hits = jnp.zeros((num_lines, LANES), jnp.int32)
    return lax.fori_loop(jnp.int32(0), jnp.int32(-(-num_faces // size)), add_chunk, hits)
