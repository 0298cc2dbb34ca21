"""Filters that store numbers made from depth, average those, and reconstruct visibility from the averages."""

from abc import abstractmethod
from typing import Any

import equinox as eqx
import jax.numpy as jnp

from shadowjax._checked import Checked
from shadowjax._checks import require_finite
from shadowjax._types import Array, DType, Float
from shadowjax.filters.base import Filter, Lookup
from shadowjax.filters.prefilter import DepthRange, Prefilter
from shadowjax.maps.blur import extend
from shadowjax.maps.sampling import is_outside
from shadowjax.maps.shadow_map import ShadowMap
from shadowjax.silhouettes.coverage import OutlinePieces

Depth = Float[Array, "rows cols"]
# One array for each stored number, all of the receivers' shape; stacked or apart.
Values = Float[Array, "n *points"] | list[Float[Array, "*points"]]


class EncodedMap(Checked):
    """What an encoded filter stores.

    Attributes:
        planes: The averaged numbers, as the filter's `Prefilter` keeps them.
        range: Depths that were mapped to [0, 1].
        num_rows: Rows of the map.
        num_cols: Columns of the map.
    """

    planes: Any
    range: DepthRange
    num_rows: int = eqx.field(static=True)
    num_cols: int = eqx.field(static=True)


class _OfList(Checked):
    """A filter's encoded values of a list of depths, world units."""

    filter: "Prefiltered"
    range: DepthRange

    def __call__(self, depth: Float[Array, "points"]) -> Float[Array, "n points"]:
        return self.filter.encode(self.range.to_unit(depth)[None])[:, 0]


class Prefiltered(Filter):
    """Encodes depth in [0, 1] as linearly filterable values (moments, basis values), averages them, decodes visibility.

    Attributes:
        prefilter: How the values are averaged.
    """

    prefilter: eqx.AbstractVar[Prefilter]

    @abstractmethod
    def encode(self, depth: Depth) -> Float[Array, "n rows cols"]:
        """The numbers stored for each depth of [0, 1]."""

    @abstractmethod
    def decode(self, values: Values, depth: Float[Array, "*points"]) -> Float[Array, "*points"]:
        """Visibility from the averaged numbers, for receivers of a depth in the same range."""

    def check(self, dtype: DType) -> None:
        """Complain about parameters that the map's dtype cannot hold."""

    def prepare(self, depth: Depth, far: Float[Array, ""] | None = None, border: str = "lit") -> EncodedMap:
        """The averaged values of a map.

        Args:
            depth: Distances along the light's rays, world units, finite.
            far: Depth that a miss reports and that lies outside the map; the largest of the map if None.
            border: What lies outside the map, for the blur.

        Raises:
            ValueError: If a depth is NaN or infinite, or the dtype cannot hold the values.
        """
        return self._prepared(require_finite(depth, "depth map"), far, border)

    def prepare_map(self, shadow_map: ShadowMap) -> EncodedMap:
        """The averaged values of a cast map, whose depths are finite by construction."""
        grid = shadow_map.grid
        return self._prepared(shadow_map.depth, grid.far, shadow_map.border, shadow_map.outlines, grid.seen)

    def _prepared(
        self,
        depth: Depth,
        far: Float[Array, ""] | None,
        border: str,
        outlines: OutlinePieces | None = None,
        seen: Float[Array, ""] | None = None,
    ) -> EncodedMap:
        self.check(depth.dtype)
        # The nearest depth of a map jumps as texels change faces; with outlines nothing may jump.
        if outlines is None or far is None:
            depth_range = DepthRange.of(depth, far, seen)
        else:
            depth_range = DepthRange(0 * far, far, seen)
        radius = self.prefilter.radius
        codes = self.encode(extend(depth_range.to_unit(depth), radius, border, jnp.ones((), depth.dtype)))
        if outlines is not None:
            rows, cols = (slice(radius, radius + size) for size in depth.shape)
            # Texels that outlines cross take means of both sides; the border beyond the map has no outlines.
            inner = outlines.blended(codes[:, rows, cols], _OfList(self, depth_range))
            codes = codes.at[:, rows, cols].set(inner)
        return EncodedMap(self.prefilter.prepare(codes), depth_range, *depth.shape)

    def visibility(self, planes: EncodedMap, lookup: Lookup) -> Float[Array, "*points"]:
        """Decoded visibility; 1 outside a map with a lit border."""
        depth = planes.range.to_unit(lookup.depth - lookup.bias)
        value = self.decode(self.prefilter.read(planes.planes, lookup), depth)
        if lookup.border != "lit":
            return value
        return jnp.where(is_outside(lookup.position, planes.num_rows, planes.num_cols), jnp.ones_like(value), value)

    @property
    def supports_coverage(self) -> bool:
        """Where values are made of each depth alone."""
        return True

    @property
    def num_tones(self) -> None:
        """A continuum."""
        return None

    @property
    def num_fetches(self) -> int:
        """Every stored number, of each texel read."""
        return self.num_planes * self.prefilter.num_fetches

    @property
    def reach(self) -> float:
        """That of the prefilter."""
        return self.prefilter.reach

    @property
    def compares(self) -> bool:
        """Reconstructed from averaged values."""
        return False
