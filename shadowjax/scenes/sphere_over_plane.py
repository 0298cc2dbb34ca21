"""A sphere over a plane: the shadow is an ellipse known exactly, and how far the tessellation can stray from it."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from shadowjax._checked import Checked, checked
from shadowjax._numerics import dot
from shadowjax._types import Scalar, Vector3, as_float_array
from shadowjax.geometry.camera import Camera
from shadowjax.geometry.light import Light
from shadowjax.geometry.mesh import Mesh
from shadowjax.scenes import closed_forms, palette
from shadowjax.scenes.base import SceneFamily, framed, sun
from shadowjax.scenes.closed_forms import Ellipse, ReceivingPlane
from shadowjax.scenes.primitives import geodesic_sphere
from shadowjax.scenes.quads import level_quad, quad_mesh


class SphereOverPlane(Checked):
    """A sphere above the origin, over the plane y = 0.

    Attributes:
        radius: Metres, > 0.
        height: Of the centre over the plane, metres, at least the radius.
        frequency: Pieces of an icosahedron's edge; the sphere's mesh has 20 frequency² triangles.
    """

    radius: Scalar = eqx.field(converter=as_float_array, default=0.7)
    height: Scalar = eqx.field(converter=as_float_array, default=1.1)
    frequency: int = eqx.field(static=True, default=12)

    @property
    def plane(self) -> ReceivingPlane:
        """The receiver, with (u, v) = (x, z)."""
        return ReceivingPlane.horizontal(jnp.zeros_like(self.height))

    @property
    def centre(self) -> Vector3:
        """World position of the sphere's centre."""
        return self.height * jnp.asarray([0.0, 1.0, 0.0], self.height.dtype)

    def ball(self) -> Mesh:
        """The sphere's triangles alone; their corners lie on the true sphere."""
        unit = geodesic_sphere(1.0, self.frequency)
        vertices = self.radius * jnp.asarray(unit.vertices, self.radius.dtype) + self.centre
        colors = jnp.asarray(np.broadcast_to(palette.TERRACOTTA, (unit.num_faces, 3)), self.radius.dtype)
        return Mesh.create(vertices, unit.faces, colors)

    def mesh(self) -> Mesh:
        """The sphere's triangles, then two for the single-sided ground."""
        one = jnp.ones_like(self.height)
        ground = level_quad(2.0 * one, 1.3 * one, 0.0 * one, x=-0.75, z=-0.15)
        return Mesh.merge([self.ball(), quad_mesh(ground[None], palette.LIMESTONE[None])])

    def shadow(self, light: Light) -> Ellipse:
        """Shadow of the true sphere on the ground's plane, in (x, z)."""
        return closed_forms.sphere_shadow(self.centre, self.radius, light, self.plane)

    def inner_radius(self) -> Scalar:
        """Radius of the largest sphere about the centre that the mesh holds.

        The mesh is convex and lies between this sphere and the true one, so its shadow lies between theirs: the edge of
        the mesh's shadow strays inwards by no more than the two ellipses are apart, and never outwards.
        """
        ball = self.ball()
        return jnp.min(dot(ball.face_normals(), ball.vertices[ball.faces[:, 0]] - self.centre))


@checked
def build(num_triangles: int) -> tuple[Mesh, Camera, tuple[Light, ...]]:
    """The frequency whose count is the nearest to the wish."""
    frequency = max(1, round(np.sqrt((num_triangles - 2) / 20)))
    mesh = SphereOverPlane(frequency=frequency).mesh()
    return mesh, framed(mesh, 0.0, 33.0), sun(75.0, 44.0)


FAMILY = SceneFamily(
    name="sphere-over-plane",
    description="a sphere over a plane, its elliptic shadow known exactly (the ground is single-sided)",
    source="shadowjax",
    build=build,
    default_triangles=2882,
    min_triangles=22,
    max_triangles=2_000_000,
    closed=False,
)
