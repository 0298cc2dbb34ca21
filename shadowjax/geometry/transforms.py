"""Rigid and projective building blocks: frames, rotations, look-at, homogeneous transforms of points."""

import jax.numpy as jnp

from shadowjax._numerics import dot, norm, normalize
from shadowjax._types import Array, Float, Points, Scalar, Vector3

Matrix4 = Float[Array, "4 4"]
Frame = Float[Array, "3 3"]


def translation(offset: Vector3) -> Matrix4:
    """4×4 matrix that adds `offset` (world units) to a point."""
    return jnp.eye(4, dtype=offset.dtype).at[:3, 3].set(offset)


def scaling(factors: Vector3) -> Matrix4:
    """4×4 matrix that scales each axis by its factor (dimensionless, nonzero)."""
    return jnp.diag(jnp.concatenate([factors, jnp.ones(1, factors.dtype)]))


def rotation(axis: Vector3, angle: Scalar) -> Matrix4:
    """4×4 matrix of the right-handed rotation by `angle` radians about `axis` (any nonzero length)."""
    x, y, z = normalize(axis)
    zero = jnp.zeros_like(x)
    skew = jnp.stack([jnp.stack([zero, -z, y]), jnp.stack([z, zero, -x]), jnp.stack([-y, x, zero])])
    turned = jnp.eye(3, dtype=axis.dtype) + jnp.sin(angle) * skew + (1 - jnp.cos(angle)) * (skew @ skew)
    return jnp.eye(4, dtype=axis.dtype).at[:3, :3].set(turned)


def transform_points(matrix: Matrix4, points: Points) -> Points:
    """Apply an affine 4×4 matrix to points (column-vector convention)."""
    return points @ matrix[:3, :3].T + matrix[:3, 3]


def any_perpendicular(direction: Vector3) -> Vector3:
    """A unit vector perpendicular to `direction`; smooth except where the smallest component changes."""
    smallest = jnp.argmin(jnp.abs(direction))
    axis = jnp.zeros_like(direction).at[smallest].set(1.0)
    return normalize(jnp.cross(direction, axis))


def view_frame(forward: Vector3, up: Vector3) -> Frame:
    """Rows right, up, forward of a right-handed viewer (right = forward × up).

    `up` may be parallel to `forward`: then any perpendicular serves.
    """
    forward = normalize(forward)
    sideways = jnp.cross(forward, normalize(up))
    parallel = norm(sideways) < 1e-6
    right = normalize(jnp.where(parallel, any_perpendicular(forward), sideways))
    return jnp.stack([right, jnp.cross(right, forward), forward])


def light_frame(to_light: Vector3, view: Vector3) -> Frame:
    """Rows x, y, z of the light space of the warping chapter.

    y points to the light (against the light direction), z lies in the plane of y and the view direction and points the
    way the view points, x = y × z completes the right-handed frame. Where view and light are parallel, z is any
    perpendicular of y: the angle γ is 0 and the chapter's warp has no direction to act in.

    Source: warping, section on the light space (γ between light and view directions).
    """
    y = normalize(to_light)
    along = view - dot(view, y) * y
    parallel = norm(along) < 1e-6 * norm(view)
    z = normalize(jnp.where(parallel, any_perpendicular(y), along))
    return jnp.stack([jnp.cross(y, z), y, z])
