"""How encoded maps are blurred when they are made and averaged when they are read."""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax.numpy as jnp

from shadowjax._checks import require, require_choice
from shadowjax._types import Array, Float
from shadowjax.filters.base import Lookup
from shadowjax.maps.blur import KERNELS, blur, kernel_radius, kernel_weights
from shadowjax.maps.sampling import read_bilinear_apart, read_texels, texel_index

SAMPLINGS = ("nearest", "bilinear")


class Prefilter(eqx.Module):
    """A blur of the stored planes and the way lookups average them: what a comparison of depths cannot have.

    Attributes:
        size: Taps of the blur along an axis, odd, ≥ 1; 1 does not blur.
        kernel: "gaussian" or "box".
        sigma: Standard deviation of the Gaussian, texels; a fifth of the size if None.
        sampling: "nearest" reads one texel, "bilinear" four.
    """

    size: int = eqx.field(static=True, default=7)
    kernel: str = eqx.field(static=True, default="gaussian")
    sigma: float | None = eqx.field(static=True, default=None)
    sampling: str = eqx.field(static=True, default="bilinear")

    def __check_init__(self):
        kernel_radius(self.size)
        require_choice(self.kernel, "kernel", KERNELS)
        require_choice(self.sampling, "sampling", SAMPLINGS)
        require(self.sigma is None or self.sigma > 0, f"sigma of a Gaussian must be positive; got {self.sigma}")

    def prepare(self, planes: Float[Array, "n more_rows more_cols"]) -> Any:
        """Blur planes that reach `radius` texels beyond the map on every side."""
        return blur(planes, kernel_weights(self.kernel, self.size, self.sigma))

    def read(
        self, prepared: Any, lookup: Lookup, each: Callable[[Array], Array] | None = None
    ) -> list[Float[Array, "*points"]]:
        """The averaged value of every plane at each receiver. What lies outside the map repeats its edge.

        Args:
            prepared: From `prepare`.
            lookup: Receivers.
            each: Applied to every number read, before the average; None for no change.
        """
        border = "clamp" if lookup.border == "lit" else lookup.border
        if self.sampling == "nearest":
            col, row = texel_index(lookup.position[..., 0]), texel_index(lookup.position[..., 1])
            values = read_texels(prepared, col, row, border)
            return values if each is None else [each(value) for value in values]
        return read_bilinear_apart(prepared, lookup.position, border, each)

    @property
    def radius(self) -> int:
        """Texels that the blur reaches to either side."""
        return (self.size - 1) // 2

    @property
    def reach(self) -> float:
        """Texels along an axis between a receiver and the centres of the texels that it depends on, at most."""
        return self.radius + (0.5 if self.sampling == "nearest" else 1.0)

    @property
    def num_fetches(self) -> int:
        """Texels read for each receiver."""
        return {"nearest": 1, "bilinear": 4}[self.sampling]


class DepthRange(eqx.Module):
    """The depths that a filter maps to [0, 1].

    Attributes:
        near: Depth that becomes 0, world units.
        far: Depth that becomes 1.
    """

    near: Float[Array, ""]
    far: Float[Array, ""]

    @classmethod
    def of(cls, depth: Float[Array, "rows cols"], far: Float[Array, ""] | None = None) -> "DepthRange":
        """From the nearest depth of a map to `far`, or to the farthest depth of the map if None."""
        return cls(jnp.min(depth), jnp.max(depth) if far is None else far)

    def to_unit(self, depth: Float[Array, "*shape"]) -> Float[Array, "*shape"]:
        """Depths as parts of the range; below 0 or above 1 outside it. An empty range is taken as one world unit."""
        width = self.far - self.near
        return (depth - self.near) / jnp.where(width > 0, width, jnp.ones_like(width))
