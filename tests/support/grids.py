"""Views that tests of the grid caster share, so that they share compiled functions too: one shape for all meshes."""

import functools

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from shadowjax import BruteForceCaster, Mesh, Rays
from shadowjax.geometry.light_space import DirectionalSpace, PerspectiveSpace
from shadowjax.rays.grid.caster import GridCaster
from shadowjax.rays.plane_map import Box
from shadowjax.rays.ray import Hit, intersect
from shadowjax.rays.ray_grid import RayGrid
from shadowjax.warps.logarithmic import LogarithmicWarp
from shadowjax.warps.perspective import PerspectiveWarp

ROWS, COLS = 26, 31
NUM_FACES, NUM_VERTICES = 400, 1200

NUM_RAYS = 256

jitted_rays = eqx.filter_jit(lambda grid: grid.rays())
jitted_brute = eqx.filter_jit(lambda mesh, rays: BruteForceCaster().closest(mesh, rays))
jitted_intersect = eqx.filter_jit(intersect)
jitted_fast = eqx.filter_jit(
    lambda mesh, grid: (GridCaster().faces_on_grid(mesh, grid), GridCaster().depth_on_grid(mesh, grid))
)


def padded(mesh: Mesh) -> Mesh:
    """The mesh with empty triangles added, so that all tests share one compiled shape."""
    faces = np.zeros((NUM_FACES - mesh.num_faces, 3), np.int32)
    vertices = np.broadcast_to(np.asarray(mesh.vertices)[:1], (NUM_VERTICES - mesh.num_vertices, 3))
    corners = np.concatenate([mesh.vertices, vertices])
    return Mesh.create(corners, np.concatenate([mesh.faces, faces]), dtype=mesh.vertices.dtype)


def fast(mesh: Mesh, grid: RayGrid) -> tuple[Hit, np.ndarray]:
    """What the grid caster finds, through the one intersection; and its depth alone."""
    mesh = padded(mesh)
    (_, face), depth = jitted_fast(mesh, grid)
    return jitted_intersect(mesh, jitted_rays(grid), face), np.asarray(depth)


def brute(mesh: Mesh, grid: RayGrid) -> Hit:
    """What brute force finds; one compiled function for all views."""
    return jitted_brute(padded(mesh), jitted_rays(grid))


def closest(mesh: Mesh, rays: Rays) -> Hit:
    """First hits by brute force; a few rays and triangles are filled up to one shape."""
    if mesh.num_faces <= NUM_FACES and mesh.num_vertices <= NUM_VERTICES:
        mesh = padded(mesh)
    flat = rays.flattened()
    spare = max(NUM_RAYS - flat.t_max.size, 0)
    flat = jax.tree.map(lambda x: jnp.concatenate([x, jnp.repeat(x[-1:], spare, axis=0)]), flat)
    hit = jitted_brute(mesh, flat)
    return jax.tree.map(lambda x: x[: x.shape[0] - spare].reshape(*rays.shape, *x.shape[1:]), hit)


def turned(seed: int, dtype):
    """A right-handed frame without special directions."""
    q = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))[0]
    return jnp.asarray(q * np.sign(np.linalg.det(q)), dtype)


@functools.cache
def views(dtype) -> dict[str, RayGrid]:
    """One grid of every kind of view and map; those called `inside` start amid the triangles."""
    frame = turned(5, dtype)

    def box(*sides: float) -> Box:
        return Box(jnp.asarray(sides[:2], dtype), jnp.asarray(sides[2:], dtype))

    def grid(space, plane_map, far=40.0) -> RayGrid:
        return RayGrid(space, plane_map, jnp.asarray(far, dtype), ROWS, COLS)

    rng = np.random.default_rng(1)
    cloud = jnp.asarray(rng.uniform(-0.8, 0.8, (12, 2)), dtype)
    axis = jnp.asarray([0.6, 0.8], dtype)
    warp = PerspectiveWarp.fit(cloud, 1.5, axis)
    outside, inside = DirectionalSpace(5 * frame[1], frame), DirectionalSpace(0.1 * frame[1], frame)
    return {
        "parallel": grid(outside, box(-1.2, -1.5, 1.4, 1.1)),
        "parallel inside": grid(inside, box(1.0, -1.0, -1.3, 1.0)),
        "short": grid(outside, box(-1.2, -1.5, 1.4, 1.1), far=4.9),
        "perspective": grid(PerspectiveSpace(-3 * frame[2], frame), box(-0.5, 0.4, 0.4, -0.5)),
        "perspective inside": grid(PerspectiveSpace(0.05 * frame[2], frame), box(0.8, -0.9, -1.0, 1.0)),
        "perspective warp inside": grid(PerspectiveSpace(0.05 * frame[2], frame), warp),
        "logarithmic warp": grid(outside, LogarithmicWarp.fit(cloud, 4.0, axis)),
    }
