"""Rays and hits, the edge rule every caster keeps, and the one differentiable ray–triangle intersection."""

from collections.abc import Sequence
from typing import Annotated, Any, NamedTuple, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import lax

from shadowjax._checked import Checked, checked
from shadowjax._checks import NOT_NEGATIVE, require, require_finite, require_value
from shadowjax._numerics import far_away, norm, normalize
from shadowjax._types import Array, ArrayLike, Bool, Float, Int, Points, as_float_array
from shadowjax.geometry.mesh import Mesh

_Tree = TypeVar("_Tree")
MISS = -1
# What rounding leaves unknown of a triangle's depth on a ray, in roundings of all its corners' offsets from the ray's
# start: an offset is off by half a rounding, its three products and their sums by three more.
TRIANGLE_ROUNDINGS = 6.0

# Distances along a ray.
NotNegative = Annotated[ArrayLike, NOT_NEGATIVE]


class Rays(Checked):
    """Half-lines, each with the part of it that counts.

    Attributes:
        origins: Start points, world units.
        directions: Unit directions.
        t_min: A hit counts from this distance on, world units.
        t_max: A hit counts up to this distance; a miss reports it as its depth. Finite.
    """

    origins: Points
    directions: Points
    t_min: Float[Array, "*#points"]
    t_max: Float[Array, "*#points"]

    @classmethod
    def create(
        cls, origins: ArrayLike, directions: ArrayLike, t_min: NotNegative = 0.0, t_max: NotNegative | None = None
    ) -> "Rays":
        """Rays from `origins` along `directions` (any nonzero length; normalised here).

        Raises:
            ValueError: If shapes do not fit, a direction is zero, or a number is negative or not finite.
        """
        origins = require_finite(as_float_array(origins), "ray origins")
        directions = require_finite(as_float_array(directions, origins.dtype), "ray directions")
        require(
            origins.shape[-1:] == (3,) and directions.shape[-1:] == (3,),
            f"ray origins and directions must end in an axis of 3; got {origins.shape} and {directions.shape}",
        )
        directions = require_value(directions, norm(directions) > 0, "a ray direction must not be the zero vector")
        require(
            all(
                1 in pair or pair[0] == pair[1]
                for pair in zip(origins.shape[::-1], directions.shape[::-1], strict=False)
            ),
            f"ray origins and directions must broadcast; got {origins.shape} and {directions.shape}",
        )
        shape = jnp.broadcast_shapes(origins.shape, directions.shape)
        t_max = far_away(origins.dtype) if t_max is None else t_max
        return cls(
            jnp.broadcast_to(origins, shape),
            jnp.broadcast_to(normalize(directions), shape),
            as_float_array(t_min, origins.dtype),
            require_finite(as_float_array(t_max, origins.dtype), "t_max"),
        )

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the batch of rays."""
        return self.origins.shape[:-1]

    def at(self, distance: Float[Array, "*points"]) -> Points:
        """World points at a distance along each ray."""
        return self.origins + distance[..., None] * self.directions

    def flattened(self) -> "Rays":
        """The same rays as one list, with explicit limits."""
        shape = self.shape
        return Rays(
            self.origins.reshape(-1, 3),
            self.directions.reshape(-1, 3),
            jnp.broadcast_to(self.t_min, shape).reshape(-1),
            jnp.broadcast_to(self.t_max, shape).reshape(-1),
        )


class Hit(Checked):
    """Where rays meet a mesh.

    Attributes:
        depth: Distance along the unit ray, world units; the ray's finite `t_max` for a miss.
        face: Triangle index; -1 for a miss.
        barycentrics: Weights of the triangle's corners, sum 1; zeros for a miss.
    """

    depth: Float[Array, "*points"]
    face: Int[Array, "*points"]
    barycentrics: Float[Array, "*points 3"]

    @property
    def is_hit(self) -> Bool[Array, "*points"]:
        """True where the ray meets a triangle."""
        return self.face >= 0


class EdgeTest(NamedTuple):
    """Outcome of the edge rule for a ray and a triangle, before distance limits are looked at."""

    inside: Bool[Array, "..."]
    depth: Float[Array, "..."]


@checked
def orthonormal_frame(direction: Points) -> tuple[Points, Points]:
    """Two unit vectors that complete each unit direction to an orthonormal frame.

    Branch-free and free of cancellation (Duff et al. 2017, "Building an Orthonormal Basis, Revisited").
    """
    x, y, z = direction[..., 0], direction[..., 1], direction[..., 2]
    sign = jnp.where(z >= 0, jnp.ones_like(z), -jnp.ones_like(z))
    a = -1.0 / (sign + z)
    b = x * y * a
    first = jnp.stack([1.0 + sign * x * x * a, sign * b, -sign * x], axis=-1)
    second = jnp.stack([b, sign + y * y * a, -y], axis=-1)
    return first, second


@checked
def edge_test(x: tuple[Array, Array, Array], y: tuple[Array, Array, Array], z: tuple[Array, Array, Array]) -> EdgeTest:
    """The edge rule: does the ray at the origin of the (x, y) plane pass through a triangle, and how far along z?

    Each edge compares two *rounded* products instead of the sign of their difference. Rounding is monotonic, so the
    verdict is right or a tie; two triangles that share an edge compare the same two numbers; and a fused multiply-add
    cannot turn a tie into two misses. Ties count as inside: a closed mesh leaks no ray. Three ties at once mean a
    triangle seen exactly edge-on or without area (two equal corners always end here): it is missed. A triangle that is
    edge-on to a rounding may tie along the whole *line* of its edges; next to its bounding rectangle it is missed too,
    by comparisons that are exact, so nothing leaks.

    Args:
        x: First coordinate of the three corners, relative to the ray.
        y: Second coordinate of the three corners, relative to the ray.
        z: Distance of the three corners along the ray.

    Returns:
        Whether the ray passes through, and its distance, between those of the corners (meaningful only inside).
    """
    weights, left, right = [], [], []
    for i, j in ((1, 2), (2, 0), (0, 1)):
        one, two = x[i] * y[j], y[i] * x[j]
        left.append(one >= two)
        right.append(one <= two)
        weights.append(one - two)
    all_left, all_right = left[0] & left[1] & left[2], right[0] & right[1] & right[2]
    determinant = weights[0] + weights[1] + weights[2]
    scaled = weights[0] * z[0] + weights[1] * z[1] + weights[2] * z[2]
    depth = scaled / jnp.where(determinant == 0, jnp.ones_like(determinant), determinant)
    # Rounded weights of a triangle seen almost edge-on may lie outside it; its depth may not.
    low, high = _least(*z), _greatest(*z)
    spans = (_least(*x) <= 0) & (_greatest(*x) >= 0) & (_least(*y) <= 0) & (_greatest(*y) >= 0)
    return EdgeTest((all_left ^ all_right) & spans, jnp.clip(depth, low, high))


def _in_order(corners: Sequence[tuple[Array, ...]]) -> list[tuple[Array, ...]]:
    """The three corners of each triangle in an order that their positions alone decide.

    Sums of three numbers round by their order. Copies of a triangle, whatever corner they begin with and whichever way
    they turn, are equally near only if their corners are taken in one order: casters sort them before they search.

    Args:
        corners: Three corners, each x, y, z and whatever goes with them.
    """
    sides = list(corners)
    for i, j in ((0, 1), (1, 2), (0, 1)):
        one, two = sides[i], sides[j]
        later = (one[1] > two[1]) | ((one[1] == two[1]) & (one[2] > two[2]))
        later = (one[0] > two[0]) | ((one[0] == two[0]) & later)
        sides[i] = tuple(jnp.where(later, b, a) for a, b in zip(one, two, strict=True))
        sides[j] = tuple(jnp.where(later, a, b) for a, b in zip(one, two, strict=True))
    return sides


@checked
def corners_in_order(triangles: Float[Array, "faces 3 3"]) -> Float[Array, "faces 3 3"]:
    """The corners of each triangle in the order of their positions."""
    corners = [tuple(triangles[:, k, axis] for axis in range(3)) for k in range(3)]
    return jnp.stack([jnp.stack(corner, axis=-1) for corner in _in_order(corners)], axis=1)


@checked
def faces_in_order(mesh: Mesh) -> Int[Array, "faces 3"]:
    """Corners of each triangle of a mesh in the order of their positions, as indices."""
    indices = [mesh.faces[:, k] for k in range(3)]
    corners = [(*(mesh.vertices[:, axis][index] for axis in range(3)), index) for index in indices]
    return jnp.stack([corner[-1] for corner in _in_order(corners)], axis=-1)


@checked
def depth_rounding(
    x: tuple[Array, Array, Array], y: tuple[Array, Array, Array], z: tuple[Array, Array, Array]
) -> Float[Array, "..."]:
    """How far rounding may put a triangle's depth on the ray at the origin of the (x, y) plane.

    Corners are off by roundings of their offsets. Sideways these move the depth by the triangle's slope, but no farther
    than the corners' depths differ, since it lies between them. Arguments as of `edge_test`.
    """
    first, second = ([part[k] - part[0] for part in (x, y, z)] for k in (1, 2))
    across = [first[i] * second[j] - first[j] * second[i] for i, j in ((1, 2), (2, 0), (0, 1))]
    along = jnp.abs(across[2])
    slope = (jnp.abs(across[0]) + jnp.abs(across[1])) / jnp.where(along == 0, jnp.ones_like(along), along)
    # The sum of offsets, which is cheaper than the longest.
    reach = sum(jnp.abs(p) for part in (x, y, z) for p in part)
    rounding = TRIANGLE_ROUNDINGS * jnp.finfo(along.dtype).eps * reach
    sideways, span = rounding * slope, _greatest(*z) - _least(*z)
    return rounding + jnp.where(sideways < span, sideways, span)


def _least(a: Array, b: Array, c: Array) -> Array:
    return jnp.minimum(jnp.minimum(a, b), c)


def _greatest(a: Array, b: Array, c: Array) -> Array:
    return jnp.maximum(jnp.maximum(a, b), c)


@checked
@eqx.filter_jit
def intersect(mesh: Mesh, rays: Rays, face: Int[Array, "*points"]) -> Hit:
    """Depth and barycentrics of rays on triangles that a caster has already chosen; every gradient comes from here.

    Differentiable, forward and reverse, in vertices, origins and directions at fixed `face`. It does not see a
    silhouette move: which triangle is hit is a discrete choice.

    Args:
        mesh: The mesh that was cast.
        rays: Rays, of the shape of `face`.
        face: Triangle hit by each ray, -1 for a miss.

    Returns:
        The hit: depth as distance along the ray, world units; `t_max` and zero gradient for a miss.
    """
    require(face.shape == rays.shape, f"face must have the shape of rays, {rays.shape}; got {face.shape}")
    missed = face < 0
    # Numbers apart, not as vectors of three: gathers, their transposes and what follows are several times faster.
    corners = _corners(mesh, jnp.where(missed, 0, face))
    origin, direction = (_components(part) for part in (rays.origins, rays.directions))
    # One copy in memory: otherwise every use of a corner gathers it again.
    depth, barycentrics = _meeting(*lax.optimization_barrier((corners, origin, direction)))
    t_max = jnp.broadcast_to(rays.t_max, depth.shape)
    return Hit(
        jnp.where(missed, t_max, depth),
        face,
        jnp.stack([jnp.where(missed, jnp.zeros_like(share), share) for share in barycentrics], axis=-1),
    )


@jax.custom_jvp
def _meeting(corners: list[list[Array]], origin: list[Array], direction: list[Array]) -> tuple[Array, list[Array]]:
    """Depth at which rays meet the planes of their triangles, within that of the corners, and barycentrics."""
    depth, shares, _ = _solved(corners, origin, direction)
    return depth, shares


@_meeting.defjvp
def _meeting_jvp(primals: tuple, tangents: tuple) -> tuple[tuple[Array, list[Array]], tuple[Array, list[Array]]]:
    """The derivative in closed form: the moving point of the triangle, carried along the ray back onto the plane."""
    depth, shares, along = _solved(*primals)
    corners, origin, direction = tangents
    moved = []
    for axis in range(3):
        point = shares[0] * corners[0][axis] + shares[1] * corners[1][axis] + shares[2] * corners[2][axis]
        moved.append(point - origin[axis] - depth * direction[axis])
    change = _inner(along, moved)
    slide = [change * part - step for part, step in zip(primals[2], moved, strict=True)]
    second, third = (_inner(slope, slide) for slope in _slopes(primals[0]))
    return (depth, shares), (change, [-second - third, second, third])


def _solved(
    corners: list[list[Array]], origin: list[Array], direction: list[Array]
) -> tuple[Array, list[Array], list[Array]]:
    """Depth, barycentrics, and the slope of depth as the triangle moves: in 64 bits, rounded once to the dtype.

    Where a ray grazes a triangle, each rounding of a position counts by 1 / cos: in 32 bits, by a hundred-thousandth of
    the scene. In 64 bits, products of numbers of 32 are exact.
    """
    dtype = origin[0].dtype
    with jax.enable_x64(True):
        (a, b, c), origin, direction = _in_64_bits((corners, origin, direction))
        one, two, offset = (
            [end - begin for end, begin in zip(*pair, strict=True)] for pair in ((b, a), (c, a), (a, origin))
        )
        normal = _cross(one, two)
        fall = _inner(normal, direction)
        unit, zero = jnp.ones_like(fall), jnp.zeros_like(fall)
        # A triangle without area, or seen edge-on, divides by 1.
        meets = fall != 0
        inverse = jnp.where(meets, 1 / jnp.where(meets, fall, unit), zero)
        around = _cross(offset, direction)
        shares = _inner(two, around) * inverse, -_inner(one, around) * inverse
        shares = 1 - shares[0] - shares[1], *shares
        first, length = _inner(offset, direction), _inner(direction, direction)
        second, third = first + _inner(one, direction), first + _inner(two, direction)
        depth = jnp.where(meets, _inner(normal, offset) * inverse, (first + second + third) / 3)
        # The ray may pass outside a triangle by a rounding: depth and weights stay those of a point of the triangle.
        ahead = depth * length
        least, most = _least(first, second, third), _greatest(first, second, third)
        depth = depth + (jnp.minimum(jnp.maximum(ahead, least), most) - ahead)
        found = depth, shares, [part * inverse for part in normal]
        depth, shares, along = jax.tree.map(lambda x: lax.convert_element_type(x, dtype), found)
    shares = [jnp.maximum(share, 0.0) for share in shares]
    total = 1 / (shares[0] + shares[1] + shares[2])
    return depth, [jnp.where(meets, share * total, 1.0 / 3.0) for share in shares], along


def _slopes(corners: list[list[Array]]) -> list[list[Array]]:
    """How the second and the third barycentric of a triangle change as a point moves in its plane."""
    dtype = corners[0][0].dtype
    with jax.enable_x64(True):
        a, b, c = _in_64_bits(corners)
        one, two = ([end - begin for end, begin in zip(corner, a, strict=True)] for corner in (b, c))
        normal = _cross(one, two)
        squared = _inner(normal, normal)
        solid, unit = squared > 0, jnp.ones_like(squared)
        inverse = jnp.where(solid, 1 / jnp.where(solid, squared, unit), jnp.zeros_like(squared))
        slopes = [[part * inverse for part in _cross(*pair)] for pair in ((two, normal), (normal, one))]
        return jax.tree.map(lambda x: lax.convert_element_type(x, dtype), slopes)


def _in_64_bits(numbers: _Tree) -> _Tree:
    return jax.tree.map(lambda x: lax.convert_element_type(x, jnp.float64), numbers)


@checked
def surface_points(mesh: Mesh, rays: Rays, hit: Hit) -> Points:
    """Where rays meet a mesh, as nearly on the triangles' planes as numbers can tell; the rays' starts for a miss.

    A distance along a ray is rounded by the ray's length, and puts a point off its surface by as much. From next to the
    triangle, a step along the ray to its plane takes that away. The step is a rounding, so it has no derivative.
    """
    missed = hit.face < 0
    points = rays.at(jnp.where(missed, jnp.zeros_like(hit.depth), hit.depth))
    travelled = hit.depth + sum(jnp.abs(part) for part in _components(rays.origins))
    return _stepped(points, *jax.lax.stop_gradient((mesh, rays.directions, hit.face, travelled)))


@jax.custom_jvp
def _stepped(
    points: Points,
    mesh: Mesh,
    directions: Points,
    face: Int[Array, "*points"],
    travelled: Float[Array, "*points"],
) -> Points:
    """Points moved along directions to the planes of their triangles; those without a triangle stay.

    In two halves of a loop, which reads points from memory: XLA would compute them once for the step and anew, in
    another order of operations, for the sum; at the end of a long ray these are two points.
    """
    shape, num = points.shape, face.size
    spare = num % 2

    def halves(array: Array, *rest: int) -> Array:
        flat = array.reshape(num, *rest)
        return jnp.pad(flat, [(0, spare)] + [(0, 0)] * len(rest), mode="edge").reshape(2, -1, *rest)

    first, second, third = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    normals = jnp.stack(_cross(_components(second - first), _components(third - first)), axis=-1)

    def half(part: tuple[Array, ...]) -> Array:
        points, directions, face, travelled = part
        index = jnp.maximum(face, 0)
        normal, corner = (
            jnp.stack([x.at[index].get(mode="promise_in_bounds") for x in _components(table)], axis=-1)
            for table in (normals, first)
        )
        step = _step_to_plane(normal, corner, points, directions, travelled)
        return points + jnp.where(face < 0, jnp.zeros_like(step), step)[:, None] * directions

    given = halves(points, 3), halves(directions, 3), halves(face), halves(travelled)
    return jax.lax.map(half, given).reshape(-1, 3)[:num].reshape(shape)


@_stepped.defjvp
def _stepped_jvp(primals: tuple[Any, ...], tangents: tuple[Any, ...]) -> tuple[Points, Points]:
    return _stepped(*primals), tangents[0]


def _step_to_plane(
    normals: Points, corners: Points, points: Points, directions: Points, travelled: Float[Array, "*points"]
) -> Float[Array, "*points"]:
    """Distance along directions from points to planes; 0 where it is less known than the points are.

    Points are off by roundings of `travelled`, steps by those of the three products that they are sums of: none for a
    wide floor that lies level, however far its corner is.
    """
    normal, corner, at = _components(normals), _components(corners), _components(points)
    products = [n * (p - q) for n, p, q in zip(normal, corner, at, strict=True)]
    ahead = _inner(normal, _components(directions))
    doubt = jnp.abs(products[0]) + jnp.abs(products[1]) + jnp.abs(products[2])
    largest = jnp.abs(normal[0]) + jnp.abs(normal[1]) + jnp.abs(normal[2])
    known = (ahead != 0) & (doubt <= travelled * largest)
    total = products[0] + products[1] + products[2]
    return jnp.where(known, total / jnp.where(known, ahead, jnp.ones_like(ahead)), jnp.zeros_like(total))


def _components(vectors: Points) -> list[Array]:
    return [vectors[..., axis] for axis in range(3)]


def _inner(a: list[Array], b: list[Array]) -> Array:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _cross(a: list[Array], b: list[Array]) -> list[Array]:
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def _corners(mesh: Mesh, face: Int[Array, "*points"]) -> list[list[Array]]:
    """The corners of the triangle of each ray, as components; indices are known to be in range."""

    def take(values: Array, index: Array) -> Array:
        return values.at[index].get(mode="promise_in_bounds")

    indices = [take(mesh.faces[:, k], face) for k in range(3)]
    return [[take(part, index) for part in _components(mesh.vertices)] for index in indices]
