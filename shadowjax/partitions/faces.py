"""The frustum's faces as the light sees them, each with a map and a perspective warp of its own."""

import equinox as eqx
import jax.numpy as jnp

from shadowjax._checked import checked
from shadowjax._numerics import dot, safe_divide
from shadowjax._types import Array, Bool, Float, Int, Points, Scalar, Vector2
from shadowjax.geometry.camera import Camera
from shadowjax.geometry.light import DirectionalLight, Light
from shadowjax.geometry.light_space import LightSpace
from shadowjax.geometry.mesh import Mesh
from shadowjax.partitions.base import Partition
from shadowjax.rays.map_part import seen_space, starting_outside
from shadowjax.rays.ray_grid import RayGrid
from shadowjax.warps.fit import padded, visible_range
from shadowjax.warps.perspective import PerspectiveWarp

FACE_NAMES = ("bottom", "right", "top", "left")
# A face seen at such a grazing angle that it covers less than this share of the frustum's square has no wedge of its
# own: what it would hold lies within the margin of its neighbours' maps.
THINNEST = 1e-4
FARTHEST_CENTRE = 8.0  # lengths of a face behind it at which the centre of its warp stops following the face's axis


Numbers = Float[Array, "..."]


class FacePartition(Partition):
    """One map for each side face of the camera's frustum through which rays enter at their least depth.

    A ray of the light crosses the frustum from one face to another, and its texel should be as fine as the finest pixel
    beam it meets: at the end of least depth. Those ends lie on the near plane and on the sides whose rays run from
    there to greater depths: all four for γ < φ, three for φ < γ < π/2 (the far one and the two next to it), one for
    γ = π/2, which is then the map of an ordinary perspective warp. As the source proposes, sides are drawn out to the
    camera's position, so that they cover the near plane too and no fifth map is needed.

    On the light's plane the sides are triangles from the image O of the camera's position to the edges of the far
    plane, without overlap. A point belongs to the triangle in whose wedge from O it lies. Depth grows linearly from O
    across each triangle, so each has a perspective warp along its own axis, whose n' is optimal in closed form.

    All four maps are cast, so that one program serves every γ; those of sides that do not apply answer for no point.

    Attributes:
        tight: Whether the depths are cut to those at which the scene has vertices.

    Source: warping, section 4.3.1 and figure 24; n' derived here.
    """

    tight: bool = eqx.field(static=True, default=True)

    def grids(self, mesh: Mesh, light: Light, camera: Camera, resolution: int) -> tuple[RayGrid, ...]:
        """One grid a side, in the order bottom, right, top, left of the image.

        Raises:
            ValueError: If the light is not directional.
        """
        light = light.as_directional("faces need", ": use Cascades or SingleMap")
        space = seen_space(light, mesh, camera)
        near, far = visible_range(camera, mesh) if self.tight else (camera.near, camera.far)
        applies = _applies(space, camera)
        warps = [face_warp(space, camera, near, far, i, applies[i]) for i in range(4)]
        return tuple(starting_outside(space, warp, mesh, resolution) for warp in warps)

    @property
    def num_maps(self) -> int:
        """One a side."""
        return len(FACE_NAMES)

    def select(self, grids: tuple[RayGrid, ...], camera: Camera, points: Points) -> Int[Array, "*points"]:
        """The side in whose wedge from O a point lies; the nearest one where rounding leaves it in none."""
        space = grids[0].space
        apex, ends = _outline(space, camera)
        applies = _applies(space, camera)
        offset = space.project(points)[0] - apex
        inside = []
        for i in range(4):
            first, last = ends[i], ends[(i + 1) % 4]
            # How far the point lies inside both sides of the wedge, whichever way its sides turn.
            turn = jnp.sign(_cross(first, last))
            depth = jnp.minimum(
                _cross(first / _length(first), offset) * turn, _cross(offset, last / _length(last)) * turn
            )
            inside.append(jnp.where(applies[i], depth, -jnp.inf))
        return jnp.argmax(jnp.stack(inside), axis=0).astype(jnp.int32)


@checked
def faces_that_apply(camera: Camera, light: DirectionalLight) -> Bool[Array, "4"]:
    """Which sides of the frustum get a map that is read, in the order of `FACE_NAMES`.

    Args:
        camera: The view.
        light: A directional light; γ and the camera's roll decide.
    """
    zero = jnp.zeros(3, camera.near.dtype)
    return _applies(light.space(camera.forward, zero, zero + 1), camera)


