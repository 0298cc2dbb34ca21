"""The logarithmic warp: texels that grow in proportion to depth, which no rasteriser does and a ray caster can."""

import math
from collections.abc import Sequence

import jax.numpy as jnp

from shadowjax._checked import checked
from shadowjax._numerics import larger
from shadowjax._types import Array, ArrayLike, Bool, Float, Vector2
from shadowjax.rays.plane_map import PlanePoints
from shadowjax.theory.aliasing.light_frustum import LightFrustum, Section
from shadowjax.theory.aliasing.roots import bisect
from shadowjax.warps.base import Warp
from shadowjax.warps.perspective import CLOSEST, components, from_components, trapezium

# Below this, the ratios of logarithm and exponential to their argument are series, exact to the last bit.
SMALL = 1e-3


class LogarithmicWarp(Warp):
    """Logarithm along z', perspective across it: t = ln(1 + u/c)/ln(1 + W/c) and s affine in x/(1 + u/c).

    With the light overhead and c = n it gives m_z = ln(f/n)/(2·tan φ_y) at every depth, the least possible maximum, and
    the m_x = 1 of a perspective shadow map. Strength is 1/c; strength 0 is the uniform map.

    Attributes:
        origin: Plane position with u = 0 and x = 0.
        axis: Unit vector of the plane along which t grows.
        extent: W, plane units.
        strength: 1/c, per plane unit, ≥ 0.
        sides: x/(1 + u/c) at s = 0 and at s = 1, plane units.
    """

    origin: Vector2
    axis: Vector2
    extent: Float[Array, ""]
    strength: Float[Array, ""]
    sides: Vector2

    @classmethod
    def fit(
        cls, points: Float[Array, "points 2"], strength: ArrayLike, axis: ArrayLike | Sequence[float] = (0.0, 1.0)
    ) -> "LogarithmicWarp":
        """The tightest warp of a given strength around plane points; see `PerspectiveWarp.fit`."""
        return cls(*trapezium(points, strength, axis))

    def forward(self, plane: PlanePoints) -> PlanePoints:
        """Logarithm along the axis (warping, eq. 48)."""
        along, across = components(plane - self.origin, self.axis)
        # Not below CLOSEST − 1, so that the logarithm exists behind the centre too, where `regular` says no.
        excess = jnp.maximum(along * self.strength, CLOSEST - 1)
        # ln(1 + u/c)/ln(1 + W/c) as ratios ln(1 + x)/x, which stay 1 in the uniform map, where both logarithms are 0.
        t = along / self.extent * _log_ratio(excess) / _log_ratio(self.extent * self.strength)
        s = (across / (1 + excess) - self.sides[0]) / (self.sides[1] - self.sides[0])
        return jnp.stack([s, t], axis=-1)

    def inverse(self, square: PlanePoints) -> PlanePoints:
        """Plane position of each (s, t)."""
        s, t = square[..., 0], square[..., 1]
        along = self._along(t)
        across = (self.sides[0] + s * (self.sides[1] - self.sides[0])) * (1 + along * self.strength)
        return self.origin + from_components(along, across, self.axis)

    def regular(self, plane: PlanePoints) -> Bool[Array, "*points"]:
        """In front of the centre of projection, where lines across the axis stay lines and t grows along it."""
        along, _ = components(plane - self.origin, self.axis)
        return 1 + along * self.strength > 2 * CLOSEST

    def widths(self, square: PlanePoints) -> Float[Array, "*points 2"]:
        """Plane distance per unit of s across, and of t along the axis; both grow in proportion to u + c."""
        # dz'/dt = (u + c)·ln(1 + W/c), written with 1/c: W·ln(1 + x)/x·(1 + u/c).
        stretch = 1 + self._along(square[..., 1]) * self.strength
        across = (self.sides[1] - self.sides[0]) * stretch
        return jnp.stack([across, self.extent * _log_ratio(self.extent * self.strength) * stretch], axis=-1)

    def _along(self, t: Float[Array, "*points"]) -> Float[Array, "*points"]:
        """(e^{t·L} − 1)/strength with L = ln(1 + W·strength)."""
        full = self.extent * self.strength
        # Again as ratios, (eˣ − 1)/x: u = t·W·ln(1 + x)/x·(eʸ − 1)/y with x = W/c and y = t·ln(1 + x).
        return t * self.extent * _log_ratio(full) * _exp_ratio(t * full * _log_ratio(full))


