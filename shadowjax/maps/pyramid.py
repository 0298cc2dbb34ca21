"""Mip chains: maps halved again and again, and reads of them that match the footprint of a pixel."""

import equinox as eqx
import jax
import jax.numpy as jnp

from shadowjax._checked import Checked, checked
from shadowjax._checks import require, require_int
from shadowjax._types import Array, Float, Int
from shadowjax.maps.sampling import bilinear_weights, fold

Numbers = Float[Array, "*points"]
# The map, and each level after it half as large.
Levels = tuple[Float[Array, "n _rows _cols"], ...]


class Pyramid(Checked):
    """All levels of some maps, one after the other.

    Attributes:
        texels: Every level of every plane, row by row.
        shapes: (rows, columns) of each level; texel i of level l covers texels 2^l·i … 2^l·(i + 1) − 1 of level 0.
    """

    texels: Float[Array, "n total"]
    shapes: tuple[tuple[int, int], ...] = eqx.field(static=True)

    @property
    def num_levels(self) -> int:
        """How many levels there are."""
        return len(self.shapes)

    def level(self, index: int) -> Float[Array, "n rows cols"]:
        """The planes of one level.

        Raises:
            ValueError: If there is no such level.
        """
        require(
            0 <= require_int(index, "mip level", 0) < self.num_levels,
            f"mip level {index} is empty: this chain has levels 0 to {self.num_levels - 1}",
        )
        start = sum(rows * cols for rows, cols in self.shapes[:index])
        rows, cols = self.shapes[index]
        return self.texels[:, start : start + rows * cols].reshape(-1, rows, cols)


@checked
def mip_levels(planes: Float[Array, "n rows cols"], num_levels: int | None = None) -> Levels:
    """Each level the mean of 2 × 2 blocks of the one before; sides of odd length repeat their last texel.

    Args:
        planes: Maps of one size, ≥ 1 texel.
        num_levels: Levels to make, with the map itself; down to one texel if None.

    Raises:
        ValueError: If there are fewer levels than asked for.
    """
    require(min(planes.shape[-2:]) >= 1, f"mip level 0 is empty: got a map of {planes.shape[-2]} × {planes.shape[-1]}")
    # ⌈log₂ side⌉ halvings bring the longer side to one texel.
    available = 1 + (max(planes.shape[-2:]) - 1).bit_length()
    wanted = available if num_levels is None else require_int(num_levels, "num_levels", 1)
    require(
        wanted <= available,
        f"mip level {available} would be empty: a map of {planes.shape[-2]} × {planes.shape[-1]} has {available} "
        f"levels; got num_levels {wanted}",
    )
    levels = [planes]
    for _ in range(wanted - 1):
        levels.append(_halved(levels[-1]))
    return tuple(levels)


@checked
def mip_chain(planes: Float[Array, "n rows cols"], num_levels: int | None = None) -> Pyramid:
    """All levels of some maps in one object; arguments and errors as of `mip_levels`."""
    return _joined(mip_levels(planes, num_levels))


def _joined(levels: Levels) -> Pyramid:
    texels = jnp.concatenate([level.reshape(level.shape[0], -1) for level in levels], axis=1)
    return Pyramid(texels, tuple((level.shape[1], level.shape[2]) for level in levels))


