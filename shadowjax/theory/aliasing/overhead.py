"""Aliasing error of warped maps as the warping chapter writes it (eq. 11–29, 37–38): beams, rates and maxima.

The general forms, for any γ and with texels measured across the light, are `error_x`, `error_z`, `max_error_x` and
`max_error_z` of `shadowjax.theory.aliasing.error`, which this module passes on. What stands here are the chapter's own
forms for a light overhead (γ = π/2) and its literal eq. 37.
"""

import jax.numpy as jnp

from shadowjax._checked import checked
from shadowjax._numerics import safe_divide
from shadowjax._types import Array, Bool, Float
from shadowjax.theory.aliasing.error import error_x, error_z, max_error_x, max_error_z
from shadowjax.theory.aliasing.light_frustum import LightFrustum, VirtualNear

Numbers = Float[Array, "..."]


@checked
def pixel_width(depth: Numbers, half_angle: Numbers, resolution: Numbers | float) -> Numbers:
    """Width of a pixel's beam at a depth, on a plane parallel to the image plane: 2z·tan φ/res.

    Exact there; as a thickness *across* the beam it is exact on the view axis only, and too large by 1/cos α at the
    view angle α.

    Args:
        depth: Depth z along the view direction, world units.
        half_angle: Half the angle of view φ in the direction of the width, radians.
        resolution: Pixels in that direction.

    Source: warping, eq. 16–17.
    """
    return 2 * depth * jnp.tan(half_angle) / resolution


@checked
def aliasing(light_width: Numbers, camera_width: Numbers, camera_cosine: Numbers, light_cosine: Numbers) -> Numbers:
    """Pixels that one texel decides, from beam thicknesses and angles of incidence: (w_l/w_c)·(cos θ_c/cos θ_l).

    Right to second order in the sizes of pixel and texel, with both thicknesses measured across their beams. The first
    factor is perspective aliasing, the second projection aliasing, which is unbounded where the light grazes.

    Args:
        light_width: w_l, thickness of the texel's beam, world units.
        camera_width: w_c, thickness of the pixel's beam, world units.
        camera_cosine: cos θ_c of the surface normal to the view ray, in [0, 1].
        light_cosine: cos θ_l of the surface normal to the light ray, in [0, 1]; 0 gives 0, not ∞.

    Source: warping, eq. 12.
    """
    return safe_divide(light_width * camera_cosine, camera_width * light_cosine)


@checked
def l_infinity(error: Numbers, valid: Bool[Array, "..."] | bool = True) -> Float[Array, ""]:
    """Largest |error| over the pixels in which something is drawn; 0 if there is none.

    The source equates this for m with this for w_l/w_c, which drops the cosines of eq. 12: they differ in general.

    Source: warping, eq. 13.
    """
    return jnp.max(jnp.where(valid, jnp.abs(error), jnp.zeros_like(error)), initial=0.0)


@checked
def overhead_s(frustum: LightFrustum, near_distance: VirtualNear, x: Numbers, depth: Numbers) -> Numbers:
    """s of a point on the plane of the view axis, with tan φ'_x = f·tan φ_x/f'.

    Source: warping, eq. 20 and 22; encloses the frustum for γ = π/2 and n' ≥ n only.
    """
    # z' of the point, n' + z − n, and of the far plane, f' = n' + f − n.
    beyond = near_distance + depth - frustum.near
    full = near_distance + frustum.far - frustum.near
    return 0.5 + x * full / (2 * beyond * frustum.far * frustum.tan_x)


@checked
def overhead_t(frustum: LightFrustum, near_distance: VirtualNear, depth: Numbers) -> Numbers:
    """t of a depth: 0 at the near plane, 1 at the far plane.

    Source: warping, eq. 21–22.
    """
    # t = f'(z' − n')/(z'(f' − n')): the projective map of [n', f'] to [0, 1].
    length, offset = frustum.far - frustum.near, depth - frustum.near
    return (near_distance + length) * offset / ((near_distance + offset) * length)


@checked
def overhead_ds_dx(frustum: LightFrustum, near_distance: VirtualNear, depth: Numbers) -> Numbers:
    """Rate of s across the view, 1/world units.

    Source: warping, eq. 23.
    """
    beyond = near_distance + depth - frustum.near
    return (near_distance + frustum.far - frustum.near) / (2 * beyond * frustum.far * frustum.tan_x)


