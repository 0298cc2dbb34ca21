"""A comb of level slats over a plane: periodic shadows known exactly."""

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
from shadowjax.scenes.closed_forms import ReceivingPlane
from shadowjax.scenes.quads import level_quad, quad_mesh

WIDTH = 2.4  # of the whole comb where the number of slats is chosen by triangles, metres


class Comb(Checked):
    """Equal slats without thickness side by side, over the plane y = 0.

    Attributes:
        slat_width: Extent of a slat across, metres.
        gap: Free space between slats, metres, > 0.
        half_length: Half the extent of a slat along itself, metres.
        height: Over the plane, metres.
        turn: Of the comb about +y, radians; 0 lays the slats side by side along x.
        num_slats: How many there are.
    """

    slat_width: Scalar = eqx.field(converter=as_float_array, default=0.14)
    gap: Scalar = eqx.field(converter=as_float_array, default=0.14)
    half_length: Scalar = eqx.field(converter=as_float_array, default=0.85)
    height: Scalar = eqx.field(converter=as_float_array, default=0.9)
    turn: Scalar = eqx.field(converter=as_float_array, default=0.3)
    num_slats: int = eqx.field(static=True, default=9)

    @property
    def plane(self) -> ReceivingPlane:
        """The receiver, with (u, v) = (x, z)."""
        return ReceivingPlane.horizontal(jnp.zeros_like(self.height))

    def corners(self) -> Float[Array, "slats 4 3"]:
        """Corners of every slat, from one side to the other."""
        place = jnp.arange(self.num_slats, dtype=self.height.dtype) - (self.num_slats - 1) / 2
        slat = level_quad(0.5 * self.slat_width, self.half_length, self.height, self.turn)
        across = jnp.stack([jnp.cos(self.turn), jnp.zeros_like(self.turn), -jnp.sin(self.turn)])
        return slat + ((self.slat_width + self.gap) * place)[:, None, None] * across

    def mesh(self) -> Mesh:
        """Two triangles a slat, then two for the ground."""
        one = jnp.ones_like(self.height)
        ground = level_quad(2.2 * one, 1.6 * one, 0.0 * one, x=-0.55)
        colors = np.concatenate([np.tile(palette.OCHRE, (self.num_slats, 1)), palette.LIMESTONE[None]])
        return quad_mesh(jnp.concatenate([self.corners(), ground[None]]), colors)

    def shadow_polygons(self, light: Light) -> Float[Array, "slats 4 2"]:
        """Corners of every slat's shadow on the ground's plane, in (x, z); from level slats they never touch."""
        return closed_forms.project(self.corners(), light, self.plane)


@checked
def build(num_triangles: int) -> tuple[Mesh, Camera, tuple[Light, ...]]:
    """As many slats as the wish allows, as wide as the gaps between them."""
    num_slats = max(1, (num_triangles - 2) // 2)
    slat = WIDTH / (2 * num_slats - 1)
    mesh = Comb(slat, slat, num_slats=num_slats).mesh()
    return mesh, framed(mesh, 0.0, 38.0), sun(65.0, 45.0)


FAMILY = SceneFamily(
    name="comb",
    description="level slats over a plane, periodic shadows known exactly (all surfaces are single-sided)",
    source="shadowjax",
    build=build,
    default_triangles=20,
    min_triangles=4,
    max_triangles=100_000,
    closed=False,
)
