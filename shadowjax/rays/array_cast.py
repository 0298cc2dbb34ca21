"""Depth of any rays from arrays alone; rays that lie on a grid, as those of a map do, are drawn instead of traced."""

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from shadowjax._checked import checked
from shadowjax._checks import concrete, require
from shadowjax._numerics import dot, norm, one_by_one, safe_divide
from shadowjax._types import Array, Bool, Float, Int, Points, Scalar, ScalarLike
from shadowjax.geometry.light_space import DirectionalSpace
from shadowjax.geometry.mesh import Mesh
from shadowjax.rays.grid.caster import GridCaster
from shadowjax.rays.plane_map import Box
from shadowjax.rays.ray import Rays, intersect
from shadowjax.rays.ray_grid import RayGrid

# How far rays may lie from a grid to count as its rays, in roundings: of unit directions, and of the farthest origin.
GRID_ROUNDINGS = 16.0
# A direction whose length is off by no more roundings is of unit length already.
UNIT_ROUNDINGS = 4.0


@checked
def cast_depth(
    vertices: Float[Array, "vertices 3"],
    faces: Int[Array, "faces 3"],
    origins: Points,
    directions: Points,
    far: ScalarLike | None = None,
) -> Float[Array, "*points"]:
    """Distance along each ray to the first triangle.

    Parallel rays in the order of a grid, (rows, cols, 3), as `map_rays` makes them, are drawn, which takes time by
    triangles and covered cells; all others are traced, by a tree where that pays. Which of both is decided by the
    numbers, also while they are traced by JAX.

    Args:
        vertices: Positions, world units.
        faces: Indices of each triangle's corners.
        origins: Start of each ray.
        directions: Direction of each ray, of any nonzero length.
        far: Distance that a miss reports, world units, > 0; one beyond the mesh for every ray if None.

    Returns:
        Distances, finite. Differentiable, forward and reverse, in vertices, origins and directions at fixed visibility
        (`rays.intersect`); a miss has gradient 0 but in a given `far`.

    Raises:
        ValueError: If a direction is zero.
    """
    known = concrete(directions)
    good = known is None or bool(np.all(np.any(known, axis=-1)))
    require(good, "a ray direction must not be the zero vector")
    mesh = Mesh(vertices, faces, jnp.zeros(faces.shape, vertices.dtype))
    rays = _limited(mesh, origins, directions, None if far is None else jnp.asarray(far, origins.dtype))
    return intersect(mesh, rays, _first_faces(*lax.stop_gradient((mesh, rays)))).depth


@jax.jit
def _limited(mesh: Mesh, origins: Points, directions: Points, far: Scalar | None) -> Rays:
    """Rays of unit direction that end at `far`."""
    length = norm(directions)
    # What is of unit length keeps every digit, so that depth is that of the very rays of a map.
    exact = jnp.abs(length - 1) <= UNIT_ROUNDINGS * jnp.finfo(length.dtype).eps
    directions = safe_divide(directions, jnp.where(exact, jnp.ones_like(length), length)[..., None])
    limit = lax.stop_gradient(_beyond(mesh, origins, directions)) if far is None else far
    return Rays(origins, directions, jnp.zeros((), origins.dtype), limit)


def _beyond(mesh: Mesh, origins: Points, directions: Points) -> Scalar:
    """A distance beyond every point of a mesh along every ray: half its extent behind its middle, and a quarter more.

    For the map of a box around the mesh it is the far limit of `RayGrid`.
    """
    lower, upper = mesh.bounds()
    return jnp.maximum(jnp.max(dot(0.5 * (lower + upper) - origins, directions)), 0.0) + 0.75 * mesh.extent


def _first_faces(mesh: Mesh, rays: Rays) -> Int[Array, "*points"]:
    """Triangle that each ray meets first, −1 for none."""
    shape = rays.shape
    if len(shape) != 2 or min(shape) < 2:
        return _traced(mesh, rays)
    grid, is_grid = _grid_of(rays)
    known = concrete(is_grid)
    if known is not None:
        return _drawn(mesh, grid) if known else _traced(mesh, rays)

    @one_by_one
    def either(mesh: Mesh, rays: Rays, grid: RayGrid, is_grid: Bool[Array, ""]) -> Int[Array, "*points"]:
        return lax.cond(is_grid, lambda: _drawn(mesh, grid), lambda: _traced(mesh, rays))

    return either(mesh, rays, grid, is_grid)


def _traced(mesh: Mesh, rays: Rays) -> Int[Array, "*points"]:
    return GridCaster().closest(mesh, rays).face


@jax.jit
def _drawn(mesh: Mesh, grid: RayGrid) -> Int[Array, "rows cols"]:
    return GridCaster().closest_on_grid(mesh, grid).face


@jax.jit
def _grid_of(rays: Rays) -> tuple[RayGrid, Bool[Array, ""]]:
    """The grid on a plane across parallel rays that their first row and column span, and whether it holds all of them.

    Args:
        rays: (rows, cols) of unit direction, at least 2 × 2.
    """
    num_rows, num_cols = rays.shape
    # The barrier keeps a compiler from working out the whole picture where the directions are known to it.
    origins, directions = lax.optimization_barrier((rays.origins, rays.directions))
    direction = directions[0, 0]
    start, across, down = origins[0, 0], origins[0, -1] - origins[0, 0], origins[-1, 0] - origins[0, 0]
    eps = GRID_ROUNDINGS * jnp.finfo(origins.dtype).eps
    rounding = eps * jnp.max(jnp.abs(origins))
    # The grid that first row and column span; a true grid of rays is off it by roundings only, in origin, direction and
    # right angles.
    width, height = norm(across), norm(down)
    col, row = (jnp.arange(size, dtype=origins.dtype) / (size - 1) for size in (num_cols, num_rows))
    expected = start + col[:, None] * across + row[:, None, None] * down
    is_grid = (
        (jnp.max(jnp.abs(directions - direction)) <= eps)
        & (jnp.max(jnp.abs(origins - expected)) <= rounding)
        & (jnp.maximum(jnp.abs(dot(across, direction)), jnp.abs(dot(down, direction))) <= rounding)
        & (jnp.abs(dot(across, down)) <= rounding * (width + height))
        & (jnp.minimum(width, height) > rounding)
    )
    x = across - dot(across, direction) * direction
    x = safe_divide(x, norm(x))
    # x, −direction and z complete a right-handed frame; a grid that runs the other way has a negative side.
    z = jnp.cross(x, -direction)
    size = jnp.stack([dot(across, x), dot(down, z)])
    cell = size / jnp.asarray([num_cols - 1, num_rows - 1], size.dtype)
    # Where rays are no grid the numbers do not count, but they must be numbers.
    cell = jnp.where(cell == 0, jnp.ones_like(cell), cell)
    space = DirectionalSpace(start, jnp.stack([x, -direction, z]))
    box = Box(-0.5 * cell, size + 0.5 * cell)
    return RayGrid(space, box, jnp.max(rays.t_max), num_rows, num_cols), is_grid


__all__ = ["cast_depth"]
