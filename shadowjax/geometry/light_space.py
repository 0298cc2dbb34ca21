"""Light spaces: a light's rays as points of a plane, each world point's place on it and its depth along the ray."""

from abc import abstractmethod

import jax.numpy as jnp

from shadowjax._checked import Checked, checked
from shadowjax._numerics import dot, far_away, norm, normalize, rotate, safe_divide
from shadowjax._types import Array, Bool, Float, Points, Scalar, Vector3
from shadowjax.geometry.camera import Camera
from shadowjax.geometry.light import DirectionalLight, Light, PointLight, SpotLight
from shadowjax.geometry.transforms import Frame, any_perpendicular, light_frame, view_frame

PlanePoints = Float[Array, "*points 2"]

# A plane position that lies outside every map, for points that no ray of the light reaches.
UNREACHED = 1e6
# Least part of a point's distance that lies ahead, for a ray of a spot light or a camera to reach it.
LEAST_FORWARD = 1e-6


class LightSpace(Checked):
    """A bijection between the rays of a light (or of a camera) and the points (u, v) of a plane.

    Depth is the distance along the ray from its start, in world units.
    """

    @abstractmethod
    def project(self, points: Points) -> tuple[PlanePoints, Float[Array, "*points"]]:
        """Plane position and depth of world points; a position outside every map where no ray arrives."""

    @abstractmethod
    def ray(self, plane: PlanePoints) -> tuple[Points, Points]:
        """Origin and unit direction of the ray at each plane position."""

    def point(self, plane: PlanePoints, depth: Float[Array, "*points"]) -> Points:
        """World point at `depth` along the ray of a plane position: the inverse of `project`."""
        origins, directions = self.ray(plane)
        return origins + depth[..., None] * directions

    @property
    @abstractmethod
    def source(self) -> Vector3:
        """World point from which plane positions and depths are counted: where rays start, or one of those places."""

    @abstractmethod
    def way_to_source(self, points: Points) -> tuple[Points, Float[Array, "*points"]]:
        """Unit direction from each point to where its ray comes from, and how far that is; finite, also at infinity."""

    def to_source(self, points: Points) -> Points:
        """Unit direction from each point against the ray that reaches it: towards the light."""
        return self.way_to_source(points)[0]


class DirectionalSpace(LightSpace):
    """Parallel rays: plane position is (x, z) of the light frame, world units; depth is distance below a start plane.

    Attributes:
        origin: World point with plane position (0, 0) and depth 0.
        frame: Rows x, y, z of the light space; y points to the light.
    """

    origin: Vector3
    frame: Frame

    def project(self, points: Points) -> tuple[PlanePoints, Float[Array, "*points"]]:
        """(x, z) and −y of the points relative to the origin."""
        local = rotate(points - self.origin, self.frame)
        return local[..., ::2], -local[..., 1]

    def ray(self, plane: PlanePoints) -> tuple[Points, Points]:
        """Rays that start on the plane y = 0 and run along −y."""
        x, y, z = self.frame
        origins = self.origin + plane[..., :1] * x + plane[..., 1:] * z
        return origins, jnp.broadcast_to(-y, origins.shape)

    @property
    def source(self) -> Vector3:
        """The origin."""
        return self.origin

    def way_to_source(self, points: Points) -> tuple[Points, Float[Array, "*points"]]:
        """The way up, without end: what blocks parallel light need not lie behind any start of its rays."""
        far = jnp.full(points.shape[:-1], far_away(points.dtype), points.dtype)
        return jnp.broadcast_to(self.frame[1], points.shape), far


class PerspectiveSpace(LightSpace):
    """Rays through one point towards a plane in front of it: a spot light, or a camera.

    Plane position is (x/z, y/z) in the frame right, up, forward (tangents of angles); depth is the *distance* from the
    position, not z.

    Attributes:
        position: World position all rays start from.
        frame: Rows right, up, forward.
    """

    position: Vector3
    frame: Frame

    def project(self, points: Points) -> tuple[PlanePoints, Float[Array, "*points"]]:
        """Tangents of the angles to forward, and distance; points at or behind the position lie outside every map."""
        local = rotate(points - self.position, self.frame)
        in_front = local[..., 2:] > LEAST_FORWARD * norm(local, keepdims=True)
        plane = local[..., :2] / jnp.where(in_front, local[..., 2:], jnp.ones_like(local[..., 2:]))
        return jnp.where(in_front, plane, jnp.full_like(plane, UNREACHED)), norm(local)

    def ray(self, plane: PlanePoints) -> tuple[Points, Points]:
        """Rays from the position through the plane at distance 1."""
        right, up, forward = self.frame
        directions = normalize(plane[..., :1] * right + plane[..., 1:] * up + forward)
        return jnp.broadcast_to(self.position, directions.shape), directions

    @property
    def source(self) -> Vector3:
        """The position."""
        return self.position

    def way_to_source(self, points: Points) -> tuple[Points, Float[Array, "*points"]]:
        """Towards the position, and the distance to it."""
        offset = self.position - points
        return normalize(offset), norm(offset)


