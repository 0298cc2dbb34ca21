"""Convex polygons in a plane and their unions: area, membership and signed distance, all differentiable."""

import jax
import jax.numpy as jnp

from shadowjax._checked import checked
from shadowjax._numerics import norm, safe_divide
from shadowjax._types import Array, Bool, Float, Scalar

Points2 = Float[Array, "*points 2"]
Polygon = Float[Array, "corners 2"]

_PARALLEL = 64.0  # roundings of the sine between two edges below which they count as parallel


def _cross(a: Float[Array, "... 2"], b: Float[Array, "... 2"]) -> Float[Array, "..."]:
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]


def _edges(polygon: Float[Array, "... corners 2"]) -> tuple[Array, Array]:
    """Starts and vectors of the edges, turned counter-clockwise in (u, v)."""
    turning = jnp.sum(_cross(polygon, jnp.roll(polygon, -1, axis=-2)), axis=-1)[..., None, None]
    polygon = jnp.where(turning < 0, polygon[..., ::-1, :], polygon)
    return polygon, jnp.roll(polygon, -1, axis=-2) - polygon


@checked
def area(polygon: Polygon) -> Scalar:
    """Area of a simple polygon in square metres, whichever way it turns."""
    return 0.5 * jnp.abs(jnp.sum(_cross(polygon, jnp.roll(polygon, -1, axis=-2)), axis=-1))


@checked
def contains(polygon: Polygon, positions: Points2) -> Bool[Array, "*points"]:
    """Whether positions lie in a convex polygon, its edge included."""
    start, along = _edges(polygon)
    return jnp.all(_cross(along, positions[..., None, :] - start) >= 0, axis=-1)


def _distance_to_segments(positions: Points2, start: Array, along: Array) -> Float[Array, "*points segments"]:
    offset = positions[..., None, :] - start
    # Foot of the perpendicular on each segment, kept between its ends.
    fraction = jnp.clip(safe_divide(jnp.sum(offset * along, axis=-1), jnp.sum(along * along, axis=-1)), 0.0, 1.0)
    return norm(offset - fraction[..., None] * along)


@checked
def signed_distance(polygon: Polygon, positions: Points2) -> Float[Array, "*points"]:
    """Distance to the edge of a convex polygon in metres, negative inside."""
    distance = jnp.min(_distance_to_segments(positions, *_edges(polygon)), axis=-1)
    return jnp.where(contains(polygon, positions), -distance, distance)


@checked
def outer_pieces(polygons: Float[Array, "shapes corners 2"]) -> tuple[Array, Array, Array]:
    """Start, vector and presence of the pieces of all edges that bound the union of convex polygons.

    Every edge is cut where it enters and leaves each other polygon (Cyrus and Beck's clip); a piece bounds the union
    where its middle lies in no other polygon.
    """
    start, along = _edges(polygons)
    num_shapes, num_corners, _ = polygons.shape
    # side(t) = inside + t * change, for each edge (a, i) against each edge line j of the polygon b
    inside = _cross(along[None, None], start[:, :, None, None] - start[None, None])
    change = _cross(along[None, None], along[:, :, None, None])
    # the sign of a rounding error must not decide about parallel edges: they are wholly inside or outside
    size = norm(along)
    tiny = _PARALLEL * jnp.finfo(size.dtype).eps * size[:, :, None, None] * size
    crossing = -safe_divide(inside, change)
    outside = jnp.where((jnp.abs(change) <= tiny) & (inside < 0), 2.0, 0.0)
    enter = jnp.max(jnp.where(change > tiny, crossing, outside), axis=-1)
    leave = jnp.min(jnp.where(change < -tiny, crossing, 1.0), axis=-1)
    enter, leave = jnp.clip(enter, 0.0, 1.0), jnp.clip(leave, 0.0, 1.0)
    other = ~jnp.eye(num_shapes, dtype=bool)[:, None, :]
    overlaps = other & (enter < leave)
    enter, leave = jnp.where(overlaps, enter, 0.0), jnp.where(overlaps, leave, 0.0)
    ends = jnp.zeros((num_shapes, num_corners, 1), polygons.dtype)
    # All cuts of an edge in order; pairs that do not overlap collapse to 0 and leave pieces without length.
    cuts = jnp.sort(jnp.concatenate([ends, enter, leave, ends + 1.0], axis=-1), axis=-1)
    middle = 0.5 * (cuts[..., 1:] + cuts[..., :-1])[..., None]
    covered = jnp.any((enter[:, :, None] < middle) & (middle < leave[:, :, None]), axis=-1)
    present = ~covered & (cuts[..., 1:] > cuts[..., :-1])
    piece_start = start[:, :, None] + cuts[..., :-1, None] * along[:, :, None]
    piece_along = (cuts[..., 1:] - cuts[..., :-1])[..., None] * along[:, :, None]
    return piece_start.reshape(-1, 2), piece_along.reshape(-1, 2), present.reshape(-1)


@checked
def union_contains(polygons: Float[Array, "shapes corners 2"], positions: Points2) -> Bool[Array, "*points"]:
    """Whether positions lie in any of several convex polygons."""
    return jnp.any(jax.vmap(contains, in_axes=(0, None))(polygons, positions), axis=0)


@checked
def union_signed_distance(polygons: Float[Array, "shapes corners 2"], positions: Points2) -> Float[Array, "*points"]:
    """Distance to the edge of the union of convex polygons in metres, negative inside; exact where they overlap too.

    No two polygons may share a stretch of an edge.
    """
    start, along, present = outer_pieces(polygons)
    distances = _distance_to_segments(positions, start, along)
    distance = jnp.min(jnp.where(present, distances, jnp.finfo(distances.dtype).max), axis=-1)
    return jnp.where(union_contains(polygons, positions), -distance, distance)


@checked
def union_area(polygons: Float[Array, "shapes corners 2"]) -> Scalar:
    """Area of the union of convex polygons in square metres, by Green's theorem around its edge."""
    start, along, present = outer_pieces(polygons)
    return 0.5 * jnp.sum(jnp.where(present, _cross(start, along), 0.0))
