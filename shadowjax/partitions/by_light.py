"""One partition for directional lights and another for lights at a place, as engines have them."""

from shadowjax._types import Array, Int, Points
from shadowjax.geometry.camera import Camera
from shadowjax.geometry.light import Light
from shadowjax.geometry.mesh import Mesh
from shadowjax.partitions.base import Partition
from shadowjax.partitions.single import SingleMap
from shadowjax.rays.ray_grid import RayGrid


class ByLight(Partition):
    """Cascades for the sun, say, and one map for every lamp.

    A technique places it: then it is the partition of the light at hand.

    Attributes:
        directional: For directional lights.
        local: For spot and point lights.
    """

    directional: Partition
    local: Partition = SingleMap()

    def with_margin(self, texels: float) -> "ByLight":
        """Both for filters that read `texels` texels away."""
        return ByLight(self.directional.with_margin(texels), self.local.with_margin(texels))

    def of(self, light: Light) -> Partition:
        """The partition of a light."""
        return self.directional if light.is_directional else self.local

    def fit(self, mesh: Mesh, light: Light, camera: Camera) -> Partition:
        """The partition of this light, placed."""
        return self.of(light).fit(mesh, light, camera)

    def grids(self, mesh: Mesh, light: Light, camera: Camera, resolution: int) -> tuple[RayGrid, ...]:
        """The grids of the partition of this light."""
        return self.of(light).grids(mesh, light, camera, resolution)

    @property
    def follows_camera(self) -> bool:
        """As the partition of either."""
        return self.directional.follows_camera or self.local.follows_camera

    @property
    def num_maps(self) -> int:
        """Those of the partition with more."""
        return max(self.directional.num_maps, self.local.num_maps)

    def select(self, grids: tuple[RayGrid, ...], camera: Camera, points: Points) -> Int[Array, "*points"]:
        """Only a placed partition knows its light.

        Raises:
            ValueError: Always.
        """
        raise ValueError("a partition by light must be fitted first: partition.fit(mesh, light, camera)")


__all__ = ["ByLight"]
