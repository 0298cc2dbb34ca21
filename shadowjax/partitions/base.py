"""What a partition is: several grids of light rays, and the rule that chooses one for each point."""

from abc import abstractmethod

import equinox as eqx

from shadowjax._types import Array, Int, Points
from shadowjax.geometry.camera import Camera
from shadowjax.geometry.light import Light
from shadowjax.geometry.mesh import Mesh
from shadowjax.rays.ray_grid import RayGrid


class Partition(eqx.Module):
    """Splits what a light must cover into regions, each with a shadow map of its own."""

    @abstractmethod
    def grids(self, mesh: Mesh, light: Light, camera: Camera, resolution: int) -> tuple[RayGrid, ...]:
        """The grid of light rays of every region; each is `resolution` × `resolution`."""

    @abstractmethod
    def select(self, grids: tuple[RayGrid, ...], camera: Camera, points: Points) -> Int[Array, "*points"]:
        """Which region answers for each point."""
