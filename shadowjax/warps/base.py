"""What a warp is: a plane map that knows its spacing, and a fit that places one for a camera, a light and a scene."""

from abc import abstractmethod
from typing import ClassVar

import jax
import jax.numpy as jnp

from shadowjax._checked import Checked, checked
from shadowjax._types import Array, Float
from shadowjax.geometry.camera import Camera
from shadowjax.geometry.light import Light
from shadowjax.geometry.light_space import LightSpace
from shadowjax.geometry.mesh import Mesh
from shadowjax.rays.plane_map import PlaneMap


class Warp(PlaneMap):
    """A bijection between a region of a light's plane and the unit square, with the spacing of its texels."""

    def spacing(self, square: Float[Array, "*points 2"]) -> Float[Array, "*points 2 2"]:
        """Derivative of `inverse`: how far the plane position moves with s and with t (last axis), plane units.

        Divided by the resolution this is the size of a texel on the light's plane. Computed from the map itself, so
        that a closed form can be checked against it.
        """
        # One Jacobian per point; they are 2 × 2, so forward mode is as good as any.
        flat = square.reshape(-1, 2)
        return jax.vmap(jax.jacfwd(self.inverse))(flat).reshape(*square.shape, 2)

    def inverse_spacing(self, plane: Float[Array, "*points 2"]) -> Float[Array, "*points 2 2"]:
        """Derivative of `forward`: how fast (s, t) move with the plane position, 1 / plane units."""
        flat = plane.reshape(-1, 2)
        return jax.vmap(jax.jacfwd(self.forward))(flat).reshape(*plane.shape, 2)


class WarpFit(Checked):
    """A rule that places a warp: the part of a technique that is chosen before scene and light are known."""

    _remedy_: ClassVar = "Give an object, such as UniformFit() or PerspectiveFit()"

    def for_slices(self) -> "WarpFit":
        """The fit that a partition uses for each slice of the view: itself, if it follows the camera's planes.

        A fit whose map does not depend on them would give every slice the same map, and names another one here.
        """
        return self

    @property
    def follows_camera(self) -> bool:
        """Whether the map moves with the view."""
        return True

    @property
    def holds_still(self) -> bool:
        """Whether its texels keep their places in the world while the camera moves."""
        return False

    @abstractmethod
    def fit(self, space: LightSpace, light: Light, mesh: Mesh, camera: Camera) -> PlaneMap:
        """The warp for these rays, this scene and this view."""


@checked
def bounding_box(plane: Float[Array, "points 2"]) -> tuple[Float[Array, "2"], Float[Array, "2"]]:
    """Lower and upper corner around plane positions, widened a little so that no position lies on the border."""
    lower, upper = jnp.min(plane, axis=0), jnp.max(plane, axis=0)
    # A scene that is flat seen from the light still gets an area.
    margin = 1e-3 * jnp.max(upper - lower) + jnp.finfo(plane.dtype).tiny ** 0.25
    return lower - margin, upper + margin
