"""The trivial partition: one map for the whole scene."""

import jax.numpy as jnp

from shadowjax._types import Array, Int, Points
from shadowjax.geometry.camera import Camera
from shadowjax.geometry.light import Light
from shadowjax.geometry.light_space import farthest, light_space
from shadowjax.geometry.mesh import Mesh
from shadowjax.partitions.base import Partition
from shadowjax.rays.ray_grid import RayGrid
from shadowjax.warps.base import WarpFit
from shadowjax.warps.uniform import UniformFit


class SingleMap(Partition):
    """One map.

    Attributes:
        warp: How the map's texels are spread over the light's plane.
    """

    warp: WarpFit = UniformFit()

    def grids(self, mesh: Mesh, light: Light, camera: Camera, resolution: int) -> tuple[RayGrid, ...]:
        """One grid around everything."""
        lower, upper = mesh.bounds()
        space = light_space(light, camera.forward, lower, upper)
        plane_map = self.warp.fit(space, light, mesh, camera)
        return (RayGrid(space, plane_map, farthest(space, lower, upper), resolution, resolution),)

    def select(self, grids: tuple[RayGrid, ...], camera: Camera, points: Points) -> Int[Array, "*points"]:
        """Region 0 for every point."""
        return jnp.zeros(points.shape[:-1], jnp.int32)
