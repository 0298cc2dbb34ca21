"""Optimal virtual near distances in closed form: least M_z, least storage M_x·M_z, least max(M_x, M_z).

Let the worst line have offsets E at the near and F at the far plane, let o be the offset of the far plane's lowest
edge, and W the extent. With q = n',

    M_z ∝ max((q + E)²/n, (q + F)²/f) · W/(q(q + W)),     M_x ∝ (q + E)/n · f/(q + o)   for q ≥ the equalising q.

The far branch of M_z falls with q because W ≤ 2F. Its near branch has one minimum, at E·W/(W − 2E), or none.
"""

import jax.numpy as jnp

from shadowjax._checked import checked
from shadowjax._numerics import larger, safe_divide, safe_sqrt
from shadowjax._types import Array, Float
from shadowjax.theory.aliasing.error import max_error_x, max_error_z
from shadowjax.theory.aliasing.light_frustum import LightFrustum, Section
from shadowjax.theory.aliasing.near_distances import equalising
from shadowjax.theory.aliasing.roots import bisect


@checked
def near_branch_minimum(frustum: LightFrustum, section: Section = "axis") -> Float[Array, "..."]:
    """E·W/(W − 2E), where the near plane's z error is least; the uniform map where W ≤ 2E."""
    offset, _ = frustum.worst_line(section)
    return frustum.ratio(offset * frustum.extent, frustum.slack(section))


@checked
def minimax(frustum: LightFrustum, section: Section = "axis") -> Float[Array, "..."]:
    """The n' of least M_z, for any γ.

    max(equalising n', near-branch minimum): the equalising one is the optimum while the near branch still falls there.
    On the axis it is the source's n'(γ) for all γ ≥ γ_lim; below, it reaches ∞ like 1/γ without an ad-hoc fade. Over
    the whole section it is the uniform map for tan γ ≤ n·tan φ/(f − n).

    Args:
        frustum: View and light.
        section: "axis", as the source, or "whole", the whole vertical section.
    """
    return frustum.bounded(larger(equalising(frustum, section), near_branch_minimum(frustum, section)))


@checked
def least_storage(frustum: LightFrustum, section: Section = "whole") -> Float[Array, "..."]:
    """The n' of least storage factor M_x·M_z, for any γ; the uniform map where nothing beats it.

    Up to the equalising n' the product never rises (it is flat for γ = π/2). Beyond, its logarithmic derivative
    3/(q + E) − 1/(q + o) − 1/q − 1/(q + W) has the sign of A·q² + 2B·q − E·o·W with A = o + W − 3E and
    B = o·W − E(o + W): one positive root if A > 0, else none and the product falls all the way to the uniform map.

    Args:
        frustum: View and light.
        section: "axis" or "whole" vertical section, over which both errors are taken.
    """
    return frustum.bounded(larger(equalising(frustum, section), storage_minimum(frustum, section)))


@checked
def storage_minimum(frustum: LightFrustum, section: Section = "whole") -> Float[Array, "..."]:
    """The n' at which M_x·M_z is stationary beyond the equalising n'; the uniform map where it falls throughout."""
    a, b, c, root = _storage_root(frustum, section)
    # two forms of one root: the first loses digits where b < 0, the second where b > 0
    # q = W·(−b + root)/a, and the same multiplied out by (b + root): W·c/(b + root).
    near = frustum.extent * safe_divide(c, b + root)
    away = frustum.ratio(frustum.extent * jnp.maximum(root - b, 0), a)
    return jnp.where(a > 0, jnp.where(b > 0, near, away), frustum.uniform_near_distance)


@checked
def storage_strength(frustum: LightFrustum, section: Section = "whole") -> Float[Array, "..."]:
    """1/n' of `storage_minimum` where that is positive; it falls through 0 where the uniform map becomes the best."""
    a, b, c, root = _storage_root(frustum, section)
    # The reciprocals of both forms, again the one without cancellation; a ≤ 0 needs no case, as 1/n' passes through 0.
    return jnp.where(b > 0, safe_divide(b + root, c), safe_divide(a, root - b)) / frustum.extent