@checked
def overhead_dt_dz(frustum: LightFrustum, near_distance: VirtualNear, depth: Numbers) -> Numbers:
    """Rate of t along depth, 1/world units: a square, where the ideal is linear (eq. 46).

    Source: warping, eq. 24.
    """
    # dt/dz' = f'·n'/(z'²(f' − n')): the square of z' is what the perspective division costs.
    length = frustum.far - frustum.near
    return (near_distance + length) * near_distance / ((near_distance + depth - frustum.near) ** 2 * length)


@checked
def overhead_error_x(
    frustum: LightFrustum, near_distance: VirtualNear, depth: Numbers, resolution_ratio: Numbers | float = 1.0
) -> Numbers:
    """m_x on the view axis with the light overhead.

    Source: warping, eq. 25.
    """
    beyond = near_distance + depth - frustum.near
    return resolution_ratio * frustum.far * beyond / (depth * (near_distance + frustum.far - frustum.near))


@checked
def overhead_error_z(
    frustum: LightFrustum, near_distance: VirtualNear, depth: Numbers, resolution_ratio: Numbers | float = 1.0
) -> Numbers:
    """m_z on the view axis with the light overhead.

    Source: warping, eq. 26.
    """
    length, beyond = frustum.far - frustum.near, near_distance + depth - frustum.near
    # dz/dt over the pixel's width: eq. 24 inverted, over eq. 17.
    shape = beyond * beyond / (depth * near_distance * (near_distance + length))
    return resolution_ratio * length / (2 * frustum.tan_y) * shape


@checked
def overhead_max_x(
    frustum: LightFrustum, near_distance: VirtualNear, resolution_ratio: Numbers | float = 1.0
) -> Numbers:
    """M_x with the light overhead, at the near plane, for n' ≥ n.

    Source: warping, eq. 28.
    """
    length = frustum.far - frustum.near
    return resolution_ratio * frustum.far / frustum.near * near_distance / (length + near_distance)


@checked
def overhead_max_z(
    frustum: LightFrustum, near_distance: VirtualNear, resolution_ratio: Numbers | float = 1.0
) -> Numbers:
    """M_z with the light overhead: at the far plane for n' ≤ n + √(fn), else at the near plane.

    Source: warping, eq. 29.
    """
    length = frustum.far - frustum.near
    # f'/n': at the far plane m_z has it as a factor, at the near plane as a divisor.
    stretch = (near_distance + length) / near_distance
    at_far, at_near = stretch / frustum.far, 1 / (frustum.near * stretch)
    best = frustum.near + jnp.sqrt(frustum.far * frustum.near)
    return resolution_ratio * length / (2 * frustum.tan_y) * jnp.where(near_distance <= best, at_far, at_near)


@checked
def literal_error_z(
    frustum: LightFrustum, near_distance: VirtualNear, depth: Numbers, resolution_ratio: Numbers | float = 1.0
) -> Numbers:
    """m_z as the source writes it for any γ: `error_z`/sin γ, because it measures the texel along the view axis.

    That is no beam thickness: it diverges as γ → 0, against eq. 53. The optimal n' is not affected. sin γ is kept above
    the smallest number of the dtype, so the value stays finite at γ = 0.

    Source: warping, eq. 37.
    """
    sine = jnp.maximum(frustum.sine, float(jnp.finfo(frustum.sine.dtype).tiny) ** 0.25)
    return error_z(frustum, near_distance, depth, resolution_ratio=resolution_ratio) / sine


@checked
def least_error_depth(frustum: LightFrustum, near_distance: VirtualNear) -> Numbers:
    """Depth on the view axis at which m_z is least; outside [n, f] unless its numerator lies in [n, f]·sin γ.

    For γ → 0 it tends to ∞, kept finite here. At the equalising n' it is √(fn) for every γ.

    Source: warping, eq. 38.
    """
    offset, slope = frustum.worst_line("axis")
    # d/dz of (n' + E + sin γ·(z − n))²/z vanishes at this depth.
    sine = jnp.maximum(slope, float(jnp.finfo(slope.dtype).tiny) ** 0.25)
    return (near_distance + offset) / sine - frustum.near


__all__ = [
    "aliasing", "error_x", "error_z", "l_infinity", "least_error_depth", "literal_error_z", "max_error_x",
    "max_error_z", "overhead_ds_dx", "overhead_dt_dz", "overhead_error_x", "overhead_error_z", "overhead_max_x",
    "overhead_max_z", "overhead_s", "overhead_t", "pixel_width",
]  # fmt: skip
