"""Light spaces: a light's rays as points of a plane, each world point's place on it and its depth along the ray."""

from abc import abstractmethod

import jax.numpy as jnp

from shadowjax._checked import Checked, checked
from shadowjax._numerics import dot, far_away, norm, normalize, rotate, safe_divide
from shadowjax._types import Array, Bool, Float, Points, Scalar, Vector3
from shadowjax.geometry.camera import Camera
from shadowjax.geometry.transforms import Frame

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

    @property
    def is_parallel(self) -> bool:
        """Whether all rays have one direction, so that texels have one size at every depth."""
        return False

    @property
    def is_projective(self) -> bool:
        """Whether straight lines of the world are straight on the plane, so that a triangle's image is a triangle."""
        return False

    @property
    def border(self) -> str:
        """What lies outside a map of the plane: "lit", or how the plane goes on there."""
        return "lit"

    @property
    def whole_plane(self) -> tuple[Float[Array, "2"], Float[Array, "2"]] | None:
        """Lower and upper corner of the plane where it is bounded; None where it has no end."""
        return None

    @property
    def rows(self) -> Frame:
        """Rows of the matrix that takes offsets from `source` to (x, y, w), of projective spaces.

        The plane position is (x, y), with depth w, for parallel rays, and (x, y)/w for rays through the source.

        Raises:
            ValueError: If the space is not projective.
        """
        raise ValueError(f"{type(self).__name__} bends straight lines, so it has no matrix")

    def as_directional(self, what: str) -> "DirectionalSpace":
        """The same space, where only parallel rays will do.

        Args:
            what: Begins the message of the error, such as "a stable map needs".

        Raises:
            ValueError: If the rays are not parallel.
        """
        raise ValueError(f"{what} a directional light; got the rays of a {type(self).__name__}")

    def as_perspective(self, what: str, instead: str = "") -> "PerspectiveSpace":
        """The same space, where only straight rays through one point will do; see `as_directional`.

        Args:
            what: Begins the message of the error: what is needed.
            instead: Ends it with the remedy.

        Raises:
            ValueError: If the rays are parallel, or fill a sphere.
        """
        raise ValueError(f"{what}; got {type(self).__name__}{instead}")

    def counted_from(self, point: Vector3) -> "LightSpace":
        """The same rays with positions and depths counted from a point, where rays have no start of their own."""
        del point
        return self

    def is_reached(self, plane: PlanePoints) -> Bool[Array, "*points"]:
        """Whether a projected position stands for a ray: behind a position with a forward direction none arrives."""
        return jnp.ones(plane.shape[:-1], bool)

    def in_front(self, points: Points) -> Bool[Array, "*points"]:
        """Whether a ray of the space reaches each point."""
        return self.is_reached(self.project(points)[0])

    def beyond(self, lower: Vector3, upper: Vector3) -> Scalar:
        """As `farthest`, of a box given by offsets of its corners from `source`, world units."""
        return 1.01 * norm(jnp.maximum(jnp.abs(lower), jnp.abs(upper)))

    def farthest(self, lower: Vector3, upper: Vector3) -> Scalar:
        """A finite depth beyond every point of a bounding box: what a miss reports.

        Args:
            lower: Lower corner of the box, world units.
            upper: Upper corner of the box, world units.
        """
        return self.beyond(lower - self.source, upper - self.source)

    def vector_to_source(self, points: Points) -> Points:
        """Vectors from points to where their rays come from, of any length; without a square root."""
        return self.source - points

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

    @property
    def is_parallel(self) -> bool:
        """Always."""
        return True

    @property
    def is_projective(self) -> bool:
        """Always."""
        return True

    @property
    def rows(self) -> Frame:
        """x, z and −y of the frame."""
        return jnp.stack([self.frame[0], self.frame[2], -self.frame[1]])

    def as_directional(self, what: str) -> "DirectionalSpace":
        """Itself."""
        del what
        return self

    def counted_from(self, point: Vector3) -> "DirectionalSpace":
        """Parallel rays may be counted from anywhere."""
        return DirectionalSpace(point, self.frame)

    def beyond(self, lower: Vector3, upper: Vector3) -> Scalar:
        """As `farthest`, of a box given by offsets of its corners from the origin."""
        # The box reaches half its diagonal beyond its middle; a quarter more keeps every point nearer than a miss.
        return dot(0.5 * (lower + upper), -self.frame[1]) + 0.75 * norm(upper - lower)

    def vector_to_source(self, points: Points) -> Points:
        """The way up."""
        return jnp.broadcast_to(self.frame[1], points.shape)

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
        # Compared with the distance, so that the quotient stays below 10⁶, the place that stands for no ray.
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

    @property
    def is_projective(self) -> bool:
        """Always."""
        return True

    @property
    def rows(self) -> Frame:
        """The frame itself."""
        return self.frame

    def as_perspective(self, what: str, instead: str = "") -> "PerspectiveSpace":
        """Itself."""
        del what, instead
        return self

    def is_reached(self, plane: PlanePoints) -> Bool[Array, "*points"]:
        """Only what lies ahead of the position."""
        return jnp.abs(plane[..., 0]) < UNREACHED

    def way_to_source(self, points: Points) -> tuple[Points, Float[Array, "*points"]]:
        """Towards the position, and the distance to it."""
        offset = self.position - points
        return normalize(offset), norm(offset)


class OctahedralSpace(LightSpace):
    """All rays through one point: the sphere of directions folded onto the square [−1, 1]² by an octahedron.

    A bijection without poles, so one map serves a point light; its only seams are folds of the square's border, which
    `maps.sampling.fold` continues.

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
        # The lower half of the octahedron |x| + |y| + |z| = 1 is unfolded over the upper one's edges into the corners
        # of the square.
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

    @property
    def border(self) -> str:
        """The square is folded along its border."""
        return "octahedral"

    @property
    def whole_plane(self) -> tuple[Float[Array, "2"], Float[Array, "2"]]:
        """The square [−1, 1]²."""
        one = jnp.ones(2, self.position.dtype)
        return -one, one

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
