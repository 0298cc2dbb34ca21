"""The surface points of a camera's image, which the cases of shadow tests ask about."""

import jax
import jax.numpy as jnp

from shadowjax import Mesh, intersect
from shadowjax._types import Array
from shadowjax.rays.ray_grid import RayGrid
from tests.benchmarks.ours import Shadowjax
from tests.benchmarks.scenes import Geometry, View, view
from tests.benchmarks.session import Session

# The camera looks from next to the light, so that it sees shadows.
STEPS_ASIDE = 60


def device_mesh(geometry: Geometry) -> Mesh:
    """A mesh of the package, on the device."""
    colors = jnp.zeros((geometry.num_faces, 3), jnp.float32)
    return Mesh(jnp.asarray(geometry.vertices), jnp.asarray(geometry.faces), colors)


def camera_and_light(session: Session, geometry: Geometry) -> tuple[View, View]:
    """The image whose points are asked about, and the map that answers."""
    camera = view(geometry, session.projections[-1], session.resolution, STEPS_ASIDE)
    return camera, view(geometry, session.projections[0], session.resolution)


def visible_points(ours: Shadowjax, mesh: Mesh, grid: RayGrid) -> tuple[Array, Array]:
    """First hits of a camera's rays and their unit normals, on the side that the camera sees.

    Args:
        ours: Casts; it has been given the mesh.
        mesh: The same mesh.
        grid: The camera.
    """
    _, face = ours.cast(grid, True)

    @jax.jit
    def locate(mesh: Mesh, grid: RayGrid, face: Array) -> tuple[Array, Array]:
        rays = grid.rays()
        normals = mesh.face_normals()[jnp.maximum(face, 0)]
        away = jnp.sum(normals * rays.directions, axis=-1, keepdims=True) > 0
        return rays.at(intersect(mesh, rays, face).depth), jnp.where(away, -normals, normals)

    return jax.block_until_ready(locate(mesh, grid, face))
