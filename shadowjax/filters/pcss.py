"""Percentage-closer soft shadows: how far blockers stand from the receiver decides how wide the filter is."""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp

from shadowjax._checked import Checked, checked
from shadowjax._checks import require, require_finite, require_int
from shadowjax._types import Array, Bool, Float
from shadowjax.filters.base import Filter, Lookup
from shadowjax.filters.hard import is_lit
from shadowjax.filters.pcf import kernel_offsets
from shadowjax.maps.sampling import read_texels, texel_index
from shadowjax.maps.shadow_map import ShadowMap

Numbers = Float[Array, "*points"]


@checked
def mean_blocker_depth(
    planes: Float[Array, "1 rows cols"], lookup: Lookup, num_taps: int, spacing: Float[Array, "*#points"]
) -> tuple[Numbers, Numbers]:
    """Mean of the stored depths that shadow the receiver, over a grid of taps around it.

    Args:
        planes: The depth map.
        lookup: Receivers.
        num_taps: Taps along an axis, ≥ 1.
        spacing: Distance between taps, texels.

    Returns:
        The mean, the receiver's own depth where nothing blocks; and the number of taps that block.

    Source: Fernando 2005, "Percentage-Closer Soft Shadows", step 1.
    """

    def step(sums: tuple[Numbers, Numbers], stored: Numbers, blocks: Bool[Array, "*points"]) -> tuple[Numbers, Numbers]:
        total, count = sums
        return total + jnp.where(blocks, stored, jnp.zeros_like(stored)), count + blocks.astype(count.dtype)

    zeros = jnp.zeros_like(lookup.depth)
    total, count = _over_taps(planes, lookup, num_taps, spacing, step, (zeros, zeros))
    # Without blockers 0/0 must not reach the gradient: the count is replaced before the division.
    none = count == 0
    return jnp.where(none, lookup.depth, total / jnp.where(none, jnp.ones_like(count), count)), count


def _over_taps(
    planes: Array, lookup: Lookup, num_taps: int, spacing: Array, step: Callable[..., Any], start: Any
) -> Any:
    """Fold `step(state, stored depth, whether it shadows)` over K × K taps; a loop, as taps are many."""
    offsets = jnp.asarray(kernel_offsets(num_taps), lookup.position.dtype)
    # All K² offsets in one list: `scan` then compiles one tap.
    taps = jnp.stack(jnp.meshgrid(offsets, offsets), axis=-1).reshape(-1, 2)

    def one(state: Any, tap: Array) -> tuple[Any, None]:
        col = texel_index(lookup.position[..., 0] + tap[0] * spacing)
        row = texel_index(lookup.position[..., 1] + tap[1] * spacing)
        (stored,) = read_texels(planes, col, row, lookup.border)
        # `depth_at` follows the receiver's plane to the texel, where the lookup knows the plane.
        return step(state, stored, ~is_lit(stored, lookup.depth_at(col, row), lookup.bias)), None

    return jax.lax.scan(one, start, taps)[0]


@checked
def penumbra_width(receiver_depth: Numbers, blocker_depth: Numbers, light_size: float, parallel: bool) -> Numbers:
    """Width of the penumbra on a receiver across the light, by similar triangles.

    Args:
        receiver_depth: d, distance along the ray, world units.
        blocker_depth: b in (0, d].
        light_size: Diameter of the light: world units for a local light, 2·tan of half its angle for a distant one.
        parallel: Whether the light is distant.

    Returns:
        size·(d − b) for distant lights, size·(d − b)/b for local ones, world units.

    Source: Fernando 2005, "Percentage-Closer Soft Shadows", step 2.
    """
    beyond = jnp.maximum(receiver_depth - blocker_depth, 0.0)
    if parallel:
        return light_size * beyond
    return light_size * beyond / jnp.maximum(blocker_depth, jnp.finfo(beyond.dtype).eps)


class SoftMap(Checked):
    """A depth map and its nearest depth.

    Attributes:
        depth: The map.
        nearest: Its smallest depth: nothing blocks from farther away.
    """

    depth: Float[Array, "1 rows cols"]
    nearest: Float[Array, ""]