def _storage_root(frustum: LightFrustum, section: Section) -> tuple[Array, Array, Array, Array]:
    """A, B and E·o·W of the quadratic, and the root of its discriminant, in units of W: powers of lengths overflow."""
    # Coefficients of A·q² + 2B·q − E·o·W = 0 for q/W; see `least_storage`.
    offset, _ = frustum.worst_line(section)
    low, offset = frustum.low_far / frustum.extent, offset / frustum.extent
    a = low + 1 - 3 * offset
    b = low - offset * (low + 1)
    c = offset * low
    return a, b, c, safe_sqrt(b * b + a * c)


@checked
def balanced(
    frustum: LightFrustum,
    ratio_x: Float[Array, "..."] | float = 1.0,
    ratio_z: Float[Array, "..."] | float = 1.0,
    section: Section = "whole",
) -> Float[Array, "..."]:
    """The n' of least max(M_x, M_z) at given resolutions, for any γ; the uniform map where nothing beats it.

    M_z falls up to its own minimax n' and rises beyond. For o > E, M_x rises from q = n(sin γ − tan φ cos γ) on: the
    optimum is one of the two ends or the crossing between them, the root of a cubic (for γ = π/2 it is
    n'/(n' + f − n) = √(n(f − n)/(2·tan φ_y)·ratio_z/ratio_x)/f). For o ≤ E, M_x falls everywhere: the optimum is M_z's
    own, or the crossing beyond it, the root of a quadratic, or the uniform map.

    Args:
        frustum: View and light.
        ratio_x: Image columns over map columns.
        ratio_z: Image rows over map rows.
        section: "axis" or "whole" vertical section, over which both errors are taken.
    """
    offset, _ = frustum.worst_line(section)
    low, extent = frustum.low_far, frustum.extent
    best_z = minimax(frustum, section)

    def excess(log_q: Array) -> Array:
        q = jnp.exp(log_q)
        return jnp.log(max_error_z(frustum, q, section, ratio_z) / max_error_x(frustum, q, section, ratio_x))

    # o > E: bisect the monotone excess between M_x's own optimum and M_z's
    lowest = larger(frustum.near * frustum.low_slope, 1e-6 * best_z)
    # M_x's optimum may lie beyond M_z's; the bracket then is empty and bisection returns its end.
    lowest = jnp.where(lowest < best_z, lowest, best_z)
    crossing = jnp.exp(bisect(excess, jnp.log(lowest), jnp.log(best_z)))
    # o ≤ E: (x + E/W)(x + o/W) = p·x(x + 1) with x = n'/W, larger root
    # M_x = M_z of the near branch, multiplied out: p collects all constant factors.
    p = frustum.far * ratio_x / (ratio_z * extent / (2 * frustum.tan_y))
    first, second = offset / extent, low / extent
    # Collected: (1 − p)x² + (E/W + o/W − p)x + E·o/W² = 0. For p ≥ 1 M_z never gets as large as M_x again.
    a, b, c = 1 - p, first + second - p, first * second
    beyond = frustum.ratio(extent * jnp.maximum(safe_sqrt(b * b - 4 * a * c) - b, 0), 2 * a)
    beyond = jnp.where(a > 0, larger(beyond, best_z), frustum.uniform_near_distance)
    # Where M_z is the larger even at its own least, nothing can lower the maximum further.
    falls = max_error_z(frustum, best_z, section, ratio_z) >= max_error_x(frustum, best_z, section, ratio_x)
    return frustum.bounded(jnp.where(falls, best_z, jnp.where(low > offset, crossing, beyond)))


__all__ = ["balanced", "least_storage", "minimax", "near_branch_minimum", "storage_minimum", "storage_strength"]
