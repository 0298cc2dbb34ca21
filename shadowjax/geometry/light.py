"""Lights: directional, spot and point; their rays, where they are seen from a point and how bright they are there."""

from abc import abstractmethod
from typing import Annotated, Any, ClassVar

import equinox as eqx
import jax.numpy as jnp

from shadowjax._checked import Checked
from shadowjax._checks import POSITIVE, require, require_finite, require_value
from shadowjax._numerics import dot, norm, normalize, safe_divide
from shadowjax._types import Array, ArrayLike, DType, Float, Points, Scalar, Vector3, as_float_array
from shadowjax.geometry.light_space import DirectionalSpace, LightSpace, OctahedralSpace, PerspectiveSpace
from shadowjax.geometry.origin import ZERO, to_local
from shadowjax.geometry.transforms import any_perpendicular, light_frame, view_frame


class Light(Checked):
    """What all lights answer. A light has no size here: an area light is many of them."""

    _remedy_: ClassVar = "DirectionalLight.create(direction) makes one"

    color: eqx.AbstractVar[Vector3]

    @abstractmethod
    def to_light(self, points: Points) -> tuple[Points, Float[Array, "*points"]]:
        """Unit direction from each point to the light and the distance to it (the far sentinel if at infinity)."""

    @abstractmethod
    def space(self, view: Vector3, lower: Vector3, upper: Vector3) -> LightSpace:
        """The light's rays over a scene, as points of a plane.

        Args:
            view: View direction, which orients the plane (warping: z points the way the view points).
            lower: Lower corner of the scene's bounding box, world units.
            upper: Upper corner of the scene's bounding box.

        Returns:
            A space in which every point of the box has positive depth.
        """

    @property
    @abstractmethod
    def homogeneous(self) -> Float[Array, "4"]:
        """The light as a point (x, y, z, w): w = 1 where it has a place, w = 0 at infinity."""

    @abstractmethod
    def moved(self, offsets: Float[Array, "samples 2"], towards: Vector3) -> "tuple[Light, ...]":
        """The light at places of a disc that faces a point.

        Args:
            offsets: From the middle of the disc: world units; for a light at infinity tangents of angles.
            towards: World point that the disc faces.
        """

    @property
    def is_directional(self) -> bool:
        """Whether the light lies at infinity, so that its rays are parallel."""
        return False

    @property
    def is_omnidirectional(self) -> bool:
        """Whether it shines into every direction from one place, so that no flat map holds its rays."""
        return False

    @property
    def cone(self) -> Scalar | None:
        """Tangent of the angle about the middle of the light's plane beyond which no light falls; None without one."""
        return None

    def as_directional(self, what: str, instead: str = "") -> "DirectionalLight":
        """The same light, where only one at infinity will do.

        Args:
            what: Begins the message of the error, such as "faces need".
            instead: Ends it with the remedy.

        Raises:
            ValueError: If the light is not directional.
        """
        raise ValueError(f"{what} a directional light; got {type(self).__name__}{instead}")

    @abstractmethod
    def radiance(self, points: Points) -> Float[Array, "*points 3"]:
        """Unshadowed light that arrives at each point, linear RGB."""

    @abstractmethod
    def covers(self, points: Points) -> Float[Array, "*points"]:
        """1 where the light shines at all, 0 elsewhere (outside a spot's cone), with a soft rim if it has one."""


def _direction(value: ArrayLike, name: str, dtype: DType | None) -> Vector3:
    vector = require_finite(as_float_array(value, dtype), name)
    require(vector.shape == (3,), f"{name} must have shape (3,); got {vector.shape}")
    return normalize(require_value(vector, norm(vector) > 0, f"{name} must not be the zero vector"))


def _position(value: ArrayLike, name: str, dtype: DType | None) -> Vector3:
    vector = require_finite(as_float_array(value, dtype), name)
    require(vector.shape == (3,), f"{name} must have shape (3,); got {vector.shape}")
    return vector


def _on_disc(middle: Vector3, axis: Vector3, offsets: Float[Array, "samples 2"]) -> Float[Array, "samples 3"]:
    # Any two directions across the axis do: a disc has no preferred one.
    across = any_perpendicular(axis)
    return middle + offsets[:, :1] * across + offsets[:, 1:] * jnp.cross(axis, across)


