"""Perspective aliasing error that a perspective warp predicts: m_x and m_z at a point, M_x and M_z over the frustum.

Everything is written in 1/n', so that the uniform map (n' = ∞) is an ordinary value and loses no digits.
"""

from typing import Annotated

import equinox as eqx
import jax.numpy as jnp

from shadowjax._checked import Checked, checked
from shadowjax._checks import MAY_BE_INFINITE
from shadowjax._numerics import larger
from shadowjax._types import Array, Float
from shadowjax.theory.aliasing.light_frustum import LightFrustum, Section, VirtualNear


@checked
def error_z(
    frustum: LightFrustum,
    near_distance: VirtualNear,
    depth: Float[Array, "..."],
    height: Float[Array, "..."] | float = 0.0,
    resolution_ratio: Float[Array, "..."] | float = 1.0,
) -> Float[Array, "..."]:
    """Perspective error along z': texel beam thickness over pixel beam thickness.

    The texel's thickness is measured across the light (dz'), so the result is sin γ times the source's eq. 37, which
    measures it along the view axis; only then does it reach eq. 53 as γ → 0.

    Args:
        frustum: View and light.
        near_distance: Virtual near distance n', world units, > 0.
        depth: Depth z of the point, world units, > 0.
        height: Height of the point above the view axis, world units.
        resolution_ratio: Image rows over map rows, res_cy/res_lt.

    Source: warping, eq. 26 and eq. 37 · sin γ.
    """
    # dz'/dt for t in [0, 1], the inverse of eq. 24 with the extent W in place of f − n: W(1 + u/n')²/(1 + W/n') at the
    # offset u. Divided by n'² throughout, it stays finite as n' → ∞.
    strength = 1 / near_distance
    stretch = 1 + frustum.offset(depth, height) * strength
    extent = frustum.extent
    texel = extent * stretch * stretch / (1 + extent * strength)
    # The pixel's beam is 2z·tan φ_y wide (eq. 17).
    return resolution_ratio * texel / (2 * depth * frustum.tan_y)


@checked
def error_x(
    frustum: LightFrustum,
    near_distance: VirtualNear,
    depth: Float[Array, "..."],
    height: Float[Array, "..."] | float = 0.0,
    resolution_ratio: Float[Array, "..."] | float = 1.0,
) -> Float[Array, "..."]:
    """Perspective error along x with the smallest P that encloses the frustum.

    Args:
        frustum: View and light.
        near_distance: Virtual near distance n', world units, > 0.
        depth: Depth z of the point, world units, > 0.
        height: Height of the point above the view axis, world units.
        resolution_ratio: Image columns over map columns, res_cx/res_ls.

    Source: warping, eq. 25 with the true opening of P; equal to eq. 25 for γ = π/2 and n' ≥ n.
    """
    strength = 1 / near_distance
    # P opens linearly in z', so a texel at offset u is 1 + u/n' times as wide as at z' = n'.
    texel = 2 * frustum.half_width(strength) * (1 + frustum.offset(depth, height) * strength)
    return resolution_ratio * texel / (2 * depth * frustum.tan_x)


def _worst(frustum: LightFrustum, strength: Float[Array, "..."], section: Section) -> tuple[Array, Array]:
    """1 + offset/n' of the worst line at the near and at the far plane."""
    # The worst line's offset is E at the near plane and F = E + g·(f − n) at the far one.
    offset, slope = frustum.worst_line(section)
    return 1 + offset * strength, 1 + (offset + slope * (frustum.far - frustum.near)) * strength


@checked
def max_error_z(
    frustum: LightFrustum,
    near_distance: VirtualNear,
    section: Section = "axis",
    resolution_ratio: Float[Array, "..."] | float = 1.0,
) -> Float[Array, "..."]:
    """M_z, the largest z error: m_z is convex in depth, so it sits at the near or at the far plane.

    Source: warping, eq. 29 and 37–39, with thickness across the light.
    """
    strength, extent = 1 / near_distance, frustum.extent
    near, far = _worst(frustum, strength, section)
    # One branch each for the near and the far plane; `larger` keeps the whole gradient of one where they tie (eq. 29).
    shape = larger(near * near / frustum.near, far * far / frustum.far)
    return resolution_ratio * extent / (1 + extent * strength) * shape / (2 * frustum.tan_y)


@checked
def max_error_x(
    frustum: LightFrustum,
    near_distance: VirtualNear,
    section: Section = "axis",
    resolution_ratio: Float[Array, "..."] | float = 1.0,
) -> Float[Array, "..."]:
    """M_x, the largest x error: m_x is monotone in depth, so it sits at the near or at the far plane.

    Source: warping, eq. 28, with the true opening of P.
    """
    strength = 1 / near_distance
    near, far = _worst(frustum, strength, section)
    shape = larger(near / frustum.near, far / frustum.far)
    return resolution_ratio * frustum.half_width(strength) / frustum.tan_x * shape


