"""Depth layers beyond the first: what a light's rays meet behind the surface they reach."""

import equinox as eqx
import jax
import jax.numpy as jnp

from shadowjax._checked import checked
from shadowjax._numerics import dot
from shadowjax._types import Array, Float
from shadowjax.geometry.mesh import Mesh
from shadowjax.rays.caster import Caster
from shadowjax.rays.ray import Hit, depth_rounding, orthonormal_frame
from shadowjax.rays.ray_grid import RayGrid

LAYERS = ("first", "second", "back", "midpoint")


@checked
def second_layer(caster: Caster, mesh: Mesh, grid: RayGrid, first: Hit) -> Hit:
    """The next surface behind the one that each ray of a grid meets first: one step of depth peeling.

    Rays start again behind the first hit by what rounding leaves unknown of that triangle (`hit_rounding`). Any mesh
    will do; `back_layer` is faster for closed ones.

    Args:
        caster: Any caster.
        mesh: What was cast.
        grid: The rays.
        first: The hit of each ray, shape (rows, cols).

    Returns:
        The hit, with depth from the ray's start; a miss where nothing more follows.
    """
    start = first.depth + hit_rounding(*jax.lax.stop_gradient((mesh, grid, first)))
    return caster.closest_beyond_on_grid(mesh, grid, jnp.minimum(jax.lax.stop_gradient(start), grid.far))


@checked
@eqx.filter_jit
def hit_rounding(mesh: Mesh, grid: RayGrid, hit: Hit) -> Float[Array, "rows cols"]:
    """What rounding leaves unknown of the depth of the triangle that each ray of a grid meets; 0 for a miss.

    That of the triangle's corners as offsets from the space's source (`ray.depth_rounding`): neither the scene's extent
    nor any other triangle counts.

    Args:
        mesh: What was cast.
        grid: The rays.
        hit: Hits of the rays, shape (rows, cols).

    Returns:
        Distance along the ray, world units.
    """
    rays = grid.rays()
    # Corners in the ray's frame, as in the edge test.
    axes = (*orthonormal_frame(rays.directions), rays.directions)
    corners = mesh.triangles()[jnp.maximum(hit.face, 0)] - grid.space.source
    x, y, z = ((dot(corners[..., 0, :], a), dot(corners[..., 1, :], a), dot(corners[..., 2, :], a)) for a in axes)
    doubt = depth_rounding(x, y, z)
    return jnp.where(hit.is_hit, doubt, jnp.zeros_like(doubt))


@checked
def back_layer(caster: Caster, mesh: Mesh, grid: RayGrid) -> Hit:
    """The first surface that each ray of a grid meets from behind: the far side of closed bodies.

    Triangles that face the light are shrunk to a point, which every caster misses. Open surfaces have no far side.

    Args:
        caster: Any caster.
        mesh: What is cast; its triangles must be counter-clockwise seen from outside.
        grid: The rays.
    """
    towards = grid.space.to_source(jnp.mean(mesh.triangles(), axis=1))
    faces_light = dot(mesh.face_normals(), towards) > 0
    faces = jnp.where(faces_light[:, None], mesh.faces[:, :1], mesh.faces)
    return caster.closest_on_grid(Mesh(mesh.vertices, faces, mesh.face_colors), grid)