def _log_ratio(x: Float[Array, "..."]) -> Float[Array, "..."]:
    """ln(1 + x)/x, smooth through 0 in value and gradient."""
    small = jnp.abs(x) < SMALL
    series = 1 - x * (1 / 2 - x * (1 / 3 - x * (1 / 4 - x / 5)))
    # The branch not taken is evaluated too: 1 keeps its gradient from 0/0.
    safe = jnp.where(small, jnp.ones_like(x), x)
    return jnp.where(small, series, jnp.log1p(safe) / safe)


def _exp_ratio(x: Float[Array, "..."]) -> Float[Array, "..."]:
    """(e^x − 1)/x, smooth through 0 in value and gradient."""
    small = jnp.abs(x) < SMALL
    series = 1 + x * (1 / 2 + x * (1 / 6 + x * (1 / 24 + x / 120)))
    safe = jnp.where(small, jnp.ones_like(x), x)
    return jnp.where(small, series, jnp.expm1(safe) / safe)


@checked
def log_distance(frustum: LightFrustum, section: Section = "axis") -> Float[Array, "..."]:
    """The c of least M_z for a logarithmic warp, for any γ.

    Errors grow as (u + c)·ln(1 + W/c)/z. They are constant for c = n·sin(γ − φ_y)/cos φ_y. As for the perspective
    warp, that is the optimum while the near plane's error still falls there; otherwise it is the minimum of that
    error, where ln(1 + x)·(1 + x)/x = 1 + x·E/W with x = W/c: a root that tends to the uniform map as W → 2E.

    Args:
        frustum: View and light.
        section: "axis" or "whole" vertical section.
    """
    half = frustum.slack(section) / (2 * frustum.extent)

    def falls(log_x: Array) -> Array:
        x = jnp.exp(log_x)
        small = jnp.minimum(x, 1e-2)
        # ½ − (ln(1 + x)(1 + x)/x − 1)/x: a difference of nearly equal numbers for small x, so its series there.
        series = small * (1 / 6 - small * (1 / 12 - small * (1 / 20 - small / 30)))
        large = jnp.maximum(x, 1e-2)
        return half - jnp.where(x > 1e-2, 0.5 - (jnp.log1p(large) * (1 + large) / large - 1) / large, series)

    # x = W/c between ε and 1/ε: beyond them the warp is uniform, or its near plane a point, to the dtype.
    widest = -math.log(float(jnp.finfo(half.dtype).eps))
    root = jnp.exp(bisect(falls, jnp.full_like(half, -widest), jnp.full_like(half, widest)))
    near_minimum = jnp.where(half > 0, frustum.extent / root, frustum.uniform_near_distance)
    return frustum.bounded(larger(frustum.near * frustum.low_slope, near_minimum))


@checked
def log_error_z(
    frustum: LightFrustum,
    distance: Float[Array, "..."],
    depth: Float[Array, "..."],
    height: Float[Array, "..."] | float = 0.0,
    resolution_ratio: Float[Array, "..."] | float = 1.0,
) -> Float[Array, "..."]:
    """Perspective error along z' of the logarithmic warp; ln(f/n)/(2·tan φ_y) for γ = π/2 and c = n.

    Args:
        frustum: View and light.
        distance: The warp's c, world units, > 0.
        depth: Depth z of the point, world units, > 0.
        height: Height of the point above the view axis, world units.
        resolution_ratio: Image rows over map rows.

    Source: warping, eq. 45 and 49, for any γ.
    """
    texel = (frustum.offset(depth, height) + distance) * jnp.log1p(frustum.extent / distance)
    return resolution_ratio * texel / (2 * depth * frustum.tan_y)


__all__ = ["LogarithmicWarp", "log_distance", "log_error_z"]
