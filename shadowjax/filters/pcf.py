"""Percentage-closer filtering: tests first, then averages the answers. Over one depth a texel or several: PCF(k, n)."""

import equinox as eqx
import jax.numpy as jnp

from shadowjax._checked import checked
from shadowjax._checks import came, require, require_int
from shadowjax._types import Array, Float
from shadowjax.filters.base import Filter, Lookup
from shadowjax.filters.hard import is_lit
from shadowjax.maps.sampling import bilinear_weights, read_texels, texel_index


@checked
def kernel_offsets(kernel_size: int) -> tuple[float, ...]:
    """Offsets of the taps along one axis: i − (K − 1)/2, whole numbers for odd K and halves for even K.

    Source: filtering, Algorithm 1.
    """
    return tuple(i - (kernel_size - 1) / 2 for i in range(kernel_size))


@checked
def percentage_closer(
    planes: Float[Array, "n rows cols"],
    lookup: Lookup,
    kernel_size: int,
    spacing: Float[Array, "*#points"] | float = 1.0,
    shift: tuple[float, float] = (0.0, 0.0),
) -> Float[Array, "*points"]:
    """PCF(k, n): the mean, over k = K² taps of a map with n depths a texel, of the composite test's visibility.

    Args:
        planes: The n depths of each texel; n = 1 for a traditional map.
        lookup: Receivers.
        kernel_size: K, taps along an axis, ≥ 1; odd or even.
        spacing: Distance between taps, texels.
        shift: (x, y) by which all taps are moved, texels.

    Returns:
        Visibility in {0, 1/(nk), …, 1}: nk + 1 tones at most.

    Source: filtering, eq. 2.1 and Algorithm 1; mdsm, sections 4.4 and 4.6.4.
    """
    num_planes = planes.shape[0]
    fits = jnp.ndim(spacing) <= lookup.depth.ndim and all(
        size in (1, whole) for size, whole in zip(jnp.shape(spacing)[::-1], lookup.depth.shape[::-1], strict=False)
    )
    require(fits, f"spacing must be one number, or one for each point of lookup; got {came(spacing)}")
    x, y = lookup.position[..., 0] + shift[0], lookup.position[..., 1] + shift[1]
    offsets = kernel_offsets(kernel_size)
    cols = [texel_index(x + offset * spacing) for offset in offsets]
    rows = [texel_index(y + offset * spacing) for offset in offsets]
    count = jnp.zeros(lookup.depth.shape, planes.dtype)
    for row in rows:
        for col in cols:
            receiver = lookup.depth_at(col, row)
            for stored in read_texels(planes, col, row, lookup.border):
                count = count + is_lit(stored, receiver, lookup.bias).astype(planes.dtype)
    # Counting in whole numbers and dividing once keeps "all lit" exactly 1 (adding 1/18 eighteen times does not).
    return count / (num_planes * kernel_size**2)


@checked
def bilinear_percentage_closer(
    planes: Float[Array, "n rows cols"], lookup: Lookup, kernel_size: int = 1
) -> Float[Array, "*points"]:
    """Mean of K × K taps, each the bilinear mix of the test results of four texels, as hardware does.

    Continuous in the receiver's position, unlike nearest taps.

    Args:
        planes: The n depths of each texel.
        lookup: Receivers.
        kernel_size: K, bilinear taps along an axis, ≥ 1.

    Returns:
        Visibility in [0, 1].

    Source: filtering, eq. 2.2, applied to results of the test.
    """
    num_planes = planes.shape[0]
    col, row, right, down = bilinear_weights(lookup.position - (kernel_size - 1) / 2)

    # Neighbouring taps share texels: their weights add up to 1 − fraction, 1, …, 1, fraction. Written as a sum and a
    # step, whole numbers stay whole: all lit is exactly 1 and all dark exactly 0.
    def blend(values: list[Array], fraction: Array) -> Array:
        return sum(values[1:-1], values[0]) + fraction * (values[-1] - values[0])

    lines = []
    for d_row in range(kernel_size + 1):
        line = []
        for d_col in range(kernel_size + 1):
            stored = read_texels(planes, col + d_col, row + d_row, lookup.border)
            receiver = lookup.depth_at(col + d_col, row + d_row)
            lit = [is_lit(depth, receiver, lookup.bias).astype(planes.dtype) for depth in stored]
            line.append(sum(lit[1:], lit[0]))
        lines.append(blend(line, right))
    return blend(lines, down) / (num_planes * kernel_size**2)


class PercentageCloser(Filter):
    """PCF with K × K nearest taps.

    Attributes:
        kernel_size: K, taps along an axis, ≥ 1; odd or even.
        width_world: Width of the whole kernel in world units at the receiver; None spaces taps one texel apart.
    """

    kernel_size: int = eqx.field(static=True, default=3)
    width_world: float | None = eqx.field(static=True, default=None)

    def __check_init__(self) -> None:
        require_int(self.kernel_size, "kernel_size", 1)
        require(
            self.width_world is None or self.width_world > 0,
            f"width_world must be positive (or None for texel spacing); got {self.width_world}",
        )

    def prepare(self, depth: Float[Array, "rows cols"]) -> Float[Array, "n rows cols"]:
        """The map itself."""
        return depth[None]

    def visibility(self, planes: Float[Array, "n rows cols"], lookup: Lookup) -> Float[Array, "*points"]:
        """Fraction of taps that are lit."""
        return percentage_closer(planes, lookup, self.kernel_size, tap_spacing(self, lookup))

    @property
    def num_planes(self) -> int:
        """One depth for each texel."""
        return 1

    @property
    def num_tones(self) -> int:
        """k + 1, mdsm eq. 4.2 with w = 2."""
        return self.kernel_size**2 + 1

    @property
    def num_fetches(self) -> int:
        """K²."""
        return self.kernel_size**2

    @property
    def reach(self) -> float:
        """Half a texel, and the taps' offset beyond it; world-sized kernels count theirs at the receiver."""
        return self.kernel_size / 2


@checked
def tap_spacing(kernel: "PercentageCloser", lookup: Lookup) -> Float[Array, "*#points"] | float:
    """Distance between taps in texels: 1, or what makes the kernel as wide as asked in world units."""
    if kernel.width_world is None:
        return 1.0
    return kernel.width_world / (kernel.kernel_size * lookup.texel_size)


class BilinearPercentageCloser(Filter):
    """PCF with bilinear taps: smooth between texels, K × K taps read (K + 1)² depths.

    Attributes:
        kernel_size: K, bilinear taps along an axis, ≥ 1.
    """

    kernel_size: int = eqx.field(static=True, default=1)

    def __check_init__(self) -> None:
        require_int(self.kernel_size, "kernel_size", 1)

    def prepare(self, depth: Float[Array, "rows cols"]) -> Float[Array, "n rows cols"]:
        """The map itself."""
        return depth[None]

    def visibility(self, planes: Float[Array, "n rows cols"], lookup: Lookup) -> Float[Array, "*points"]:
        """Weighted fraction of lit texels."""
        return bilinear_percentage_closer(planes, lookup, self.kernel_size)

    @property
    def num_planes(self) -> int:
        """One depth for each texel."""
        return 1

    @property
    def num_tones(self) -> None:
        """A continuum: the weights vary smoothly."""
        return None

    @property
    def num_fetches(self) -> int:
        """(K + 1)²."""
        return (self.kernel_size + 1) ** 2

    @property
    def reach(self) -> float:
        """The outermost texel of K bilinear taps."""
        return (self.kernel_size + 1) / 2