class ContactHardening(Filter):
    """PCSS: a blocker search, then PCF as wide as the penumbra that those blockers make.

    Taps are tested against the receiver's own plane, since a wide kernel would need a bias as wide.

    Attributes:
        angle: Diameter of a directional light as seen from the scene, 2·tan of half its angle, ≥ 0; the sun has 0.0093.
        size: Diameter of a spot or point light, world units, ≥ 0.
        num_taps: K taps of the PCF along an axis, ≥ 1.
        num_search_taps: Taps of the blocker search along an axis, ≥ 1.
        max_width: Widest kernel and widest search, texels, ≥ 1.

    Source: Fernando 2005, "Percentage-Closer Soft Shadows".
    """

    angle: float = eqx.field(static=True, default=0.1)
    size: float = eqx.field(static=True, default=0.2)
    num_taps: int = eqx.field(static=True, default=5)
    num_search_taps: int = eqx.field(static=True, default=5)
    max_width: float = eqx.field(static=True, default=16.0)

    def __check_init__(self) -> None:
        require(self.angle >= 0, f"angle of the light must not be negative; got {self.angle}")
        require(self.size >= 0, f"size of the light must not be negative; got {self.size}")
        require_int(self.num_taps, "num_taps", 1)
        require_int(self.num_search_taps, "num_search_taps", 1)
        require(self.max_width >= 1, f"max_width must be at least a texel; got {self.max_width}")

    def prepare(self, depth: Float[Array, "rows cols"]) -> SoftMap:
        """The map itself."""
        depth = require_finite(depth, "depth map")
        return SoftMap(depth[None], jnp.min(depth))

    def prepare_map(self, shadow_map: ShadowMap) -> SoftMap:
        """The map itself, whose depths are finite by construction."""
        return SoftMap(shadow_map.depth[None], jnp.min(shadow_map.depth))

    def visibility(self, planes: SoftMap, lookup: Lookup) -> Numbers:
        """Fraction of taps that are lit; 1 where the search finds no blocker."""
        # No blocker is nearer to the light than the map's nearest depth, so no penumbra is wider than its.
        search = self._width(lookup, jnp.minimum(planes.nearest, lookup.depth))
        blocker, count = mean_blocker_depth(planes.depth, lookup, self.num_search_taps, search / self.num_search_taps)
        # Penumbra of the mean blocker, for the second step's kernel.
        width = self._width(lookup, blocker)

        def step(dark: Numbers, stored: Numbers, blocks: Bool[Array, "*points"]) -> Numbers:
            return dark + blocks.astype(dark.dtype)

        zeros = jnp.zeros_like(lookup.depth)
        dark = _over_taps(planes.depth, lookup, self.num_taps, width / self.num_taps, step, zeros)
        return jnp.where(count == 0, jnp.ones_like(dark), (self.num_taps**2 - dark) / self.num_taps**2)

    def _width(self, lookup: Lookup, blocker_depth: Numbers) -> Numbers:
        """Width of the penumbra in texels, at least one and at most `max_width`."""
        light_size = self.angle if lookup.parallel else self.size
        # World width over the texel's world size: the kernel's width in texels.
        width = penumbra_width(lookup.depth, blocker_depth, light_size, lookup.parallel) / lookup.texel_size
        return jnp.clip(width, 1.0, self.max_width)

    @property
    def num_planes(self) -> int:
        """One depth for each texel."""
        return 1

    @property
    def num_tones(self) -> int:
        """K² + 1."""
        return self.num_taps**2 + 1

    @property
    def num_fetches(self) -> int:
        """Those of the search and of the filter."""
        return self.num_taps**2 + self.num_search_taps**2

    @property
    def reach(self) -> float:
        """Half of the widest kernel."""
        return self.max_width / 2 + 0.5

    @property
    def bias_reach(self) -> float:
        """Taps follow the receiver's plane; a texel covers how a map bends it."""
        return 1.0

    @property
    def follows_plane(self) -> bool:
        """Always."""
        return True
