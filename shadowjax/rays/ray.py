"""Rays and hits, the edge rule every caster keeps, and the one differentiable ray–triangle intersection."""

from typing import Annotated, Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp

from shadowjax._checked import Checked, checked
from shadowjax._checks import NOT_NEGATIVE, require, require_finite, require_value
from shadowjax._numerics import norm, normalize
from shadowjax._types import Array, ArrayLike, Bool, Float, Int, Points, as_float_array
from shadowjax.geometry.mesh import Mesh

MISS = -1

# Distances along a ray.
NotNegative = Annotated[ArrayLike, NOT_NEGATIVE]


@checked
def far_away(dtype: Any) -> float:
    """The finite stand-in for infinity: its square is still finite, so moments of depth stay finite too."""
    return float(jnp.finfo(dtype).max) ** 0.5


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
    edge-on to a rounding may tie along the whole *line* of its edges; beside its bounding rectangle it is missed too,
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
    offsets = [[part - start for part, start in zip(corner, origin, strict=True)] for corner in corners]
    # Step along the ray to beside the triangle first: edge functions of far triangles cancel badly in float32. The
    # step shifts both sides of the equation, so it carries no gradient.
    step = _inner(offsets[0], direction)
    step = jnp.where(missed, jnp.zeros_like(step), jax.lax.stop_gradient(step))
    # The offsets first: far from the world's origin they keep digits that a position along the ray would lose.
    a, b, c = ([part - step * d for part, d in zip(offset, direction, strict=True)] for offset in offsets)
    # Beside every triangle the products are of its own size; a degenerate one, or a miss, divides by 1.
    weights = [_inner(direction, _cross(p, q)) for p, q in ((b, c), (c, a), (a, b))]
    total = weights[0] + weights[1] + weights[2]
    # Rounding can put a weight just outside the triangle; clamping keeps the depth between the corners' depths.
    sign = jnp.where(total < 0, -jnp.ones_like(total), jnp.ones_like(total))
    weights = [jnp.maximum(weight * sign, 0.0) for weight in weights]
    total = weights[0] + weights[1] + weights[2]
    some = total > 0
    inverse = jnp.where(some, 1 / jnp.where(some, total, jnp.ones_like(total)), jnp.zeros_like(total))
    barycentrics = [jnp.where(some, weight * inverse, 1.0 / 3.0) for weight in weights]
    depth = step
    for share, corner in zip(barycentrics, (a, b, c), strict=True):
        depth = depth + share * _inner(corner, direction)
    t_max = jnp.broadcast_to(rays.t_max, depth.shape)
    return Hit(
        jnp.where(missed, t_max, depth),
        face,
        jnp.stack([jnp.where(missed, jnp.zeros_like(share), share) for share in barycentrics], axis=-1),
    )


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
