"""PCF whose bilinear taps lie anywhere: visibility is differentiable in their offsets, so they can be learned."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from shadowjax._checks import require, require_finite
from shadowjax._types import Array, ArrayLike, Float, as_float_array
from shadowjax.filters.base import Filter, Lookup
from shadowjax.filters.pcf import percentage_closer_of


class OffsetPercentageCloser(Filter):
    """Mean of bilinear taps at chosen offsets from the receiver.

    The gradient in the offsets is that of the bilinear weights: the depth tests stay tests.

    Attributes:
        offsets: (x, y) of each tap, texels.
        extent: Largest |x| or |y|, texels: what the bias must cover.
    """

    offsets: Float[Array, "taps 2"]
    extent: float = eqx.field(static=True)

    @classmethod
    def create(cls, offsets: ArrayLike) -> "OffsetPercentageCloser":
        """Checked constructor.

        Raises:
            ValueError: If the offsets are not pairs, or not finite.
        """
        made = require_finite(as_float_array(offsets), "tap offsets")
        require(made.ndim == 2 and made.shape[1] == 2, f"tap offsets must have shape (taps, 2); got {made.shape}")
        return cls(made, float(np.abs(np.asarray(made)).max(initial=0.0)))

    def prepare(self, depth: Float[Array, "rows cols"]) -> Float[Array, "n rows cols"]:
        """The map itself."""
        return depth[None]

    def visibility(self, planes: Any, lookup: Lookup) -> Float[Array, "*points"]:
        """Mean of the taps, one after the other."""
        offsets = self.offsets.astype(planes.dtype)

        def tap(total: Array, offset: Array) -> tuple[Array, None]:
            depth = lookup.depth
            if lookup.gradient is not None:  # the receiver's plane where the tap is
                depth = depth + lookup.gradient[..., 0] * offset[0] + lookup.gradient[..., 1] * offset[1]
            # Moving the receiver by the tap's offset is one bilinear read around the tap, with weights that follow it.
            moved = eqx.tree_at(lambda one: (one.position, one.depth), lookup, (lookup.position + offset, depth))
            return total + percentage_closer_of(planes, moved, 1, "bilinear"), None

        total, _ = jax.lax.scan(tap, jnp.zeros(lookup.depth.shape, planes.dtype), offsets)
        return total / offsets.shape[0]

    @property
    def num_planes(self) -> int:
        """One depth for each texel."""
        return 1

    @property
    def num_tones(self) -> None:
        """A continuum."""
        return None

    @property
    def num_fetches(self) -> int:
        """Four for each tap."""
        return 4 * self.offsets.shape[0]

    @property
    def reach(self) -> float:
        """The farthest tap and the texel beyond it."""
        return self.extent + 1.0


__all__ = ["OffsetPercentageCloser"]
