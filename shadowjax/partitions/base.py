"""What a partition is: several grids of light rays, and the rule that chooses one or mixes some for each point."""

from abc import abstractmethod
from typing import ClassVar

from shadowjax._checked import Checked
from shadowjax._types import Array, Float, Int, Points
from shadowjax.geometry.camera import Camera
from shadowjax.geometry.light import Light
from shadowjax.geometry.mesh import Mesh
from shadowjax.rays.ray_grid import RayGrid


class Partition(Checked):
    """Splits what a light must cover into regions, each with a shadow map of its own."""

    _remedy_: ClassVar = "make_partition(name) makes one; or SingleMap(), Cascades(4), FacePartition(), CubeMap()"

    def fit(self, mesh: Mesh, light: Light, camera: Camera) -> "Partition":
        """This partition with what it reads off the scene and the view fixed; itself where there is nothing to fix.

        A technique places its partition once, then asks it for grids and, later, for the region of each point.
        """
        return self

    def with_margin(self, texels: float) -> "Partition":
        """This partition for filters that read `texels` texels away; itself where regions do not border on each other.

        Args:
            texels: The filter's reach along an axis, in texels of the grids.
        """
        return self

    @abstractmethod
    def grids(self, mesh: Mesh, light: Light, camera: Camera, resolution: int) -> tuple[RayGrid, ...]:
        """The grid of light rays of every region; each is `resolution` × `resolution`."""

    @property
    def follows_camera(self) -> bool:
        """Whether the maps move with the view; a uniform map around the scene only turns with it."""
        return True

    @property
    @abstractmethod
    def num_maps(self) -> int:
        """Maps that are cast for one light, at most: a light of another kind may need fewer."""

    @abstractmethod
    def select(self, grids: tuple[RayGrid, ...], camera: Camera, points: Points) -> Int[Array, "*points"]:
        """Which region answers for each point."""

    def shares(self, grids: tuple[RayGrid, ...], camera: Camera, points: Points) -> tuple[Float[Array, "*points"], ...]:
        """How much each region's answer counts at each point: shares that sum to 1, or to less where shadows end.

        One region alone unless the partition blends across its seams. What is left of 1 counts as lit.
        """
        region = self.select(grids, camera, points)
        return tuple((region == index).astype(points.dtype) for index in range(len(grids)))
