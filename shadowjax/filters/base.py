"""What a filter is: it prepares a depth map once, then turns receiver depths into visibility."""

from abc import abstractmethod
from typing import Any, ClassVar

import equinox as eqx

from shadowjax._checked import Checked, checked
from shadowjax._types import Array, Float, Int
from shadowjax.maps.shadow_map import ShadowMap


@checked
def depth_at_texel(
    position: Float[Array, "*points 2"],
    depth: Float[Array, "*points"],
    gradient: Float[Array, "*points 2"] | None,
    col: Int[Array, "*points"],
    row: Int[Array, "*points"],
) -> Float[Array, "*points"]:
    """Depth that a texel is tested against: the receiver's, or its own plane's at the texel's centre.

    Args:
        position: (x, y) of receivers in texels, centres at +½.
        depth: Their distances along the light ray, world units.
        gradient: Change of each receiver's plane in depth over one texel along x and along y, world units; None tests
            every texel against the receiver's depth.
        col: Column of the texel.
        row: Row of the texel.
    """
    if gradient is None:
        return depth
    # From the receiver to the texel's centre, in texels; the plane's gradient is per texel too.
    x = col.astype(depth.dtype) + 0.5 - position[..., 0]
    y = row.astype(depth.dtype) + 0.5 - position[..., 1]
    return depth + gradient[..., 0] * x + gradient[..., 1] * y


class Lookup(Checked):
    """Where and how receivers read a map.

    Attributes:
        position: (x, y) in texels, centres at +½.
        depth: Receiver's distance along the light ray, world units.
        bias: Depth tolerance of the test, world units: lit where depth − bias ≤ stored depth.
        texel_size: World size of a texel at the receiver.
        border: What lies outside the map (`maps.sampling.BORDERS`).
        footprint: Change of (x, y), in texels, over one pixel along the image's columns (first) and rows; None if the
            image is unknown. `footprint[..., i, j]` is the change of coordinate i for a step along image axis j.
        parallel: Whether the light's rays are parallel; else they start in one point.
        gradient: Change of the receiver's own plane in depth over one texel along x and along y, world units, where
            each tap is tested against that plane; None tests every tap against `depth`.
    """

    position: Float[Array, "*points 2"]
    depth: Float[Array, "*points"]
    bias: Float[Array, "*#points"]
    texel_size: Float[Array, "*#points"]
    border: str = eqx.field(static=True, default="lit")
    footprint: Float[Array, "*points 2 2"] | None = None
    parallel: bool = eqx.field(static=True, default=True)
    gradient: Float[Array, "*points 2"] | None = None

    def depth_at(self, col: Int[Array, "*points"], row: Int[Array, "*points"]) -> Float[Array, "*points"]:
        """Depth that a texel is tested against: the receiver's, or its plane's at the texel's centre."""
        return depth_at_texel(self.position, self.depth, self.gradient, col, row)


class Filter(Checked):
    """Turns depths into visibility."""

    _remedy_: ClassVar = "Give an object, such as Hard() or PercentageCloser(3)"

    @abstractmethod
    def prepare(self, depth: Float[Array, "rows cols"]) -> Any:
        """The planes that lookups read, made once for each map: one array (n, rows, cols), or what holds several."""

    def prepare_map(self, shadow_map: ShadowMap) -> Any:
        """The planes of a cast map; filters that need its depth range or its border know them from here."""
        return self.prepare(shadow_map.depth)

    @abstractmethod
    def visibility(self, planes: Any, lookup: Lookup) -> Float[Array, "*points"]:
        """Visibility in [0, 1] of every receiver: 1 lit, 0 in shadow."""

    @property
    @abstractmethod
    def num_planes(self) -> int:
        """How many numbers are stored for each texel."""

    @property
    @abstractmethod
    def num_tones(self) -> int | None:
        """Upper bound on the number of distinct visibilities; None where they are a continuum."""

    @property
    @abstractmethod
    def num_fetches(self) -> int:
        """Depths read for each receiver."""

    @property
    @abstractmethod
    def reach(self) -> float:
        """How far from the receiver's position the depths it reads were sampled, in texels along an axis."""

    @property
    def bias_reach(self) -> float:
        """Slope bias, in texels, that frees a plane of acne: the reach for filters that compare depths."""
        return self.reach

    @property
    def compares(self) -> bool:
        """Whether visibility is a mean of depth comparisons, so exact away from shadow edges and without gradient in
        stored depths; else it is reconstructed from a smooth encoding of depth."""
        return True

    @property
    def supports_coverage(self) -> bool:
        """Whether the filter averages its values over the area of texels that outlines cross (`ShadowMap.outlines`)."""
        return False

    def for_coverage(self) -> "Filter":
        """This filter as it must be where `ShadowMap.outlines` are known; itself unless a number stands in the way."""
        return self

    @property
    def follows_plane(self) -> bool:
        """Whether lookups must know the receiver's own plane (`Lookup.gradient`) whatever the bias."""
        return False

    @property
    def cast_factor(self) -> int:
        """Rays cast for each texel along an axis: 1, or more for filters that keep several samples a texel."""
        return 1