def _color(value: ArrayLike, dtype: DType | None) -> Vector3:
    color = require_finite(as_float_array(value, dtype), "light color")
    require(color.ndim == 0 or color.shape == (3,), f"light color must be a number or (3,); got {color.shape}")
    return jnp.broadcast_to(require_value(color, color >= 0, "light color must not be negative"), (3,))


class DirectionalLight(Light):
    """A light at infinity.

    Attributes:
        direction: Unit vector along which the light travels.
        color: Linear RGB irradiance on a surface that faces it.
    """

    direction: Vector3
    color: Vector3

    @classmethod
    def create(
        cls,
        direction: ArrayLike | None = None,
        color: ArrayLike = 1.0,
        dtype: DType | None = None,
        *,
        towards: ArrayLike | None = None,
    ) -> "DirectionalLight":
        """Light from infinity, by the direction in which it travels or by the direction to where it comes from.

        Args:
            direction: Along which the light travels, of any nonzero length.
            color: Linear RGB irradiance on a surface that faces it; one number for grey.
            dtype: Floating dtype; that of the direction if None.
            towards: Towards the sun, in place of `direction`: the other habit.

        Raises:
            ValueError: If not exactly one direction is given, it is zero, or a number is not finite.
        """
        if (direction is None) == (towards is None):
            raise ValueError(
                "give one of direction, in which the light travels, and towards, where it comes from; got "
                + ("neither" if direction is None else "both")
            )
        if towards is not None:
            return cls(-_direction(towards, "direction towards the light", dtype), _color(color, dtype))
        assert direction is not None
        return cls(_direction(direction, "light direction", dtype), _color(color, dtype))

    def to_light(self, points: Points) -> tuple[Points, Float[Array, "*points"]]:
        """Unit direction against the light's own, and infinity's stand-in: the largest finite number."""
        largest = jnp.finfo(points.dtype).max
        return jnp.broadcast_to(-self.direction, points.shape), jnp.full(points.shape[:-1], largest, points.dtype)

    def space(self, view: Vector3, lower: Vector3, upper: Vector3) -> DirectionalSpace:
        """Parallel rays."""
        frame = light_frame(-self.direction, view)
        centre = 0.5 * (lower + upper)
        # Start every ray outside the sphere around the scene, a hundredth of it away from the nearest surface.
        radius = 0.505 * norm(upper - lower)
        return DirectionalSpace(centre + radius * frame[1], frame)

    @property
    def homogeneous(self) -> Float[Array, "4"]:
        """The direction towards the light, with w = 0."""
        return jnp.concatenate([-self.direction, jnp.zeros_like(self.direction[:1])])

    def moved(self, offsets: Float[Array, "samples 2"], towards: Vector3) -> "tuple[DirectionalLight, ...]":
        """Lights from directions about this one."""
        del towards
        directions = normalize(_on_disc(self.direction, self.direction, offsets))
        return tuple(DirectionalLight(direction, self.color) for direction in directions)

    @property
    def is_directional(self) -> bool:
        """Always."""
        return True

    def as_directional(self, what: str, instead: str = "") -> "DirectionalLight":
        """Itself."""
        del what, instead
        return self

    def radiance(self, points: Points) -> Float[Array, "*points 3"]:
        """The light's colour everywhere."""
        return jnp.broadcast_to(self.color, points.shape)

    def covers(self, points: Points) -> Float[Array, "*points"]:
        """1 everywhere."""
        return jnp.ones(points.shape[:-1], points.dtype)


