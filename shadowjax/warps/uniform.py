"""The uniform map: texels of one size over the plane of the light (standard shadow maps)."""

import jax.numpy as jnp

from shadowjax._types import Array, Float
from shadowjax.geometry.camera import Camera
from shadowjax.geometry.light import Light, SpotLight
from shadowjax.geometry.mesh import Mesh
from shadowjax.rays.light_space import LightSpace, OctahedralSpace
from shadowjax.rays.plane_map import Box
from shadowjax.warps.base import Warp, WarpFit, bounding_box

PlanePoints = Float[Array, "*points 2"]


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


class UniformFit(WarpFit):
    """Covers all that can cast or receive a shadow.

    A directional light gets the bounding rectangle of the scene, a spot light its cone, a point light every direction.
    """

    def fit(self, space: LightSpace, light: Light, mesh: Mesh, camera: Camera) -> UniformWarp:
        """The smallest axis-aligned rectangle of the light's plane around what the light can see."""
        if isinstance(space, OctahedralSpace):
            one = jnp.ones(2, mesh.vertices.dtype)
            return UniformWarp(Box(-one, one))
        if isinstance(light, SpotLight):
            reach = jnp.broadcast_to(jnp.tan(light.half_angle), (2,))
            return UniformWarp(Box(-reach, reach))
        plane, _ = space.project(mesh.vertices)
        return UniformWarp(Box(*bounding_box(plane)))
