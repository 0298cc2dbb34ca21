"""A level plate over a plane: the shadow is a parallelogram known exactly."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from shadowjax._checked import Checked, checked
from shadowjax._types import Array, Float, Scalar, as_float_array
from shadowjax.geometry.camera import Camera
from shadowjax.geometry.light import Light
from shadowjax.geometry.mesh import Mesh
from shadowjax.scenes import closed_forms, palette
from shadowjax.scenes.base import SceneFamily, framed, sun
from shadowjax.scenes.closed_forms import Polygon, ReceivingPlane
from shadowjax.scenes.quads import level_quad, quad_mesh


class PlateOverPlane(Checked):
    """A plate without thickness, centred on the y axis, over the plane y = 0.

    Attributes:
        half_x: Half its extent along x before the turn, metres.
        half_z: Half its extent along z before the turn, metres.
        height: Over the plane, metres.
        turn: Of the plate about +y, radians.
        ground_half_x: Half the extent of the ground along x, metres.
        ground_half_z: Half the extent of the ground along z, metres.
        ground_x: Where the middle of the ground lies along x, metres.
    """

    half_x: Scalar = eqx.field(converter=as_float_array, default=0.8)
    half_z: Scalar = eqx.field(converter=as_float_array, default=0.6)
    height: Scalar = eqx.field(converter=as_float_array, default=1.0)
    turn: Scalar = eqx.field(converter=as_float_array, default=0.45)
    ground_half_x: Scalar = eqx.field(converter=as_float_array, default=2.2)
    ground_half_z: Scalar = eqx.field(converter=as_float_array, default=1.5)
    ground_x: Scalar = eqx.field(converter=as_float_array, default=-0.7)

    @property
    def plane(self) -> ReceivingPlane:
        """The receiver, with (u, v) = (x, z)."""
        return ReceivingPlane.horizontal(jnp.zeros_like(self.height))

    def corners(self) -> Float[Array, "4 3"]:
        """Corners of the plate."""
        return level_quad(self.half_x, self.half_z, self.height, self.turn)

    def ground(self) -> Float[Array, "4 3"]:
        """Corners of the ground."""
        return level_quad(self.ground_half_x, self.ground_half_z, jnp.zeros_like(self.height), x=self.ground_x)

    def mesh(self) -> Mesh:
        """Triangles 0 and 1 are the plate, 2 and 3 the ground."""
        return quad_mesh(jnp.stack([self.corners(), self.ground()]), np.stack([palette.TEAL, palette.LIMESTONE]))

    def shadow_polygon(self, light: Light) -> Polygon:
        """Corners (4, 2) of the shadow on the ground's plane, in (x, z)."""
        return closed_forms.project(self.corners(), light, self.plane)


@checked
def build(num_triangles: int) -> tuple[Mesh, Camera, tuple[Light, ...]]:
    """The default plate; the count does not change."""
    del num_triangles
    mesh = PlateOverPlane().mesh()
    return mesh, framed(mesh, 0.0, 35.0), sun(75.0, 42.0)


FAMILY = SceneFamily(
    name="plate-over-plane",
    description="a level plate over a plane, its shadow known exactly (plate and ground are single-sided)",
    source="shadowjax",
    build=build,
    default_triangles=4,
    min_triangles=4,
    max_triangles=4,
    closed=False,
)