class PointLight(Light):
    """A light at a place that shines in every direction.

    Attributes:
        position: World position.
        color: Linear RGB intensity; irradiance falls with the squared distance, and is `color` at distance 1.
    """

    position: Vector3
    color: Vector3

    @classmethod
    def create(
        cls, position: ArrayLike, color: ArrayLike = 1.0, dtype: DType | None = None, origin: Any = ZERO
    ) -> "PointLight":
        """Light at `position`; in the world, where `origin` is the `Mesh.origin` of the mesh it shines on.

        Raises:
            ValueError: If a number is not finite or a colour is negative.
        """
        return cls(_position(to_local(position, origin), "light position", dtype), _color(color, dtype))

    def to_light(self, points: Points) -> tuple[Points, Float[Array, "*points"]]:
        """Unit direction and distance to the light, world units."""
        offset = self.position - points
        return normalize(offset), norm(offset)

    def space(self, view: Vector3, lower: Vector3, upper: Vector3) -> OctahedralSpace:
        """Rays in every direction."""
        del view, lower, upper
        return OctahedralSpace(self.position)

    @property
    def homogeneous(self) -> Float[Array, "4"]:
        """The position, with w = 1."""
        return jnp.concatenate([self.position, jnp.ones_like(self.position[:1])])

    def moved(self, offsets: Float[Array, "samples 2"], towards: Vector3) -> "tuple[PointLight, ...]":
        """Lights at places about this one."""
        places = _on_disc(self.position, normalize(towards - self.position), offsets)
        return tuple(PointLight(place, self.color) for place in places)

    @property
    def is_omnidirectional(self) -> bool:
        """Always."""
        return True

    def radiance(self, points: Points) -> Float[Array, "*points 3"]:
        """Inverse-square falloff; 0, not infinity, at the light itself."""
        offset = self.position - points
        return self.color * safe_divide(jnp.ones_like(points[..., :1]), dot(offset, offset)[..., None])

    def covers(self, points: Points) -> Float[Array, "*points"]:
        """1 everywhere."""
        return jnp.ones(points.shape[:-1], points.dtype)


class SpotLight(Light):
    """A light at a place that shines into a cone.

    Attributes:
        position: World position.
        direction: Unit axis of the cone, the way the light travels.
        half_angle: Angle between axis and rim, radians, in (0, π/2).
        color: Linear RGB intensity on the axis, at distance 1.
    """

    position: Vector3
    direction: Vector3
    half_angle: Annotated[Scalar, POSITIVE]
    color: Vector3

    @classmethod
    def create(
        cls,
        position: ArrayLike,
        direction: ArrayLike,
        half_angle: ArrayLike,
        color: ArrayLike = 1.0,
        dtype: DType | None = None,
        origin: Any = ZERO,
    ) -> "SpotLight":
        """Light at `position` that shines along `direction` into a cone of `half_angle` radians.

        The position is in the world, where `origin` is the `Mesh.origin` of the mesh that the light shines on.

        Raises:
            ValueError: If the direction is zero, the half angle lies outside (0, π/2), or a number is not finite.
        """
        angle = require_finite(as_float_array(half_angle, dtype), "half_angle")
        angle = require_value(
            angle, (angle > 0) & (angle < jnp.pi / 2), "half_angle of a spot light must lie in (0, π/2) radians"
        )
        return cls(
            _position(to_local(position, origin), "light position", dtype),
            _direction(direction, "light direction", dtype),
            angle,
            _color(color, dtype),
        )

    def to_light(self, points: Points) -> tuple[Points, Float[Array, "*points"]]:
        """Unit direction and distance to the light, world units."""
        offset = self.position - points
        return normalize(offset), norm(offset)

    def space(self, view: Vector3, lower: Vector3, upper: Vector3) -> PerspectiveSpace:
        """Rays through the plane at distance 1 ahead."""
        del view, lower, upper
        return PerspectiveSpace(self.position, view_frame(self.direction, any_perpendicular(self.direction)))

    @property
    def homogeneous(self) -> Float[Array, "4"]:
        """The position, with w = 1."""
        return jnp.concatenate([self.position, jnp.ones_like(self.position[:1])])

    def moved(self, offsets: Float[Array, "samples 2"], towards: Vector3) -> "tuple[SpotLight, ...]":
        """Lights at places about this one."""
        places = _on_disc(self.position, normalize(towards - self.position), offsets)
        return tuple(SpotLight(place, self.direction, self.half_angle, self.color) for place in places)

    @property
    def cone(self) -> Scalar:
        """Tangent of the half angle."""
        return jnp.tan(self.half_angle)

    def covers(self, points: Points) -> Float[Array, "*points"]:
        """1 inside the cone, falling smoothly to 0 over the outer tenth of the cosine's range."""
        # Smoothstep of the cosine: no kink at either end of the rim.
        cosine = dot(normalize(points - self.position), jnp.broadcast_to(self.direction, points.shape))
        rim = jnp.cos(self.half_angle)
        ramp = jnp.clip((cosine - rim) / (0.1 * (1 - rim)), 0.0, 1.0)
        return ramp * ramp * (3 - 2 * ramp)

    def radiance(self, points: Points) -> Float[Array, "*points 3"]:
        """Inverse-square falloff inside the cone."""
        offset = self.position - points
        falloff = safe_divide(self.covers(points), dot(offset, offset))
        return self.color * falloff[..., None]
