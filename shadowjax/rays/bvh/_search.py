"""Fits a tree's boxes to vertices and walks it: ray by ray, without a stack, in loops that XLA compiles whole."""

import equinox as eqx
import jax.numpy as jnp
from jax import lax

from shadowjax._types import Array, Float, Int
from shadowjax.geometry.mesh import Mesh
from shadowjax.rays.bvh._build import LEAF_SIZE
from shadowjax.rays.ray import MISS, Rays, corners_in_order, depth_rounding, edge_test, orthonormal_frame

# How far boxes are widened, in roundings of the largest offset between a ray's origin and the scene. The edge rule sees
# corners that are off by at most about 8: rotated into the ray's frame, whose axes are rounded too.
WIDEN_ROUNDINGS = 16.0
NONE = jnp.iinfo(jnp.int32).max

# Columns of the table of rays.
ORIGIN, ACROSS, UPWARD, DIRECTION, INVERSE, T_MIN, T_MAX, WIDEN = 0, 3, 6, 9, 12, 15, 16, 17
NUM_COLUMNS = 18


class Links(eqx.Module):
    """The tree without coordinates, see `_build.Topology`."""

    order: Int[Array, "faces"]
    first: Int[Array, "nodes_1"]
    links: Int[Array, "8 nodes 2"]
    inner: Int[Array, "inner"]
    second: Int[Array, "inner"]


class Fitted(eqx.Module):
    """Coordinates for a tree: those of one mesh.

    Attributes:
        corners: The nine coordinates of each triangle, in the order of the leaves.
        boxes: Lower corner and negated upper corner of each node's box.
    """

    corners: Float[Array, "faces 9"]
    boxes: Float[Array, "nodes 6"]


def fit(tree: Links, mesh: Mesh) -> Fitted:
    """Corners in the tree's order and the boxes around them, for any positions of the vertices."""
    corners = corners_in_order(mesh.vertices[mesh.faces[tree.order]])
    bounds = jnp.concatenate([jnp.min(corners, axis=1), jnp.min(-corners, axis=1)], axis=1)
    start, end = tree.first[:-1], tree.first[1:]
    places = [jnp.clip(start + k, 0, jnp.maximum(end - 1, 0)) for k in range(LEAF_SIZE)]
    boxes = bounds[places[0]]
    for place in places[1:]:
        boxes = jnp.minimum(boxes, bounds[place])

    def join(i: Array, boxes: Array) -> Array:
        node, zero = tree.inner[i], jnp.int32(0)
        one, two = (lax.dynamic_slice(boxes, (child, zero), (1, 6)) for child in (node + 1, tree.second[i]))
        return lax.dynamic_update_slice(boxes, jnp.minimum(one, two), (node, zero))

    # A few triangles are one leaf; a loop over no rows cannot even be traced.
    if tree.inner.shape[0]:
        boxes = lax.fori_loop(jnp.int32(0), jnp.int32(tree.inner.shape[0]), join, boxes)
    return Fitted(corners.reshape(-1, 9), boxes)


def search(tree: Links, fitted: Fitted, rays: Rays, any_hit: bool) -> Int[Array, "rays"]:
    """Triangle of every ray of a list: the nearest, of equals the lowest; or, for `any_hit`, whichever is met first
    between the ray's ends, no nearer to them than its own rounding.

    An iteration of each loop touches less than a kilobyte; XLA compiles such loops to plain machine code, about fifty
    times faster than if it dispatched every step. So all that changes travels in one small array of integers, numbers
    of a ray are read from its row where they are used, and triangles and boxes are read number by number.
    """
    table = _table(fitted, rays)
    num_nodes, zero = fitted.boxes.shape[0], jnp.int32(0)

    def one(ray: Array, out: Array) -> Array:
        # Ray, node, bits of the nearest depth, face.
        bits = _bits(_read(table, ray, T_MAX))
        state = jnp.concatenate([jnp.stack([ray, zero]), bits, jnp.full(1, NONE, jnp.int32)])

        def wanted(state: Array) -> Array:
            going = state[1] < num_nodes
            return going & (state[-1] == NONE) if any_hit else going

        state = lax.while_loop(wanted, lambda state: _visit(tree, fitted, table, state, any_hit), state)
        return lax.dynamic_update_slice(out, state[-1:], (ray,))

    num_rays = rays.t_max.shape[0]
    found = lax.fori_loop(zero, jnp.int32(num_rays), one, jnp.zeros(num_rays, jnp.int32))
    return jnp.where(found == NONE, MISS, found)


