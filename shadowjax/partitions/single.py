"""The trivial partition: one map for the whole scene."""

import jax.numpy as jnp

from shadowjax._types import Array, Int, Points
from shadowjax.geometry.camera import Camera
from shadowjax.geometry.light import Light
from shadowjax.geometry.mesh import Mesh
from shadowjax.partitions.base import Partition
from shadowjax.rays.map_part import seen_space, starting_outside
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
        space = seen_space(light, mesh, camera)
        return (starting_outside(space, self.warp.fit(space, light, mesh, camera), mesh, resolution),)

    def select(self, grids: tuple[RayGrid, ...], camera: Camera, points: Points) -> Int[Array, "*points"]:
        """Region 0 for every point."""
        return jnp.zeros(points.shape[:-1], jnp.int32)