class OctahedralSpace(LightSpace):
    """All rays through one point: the sphere of directions folded onto the square [−1, 1]² by an octahedron.

    A bijection without poles, so one map serves a point light; its only seams are folds of the square's border, which
    `wrap` continues.

    Attributes:
        position: World position all rays start from.
    """

    position: Vector3

    def project(self, points: Points) -> tuple[PlanePoints, Float[Array, "*points"]]:
        """Octahedral coordinates of the direction from the light, and distance."""
        offset = points - self.position
        length_one = jnp.sum(jnp.abs(offset), axis=-1, keepdims=True)
        unit = safe_divide(offset, length_one)
        upper = unit[..., :2]
        lower = (1 - jnp.abs(upper[..., ::-1])) * _sign(upper)
        return jnp.where(unit[..., 2:] >= 0, upper, lower), norm(offset)

    def ray(self, plane: PlanePoints) -> tuple[Points, Points]:
        """Rays from the position along the unfolded direction."""
        height = 1 - jnp.sum(jnp.abs(plane), axis=-1, keepdims=True)
        folded = (1 - jnp.abs(plane[..., ::-1])) * _sign(plane)
        sideways = jnp.where(height >= 0, plane, folded)
        directions = normalize(jnp.concatenate([sideways, height], axis=-1))
        return jnp.broadcast_to(self.position, directions.shape), directions

    @property
    def source(self) -> Vector3:
        """The position."""
        return self.position

    def way_to_source(self, points: Points) -> tuple[Points, Float[Array, "*points"]]:
        """Towards the position, and the distance to it."""
        offset = self.position - points
        return normalize(offset), norm(offset)


def _sign(value: Float[Array, "..."]) -> Float[Array, "..."]:
    return jnp.where(value >= 0, jnp.ones_like(value), -jnp.ones_like(value))


@checked
def camera_space(camera: Camera) -> PerspectiveSpace:
    """The rays of a camera."""
    return PerspectiveSpace(camera.position, camera.rotation)


@checked
def light_space(light: Light, view: Vector3, lower: Vector3, upper: Vector3) -> LightSpace:
    """The light space of any light over a scene.

    Args:
        light: Directional, spot or point light.
        view: View direction, which orients the plane (warping: z points the way the view points).
        lower: Lower corner of the scene's bounding box, world units.
        upper: Upper corner of the scene's bounding box.

    Returns:
        A space in which every point of the box has positive depth.

    Raises:
        ValueError: For a light of an unknown kind.
    """
    if isinstance(light, DirectionalLight):
        frame = light_frame(-light.direction, view)
        centre = 0.5 * (lower + upper)
        # Start every ray outside the sphere around the scene, a hundredth of it away from the nearest surface.
        radius = 0.505 * norm(upper - lower)
        return DirectionalSpace(centre + radius * frame[1], frame)
    if isinstance(light, SpotLight):
        return PerspectiveSpace(light.position, view_frame(light.direction, any_perpendicular(light.direction)))
    if isinstance(light, PointLight):
        return OctahedralSpace(light.position)
    raise ValueError(f"no light space for a light of type {type(light).__name__}; use one of the package's lights")


@checked
def farthest(space: LightSpace, lower: Vector3, upper: Vector3) -> Scalar:
    """A finite depth beyond every point of a bounding box: what a miss reports.

    Args:
        space: Any light space.
        lower: Lower corner of the box, world units.
        upper: Upper corner of the box, world units.
    """
    return beyond(space, lower - space.source, upper - space.source)


@checked
def beyond(space: LightSpace, lower: Vector3, upper: Vector3) -> Scalar:
    """As `farthest`, of a box given by offsets of its corners from the space's `source`."""
    if isinstance(space, DirectionalSpace):
        return dot(0.5 * (lower + upper), -space.frame[1]) + 0.75 * norm(upper - lower)
    return 1.01 * norm(jnp.maximum(jnp.abs(lower), jnp.abs(upper)))


@checked
def in_front(space: LightSpace, points: Points) -> Bool[Array, "*points"]:
    """Whether a ray of the space reaches each point."""
    plane, _ = space.project(points)
    return is_reached(space, plane)


@checked
def is_reached(space: LightSpace, plane: PlanePoints) -> Bool[Array, "*points"]:
    """Whether a projected position stands for a ray: only behind a position with a forward direction none arrives."""
    if isinstance(space, PerspectiveSpace):
        return jnp.abs(plane[..., 0]) < UNREACHED
    return jnp.ones(plane.shape[:-1], bool)
