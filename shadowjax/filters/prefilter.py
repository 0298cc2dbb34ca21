"""How encoded maps are blurred when they are made and averaged when they are read."""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax.numpy as jnp

from shadowjax._checked import Checked, checked
from shadowjax._checks import require, require_choice, require_int
from shadowjax._types import Array, Float, ScalarLike
from shadowjax.filters.base import Lookup
from shadowjax.maps.blur import KERNELS, Weights, blur, kernel_radius, kernel_weights
from shadowjax.maps.pyramid import mip_chain, mip_level, read_anisotropic, read_trilinear
from shadowjax.maps.sampling import read_bilinear_apart, read_texels, texel_index
from shadowjax.maps.summed_area import read_box_mean, summed_area_table

SAMPLINGS = ("nearest", "bilinear", "trilinear", "anisotropic", "summed-area")


class Prefilter(Checked):
    """A blur of the stored planes and the way lookups average them: what a comparison of depths cannot have.

    Attributes:
        size: Taps of the blur along an axis, odd, ≥ 1; 1 does not blur.
        kernel: "gaussian" or "box".
        sigma: Standard deviation of the Gaussian, texels; a fifth of the size if None.
        sampling: "nearest" reads one texel, "bilinear" four. The others average over the pixel's footprint on the map,
            where lookups know it (`MappedShadows.with_pixel_footprints`; otherwise over a texel): "trilinear" with a
            mip chain, "anisotropic" with several reads of it, "summed-area" over the box round the footprint.
        max_anisotropy: Reads of an anisotropic lookup, ≥ 1.
    """

    size: int = eqx.field(static=True, default=7)
    kernel: str = eqx.field(static=True, default="gaussian")
    sigma: float | None = eqx.field(static=True, default=None)
    sampling: str = eqx.field(static=True, default="bilinear")
    max_anisotropy: int = eqx.field(static=True, default=8)

    def __check_init__(self) -> None:
        kernel_radius(self.size)
        require_choice(self.kernel, "kernel", KERNELS)
        require_choice(self.sampling, "sampling", SAMPLINGS)
        require_int(self.max_anisotropy, "max_anisotropy", 1)
        require(self.sigma is None or self.sigma > 0, f"sigma of a Gaussian must be positive; got {self.sigma}")

    def prepare(self, planes: Float[Array, "n more_rows more_cols"]) -> Any:
        """Blur planes that reach `radius` texels beyond the map on every side; then make what the sampling reads."""
        blurred = blur(planes, self.weights)
        if self.sampling in ("trilinear", "anisotropic"):
            return mip_chain(blurred)
        return summed_area_table(blurred) if self.sampling == "summed-area" else blurred

    def read(
        self, prepared: Any, lookup: Lookup, each: Callable[[Array], Array] | None = None
    ) -> list[Float[Array, "*points"]]:
        """The averaged value of every plane at each receiver. What lies outside the map repeats its edge.

        Args:
            prepared: From `prepare`.
            lookup: Receivers.
            each: Applied to every number read, before the average, if the sampling reads texels; None for no change.
        """
        border = "clamp" if lookup.border == "lit" else lookup.border
        if self.sampling not in ("nearest", "bilinear"):
            return self._read_footprint(prepared, lookup, border)
        if self.sampling == "nearest":
            col, row = texel_index(lookup.position[..., 0]), texel_index(lookup.position[..., 1])
            values = read_texels(prepared, col, row, border)
            return values if each is None else [each(value) for value in values]
        return read_bilinear_apart(prepared, lookup.position, border, each)

    def _read_footprint(self, prepared: Any, lookup: Lookup, border: str) -> list[Float[Array, "*points"]]:
        footprint = lookup.footprint
        if footprint is None:
            # Without a known image a pixel is taken to be a texel wide.
            one = jnp.eye(2, dtype=lookup.position.dtype)
            footprint = jnp.broadcast_to(one, (*lookup.position.shape[:-1], 2, 2))
        if self.sampling == "summed-area":
            # Sides of the box around the pixel's parallelogram, at least a texel.
            size = jnp.maximum(jnp.sum(jnp.abs(footprint), axis=-1), 1.0)
            return read_box_mean(prepared, lookup.position, size)
        if self.sampling == "trilinear":
            return read_trilinear(prepared, lookup.position, mip_level(footprint), border)
        return read_anisotropic(prepared, lookup.position, footprint, self.max_anisotropy, border)

    @property
    def weights(self) -> Weights:
        """Of the blur, along one axis."""
        return kernel_weights(self.kernel, self.size, self.sigma)

    @property
    def radius(self) -> int:
        """Texels that the blur reaches to either side."""
        return (self.size - 1) // 2

    @property
    def reach(self) -> float:
        """Texels along an axis between a receiver and the centres of the texels that it depends on, at most; where the
        pixel's footprint is larger than a texel, half of it more."""
        return self.radius + (0.5 if self.sampling == "nearest" else 1.0)

    @property
    def num_fetches(self) -> int:
        """Texels read for each receiver."""
        probes = {"nearest": 1, "bilinear": 4, "trilinear": 8, "summed-area": 16}
        return probes.get(self.sampling, 8 * self.max_anisotropy)