def _table(fitted: Fitted, rays: Rays) -> Float[Array, "rays 18"]:
    """All that the loops need of each ray, in one row."""
    direction = rays.directions
    smallest = jnp.asarray(jnp.finfo(direction.dtype).tiny ** 0.5, direction.dtype)
    # Along a ray parallel to a face of a box the inverse must be huge, not infinite: 0 × ∞ is no number.
    steep = jnp.where(jnp.abs(direction) < smallest, jnp.where(direction < 0, -smallest, smallest), direction)
    # Largest offset of the ray's origin from the scene's box: what corners' roundings are a share of.
    reach = jnp.maximum(jnp.abs(fitted.boxes[0, :3] - rays.origins), jnp.abs(-fitted.boxes[0, 3:] - rays.origins))
    widen = WIDEN_ROUNDINGS * jnp.finfo(direction.dtype).eps * jnp.sum(reach, axis=-1)
    columns = [rays.origins, *orthonormal_frame(direction), direction, 1 / steep]
    limits = jnp.stack([rays.t_min, rays.t_max, widen], axis=-1)
    return jnp.concatenate([*columns, limits], axis=1)


def _visit(tree: Links, fitted: Fitted, table: Array, state: Int[Array, "n"], any_hit: bool) -> Int[Array, "n"]:
    """Test one node's box; where it is hit, its triangles; and step to the next node."""
    ray, node = state[0], state[1]
    nearest = _number(state[2:-1], table)
    near, far = _read(table, ray, T_MIN), nearest
    octant = jnp.int32(0)
    for axis in range(3):
        origin, widen = _read(table, ray, ORIGIN + axis), _read(table, ray, WIDEN)
        inverse = _read(table, ray, INVERSE + axis)
        # Slab test: where the ray enters and leaves the widened box along each axis.
        low = (_read(fitted.boxes, node, axis) - origin - widen) * inverse
        high = (-_read(fitted.boxes, node, 3 + axis) - origin + widen) * inverse
        near, far = jnp.maximum(near, jnp.minimum(low, high)), jnp.minimum(far, jnp.maximum(low, high))
        octant = octant + jnp.where(inverse < 0, 1 << axis, 0).astype(jnp.int32)
    hit = (near <= far).astype(jnp.int32)
    start = lax.dynamic_slice(tree.first, (node,), (1,)).reshape(())
    end = lax.dynamic_slice(tree.first, (node + 1,), (1,)).reshape(())

    following = lax.dynamic_slice(tree.links, (octant, node, hit), (1, 1, 1)).reshape(1)
    # The ray travels with the state of the inner loop too, or XLA would read its numbers once before the loop, into a
    # dozen places: more bytes than there may be.
    state = jnp.concatenate([state[:1], following, state[2:]])
    return lax.fori_loop(
        start,
        start + hit * (end - start),
        lambda place, state: _test(tree, fitted, table, place, state, any_hit),
        state,
    )


def _test(tree: Links, fitted: Fitted, table: Array, place: Array, state: Array, any_hit: bool) -> Array:
    """The state after one more triangle."""
    ray, nearest, face = state[0], _number(state[2:-1], table), state[-1]
    x, y, z = [], [], []
    for corner in range(3):
        # Corners in the ray's own frame, its origin at 0: there the ray is the z axis, as the edge rule wants it.
        offset = [_read(fitted.corners, place, 3 * corner + a) - _read(table, ray, ORIGIN + a) for a in range(3)]
        for coordinate, unit in ((x, ACROSS), (y, UPWARD), (z, DIRECTION)):
            axes = [_read(table, ray, unit + a) for a in range(3)]
            coordinate.append(offset[0] * axes[0] + offset[1] * axes[1] + offset[2] * axes[2])
    inside, depth = edge_test(tuple(x), tuple(y), tuple(z))
    index = lax.dynamic_slice(tree.order, (place,), (1,)).reshape(())
    if any_hit:
        # A blocker within rounding of either end of the ray blocks nothing.
        doubt = depth_rounding(tuple(x), tuple(y), tuple(z))
        better = inside & (depth - doubt > _read(table, ray, T_MIN)) & (depth + doubt < _read(table, ray, T_MAX))
    else:
        # Equal depths go to the lowest face, in whatever order the tree is walked.
        nearer = (depth < nearest) | ((depth == nearest) & (index < face))
        better = inside & (depth >= _read(table, ray, T_MIN)) & nearer
    return jnp.where(better, jnp.concatenate([state[:2], _bits(depth), index.reshape(1)]), state)


def _read(table: Array, row: Array, column: int) -> Array:
    return lax.dynamic_slice(table, (row, jnp.int32(column)), (1, 1)).reshape(())


def _bits(value: Float[Array, ""]) -> Int[Array, "words"]:
    """The bits of a number as one or two 32-bit words."""
    return lax.bitcast_convert_type(value, jnp.int32).reshape(-1)


def _number(bits: Int[Array, "words"], like: Array) -> Float[Array, ""]:
    """The number of these bits."""
    words = bits if like.dtype.itemsize == 8 else bits.reshape(())
    return lax.bitcast_convert_type(words, like.dtype)
