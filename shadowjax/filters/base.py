"""What a filter is: it prepares a depth map once, then turns receiver depths into visibility."""

from abc import abstractmethod

import equinox as eqx

from shadowjax._types import Array, Float, Int


class Lookup(eqx.Module):
    """Where and how receivers read a map.

    Attributes:
        position: (x, y) in texels, centres at +½.
        depth: Receiver's distance along the light ray, world units.
        bias: Depth the test forgives, world units: lit where depth − bias ≤ stored depth.
        texel_size: World size of a texel at the receiver.
        border: What lies outside the map (`maps.sampling.BORDERS`).
        gradient: Change of the receiver's own plane in depth over one texel along x and along y, world units, where
            each tap is tested against that plane; None tests every tap against `depth`.
    """

    position: Float[Array, "*points 2"]
    depth: Float[Array, "*points"]
    bias: Float[Array, "*#points"]
    texel_size: Float[Array, "*#points"]
    border: str = eqx.field(static=True, default="lit")
    gradient: Float[Array, "*points 2"] | None = None

    def depth_at(self, col: Int[Array, "*points"], row: Int[Array, "*points"]) -> Float[Array, "*points"]:
        """Depth that a texel is tested against: the receiver's, or its plane's at the texel's centre."""
        if self.gradient is None:
            return self.depth
        x = col.astype(self.depth.dtype) + 0.5 - self.position[..., 0]
        y = row.astype(self.depth.dtype) + 0.5 - self.position[..., 1]
        return self.depth + self.gradient[..., 0] * x + self.gradient[..., 1] * y


class Filter(eqx.Module):
    """Turns depths into visibility."""

    @abstractmethod
    def prepare(self, depth: Float[Array, "rows cols"]) -> Float[Array, "n rows cols"]:
        """The planes that lookups read, made once for each map."""

    @abstractmethod
    def visibility(self, planes: Float[Array, "n rows cols"], lookup: Lookup) -> Float[Array, "*points"]:
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
        """How far from the receiver's position the depths it reads were sampled, in texels along an axis.

        A plane receiver needs a slope bias of just this many texels to be free of acne.
        """
