"""The pinhole camera: pose, half angle of view, frustum, and its angle γ to a light."""

from typing import Annotated, Any, ClassVar

import jax.numpy as jnp

from shadowjax._checked import Checked
from shadowjax._checks import POSITIVE, concrete, require, require_finite, require_value
from shadowjax._numerics import norm, rotate
from shadowjax._types import Array, ArrayLike, DType, Float, Points, Scalar, Vector3, as_float_array
from shadowjax.geometry.origin import ZERO, to_local
from shadowjax.geometry.transforms import angle_between_lines, unit, view_frame


class Camera(Checked):
    """A pinhole camera.

    Attributes:
        position: Centre of projection, world units.
        rotation: Rows right, up, forward: an orthonormal frame.
        phi_y: *Half* of the vertical angle of view, radians, in (0, π/2).
        aspect: Width over height of the image.
        near: Distance of the near plane along forward, world units.
        far: Distance of the far plane along forward, world units.
    """

    _remedy_: ClassVar = "Camera.look_at(…) makes one"

    position: Vector3
    rotation: Float[Array, "3 3"]
    phi_y: Annotated[Scalar, POSITIVE]
    aspect: Annotated[Scalar, POSITIVE]
    near: Annotated[Scalar, POSITIVE]
    far: Annotated[Scalar, POSITIVE]

    @classmethod
    def look_at(
        cls,
        position: ArrayLike,
        target: ArrayLike,
        up: ArrayLike = (0.0, 1.0, 0.0),
        *,
        phi_y: ArrayLike,
        near: ArrayLike,
        far: ArrayLike,
        aspect: ArrayLike = 1.0,
        dtype: DType | None = None,
        origin: Any = ZERO,
    ) -> "Camera":
        """Camera at `position` that looks at `target`.

        Args:
            position: World position.
            target: World point in the middle of the image; not equal to `position`.
            up: World direction that points up in the image.
            phi_y: Half of the vertical angle of view, radians, in (0, π/2).
            near: Near distance, world units, > 0.
            far: Far distance, world units, > near.
            aspect: Width over height, > 0.
            dtype: Floating dtype of all numbers; that of `position` if None.
            origin: `Mesh.origin` of the mesh looked at, where position and target are world coordinates.

        Raises:
            ValueError: If a number lies outside its range; the message names it.
        """
        dtype = as_float_array(position, dtype).dtype
        position, target = to_local(position, origin), to_local(target, origin)
        position, target, up, phi_y, near, far, aspect = (
            require_finite(as_float_array(value, dtype), name)
            for value, name in [
                (position, "camera position"), (target, "camera target"), (up, "camera up"), (phi_y, "phi_y"),
                (near, "near"), (far, "far"), (aspect, "aspect"),
            ]
        )  # fmt: skip
        for vector, name in [(position, "position"), (target, "target"), (up, "up")]:
            require(vector.shape == (3,), f"camera {name} must have shape (3,); got {vector.shape}")
        for number, name in [(phi_y, "phi_y"), (near, "near"), (far, "far"), (aspect, "aspect")]:
            require(number.ndim == 0, f"camera {name} must be one number; got an array of shape {number.shape}")
        forward = require_value(
            target - position, norm(target - position) > 0, "camera position and target must differ"
        )
        up = require_value(up, norm(up) > 0, "camera up must not be the zero vector")
        phi_y = require_value(
            phi_y, (phi_y > 0) & (phi_y < jnp.pi / 2), "phi_y, half the angle of view, must lie in (0, π/2) radians"
        )
        near = require_value(near, near > 0, "near must be positive")
        if concrete(near) is not None and concrete(far) is not None:
            require(bool(near < far), f"near must be less than far; got near = {near}, far = {far}")
        else:
            near = require_value(near, near < far, "near must be less than far")
        aspect = require_value(aspect, aspect > 0, "aspect must be positive")
        return cls(position, view_frame(forward, up), phi_y, aspect, near, far)

    @property
    def right(self) -> Vector3:
        """Unit vector to the right of the image."""
        return self.rotation[0]

    @property
    def up(self) -> Vector3:
        """Unit vector to the top of the image."""
        return self.rotation[1]

    @property
    def forward(self) -> Vector3:
        """Unit view direction."""
        return self.rotation[2]

    @property
    def half_size(self) -> Float[Array, "2"]:
        """Half width and half height of the image plane at distance 1 (tangents of the half angles)."""
        tangent = jnp.tan(self.phi_y)
        return jnp.stack([tangent * self.aspect, tangent])

    def to_view(self, points: Points) -> Points:
        """World points in camera coordinates: x right, y up, z along the view."""
        return rotate(points - self.position, self.rotation)

    def frustum_corners(self) -> Float[Array, "8 3"]:
        """World positions of the corners: the near four, then the far four, each (−,−), (+,−), (+,+), (−,+)."""
        signs = jnp.asarray([[-1, -1], [1, -1], [1, 1], [-1, 1]], self.near.dtype)
        # Corners of the image plane at distance 1, scaled to both planes.
        plane = jnp.concatenate([signs * self.half_size, jnp.ones((4, 1), signs.dtype)], axis=1)
        corners = jnp.concatenate([self.near * plane, self.far * plane])
        return self.position + corners @ self.rotation

    def gamma(self, light_direction: Vector3) -> Scalar:
        """Angle γ between the line of the light and the view, radians in [0, π/2].

        Source: warping, section on general positions of the light (γ = 90° where warping helps most).
        """
        return angle_between_lines(unit(light_direction), self.forward)
