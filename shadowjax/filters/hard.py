"""The shadow test: one comparison; several of one texel, counted: the composite test; and the filter of one texel."""

import jax.numpy as jnp

from shadowjax._checked import checked
from shadowjax._types import Array, Bool, Float
from shadowjax.filters.base import Filter, Lookup
from shadowjax.maps.sampling import read_texels, texel_index


@checked
def is_lit(
    stored_depth: Float[Array, "*#points"],
    receiver_depth: Float[Array, "*#points"],
    bias: Float[Array, "*#points"] | float = 0.0,
) -> Bool[Array, "*points"]:
    """The shadow test: lit where the receiver, moved towards the light by the bias, is not behind the stored depth.

    Args:
        stored_depth: Depth in the map, world units.
        receiver_depth: Receiver's distance along the light ray, world units.
        bias: Depth tolerance, world units.

    Source: filtering, eq. 2.1 (lit iff d ≤ z); mdsm, section 4.4 (1-TS).
    """
    return receiver_depth - bias <= stored_depth


@checked
def composite_test(
    planes_at_texel: Float[Array, "n *points"],
    depth: Float[Array, "*points"],
    bias: Float[Array, "*#points"] | float = 0.0,
) -> Float[Array, "*points"]:
    """The composite shadow test: visibility by the fraction of a texel's n depths that leave the receiver lit.

    1 is lit and 0 is in shadow, as figure 4.19 computes it; the attenuation s/n of section 4.2 is 1 minus this.

    Args:
        planes_at_texel: The n depths of the texel that each receiver reads, world units.
        depth: Receiver's distance along the light ray, world units.
        bias: Depth tolerance, world units.

    Returns:
        Visibility in {0, 1/n, …, 1}, without gradient.

    Source: mdsm, section 4.4.
    """
    lit = is_lit(planes_at_texel, depth, bias)
    return jnp.sum(lit, axis=0).astype(planes_at_texel.dtype) / planes_at_texel.shape[0]


class Hard(Filter):
    """Nearest texel, binary answer. Gradient 0 by construction."""

    def prepare(self, depth: Float[Array, "rows cols"]) -> Float[Array, "n rows cols"]:
        """The map itself."""
        return depth[None]

    def visibility(self, planes: Float[Array, "n rows cols"], lookup: Lookup) -> Float[Array, "*points"]:
        """0 or 1."""
        col, row = texel_index(lookup.position[..., 0]), texel_index(lookup.position[..., 1])
        stored = read_texels(planes, col, row, lookup.border)[0]
        return is_lit(stored, lookup.depth_at(col, row), lookup.bias).astype(planes.dtype)

    @property
    def num_planes(self) -> int:
        """One depth for each texel."""
        return 1

    @property
    def num_tones(self) -> int:
        """Lit or not."""
        return 2

    @property
    def num_fetches(self) -> int:
        """One."""
        return 1

    @property
    def reach(self) -> float:
        """A receiver lies at most half a texel from the centre of its texel."""
        return 0.5