@checked
def face_near_distance(low: Numbers, start: Numbers, length: Numbers, near: Numbers, far: Numbers) -> Numbers:
    """n' of least worst z error of a side face, counted from its map's lowest line.

    Across the face the pixel beam is n wide up to `start` and grows linearly to f at `length`, while texels grow with
    (n' + u)²: only the ends of that stretch matter, as for the whole frustum, with E = start − low and
    F = W = length − low.

    Args:
        low: Distance of the map's lowest line from O along the face's axis, plane units.
        start: Distance of the near plane's edge, at least `low`.
        length: Distance of the far plane's edge.
        near: Depth n, world units.
        far: Depth f.

    Source: warping, eq. 37–39, carried over to a face.
    """
    offset, extent = start - low, length - low
    # √f − √n as (f − n)/(√f + √n), which keeps its digits in thin slices
    sums = jnp.sqrt(far) + jnp.sqrt(near)
    # (q + s − low)²/n = (q + l − low)²/f at both ends of the stretch, solved for q.
    equalising = (length * jnp.sqrt(near) - start * jnp.sqrt(far)) * sums / (far - near) + low
    slack = extent - 2 * offset
    largest = extent * (4 / float(jnp.finfo(extent.dtype).eps))  # the uniform map to the last bit
    minimum = jnp.where(slack > 0, offset * extent / jnp.maximum(slack, offset * extent / largest), largest)
    return jnp.minimum(jnp.maximum(equalising, minimum), largest)


@checked
def face_warp(
    space: LightSpace, camera: Camera, near: Scalar, far: Scalar, face: int, applies: Bool[Array, ""]
) -> PerspectiveWarp:
    """The warp of one side: axis across its far edge, projection centre on the line from O through that edge's middle.

    Args:
        space: The light's rays.
        camera: The view.
        near: Least depth that matters, world units.
        far: Greatest depth that matters.
        face: Index into `FACE_NAMES`.
        applies: Whether the side is used; a warp around the whole frustum stands in for one that is not.
    """
    apex, ends = _outline(space, camera)
    # Edges of the far plane as seen from O: lengths on the light's plane grow with depth from there.
    first, last = far * ends[face], far * ends[(face + 1) % 4]
    middle = (first + last) / 2
    edge = last - first
    # Perpendicular to the far edge, away from O.
    axis = jnp.stack([edge[1], -edge[0]]) / _length(edge)
    axis = axis * jnp.where(dot(axis, middle) < 0, -1.0, 1.0).astype(axis.dtype)
    # what stands in for a side that is not used: any region with an area
    axis = jnp.where(applies, axis, jnp.asarray([0.0, 1.0], axis.dtype))
    size = far * jnp.max(jnp.abs(ends))
    first = jnp.where(applies, first, size * jnp.asarray([-1.0, 1.0], axis.dtype))
    last = jnp.where(applies, last, size * jnp.asarray([1.0, 1.0], axis.dtype))
    length = dot(first, axis)
    low = jnp.where(applies, _lowest(near * ends, first, last, axis), length * 0.5)
    start = jnp.maximum(near / far * length, low)
    distance = face_near_distance(low, start, length, near, far)
    share = low / length
    corners = padded(apex + jnp.stack([share * first, share * last, first, last]))
    return skewed_warp(corners, 1 / distance, axis, apex, (first + last) / 2)


@checked
def skewed_warp(
    points: Float[Array, "points 2"], strength: Scalar, axis: Vector2, apex: Vector2, middle: Vector2
) -> PerspectiveWarp:
    """The tightest warp of one strength whose projection centre lies on the line from a face's apex to its far edge.

    Lines from the centre then run along the face although it is not symmetric about its axis.
    """
    turned = jnp.stack([axis[1], -axis[0]])
    along = points @ axis
    lowest = jnp.min(along)
    extent = jnp.max(along) - lowest
    slope = dot(middle, turned) / dot(middle, axis)
    # The centre n' behind the lowest line, on the line from O; a far centre needs no skew that would lose digits.
    behind = jnp.minimum(1 / strength, FARTHEST_CENTRE * extent)
    centre = dot(apex, turned) + slope * (lowest - behind - dot(apex, axis))
    # Projected onto the lowest line through the skewed centre: the extremes are the map's sides.
    across = (points @ turned - centre) / (1 + (along - lowest) * strength)
    sides = jnp.stack([jnp.min(across), jnp.max(across)])
    return PerspectiveWarp(lowest * axis + centre * turned, axis, extent, strength, sides)


