"""Percentage-closer filtering: tests first, then averages the answers. Over one depth a texel or several: PCF(k, n)."""

import equinox as eqx
import jax.numpy as jnp

from shadowjax._checked import checked
from shadowjax._checks import require, require_choice, require_int
from shadowjax._types import Array, Float
from shadowjax.filters.base import Filter, Lookup, depth_at_texel
from shadowjax.filters.hard import is_lit
from shadowjax.maps.sampling import bilinear_weights, read_texels, texel_index

TAPS = ("nearest", "bilinear")


@checked
def kernel_offsets(kernel_size: int) -> tuple[float, ...]:
    """Offsets of the taps along one axis: i − (K − 1)/2, whole numbers for odd K and halves for even K.

    Source: filtering, Algorithm 1.
    """
    return tuple(i - (kernel_size - 1) / 2 for i in range(kernel_size))


@checked
def percentage_closer(
    planes: Float[Array, "n rows cols"],
    position: Float[Array, "*points 2"],
    depth: Float[Array, "*points"],
    kernel_size: int = 3,
    bias: Float[Array, "*#points"] | float = 0.0,
    border: str = "lit",
    *,
    taps: str = "nearest",
    width_world: Float[Array, "*#points"] | float | None = None,
    texel_size: Float[Array, "*#points"] | float = 1.0,
    shift: tuple[float, float] = (0.0, 0.0),
    gradient: Float[Array, "*points 2"] | None = None,
) -> Float[Array, "*points"]:
    """PCF(k, n): the mean, over k = K² taps of a map with n depths a texel, of the composite test's visibility.

    Args:
        planes: The n depths of each texel, world units; n = 1 for a traditional map.
        position: (x, y) of receivers in texels, centres at +½.
        depth: Receivers' distances along the light ray, world units.
        kernel_size: K, taps along an axis, ≥ 1; odd or even.
        bias: Depth tolerance, world units.
        border: What lies outside the map: "lit", "clamp" (the edge goes on) or "octahedral".
        taps: "nearest" reads one texel a tap; "bilinear" mixes the test results of the four around it, as hardware
            does, and is continuous in the receiver's position.
        width_world: Width of the whole kernel in world units, > 0; None spaces taps one texel apart.
        texel_size: World size of a texel at the receiver; of use with `width_world`, which is in texels where it is 1.
        shift: (x, y) by which all taps are moved, texels: against the centroid of extra depths (`multi_depth_shift`).
        gradient: Change of each receiver's plane in depth over one texel along x and y, world units: each texel is then
            tested against that plane. None tests all against `depth`.

    Returns:
        Visibility in {0, 1/(nk), …, 1}, nk + 1 tones at most; in [0, 1] with bilinear taps. Its gradient is 0, but for
        that of the bilinear weights in the position.

    Raises:
        ValueError: If a choice is unknown, or the kernel has no taps.

    Source: filtering, eqs 2.1 and 2.2 and Algorithm 1; mdsm, sections 4.4 and 4.6.4.
    """
    require_int(kernel_size, "kernel_size", 1)
    require_choice(taps, "taps", TAPS)
    receivers = position, depth, gradient
    # K taps spread over the width: width/K from one to the next, in texels of the receiver's place.
    spacing = 1.0 if width_world is None else width_world / (kernel_size * texel_size)
    if taps == "nearest":
        count = _nearest_count(planes, receivers, kernel_size, bias, border, spacing, shift)
    else:
        moved = position + jnp.asarray(shift, position.dtype) if shift != (0.0, 0.0) else position
        if width_world is None:
            count = _bilinear_count(planes, moved, receivers, kernel_size, bias, border)
        else:
            # Taps that are not whole texels apart share no texels: each is a kernel of one.
            steps = [offset * spacing for offset in kernel_offsets(kernel_size)]
            apart = [jnp.stack(jnp.broadcast_arrays(x, y), -1) for y in steps for x in steps]
            first, *others = (_bilinear_count(planes, moved + step, receivers, 1, bias, border) for step in apart)
            count = sum(others, first)
    # Counting in whole numbers and dividing once keeps "all lit" exactly 1 (adding 1/18 eighteen times does not).
    return count / (planes.shape[0] * kernel_size**2)


