"""Shadows that are known exactly: of convex polygons and spheres on a plane, as differentiable functions of everything.

Positions in a receiving plane are pairs (u, v). Distances are signed: negative inside the shadow.
"""

import jax.numpy as jnp

from shadowjax._checked import Checked, checked
from shadowjax._checks import require, require_value
from shadowjax._numerics import dot, norm, normalize, safe_divide
from shadowjax._types import ArrayLike, Points, Scalar, Vector3, as_float_array
from shadowjax.geometry.light import Light
from shadowjax.scenes.ellipse import Ellipse
from shadowjax.scenes.polygons import (  # fmt: skip
    Points2,
    Polygon,
    area,
    contains,
    signed_distance,
    union_area,
    union_contains,
    union_signed_distance,
)


class ReceivingPlane(Checked):
    """A plane with coordinates (u, v).

    Attributes:
        origin: World position of (0, 0).
        axis_u: Unit vector along u.
        axis_v: Unit vector along v, perpendicular to u.
    """

    origin: Vector3
    axis_u: Vector3
    axis_v: Vector3

    @classmethod
    def horizontal(cls, height: ArrayLike = 0.0) -> "ReceivingPlane":
        """The plane y = `height` seen from above, with (u, v) = (x, z)."""
        height = as_float_array(height)
        require(height.shape == (), f"height must be one number; got shape {height.shape}")
        zero, one = jnp.zeros_like(height), jnp.ones_like(height)
        return cls(jnp.stack([zero, height, zero]), jnp.stack([one, zero, zero]), jnp.stack([zero, zero, one]))

    @property
    def normal(self) -> Vector3:
        """Unit vector towards the lit side: axis_v × axis_u, which is +y for (u, v) = (x, z)."""
        return jnp.cross(self.axis_v, self.axis_u)

    def to_plane(self, points: Points) -> Points2:
        """Coordinates of the feet of world points."""
        offset = points - self.origin
        return jnp.stack([offset @ self.axis_u, offset @ self.axis_v], axis=-1)

    def to_world(self, positions: Points2) -> Points:
        """World points at coordinates (u, v)."""
        return self.origin + positions[..., :1] * self.axis_u + positions[..., 1:] * self.axis_v


@checked
def project(points: Points, light: Light, plane: ReceivingPlane) -> Points2:
    """Where the light's rays through points meet the plane.

    Args:
        points: On the lit side of the plane, or in it.
        light: On the lit side, farther from the plane than the points.
        plane: Receiver.

    Returns:
        Coordinates (u, v) in the plane; the corners of a polygon give the corners of its shadow.

    Raises:
        ValueError: If a point or the light lies behind the plane, or a point lies above the light.
    """
    to_light, _ = light.to_light(points)
    rise = to_light @ plane.normal
    height = (points - plane.origin) @ plane.normal
    points = require_value(
        points, (rise > 0) & (height >= 0), "occluders must lie between the light and the plane's lit side"
    )
    return plane.to_plane(points - to_light * safe_divide(height, rise)[..., None])


@checked
def sphere_shadow(centre: Vector3, radius: Scalar, light: Light, plane: ReceivingPlane) -> Ellipse:
    """The shadow of a sphere on a plane.

    A position is in shadow where its ray to the light passes the centre within the radius r. Let p be the position from
    the centre, D the distance of the light from the centre and w the unit vector along which the light travels there.
    The ray's line passes within r where |p - (p·w) w|² ≤ r² |w + p / D|²: a cone, and for D = ∞ a cylinder. Either is a
    quadratic form in (u, v, 1), and written so it loses no digits for a light far away.

    Args:
        centre: World position of the centre.
        radius: Metres, > 0.
        light: Directional, point or spot light on the plane's lit side (a spot's rim is not considered).
        plane: Receiver.

    Returns:
        The ellipse.

    Raises:
        ValueError: If the sphere reaches below the plane, or is not wholly below a light at a place (the shadow would
            not end), or parallel light comes from behind.
    """
    normal = plane.normal
    height = dot(centre - plane.origin, normal)
    radius = require_value(radius, (radius > 0) & (height >= radius), "the sphere must lie on the plane's lit side")
    if light.is_directional:
        direction = -light.homogeneous[:3]
        lit = dot(direction, normal) < 0
        travel = require_value(direction, lit, "the light must shine onto the plane's lit side")
        nearness = jnp.zeros_like(radius)
    else:
        position = light.homogeneous[:3]
        above = dot(position - plane.origin, normal) > height + radius
        message = "the light must lie farther from the plane than the whole sphere"
        offset = centre - require_value(position, above, message)
        travel, nearness = normalize(offset), 1.0 / norm(offset)
    frame = jnp.stack([plane.axis_u, plane.axis_v, plane.origin - centre], axis=-1)  # p = frame (u, v, 1)
    # p less its part along the ray, as a matrix on (u, v, 1).
    across = frame - jnp.outer(travel, travel @ frame)
    # w + p/D likewise: its third column takes the constant w.
    ray = nearness * frame + jnp.zeros_like(frame).at[:, 2].set(travel)
    return Ellipse(across.T @ across - radius**2 * (ray.T @ ray))


__all__ = [
    "Ellipse", "Points2", "Polygon", "ReceivingPlane", "area", "contains", "project", "signed_distance",
    "sphere_shadow", "union_area", "union_contains", "union_signed_distance",
]  # fmt: skip
