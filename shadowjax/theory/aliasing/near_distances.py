"""Virtual near distances n' of light-space perspective shadow maps: the published families, corrected where wrong."""

import math
from collections.abc import Callable
from typing import Literal

import jax.numpy as jnp

from shadowjax._checked import checked
from shadowjax._checks import require_choice, require_value
from shadowjax._types import Array, ArrayLike, Float
from shadowjax.theory.aliasing.light_frustum import LightFrustum, Section, VirtualNear

Fade = Literal["sine", "squared"]


@checked
def psm(frustum: LightFrustum) -> Float[Array, "..."]:
    """n' = n, the perspective shadow map.

    Source: warping, figure 18; η = 1 of eq. 32.
    """
    return frustum.near + jnp.zeros_like(frustum.gamma)


@checked
def uniform(frustum: LightFrustum) -> Float[Array, "..."]:
    """The finite n' that stands for n' = ∞, the standard map."""
    return frustum.uniform_near_distance


@checked
def wimmer(frustum: LightFrustum) -> Float[Array, "..."]:
    """n' = n + √(fn): equal z errors at both planes when the light is overhead, whatever γ is.

    Source: warping, eq. 27.
    """
    return frustum.near + mean_depth(frustum) + jnp.zeros_like(frustum.gamma)


@checked
def wimmer_over_sine(frustum: LightFrustum) -> Float[Array, "..."]:
    """n' = (n + √(fn))/sin γ: fades to the uniform map as the light turns parallel to the view.

    Source: warping, section 4.2.2 (Wimmer's own fade).
    """
    return frustum.ratio(wimmer(frustum), frustum.sine)


@checked
def equalising(frustum: LightFrustum, section: Section = "axis") -> Float[Array, "..."]:
    """The n' that makes the z error equal at near and far plane; not positive where none does.

    With the worst line's offset E + g·(z − n), equality of (n' + offset)²/z at both planes gives
    n' = (n + √(fn))·g − E; with e = sin γ − tan φ·cos γ of the lower edge that is √(fn)·g + e·n, or e·f where e < 0,
    which keeps its digits. On the axis this is the source's n'₁ for γ ≥ φ and n'₂ below. It turns negative only for
    tan γ < tan φ/(1 + √(n/f)), not for all γ ≤ φ as the source says.

    Source: warping, eq. 39 (whose first line must read m_z).
    """
    # (n + √(fn))·g − E rearranged: E and n·g cancel to n·e, or to f·e where the far plane holds the lowest point.
    _, slope = frustum.worst_line(section)
    edge = frustum.low_slope
    return mean_depth(frustum) * slope + jnp.where(edge >= 0, frustum.near, frustum.far) * edge


@checked
def mean_depth(frustum: LightFrustum) -> Float[Array, "..."]:
    """√(fn), without the product, which leaves the range of small formats."""
    return frustum.near * jnp.sqrt(frustum.far / frustum.near)


@checked
def fade_sine(gamma: Float[Array, "..."], gamma_limit: Float[Array, "..."]) -> Float[Array, "..."]:
    """r(γ) = sin(π/2·γ/γ_lim), between 0 at γ = 0 and 1 at γ_lim.

    Source: warping, eq. 43.
    """
    return jnp.sin(gamma / gamma_limit * (math.pi / 2))


@checked
def fade_squared(gamma: Float[Array, "..."], gamma_limit: Float[Array, "..."]) -> Float[Array, "..."]:
    """r(γ) = (1 + sin(π/2·(γ/γ_lim − 1)))², between 0 at γ = 0 and 1 at γ_lim; of order γ⁴ near 0.

    Written as (2·sin²(π/4·γ/γ_lim))², which is the same and loses no digits near 0.

    Source: warping, eq. 44.
    """
    # 1 + sin(x − π/2) = 1 − cos x = 2·sin²(x/2).
    half = jnp.sin(gamma / gamma_limit * (math.pi / 4))
    return (2 * half * half) ** 2


FADES: dict[str, Callable[[Float[Array, "..."], Float[Array, "..."]], Float[Array, "..."]]] = {
    "sine": fade_sine,
    "squared": fade_squared,
}