class Pieces(Checked):
    """Smooth functions of n' whose largest is a worst error: ln of each is level + Σ power·ln(1 + offset/n').

    Attributes:
        level: ln of each for the uniform map.
        offsets: E and F of the worst line, those of the lower edge at near and far plane, and the extent W.
        powers: For each piece, the power of each offset's stretch.
    """

    level: Float[Array, "*batch pieces"]
    offsets: Float[Array, "*batch 5"]
    powers: tuple[tuple[float, ...], ...] = eqx.field(static=True)

    def logs(self, near_distance: Annotated[Float[Array, "*batch"], MAY_BE_INFINITE]) -> Float[Array, "*batch pieces"]:
        """ln of every piece at an n'."""
        return self.bent(1 / near_distance)

    def bent(self, strength: Float[Array, "*batch"]) -> Float[Array, "*batch pieces"]:
        """ln of every piece at a strength 1/n', smooth through the uniform map."""
        stretches = jnp.log1p(self.offsets * strength[..., None])
        return self.level + jnp.sum(self._powers() * stretches[..., None, :], axis=-1)

    def terms(self, near_distance: Annotated[Float[Array, "*batch"], MAY_BE_INFINITE]) -> Float[Array, "*batch pieces"]:
        """Sum of the sizes of the terms that a piece's slope along ln n' is made of: rounding is a share of it."""
        # d ln(1 + u/n')/d ln n' = −(u/n')/(1 + u/n'): the terms of a slope, by size.
        ratio = jnp.abs(self.offsets) / near_distance[..., None]
        return jnp.sum(jnp.abs(self._powers()) * (ratio / (1 + ratio))[..., None, :], axis=-1)

    def _powers(self) -> Float[Array, "pieces 5"]:
        return jnp.asarray(self.powers, self.offsets.dtype)


# Powers of the stretches of (E, F, low near edge, low far edge, W). M_z has the square of the near or far stretch over
# 1 + W/n'. M_x has the near or far stretch over that of whichever lower edge decides P's width.
_ALONG = ((2.0, 0.0, 0.0, 0.0, -1.0), (0.0, 2.0, 0.0, 0.0, -1.0))
_ACROSS = tuple((near, 1.0 - near, -edge, edge - 1.0, 0.0) for edge in (1.0, 0.0) for near in (1.0, 0.0))
_POWERS = {
    "x": _ACROSS,
    "z": _ALONG,
    "storage": tuple(tuple(p + q for p, q in zip(x, z, strict=True)) for x in _ACROSS for z in _ALONG),
    "both": (*_ACROSS, *_ALONG),
}


@checked
def error_pieces(frustum: LightFrustum, error: str, section: Section = "axis") -> Pieces:
    """The smooth functions of n' whose largest is M_x, M_z, S or max(M_x, M_z).

    m_z is largest at the near or the far plane; so is m_x, in a map as wide as the near or the far plane needs.

    Args:
        frustum: View and light.
        error: "x", "z", "storage" or "both".
        section: "axis" or "whole" vertical section.
    """
    first, slope = frustum.worst_line(section)
    # Values at strength 0, where all stretches are 1. `log1p` of (f − n)/n keeps the digits of thin slices.
    length = frustum.far - frustum.near
    ratio = jnp.log1p(length / frustum.near)
    texel = jnp.log(frustum.extent / (2 * frustum.tan_y * frustum.near))
    along = [texel, texel - ratio]
    zero = jnp.zeros_like(ratio)
    # In the order of `_ACROSS`: width for the near edge, error at near, far; then width for the far edge, near, far.
    across = [zero, -ratio, ratio, zero]
    level = {
        "x": across,
        "z": along,
        "storage": [x + z for x in across for z in along],
        "both": [*across, *along],
    }[error]
    offsets = [first, first + slope * length, frustum.low_near, frustum.low_far, frustum.extent]
    levels, stacked = (jnp.stack(jnp.broadcast_arrays(*part), axis=-1) for part in (level, offsets))
    return Pieces(levels, stacked, _POWERS[error])


@checked
def storage_factor(frustum: LightFrustum, near_distance: VirtualNear, section: Section = "axis") -> Float[Array, "..."]:
    """S = M_x·M_z at equal resolutions: texels of a map without perspective aliasing per pixel of the image.

    Source: warping, eq. 30–31, for any γ.
    """
    return max_error_x(frustum, near_distance, section) * max_error_z(frustum, near_distance, section)


__all__ = [
    "Pieces", "error_pieces", "error_x", "error_z", "max_error_x", "max_error_z", "storage_factor",
]  # fmt: skip
