"""Rigid and projective building blocks: frames, rotations, look-at, homogeneous transforms of points."""

import jax.numpy as jnp
from jax import lax

from shadowjax._checked import checked
from shadowjax._numerics import dot, norm, normalize
from shadowjax._types import Array, Float, Points, Scalar, Vector3

Matrix4 = Float[Array, "4 4"]
Frame = Float[Array, "3 3"]

# Directions at less than this many roundings of their dtype count as parallel: unit vectors are known no better.
PARALLEL_ROUNDINGS = 4.0


@checked
def translation(offset: Vector3) -> Matrix4:
    """4×4 matrix that adds `offset` (world units) to a point."""
    return jnp.eye(4, dtype=offset.dtype).at[:3, 3].set(offset)


@checked
def scaling(factors: Vector3) -> Matrix4:
    """4×4 matrix that scales each axis by its factor (dimensionless, nonzero)."""
    return jnp.diag(jnp.concatenate([factors, jnp.ones(1, factors.dtype)]))


@checked
def rotation(axis: Vector3, angle: Scalar) -> Matrix4:
    """4×4 matrix of the right-handed rotation by `angle` radians about `axis` (any nonzero length)."""
    x, y, z = normalize(axis)
    zero = jnp.zeros_like(x)
    # Rodrigues: R = 1 + sin α·K + (1 − cos α)·K², with K·v = axis × v.
    skew = jnp.stack([jnp.stack([zero, -z, y]), jnp.stack([z, zero, -x]), jnp.stack([-y, x, zero])])
    turned = jnp.eye(3, dtype=axis.dtype) + jnp.sin(angle) * skew + (1 - jnp.cos(angle)) * (skew @ skew)
    return jnp.eye(4, dtype=axis.dtype).at[:3, :3].set(turned)


@checked
def transform_points(matrix: Matrix4, points: Points) -> Points:
    """Apply an affine 4×4 matrix to points (column-vector convention)."""
    return points @ matrix[:3, :3].T + matrix[:3, 3]


@checked
def unit(vector: Vector3) -> Vector3:
    """Unit vector of any nonzero one, however short or long: its square may leave the range of the dtype."""
    size = lax.stop_gradient(jnp.max(jnp.abs(vector)))
    return normalize(vector / jnp.where(size > 0, size, jnp.ones_like(size)))


@checked
def any_perpendicular(direction: Vector3) -> Vector3:
    """A unit vector perpendicular to `direction`; smooth except where the smallest component changes."""
    direction = unit(direction)
    smallest = jnp.argmin(jnp.abs(direction))
    axis = jnp.zeros_like(direction).at[smallest].set(1.0)
    return normalize(jnp.cross(direction, axis))


@checked
def perpendicular_part(direction: Vector3, axis: Vector3) -> tuple[Vector3, Scalar]:
    """Unit vector of the part of a unit `direction` that is perpendicular to a unit `axis`, and sin γ of their angle.

    For nearly parallel directions everything cancels in direction − (direction·axis) axis. Their difference is exact
    there, since it is between numbers of about one size; what it holds of the axis is taken away twice, so that the
    result is perpendicular to rounding at any angle. Where the directions are parallel to rounding, the part is any
    perpendicular of the axis and the sine 0.
    """
    # The end of the axis on the direction's side: their difference is then at most √2 long and exact when short.
    towards = jnp.where(dot(direction, axis) < 0, -axis, axis)
    part = direction - towards
    part = part - dot(part, axis) * axis
    sine = norm(part)
    parallel = sine < PARALLEL_ROUNDINGS * jnp.finfo(axis.dtype).eps
    first = normalize(jnp.where(parallel, any_perpendicular(axis), part))
    return normalize(first - dot(first, axis) * axis), jnp.where(parallel, jnp.zeros_like(sine), sine)


@checked
def angle_between_lines(direction: Vector3, axis: Vector3) -> Scalar:
    """Angle in [0, π/2] between the lines of two unit vectors, to rounding at every angle.

    Source: W. Kahan, "How futile are mindless assessments of roundoff", section on angles between vectors.
    """
    towards = jnp.where(dot(direction, axis) < 0, -axis, axis)
    # tan(α/2) = |a − b|/|a + b|: neither an arc cosine near 1 nor an arc sine near π/2.
    angle = 2 * jnp.arctan2(norm(direction - towards), norm(direction + towards))
    return jnp.where(angle > jnp.pi / 2, jnp.pi / 2, angle)


@checked
def view_frame(forward: Vector3, up: Vector3) -> Frame:
    """Rows right, up, forward of a right-handed viewer (right = forward × up), orthonormal to rounding.

    `up` may be parallel to `forward`, to rounding: then any perpendicular serves.
    """
    forward = unit(forward)
    upward, _ = perpendicular_part(unit(up), forward)
    right = normalize(jnp.cross(forward, upward))
    return jnp.stack([right, upward, forward])


@checked
def light_frame(to_light: Vector3, view: Vector3) -> Frame:
    """Rows x, y, z of the light space of the warping chapter, orthonormal to rounding for every pair of directions.

    y points to the light (against the light direction), z lies in the plane of y and the view direction and points the
    way the view points, x = y × z completes the right-handed frame. Where view and light are parallel to rounding, z is
    any perpendicular of y: the angle γ is 0 and the chapter's warp has no direction to act in.

    Source: warping, section on the light space (γ between light and view directions).
    """
    y = unit(to_light)
    z, _ = perpendicular_part(unit(view), y)
    return jnp.stack([normalize(jnp.cross(y, z)), y, z])