def _halved(planes: Array) -> Array:
    num, rows, cols = planes.shape
    even = jnp.pad(planes, ((0, 0), (0, rows % 2), (0, cols % 2)), mode="edge")
    # Axes 2 and 4 run within a block.
    blocks = even.reshape(num, even.shape[1] // 2, 2, even.shape[2] // 2, 2)
    return jnp.mean(blocks, axis=(2, 4))


@checked
def mip_level(footprint: Float[Array, "*points 2 2"]) -> Numbers:
    """λ = log₂ ρ, with ρ the longer of the pixel's two sides on the map in texels; at least 0.

    It errs towards blur: on a surface tilted by θ it takes 1/cos θ times the texels that the pixel covers.

    Args:
        footprint: Change of (x, y), texels, over one pixel along each image axis.

    Source: OpenGL 4.6 specification, section 8.14.1; asm, mip-map footprints.
    """
    # Squared lengths of the two columns of the Jacobian; ½·log₂ of the larger is λ.
    square = jnp.max(jnp.sum(footprint * footprint, axis=-2), axis=-1)
    return 0.5 * jnp.log2(jnp.maximum(square, 1.0))


@checked
def read_trilinear(
    pyramid: Pyramid, position: Float[Array, "*points 2"], level: Numbers, border: str = "clamp"
) -> list[Numbers]:
    """Bilinear reads of the two nearest levels, mixed.

    Args:
        pyramid: From `mip_chain`.
        position: (x, y) in texels of level 0, centres at +½.
        level: λ; limited to the levels that exist.
        border: "clamp" or "octahedral" (see `maps.sampling`).

    Returns:
        One array for each plane.
    """
    level = jnp.clip(level, 0.0, float(pyramid.num_levels - 1))
    lower = jnp.floor(level)
    mix = level - lower
    index = lower.astype(jnp.int32)
    finer = _read_level(pyramid, position, index, border)
    coarser = _read_level(pyramid, position, jnp.minimum(index + 1, pyramid.num_levels - 1), border)
    return [a + mix * (b - a) for a, b in zip(finer, coarser, strict=True)]


def _read_level(pyramid: Pyramid, position: Array, level: Int[Array, "*points"], border: str) -> list[Array]:
    """Bilinear read of a level that may differ from point to point."""
    # All levels lie in one row of texels, so that a level may be an array: its start and size are looked up, and each
    # read is one gather.
    sizes = jnp.asarray(pyramid.shapes, jnp.int32)
    starts = jnp.concatenate([jnp.zeros(1, jnp.int32), jnp.cumsum(sizes[:, 0] * sizes[:, 1], dtype=jnp.int32)])
    num_rows, num_cols, start = sizes[level, 0], sizes[level, 1], starts[level]
    scale = jnp.exp2(-level.astype(position.dtype))
    col, row, right, down = bilinear_weights(position * scale[..., None])
    results = [jnp.zeros(position.shape[:-1], position.dtype) for _ in pyramid.texels]
    for d_row, row_weight in ((0, 1 - down), (1, down)):
        for d_col, col_weight in ((0, 1 - right), (1, right)):
            at_col, at_row = col + d_col, row + d_row
            if border == "octahedral":
                at_col, at_row = fold(at_col, at_row, num_cols, num_rows)
            at = start + jnp.clip(at_row, 0, num_rows - 1) * num_cols + jnp.clip(at_col, 0, num_cols - 1)
            weight = row_weight * col_weight
            results = [result + plane[at] * weight for result, plane in zip(results, pyramid.texels, strict=True)]
    return results


@checked
def footprint_axes(footprint: Float[Array, "*points 2 2"]) -> tuple[Float[Array, "*points 2"], Numbers, Numbers]:
    """The ellipse that a pixel's footprint makes of a circle.

    Args:
        footprint: Change of (x, y), texels, over one pixel along each image axis.

    Returns:
        Unit direction of the longer axis, and both diameters, texels: the singular values of the footprint.
    """
    # J·Jᵀ = [[a, b], [b, c]]: its eigenvalues are the squares of the half axes, its first eigenvector lies at
    # ½·atan2(2b, a − c).
    a = jnp.sum(footprint[..., 0, :] ** 2, axis=-1)
    c = jnp.sum(footprint[..., 1, :] ** 2, axis=-1)
    b = jnp.sum(footprint[..., 0, :] * footprint[..., 1, :], axis=-1)
    half_sum, half_difference = 0.5 * (a + c), 0.5 * (a - c)
    # A circle has no longer axis: the x axis will do, and derivatives stay finite.
    square = half_difference * half_difference + b * b
    round_ = square <= jnp.finfo(a.dtype).eps ** 2 * half_sum * half_sum
    radius = jnp.sqrt(jnp.where(round_, jnp.ones_like(square), square))
    angle = 0.5 * jnp.arctan2(jnp.where(round_, 0.0, b), jnp.where(round_, 1.0, half_difference))
    radius = jnp.where(round_, jnp.zeros_like(radius), radius)
    tiny = jnp.finfo(a.dtype).tiny
    longer = jnp.sqrt(jnp.maximum(half_sum + radius, tiny))
    # The product of both is |det|, which does not cancel as half_sum − radius does.
    determinant = footprint[..., 0, 0] * footprint[..., 1, 1] - footprint[..., 0, 1] * footprint[..., 1, 0]
    return jnp.stack([jnp.cos(angle), jnp.sin(angle)], axis=-1), longer, jnp.abs(determinant) / longer


@checked
def read_anisotropic(
    pyramid: Pyramid,
    position: Float[Array, "*points 2"],
    footprint: Float[Array, "*points 2 2"],
    max_anisotropy: int = 8,
    border: str = "clamp",
) -> list[Numbers]:
    """Trilinear reads along the longer axis of the footprint, at the level of its shorter axis.

    Args:
        pyramid: From `mip_chain`.
        position: (x, y) in texels of level 0.
        footprint: Change of (x, y), texels, over one pixel along each image axis.
        max_anisotropy: Reads, ≥ 1; a longer ellipse takes a coarser level.
        border: "clamp" or "octahedral".

    Returns:
        One array for each plane.

    Source: EXT_texture_filter_anisotropic, with the exact axes of the ellipse.
    """
    num = require_int(max_anisotropy, "max_anisotropy", 1)
    axis, longer, shorter = footprint_axes(footprint)
    # An ellipse longer than `num` of its widths takes a level as coarse as its length over `num`.
    level = jnp.log2(jnp.maximum(jnp.maximum(shorter, longer / num), 1.0))

    def step(sums: list[Array], along: Array) -> tuple[list[Array], None]:
        values = read_trilinear(pyramid, position + axis * (along * longer)[..., None], level, border)
        return [total + value for total, value in zip(sums, values, strict=True)], None

    # Middles of `num` equal parts of the longer axis, from −½ to ½.
    offsets = (jnp.arange(num, dtype=position.dtype) + 0.5) / num - 0.5
    zeros = [jnp.zeros(position.shape[:-1], position.dtype) for _ in pyramid.texels]
    sums, _ = jax.lax.scan(step, zeros, offsets)
    return [total / num for total in sums]


@checked
def read_mip(
    levels: Levels, position: Float[Array, "*points 2"], level: Numbers, border: str = "clamp"
) -> Float[Array, "n *points"]:
    """`read_trilinear` from arrays: the two nearest levels, mixed.

    Args:
        levels: From `mip_levels`.
        position: (x, y) in texels of level 0, centres at +½.
        level: λ (`mip_level`); limited to the levels that exist.
        border: "clamp" or "octahedral".
    """
    return jnp.stack(read_trilinear(_joined(levels), position, level, border))


@checked
def read_mip_anisotropic(
    levels: Levels,
    position: Float[Array, "*points 2"],
    footprint: Float[Array, "*points 2 2"],
    max_anisotropy: int = 8,
    border: str = "clamp",
) -> Float[Array, "n *points"]:
    """`read_anisotropic` from arrays: reads along the longer axis of the footprint, at the level of its shorter axis.

    Args:
        levels: From `mip_levels`.
        position: (x, y) in texels of level 0, centres at +½.
        footprint: Change of (x, y), texels, over one pixel along each image axis.
        max_anisotropy: Reads, ≥ 1.
        border: "clamp" or "octahedral".
    """
    return jnp.stack(read_anisotropic(_joined(levels), position, footprint, max_anisotropy, border))
