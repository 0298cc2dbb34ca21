"""The perspective warp: a trapezium of a light's plane onto the unit square, with inverse, spacing and fit."""

from collections.abc import Sequence

import jax.numpy as jnp

from shadowjax._checked import checked
from shadowjax._checks import require_value
from shadowjax._numerics import normalize
from shadowjax._types import Array, ArrayLike, Bool, Float, Vector2, as_float_array
from shadowjax.rays.plane_map import PlanePoints
from shadowjax.warps.base import Warp

# Positions at or behind the centre of projection are taken this close in front of it: far outside the map, yet finite.
CLOSEST = 1e-6


class PerspectiveWarp(Warp):
    """Central projection of the light's plane along z', with strength 1/n' (warping, section 4.2).

    With u the offset along the axis and x the offset across it, t = u·(1 + W/n')/(W·(1 + u/n')) and s is affine in
    x/(1 + u/n'). Written with 1/n', the uniform map is strength 0 and no special case.

    Attributes:
        origin: Plane position with u = 0 and x = 0; t = 0 there.
        axis: Unit vector of the plane along which t grows, the z' of light space.
        extent: W = f' − n', plane units.
        strength: 1/n', per plane unit, ≥ 0.
        sides: x/(1 + u/n') at s = 0 and at s = 1, plane units.
    """

    origin: Vector2
    axis: Vector2
    extent: Float[Array, ""]
    strength: Float[Array, ""]
    sides: Vector2

    @classmethod
    def fit(
        cls, points: Float[Array, "points 2"], strength: ArrayLike, axis: ArrayLike | Sequence[float] = (0.0, 1.0)
    ) -> "PerspectiveWarp":
        """The tightest warp of a given strength around plane points (the corners of what has to be in the map).

        Args:
            points: Plane positions, such as the projected corners of the camera frustum or of the focus body.
            strength: 1/n', per plane unit, ≥ 0; n' counts from the lowest point.
            axis: Direction in which texels grow: away from the camera.

        Raises:
            ValueError: If the points lie on one line, which no map can cover (a camera inside the light's plane), or
                the strength is negative or not finite.
        """
        return cls(*trapezium(points, strength, axis))

    def forward(self, plane: PlanePoints) -> PlanePoints:
        """Project the plane through the centre n' below the origin (warping, eq. 20–21)."""
        along, across = components(plane - self.origin, self.axis)
        stretch = jnp.maximum(1 + along * self.strength, CLOSEST)
        # 1 + u/n' is (n' + u)/n': with 1/n' in place of n' the uniform map is strength 0, without ∞/∞.
        t = along * (1 + self.extent * self.strength) / (self.extent * stretch)
        s = (across / stretch - self.sides[0]) / (self.sides[1] - self.sides[0])
        return jnp.stack([s, t], axis=-1)

    def inverse(self, square: PlanePoints) -> PlanePoints:
        """Plane position of each (s, t)."""
        s, t = square[..., 0], square[..., 1]
        # t = u(1 + W/n')/(W(1 + u/n')) solved for u.
        along = t * self.extent / jnp.maximum(1 + self.extent * self.strength * (1 - t), CLOSEST)
        across = (self.sides[0] + s * (self.sides[1] - self.sides[0])) * (1 + along * self.strength)
        return self.origin + from_components(along, across, self.axis)

    def regular(self, plane: PlanePoints) -> Bool[Array, "*points"]:
        """In front of the centre of projection, where lines across the axis stay lines and t grows along it."""
        along, _ = components(plane - self.origin, self.axis)
        return 1 + along * self.strength > 2 * CLOSEST

    def widths(self, square: PlanePoints) -> Float[Array, "*points 2"]:
        """Plane distance per unit of s across, and of t along the axis: (dx/ds, dz'/dt).

        Divide by the map's columns and rows for the size of a texel. Source: warping, eq. 18–19 and 23–24.
        """
        t = square[..., 1]
        # 1 + u/n' written in t, as in `inverse`; its square is the dz'/dt of a projective map.
        shrink = jnp.maximum(1 + self.extent * self.strength * (1 - t), CLOSEST)
        stretch = 1 + t * self.extent / shrink * self.strength
        across = (self.sides[1] - self.sides[0]) * stretch
        along = self.extent * stretch * stretch / (1 + self.extent * self.strength)
        return jnp.stack([jnp.broadcast_to(across, t.shape), along], axis=-1)


@checked
def trapezium(
    points: Float[Array, "points 2"], strength: ArrayLike, axis: ArrayLike | Sequence[float]
) -> tuple[Array, ...]:
    """Origin, axis, extent, strength and sides of the tightest trapezium of one strength around plane points.

    Its two sides meet n' below the lowest point, in the middle of the points' width.
    """
    direction = normalize(jnp.asarray(axis, dtype=points.dtype))
    strength = as_float_array(strength, points.dtype)
    strength = require_value(
        strength, (strength >= 0) & jnp.isfinite(strength), "n' must be positive: its strength 1/n' finite and ≥ 0"
    )
    along, across = components(points, direction)
    # The centre of projection lies below the middle of the points' width, whatever their shape.
    lowest, middle = jnp.min(along), (jnp.min(across) + jnp.max(across)) / 2
    along, across = along - lowest, across - middle
    extent = jnp.max(along)
    # Projected along the trapezium's sides onto the line u = 0: the extremes there are where the sides start.
    shrunk = across / (1 + along * strength)
    sides = jnp.stack([jnp.min(shrunk), jnp.max(shrunk)])
    flat = (extent > 0) & (sides[1] > sides[0])
    message = "points of a light's plane lie on one line, so no map covers them; is the camera in the light's plane?"
    extent = require_value(extent, flat, message)
    return from_components(lowest, middle, direction), direction, extent, strength, sides


@checked
def components(offset: PlanePoints, axis: Vector2) -> tuple[Float[Array, "*points"], Float[Array, "*points"]]:
    """Components along the axis and across it (the axis turned clockwise, x for the axis z)."""
    x, z = offset[..., 0], offset[..., 1]
    return x * axis[0] + z * axis[1], x * axis[1] - z * axis[0]


@checked
def from_components(along: Float[Array, "..."], across: Float[Array, "..."], axis: Vector2) -> PlanePoints:
    """The plane vector with these components."""
    return jnp.stack([along * axis[0] + across * axis[1], along * axis[1] - across * axis[0]], axis=-1)


__all__ = ["CLOSEST", "PerspectiveWarp", "components", "from_components", "trapezium"]
