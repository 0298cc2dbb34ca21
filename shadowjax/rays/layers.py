"""Depth layers beyond the first: what a light's rays meet behind the surface they reach."""

import jax
import jax.numpy as jnp

from shadowjax._checked import checked
from shadowjax._numerics import dot
from shadowjax._types import Array, Float
from shadowjax.geometry.mesh import Mesh
from shadowjax.rays.caster import Caster
from shadowjax.rays.ray import Hit
from shadowjax.rays.ray_grid import RayGrid

LAYERS = ("first", "second", "back", "midpoint")


@checked
def second_layer(caster: Caster, mesh: Mesh, grid: RayGrid, first_depth: Float[Array, "rows cols"]) -> Hit:
    """The next surface behind the one that each ray of a grid meets first: one step of depth peeling.

    Rays start again a few roundings behind the first hit. Any mesh will do; `back_layer` is faster for closed ones.

    Args:
        caster: Any caster.
        mesh: What was cast.
        grid: The rays.
        first_depth: Depth of the first hit along each ray, `grid.far` for a miss.

    Returns:
        The hit, with depth from the ray's start; a miss where nothing more follows.
    """
    start = jnp.minimum(jax.lax.stop_gradient(first_depth) + grid.depth_rounding, grid.far)
    return caster.closest_beyond_on_grid(mesh, grid, start)


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
