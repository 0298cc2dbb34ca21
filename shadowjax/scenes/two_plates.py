"""Two level plates over a plane, one shading the other: overlapping shadows known exactly."""

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


class TwoPlates(Checked):
    """A lower and an upper plate without thickness over the plane y = 0.

    Attributes:
        lower_half: Half the extent of the square lower plate, metres; it is centred on the y axis.
        lower_height: Of the lower plate over the plane, metres.
        upper_half: Half the extent of the square upper plate, metres.
        upper_height: Of the upper plate over the plane, metres; more than `lower_height`.
        upper_turn: Of the upper plate about +y, radians.
        upper_x: Where the middle of the upper plate lies along x, metres.
        upper_z: Where the middle of the upper plate lies along z, metres.
    """

    lower_half: Scalar = eqx.field(converter=as_float_array, default=0.75)
    lower_height: Scalar = eqx.field(converter=as_float_array, default=0.5)
    upper_half: Scalar = eqx.field(converter=as_float_array, default=0.45)
    upper_height: Scalar = eqx.field(converter=as_float_array, default=1.3)
    upper_turn: Scalar = eqx.field(converter=as_float_array, default=0.5)
    upper_x: Scalar = eqx.field(converter=as_float_array, default=0.05)
    upper_z: Scalar = eqx.field(converter=as_float_array, default=0.85)

    @property
    def plane(self) -> ReceivingPlane:
        """The ground's plane, with (u, v) = (x, z)."""
        return ReceivingPlane.horizontal(jnp.zeros_like(self.lower_height))

    @property
    def lower_plane(self) -> ReceivingPlane:
        """The lower plate's plane, with (u, v) = (x, z)."""
        return ReceivingPlane.horizontal(self.lower_height)

    def corners(self) -> Float[Array, "2 4 3"]:
        """Corners of the lower and of the upper plate."""
        lower = level_quad(self.lower_half, self.lower_half, self.lower_height)
        upper = level_quad(
            self.upper_half, self.upper_half, self.upper_height, self.upper_turn, self.upper_x, self.upper_z
        )
        return jnp.stack([lower, upper])

    def mesh(self) -> Mesh:
        """Two triangles each: the lower plate, the upper plate, the ground."""
        one = jnp.ones_like(self.lower_height)
        ground = level_quad(1.9 * one, 1.55 * one, 0.0 * one, x=-0.5, z=0.1)
        colors = np.stack([palette.TERRACOTTA, palette.TEAL, palette.LIMESTONE])
        return quad_mesh(jnp.concatenate([self.corners(), ground[None]]), colors)

    def shadow_polygons(self, light: Light) -> Float[Array, "2 4 2"]:
        """Corners of both shadows on the ground's plane, in (x, z); the ground's shadow is their union."""
        return closed_forms.project(self.corners(), light, self.plane)

    def shadow_on_lower(self, light: Light) -> Polygon:
        """Corners (4, 2) of the upper plate's shadow in the lower plate's plane, in (x, z)."""
        return closed_forms.project(self.corners()[1], light, self.lower_plane)


@checked
def build(num_triangles: int) -> tuple[Mesh, Camera, tuple[Light, ...]]:
    """The default plates; the count does not change."""
    del num_triangles
    mesh = TwoPlates().mesh()
    return mesh, framed(mesh, 0.0, 35.0), sun(60.0, 46.0)


FAMILY = SceneFamily(
    name="two-plates",
    description="one plate shades another over a plane, all shadows known exactly (all surfaces are single-sided)",
    source="shadowjax",
    build=build,
    default_triangles=6,
    min_triangles=6,
    max_triangles=6,
    closed=False,
)