# Part of [0, 1] that goes to the depths of what a view sees, where those are not all.
SEEN_SHARE = 0.9


@checked
def unit_depth(depth: Float[Array, "*shape"], near: ScalarLike, far: ScalarLike) -> Float[Array, "*shape"]:
    """Depths as parts of a range, [0, 1] inside it: what filters that average encoded depths store and are asked for.

    Args:
        depth: Distances along the light's rays, world units.
        near: Depth that becomes 0, world units.
        far: Depth that becomes 1; a range that is empty is taken as one world unit.
    """
    # A flat map has no range: one world unit keeps receivers behind it behind it.
    width = jnp.asarray(far - near, depth.dtype)
    return (depth - near) / jnp.where(width > 0, width, jnp.ones_like(width))


class DepthRange(Checked):
    """The depths that a filter maps to [0, 1].

    A lamp over a wide ground sees depths a million times those that matter, beside which these would all become 0. So
    the part up to `seen` gets `SEEN_SHARE` of [0, 1], evenly; what lies beyond keeps its order in the rest, as
    1 − (1 − a)² / (1 − a + a (x − 1)) for the share a and the depth x in parts of the seen range, which goes on with
    the same derivative and stays below 1 but for rounding.

    Attributes:
        near: Depth that becomes 0, world units.
        far: Depth that becomes 1, or comes near to it.
        seen: Depth up to which parts are even, world units; all of the range if None or not between the others.
    """

    near: Float[Array, ""]
    far: Float[Array, ""]
    seen: Float[Array, ""] | None = None

    @classmethod
    def of(
        cls, depth: Float[Array, "rows cols"], far: Float[Array, ""] | None = None, seen: Float[Array, ""] | None = None
    ) -> "DepthRange":
        """From the nearest depth of a map to `far`, or to the farthest depth of the map if None."""
        return cls(jnp.min(depth), jnp.max(depth) if far is None else far, seen)

    def to_unit(self, depth: Float[Array, "*shape"]) -> Float[Array, "*shape"]:
        """Depths as parts of the range; below 0 or above 1 outside it. An empty range is taken as one world unit."""
        if self.seen is None:
            return unit_depth(depth, self.near, self.far)
        bends = (self.seen > self.near) & (self.seen < self.far)
        part = unit_depth(depth, self.near, jnp.where(bends, self.seen, self.far))
        share = jnp.where(bends, jnp.asarray(SEEN_SHARE, part.dtype), jnp.ones_like(self.far))
        rest = 1 - share
        past = jnp.where(bends, jnp.maximum(part - 1, 0), jnp.zeros_like(part))
        # where nothing bends the divisor must not be 0
        beyond = 1 - rest * rest / (jnp.where(bends, rest, jnp.ones_like(rest)) + share * past)
        return jnp.where(bends & (part > 1), beyond, share * part)