@checked
def generalised(frustum: LightFrustum, fade: Fade = "squared") -> Float[Array, "..."]:
    """The source's own n'(γ): equalising down to γ_lim, then n'(γ_lim)/r(γ), which tends to ∞ as γ → 0.

    Continuous but not differentiable at γ_lim with either fade. It is the exact minimax on the axis for γ ≥ γ_lim; see
    `shadowjax.theory.aliasing.optimal` for what is better below.

    Args:
        frustum: The view and the light.
        fade: "sine" (eq. 43) or "squared" (eq. 44, the source's choice).

    Source: warping, eq. 40–44.
    """
    return jnp.where(frustum.gamma >= frustum.gamma_limit, equalising(frustum), faded(frustum, fade))


@checked
def faded(frustum: LightFrustum, fade: Fade = "squared") -> Float[Array, "..."]:
    """n'(γ_lim)/r(γ), the source's branch below γ_lim.

    Args:
        frustum: The view and the light.
        fade: "sine" (eq. 43) or "squared" (eq. 44).

    Source: warping, eq. 41–44.
    """
    require_choice(fade, "fade", FADES)
    limit, near, far = frustum.gamma_limit, frustum.near, frustum.far
    # (n + √(fn))·sin γ_lim − n·tan φ·cos γ_lim with tan γ_lim put in, which leaves sums of positive terms
    at_limit = frustum.tan_y * jnp.cos(limit) * (2 * near * near + mean_depth(frustum) * (far + near)) / (far - near)
    return frustum.ratio(at_limit, FADES[fade](frustum.gamma, limit))


@checked
def near_distance_from_eta(frustum: LightFrustum, eta: ArrayLike) -> Float[Array, "..."]:
    """The n' of a position η in the family of perspective warps with the light overhead.

    η = −1 is the uniform map (as a finite number), 0 LiSPSM, 1 PSM. The branch η ≥ 0 is n(n + √(fn))/(n + η√(fn));
    the source prints it without the factor n, which has the wrong dimension.

    Args:
        frustum: The view; its γ is not used.
        eta: Position in [−1, 1].

    Raises:
        ValueError: If η is outside [−1, 1].

    Source: warping, eq. 33, corrected.
    """
    eta = jnp.asarray(eta, dtype=frustum.near.dtype)
    eta = require_value(eta, (eta >= -1) & (eta <= 1), "eta must lie in [-1, 1]")
    near, root = frustum.near, mean_depth(frustum)
    # Each branch is evaluated with η clipped to its own range, so that the one not taken stays finite for gradients.
    towards_psm = near * (near + root) / (near + jnp.maximum(eta, 0) * root)
    # η = past/(n' + f − n) solved for n'; its denominator 1 + η vanishes at the uniform map, hence `ratio`.
    negative = jnp.minimum(eta, 0)
    towards_uniform = frustum.ratio(near + root - negative * (frustum.far - near), negative + 1)
    return jnp.where(eta >= 0, towards_psm, towards_uniform)


@checked
def eta_from_near_distance(frustum: LightFrustum, near_distance: VirtualNear) -> Float[Array, "..."]:
    """Position η ∈ [−1, 1] of an n' in [n, ∞], from how much its M_z exceeds LiSPSM's.

    Source: warping, eq. 32 with the M_z of eq. 29, its differences of nearly equal errors taken out.
    """
    # η is ±(M_z − M_z,best)/(M_z,end − M_z,best), towards PSM or the uniform map, with common factors divided out.
    past = frustum.near + mean_depth(frustum) - near_distance  # of LiSPSM's
    towards_psm = frustum.near * past / (near_distance * mean_depth(frustum))
    towards_uniform = past / (near_distance + (frustum.far - frustum.near))
    return jnp.where(past >= 0, towards_psm, towards_uniform)


__all__ = [
    "FADES", "Fade", "equalising", "eta_from_near_distance", "fade_sine", "fade_squared", "faded", "generalised",
    "mean_depth", "near_distance_from_eta", "psm", "uniform", "wimmer", "wimmer_over_sine",
]  # fmt: skip