def _outline(space: LightSpace, camera: Camera) -> tuple[Vector2, Float[Array, "4 2"]]:
    """O, the camera's position on the light's plane, and the four edges of the frustum from it, per unit of depth."""
    signs = jnp.asarray([[-1, -1], [1, -1], [1, 1], [-1, 1]], camera.near.dtype)
    # Corners of the image at depth 1 in the camera's frame, turned into the world by its rows.
    rays = jnp.concatenate([signs * camera.half_size, jnp.ones((4, 1), signs.dtype)], axis=1) @ camera.rotation
    apex, _ = space.project(camera.position)
    return apex, space.project(camera.position + rays)[0] - apex


def _applies(space: LightSpace, camera: Camera) -> Bool[Array, "4"]:
    """Sides that rays enter towards greater depth and that cover an area."""
    apex, ends = _outline(space, camera)
    del apex
    travel = -space.to_source(camera.position)
    # The light's direction of travel or its reverse, whichever leads to greater depth.
    deeper = jnp.where(dot(travel, camera.forward) < 0, -travel, travel)
    half = camera.half_size
    zero, one = jnp.zeros((), half.dtype), jnp.ones((), half.dtype)
    # Normals of |x| = half_x·z and |y| = half_y·z in the camera's frame; a ray enters where it runs against one.
    outward = jnp.stack(
        [
            jnp.stack([zero, -one, -half[1]]), jnp.stack([one, zero, -half[0]]),
            jnp.stack([zero, one, -half[1]]), jnp.stack([-one, zero, -half[0]]),
        ]
    ) @ camera.rotation  # fmt: skip
    areas = jnp.abs(_cross(ends, jnp.roll(ends, -1, axis=0)))
    large = areas > THINNEST * jnp.max(jnp.sum(ends * ends, axis=-1))
    return (outward @ deeper < 0) & large


def _lowest(near_corners: Float[Array, "4 2"], first: Vector2, last: Vector2, axis: Vector2) -> Scalar:
    """Least distance from O, along a face's axis, of what its wedge holds of the near plane; O is the origin.

    The near plane's quadrilateral cut by the wedge is convex: its lowest point is a corner of it inside the wedge, a
    crossing of an edge with a side of the wedge, or O itself.
    """
    turn = jnp.sign(_cross(first, last))
    rounding = 1e-5

    def held(points: Float[Array, "points 2"]) -> Bool[Array, "points"]:
        # Inside the wedge, or off it by no more than rounding: both cross products are areas, and so is the slack.
        slack = rounding * jnp.max(jnp.abs(near_corners)) * jnp.maximum(_length(first), _length(last))
        return (turn * _cross(first, points) >= -slack) & (turn * _cross(points, last) >= -slack)

    following = jnp.roll(near_corners, -1, axis=0)
    edges = following - near_corners
    candidates = [jnp.where(held(near_corners), near_corners @ axis, jnp.inf)]
    for side in (first, last):
        # near corner + a·edge = b·side
        whole = _cross(edges, side)
        a = safe_divide(-_cross(near_corners, side), whole, -1.0)
        b = safe_divide(_cross(edges, near_corners), whole, -1.0)
        crosses = (a >= -rounding) & (a <= 1 + rounding) & (b >= 0)
        candidates.append(jnp.where(crosses, b * dot(side, axis), jnp.inf))
    # O inside the near plane's image: all edges turn one way round it, and the lowest point is O itself.
    turns = _cross(near_corners, following)
    around = jnp.all(turns >= 0) | jnp.all(turns <= 0)
    lowest = jnp.min(jnp.concatenate(candidates))
    lowest = jnp.where(around | ~jnp.isfinite(lowest), 0.0, lowest)
    return jnp.clip(lowest * (1 - 1e-3), 0.0, 0.99 * dot(first, axis)).astype(axis.dtype)


def _cross(a: Float[Array, "*a 2"], b: Float[Array, "*b 2"]) -> Float[Array, "..."]:
    """Signed area of the parallelogram of two plane vectors."""
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]


def _length(vector: Vector2) -> Scalar:
    """Length; a tiny one where the vector is zero, so that it can be divided by."""
    return jnp.sqrt(jnp.sum(vector * vector) + float(jnp.finfo(vector.dtype).tiny))


__all__ = ["FACE_NAMES", "FacePartition", "face_near_distance", "face_warp", "faces_that_apply", "skewed_warp"]
