"""Shadow volumes as a technique: exact counts of crossed volume walls."""

import equinox as eqx
import jax
import jax.numpy as jnp

from shadowjax._checks import (
    concrete,
    require_choice,
)
from shadowjax._numerics import faces_light
from shadowjax._types import Array, Float, Int, Points
from shadowjax.geometry.camera import Camera
from shadowjax.geometry.light import Light
from shadowjax.geometry.light_space import LightSpace
from shadowjax.geometry.mesh import Mesh
from shadowjax.rays.caster import receiver_gap
from shadowjax.techniques.base import Shadows, Technique
from shadowjax.volumes.draw import count_image
from shadowjax.volumes.extrude import CASTERS, VolumeEdges, require_closed, volume_edges
from shadowjax.volumes.regions import Regions, boundary, count_regions
from shadowjax.volumes.stencil import METHODS, Stencil, is_lit, method_regions, start_count

# How far behind a face's plane its shadow begins, in roundings of the products that add up to its offset from the eye.
FACE_ROUNDINGS = 16.0


# Corners of a quad, and numbers of a homogeneous corner.
QUAD_NUMBERS = 4 * 4


class ShadowVolumes(Technique):
    """Walls of shadow volumes counted between the eye and each point: exact, without a map and without a ray.

    The count begins with the volumes around the camera's position, found by a segment to the light, so no capping is
    needed; light caps are counted too, so points need not be visible from the camera.

    Attributes:
        method: "z-pass" counts between camera and point, "z-fail" behind the point.
        casters: "both": every face casts, whichever side it shows the light; any mesh will do. "facing": only faces
            whose outer side the light sees, as in the source; half the counts, but it needs a closed mesh wound
            outwards, and the light outside it.
        stencil: Arithmetic of the counters.

    Source: stencil, sections 4.1 and 7, with the count at the eye in place of cap polygons.
    """

    method: str = eqx.field(static=True, default="z-pass")
    casters: str = eqx.field(static=True, default="both")
    stencil: Stencil = Stencil()

    def __check_init__(self) -> None:
        require_choice(self.method, "method", METHODS)
        require_choice(self.casters, "casters", CASTERS)

    def build(self, mesh: Mesh, light: Light, camera: Camera) -> "VolumeShadows":
        """Find the edges, and the planes of everything that can be crossed.

        Raises:
            ValueError: With casters="facing", if the mesh is open or its faces are wound inconsistently.
        """
        return self.extrude(volume_edges(mesh), mesh, light, camera)

    def extrude(self, edges: VolumeEdges, mesh: Mesh, light: Light, camera: Camera) -> "VolumeShadows":
        """As `build`, for edges that are known: a mesh that moves keeps them, under `jit` too."""
        if self.casters == "facing":
            require_closed(edges)
        return _extruded(edges, mesh, light, camera, self)

    @property
    def num_tones(self) -> int:
        """Lit or not."""
        return 2


@eqx.filter_jit
def _extruded(
    edges: VolumeEdges, mesh: Mesh, light: Light, camera: Camera, technique: ShadowVolumes
) -> "VolumeShadows":
    mesh, light, camera = jax.lax.stop_gradient((mesh, light, camera))
    found = boundary(mesh.vertices, mesh.faces, edges, light.homogeneous, camera.position, technique.casters)
    found = found.held_back(FACE_ROUNDINGS)
    lower, upper = mesh.bounds()
    return VolumeShadows(
        method_regions(found, technique.method),
        start_count(found, technique.method),
        jnp.sum(found.wall_regions(False).weights != 0, dtype=jnp.int32),
        camera,
        light,
        light.space(camera.forward, lower, upper),
        technique.stencil,
    )


class VolumeShadows(Shadows):
    """Shadow volumes of one light, ready to be counted from one eye.

    Attributes:
        regions: What is crossed on the way to a point, or behind it.
        start: Volumes around the eye.
        num_quads: Quads that bound the volumes.
        camera: The eye, and the image that it sees.
        light: The light.
        space: Its rays.
        stencil: Arithmetic of the counters.
    """

    regions: Regions
    start: Int[Array, ""]
    num_quads: Int[Array, ""]
    camera: Camera
    light: Light
    space: LightSpace
    stencil: Stencil

    @eqx.filter_jit
    def count(self, points: Points, normals: Points) -> Int[Array, "*points"]:
        """What the stencil buffer holds at each point.

        Args:
            points: World points on surfaces; an image (rows, cols, 3) that the camera sees is counted fastest.
            normals: Unit normals of the side that is looked at: the count is taken a few roundings off the surface.
        """
        to_light, _ = self.light.to_light(points)
        offset = points - self.camera.position
        # Off the surface by the roundings of the point and of its offset from the eye, towards normal and light.
        gap = receiver_gap(points, normals) + receiver_gap(offset, normals)
        seen = jax.lax.stop_gradient(offset + gap[..., None] * (normals + to_light))

        def count(regions: Regions) -> Int[Array, "*points"]:
            if points.ndim != 3:
                return count_regions(regions, seen)
            # An image's background stands at the eye itself.
            counts = jnp.any(points != self.camera.position, axis=-1)
            return count_image(regions, seen, counts, self.camera.rotation)

        if self.stencil.wraps:
            total = count(self.regions)
            return self.stencil.value(self.start, total, jnp.zeros_like(total))
        # Saturating counters need increments and decrements apart: positive and negative weights, each as a count.
        up, down = (
            count(eqx.tree_at(lambda r: r.weights, self.regions, jnp.maximum(sign * self.regions.weights, 0)))
            for sign in (1, -1)
        )
        return self.stencil.value(self.start, up, down)

    @eqx.filter_jit
    def visibility(self, points: Points, normals: Points) -> Float[Array, "*points"]:
        """1 where the side that is looked at faces the light and no volume holds the point, else 0."""
        to_light, _ = self.light.to_light(points)
        # No ray arrives behind a spot light, so nothing blocks one there.
        lit = is_lit(self.count(points, normals)) | ~self.space.in_front(points)
        return (lit & faces_light(normals, to_light)).astype(points.dtype)

    @property
    def map_bytes(self) -> int:
        """No map."""
        return 0

    def volume_bytes(self, num_samples: int) -> int:
        """Corners of the quads that bound the volumes, and one counter a sample.

        Where the mesh is being traced, every edge counts as a quad.
        """
        known = concrete(self.num_quads)
        num = self.regions.weights.shape[0] if known is None else int(known)
        return num * QUAD_NUMBERS * self.regions.planes.dtype.itemsize + -(-self.stencil.bits * num_samples // 8)

    @property
    def prefers_images(self) -> bool:
        """Neighbours in an image are drawn over together."""
        return True
