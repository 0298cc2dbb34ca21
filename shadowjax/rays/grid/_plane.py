"""How depth changes with vertices on triangles already chosen, from the planes of the triangles."""

import jax
import jax.numpy as jnp
from jax import lax

from shadowjax._numerics import safe_divide
from shadowjax._types import Array, Float, Int
from shadowjax.geometry.mesh import Mesh
from shadowjax.rays.grid._project import View, project
from shadowjax.rays.ray_grid import RayGrid


def depth_tangent(
    grid: RayGrid,
    table: View,
    mesh: Mesh,
    change: Float[Array, "vertices 3"],
    depth: Float[Array, "rows cols"],
    face: Int[Array, "rows cols"],
) -> Float[Array, "rows cols"]:
    """Derivative of the depth of every cell as vertices move, at fixed triangles; 0 for a miss.

    On the plane of the grid, depth (for parallel rays) or 1/w (for rays through a point) is affine over a triangle.
    Its value and two slopes are computed once a triangle, so that the transpose adds up three numbers a cell for each
    triangle, where that of `ray.intersect` adds up nine. The derivative is the same.

    Args:
        grid: The rays, which stay.
        table: The grid's view.
        mesh: Where the vertices are.
        change: How fast they move.
        depth: Of every cell.
        face: Triangle of each cell, −1 for a miss.
    """
    index = jnp.where(face < 0, 0, face)
    # With more triangles than cells most are not seen: then a plane for each cell is less work.
    by_cell = mesh.num_faces > face.size
    faces = mesh.faces[index.reshape(-1)] if by_cell else mesh.faces
    (_, slopes) = jax.jvp(lambda vertices: _planes(grid, table, vertices, faces), (mesh.vertices,), (change,))
    (_, _, _, at_u, at_v) = _planes(grid, table, mesh.vertices, faces)
    # One copy in memory: otherwise every cell would compute the plane of its triangle again.
    value, along_u, along_v = lax.optimization_barrier(slopes[:3])
    at_u, at_v = lax.optimization_barrier((at_u, at_v))
    value, along_u, along_v, at_u, at_v = (
        part.reshape(face.shape) if by_cell else part.at[index].get(mode="promise_in_bounds")
        for part in (value, along_u, along_v, at_u, at_v)
    )
    u, v = (table.u[None, :], table.v[:, None]) if table.u.ndim == 1 else (table.u, table.v)
    total = value + along_u * (u - at_u) + along_v * (v - at_v)
    if not grid.space.is_parallel:
        # depth = |(u, v, 1)| · w, and total is the change of 1/w
        total = -total * depth * depth / jnp.sqrt(1 + u * u + v * v)
    return jnp.where(face < 0, jnp.zeros_like(total), total)


def _planes(
    grid: RayGrid, table: View, vertices: Float[Array, "vertices 3"], faces: Int[Array, "faces 3"]
) -> tuple[Array, Array, Array, Array, Array]:
    """For each triangle the key's value at a place on the plane, its slopes along u and v, and the place."""
    corners = [project(grid, vertices[faces[:, k]]) for k in range(3)]
    first, second = corners[1] - corners[0], corners[2] - corners[0]
    # Plane of the triangle in (x, y, w). Parallel: w is depth, with slopes −n_x/n_w and −n_y/n_w. From a point: 1/w =
    # (n_x·u + n_y·v + n_w)/(n·corner).
    normal = jnp.stack([
        first[1] * second[2] - first[2] * second[1],
        first[2] * second[0] - first[0] * second[2],
        first[0] * second[1] - first[1] * second[0],
    ])  # fmt: skip
    parallel = grid.space.is_parallel
    x, y, w = corners[0]
    # A place on the plane near the triangle, from which offsets are small; constant, so it has no share in derivatives.
    ahead = parallel | (w >= table.nearest)
    scale = jnp.ones_like(w) if parallel else jnp.where(ahead, w, jnp.ones_like(w))
    at_u, at_v = lax.stop_gradient((jnp.where(ahead, x / scale, 0.0), jnp.where(ahead, y / scale, 0.0)))
    if parallel:
        along_u, along_v = -safe_divide(normal[0], normal[2]), -safe_divide(normal[1], normal[2])
        value = w + along_u * (at_u - x) + along_v * (at_v - y)
    else:
        height = normal[0] * x + normal[1] * y + normal[2] * w
        along_u, along_v = safe_divide(normal[0], height), safe_divide(normal[1], height)
        value = safe_divide(normal[0] * at_u + normal[1] * at_v + normal[2], height)
    return value, along_u, along_v, at_u, at_v
