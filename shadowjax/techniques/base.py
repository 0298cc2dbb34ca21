"""What a technique is: `build(mesh, light, camera)` gives shadows, which answer `visibility(points, normals)`."""

from abc import abstractmethod
from typing import ClassVar

import jax.numpy as jnp

import shadowjax  # for the name of a class that stands on this one
from shadowjax._checked import Checked
from shadowjax._types import Array, Float, Int, Points
from shadowjax.bias.rule import BiasRule
from shadowjax.filters.base import Filter
from shadowjax.geometry.camera import Camera
from shadowjax.geometry.light import Light
from shadowjax.geometry.mesh import Mesh
from shadowjax.maps.shadow_map import ShadowMap
from shadowjax.partitions.base import Partition
from shadowjax.rays.ray_grid import RayGrid


class Shadows(Checked):
    """What a technique has built for one light: it answers for any point."""

    @abstractmethod
    def visibility(self, points: Points, normals: Points) -> Float[Array, "*points"]:
        """Fraction of the light that reaches each point, in [0, 1]: 1 lit, 0 in shadow.

        Args:
            points: World points on surfaces.
            normals: Unit normals of the side that is looked at; one that does not face the light by
                more than rounding is dark.
        """

    def visibility_of(self, points: Points, normals: Points, faces: Int[Array, "*points"]) -> Float[Array, "*points"]:
        """As `visibility`, for points whose triangle is known; techniques that compare surfaces look at it.

        Args:
            points: World points on surfaces.
            normals: Unit normals of the side that is looked at.
            faces: Triangle that each point lies on; −1 for points on none.
        """
        del faces
        return self.visibility(points, normals)

    @property
    @abstractmethod
    def map_bytes(self) -> int:
        """Bytes of all stored planes."""

    @property
    def texture_bytes(self) -> int:
        """Bytes of all stored planes in textures of a graphics card's formats, without mip chains."""
        return self.map_bytes

    @property
    def cast_maps(self) -> tuple[ShadowMap, ...]:
        """Whole maps of depths that were cast; none where a technique keeps none."""
        return ()

    def volume_bytes(self, num_samples: int) -> int:
        """Memory used instead of a shadow map: volume geometry plus a stencil buffer of `num_samples`."""
        del num_samples
        return 0

    @property
    def depth_bias(self) -> BiasRule | None:
        """Depth tolerance of the test, which the attribute `bias` holds; None where no stored depth is tested."""
        return None

    def maps_of(self, points: Points) -> tuple[tuple[RayGrid, ...], Int[Array, "*points"]]:
        """The light rays of every stored map, and which of the maps answers for each point.

        Args:
            points: World points on surfaces.

        Returns:
            No grid where there is no map.
        """
        return (), jnp.zeros(points.shape[:-1], jnp.int32)

    @property
    def prefers_images(self) -> bool:
        """Whether `visibility` is faster for points of an image, (rows, cols, 3), than for a list of them."""
        return False


class Technique(Checked):
    """A way to answer "how much of the light arrives here?"."""

    _remedy_: ClassVar = "make_technique(name) makes one"

    @abstractmethod
    def build(self, mesh: Mesh, light: Light, camera: Camera) -> Shadows:
        """Do the work that does not depend on receivers."""

    @property
    @abstractmethod
    def num_tones(self) -> int | None:
        """Upper bound on distinct visibilities; None where they are a continuum."""

    @property
    def num_planes(self) -> int | None:
        """Numbers stored for each texel; 0 without a map, None where that depends on the view."""
        return 0

    @property
    def num_fetches(self) -> int | None:
        """Depths or numbers read for each receiver; 0 without a map, None where that depends on the view."""
        return 0

    @property
    def num_maps(self) -> int | None:
        """Maps cast for one light, at most; 0 without a map, None where that depends on the view."""
        return 0

    @property
    def map_filter(self) -> Filter | None:
        """The filter whose one lookup gives the visibility; None where there is none or several lookups do."""
        return None

    @property
    def map_partition(self) -> Partition | None:
        """The partition of the maps that the filter reads; None without such a filter."""
        return None

    @property
    def map_resolution(self) -> int | None:
        """Texels along each side of every map; None for techniques that are not told it."""
        return None

    def resized(self, factor: float) -> "Technique":
        """This technique with maps so many times finer; itself where it is not told their resolution.

        Args:
            factor: Of texels along a side, > 0.
        """
        del factor
        return self

    @property
    def parts(self) -> str:
        """What it is made of, joined by `+`."""
        return type(self).__name__

    def as_shadow_mapping(self, what: str) -> "shadowjax.ShadowMapping":
        """The same technique, where only partition × warp × filter × caster will do.

        Args:
            what: Begins the message of the error, such as "a search of the bias needs".

        Raises:
            ValueError: If it is not made so.
        """
        raise ValueError(f"{what} shadow maps of one resolution each; got {self.parts}: choose another technique")
