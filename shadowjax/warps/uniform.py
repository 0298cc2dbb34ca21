"""The uniform map: texels of one size over the plane of the light (standard shadow maps)."""

import equinox as eqx
import jax.numpy as jnp

from shadowjax._checks import require_choice
from shadowjax._types import Array, Float
from shadowjax.geometry.camera import Camera
from shadowjax.geometry.light import Light
from shadowjax.geometry.light_space import LightSpace
from shadowjax.geometry.mesh import Mesh
from shadowjax.rays.plane_map import Box
from shadowjax.warps.base import Warp, WarpFit, bounding_box
from shadowjax.warps.receivers import receiver_outline

PlanePoints = Float[Array, "*points 2"]
COVERS = ("scene", "view")


class UniformWarp(Warp):
    """An affine map: the same texel size everywhere on the light's plane.

    Attributes:
        box: The rectangle of the plane that the map covers.
    """

    box: Box

    def forward(self, plane: PlanePoints) -> PlanePoints:
        """(s, t) of plane positions."""
        return self.box.forward(plane)

    def inverse(self, square: PlanePoints) -> PlanePoints:
        """Plane positions of (s, t)."""
        return self.box.inverse(square)

    def enlarged(self, factor: float) -> "UniformWarp":
        """The rectangle `factor` times as wide and as high about its middle."""
        middle, half = (self.box.lower + self.box.upper) / 2, (self.box.upper - self.box.lower) / 2
        return UniformWarp(Box(middle - factor * half, middle + factor * half))


class UniformFit(WarpFit):
    """A rectangle of texels of one size around all that can cast or receive a shadow, or around what a view needs.

    Over the scene, a directional light gets the bounding rectangle of the mesh, a spot light its cone, a point light
    every direction. Over the view, a directional or a spot light gets the bounding rectangle of the frustum cut to the
    box around the mesh and to the light's cone; casters outside the view are on the rays of their receivers, so none
    is lost. Slices of a view (`Cascades`) are always covered so, each for itself.

    Attributes:
        cover: "scene" or "view".
    """

    cover: str = eqx.field(static=True, default="scene")

    def __check_init__(self) -> None:
        require_choice(self.cover, "what a uniform map covers", COVERS)

    @property
    def follows_camera(self) -> bool:
        """Around the view, not around the scene."""
        return self.cover == "view"

    def for_slices(self) -> "UniformFit":
        """The fit that covers the view."""
        return UniformFit("view")

    def fit(self, space: LightSpace, light: Light, mesh: Mesh, camera: Camera) -> UniformWarp:
        """The smallest rectangle along the axes of the light's plane around what it has to cover."""
        if (whole := space.whole_plane) is not None:
            return UniformWarp(Box(*whole))
        if self.cover == "view":
            return UniformWarp(Box(*bounding_box(receiver_outline(space, light, mesh, camera).plane)))
        if (cone := light.cone) is not None:
            reach = jnp.broadcast_to(cone, (2,))
            return UniformWarp(Box(-reach, reach))
        plane, _ = space.project(mesh.vertices)
        return UniformWarp(Box(*bounding_box(plane)))


__all__ = ["COVERS", "UniformFit", "UniformWarp"]
