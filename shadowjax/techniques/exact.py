"""Exact shadows: a shadow ray for every point."""

from shadowjax._types import Array, Float, Points
from shadowjax.geometry.camera import Camera
from shadowjax.geometry.light import Light
from shadowjax.geometry.light_space import LightSpace
from shadowjax.geometry.mesh import Mesh
from shadowjax.rays.caster import Caster
from shadowjax.rays.casters import default_caster
from shadowjax.techniques.base import Shadows, Technique


class Exact(Technique):
    """The reference: a shadow ray for every point, no map and no bias.

    With the `GridCaster` caster this is an alias-free shadow map: points are put into cells of the light's plane and
    triangles are drawn over them, which gives the same answers without a traced ray.

    Attributes:
        caster: Finds what blocks the shadow rays.
    """

    caster: Caster = default_caster()

    def build(self, mesh: Mesh, light: Light, camera: Camera) -> "ExactShadows":
        """Nothing to prepare but the space of the light's rays."""
        lower, upper = mesh.bounds()
        return ExactShadows(mesh, light.space(camera.forward, lower, upper), self.caster)

    @property
    def num_tones(self) -> int:
        """Lit or not."""
        return 2


class ExactShadows(Shadows):
    """Shadow rays against a mesh.

    Attributes:
        mesh: Everything that casts shadows.
        space: The rays of the light.
        caster: Traces the shadow rays.
    """

    mesh: Mesh
    space: LightSpace
    caster: Caster

    def visibility(self, points: Points, normals: Points) -> Float[Array, "*points"]:
        """0 or 1."""
        return self.caster.visible(self.mesh, self.space, points, normals).astype(points.dtype)

    @property
    def map_bytes(self) -> int:
        """No map."""
        return 0

    @property
    def prefers_images(self) -> bool:
        """As its caster does for the light's rays."""
        return self.caster.prefers_images(self.space)