def _nearest_count(
    planes: Array,
    receivers: tuple[Array, Array, Array | None],
    kernel_size: int,
    bias: Array | float,
    border: str,
    spacing: Array | float,
    shift: tuple[float, float],
) -> Array:
    """Lit tests of K × K single texels."""
    position, depth, gradient = receivers
    x, y = position[..., 0] + shift[0], position[..., 1] + shift[1]
    offsets = kernel_offsets(kernel_size)
    # Columns and rows of the taps are worked out once each, not for every pair.
    cols = [texel_index(x + offset * spacing) for offset in offsets]
    rows = [texel_index(y + offset * spacing) for offset in offsets]
    count = jnp.zeros(depth.shape, planes.dtype)
    for row in rows:
        for col in cols:
            receiver = depth_at_texel(position, depth, gradient, col, row)
            for stored in read_texels(planes, col, row, border):
                count = count + is_lit(stored, receiver, bias).astype(planes.dtype)
    return count


def _bilinear_count(
    planes: Array,
    moved: Array,
    receivers: tuple[Array, Array, Array | None],
    kernel_size: int,
    bias: Array | float,
    border: str,
) -> Array:
    """Lit tests of K × K bilinear taps, K + 1 texels along an axis, weighted."""
    position, depth, gradient = receivers
    col, row, right, down = bilinear_weights(moved - (kernel_size - 1) / 2)

    # Neighbouring taps share texels: their weights add up to 1 − fraction, 1, …, 1, fraction. Written as a sum and a
    # step, whole numbers stay whole: all lit is exactly 1 and all dark exactly 0.
    def blend(values: list[Array], fraction: Array) -> Array:
        return sum(values[1:-1], values[0]) + fraction * (values[-1] - values[0])

    # (K + 1)² texels, each tested once: blended along columns within a row, then the rows.
    lines = []
    for d_row in range(kernel_size + 1):
        line = []
        for d_col in range(kernel_size + 1):
            stored = read_texels(planes, col + d_col, row + d_row, border)
            receiver = depth_at_texel(position, depth, gradient, col + d_col, row + d_row)
            lit = [is_lit(one, receiver, bias).astype(planes.dtype) for one in stored]
            line.append(sum(lit[1:], lit[0]))
        lines.append(blend(line, right))
    return blend(lines, down)


@checked
def percentage_closer_of(
    planes: Float[Array, "n rows cols"],
    lookup: Lookup,
    kernel_size: int,
    taps: str = "nearest",
    width_world: Float[Array, "*#points"] | float | None = None,
    shift: tuple[float, float] = (0.0, 0.0),
) -> Float[Array, "*points"]:
    """`percentage_closer` at the receivers of a lookup."""
    return percentage_closer(
        planes, lookup.position, lookup.depth, kernel_size, lookup.bias, lookup.border, taps=taps,
        width_world=width_world, texel_size=lookup.texel_size, shift=shift, gradient=lookup.gradient,
    )  # fmt: skip


def _require_width(width_world: float | None) -> None:
    require(
        width_world is None or width_world > 0,
        f"width_world must be positive (or None for texel spacing); got {width_world}",
    )


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
        _require_width(self.width_world)

    def prepare(self, depth: Float[Array, "rows cols"]) -> Float[Array, "n rows cols"]:
        """The map itself."""
        return depth[None]

    def visibility(self, planes: Float[Array, "n rows cols"], lookup: Lookup) -> Float[Array, "*points"]:
        """Fraction of taps that are lit."""
        return percentage_closer_of(planes, lookup, self.kernel_size, width_world=self.width_world)

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


class BilinearPercentageCloser(Filter):
    """PCF with bilinear taps: smooth between texels, K × K taps one texel apart read (K + 1)² depths.

    Attributes:
        kernel_size: K, bilinear taps along an axis, ≥ 1.
        width_world: Width of the whole kernel in world units at the receiver; None spaces taps one texel apart.
    """

    kernel_size: int = eqx.field(static=True, default=1)
    width_world: float | None = eqx.field(static=True, default=None)

    def __check_init__(self) -> None:
        require_int(self.kernel_size, "kernel_size", 1)
        _require_width(self.width_world)

    def prepare(self, depth: Float[Array, "rows cols"]) -> Float[Array, "n rows cols"]:
        """The map itself."""
        return depth[None]

    def visibility(self, planes: Float[Array, "n rows cols"], lookup: Lookup) -> Float[Array, "*points"]:
        """Weighted fraction of lit texels."""
        return percentage_closer_of(planes, lookup, self.kernel_size, "bilinear", self.width_world)

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
        """(K + 1)², or four for each tap where taps are apart."""
        return (self.kernel_size + 1) ** 2 if self.width_world is None else 4 * self.kernel_size**2

    @property
    def reach(self) -> float:
        """The outermost texel of K bilinear taps; world-sized kernels count theirs at the receiver."""
        return (self.kernel_size + 1) / 2
