"""Shimmer: how many points of static surfaces change their shadow when only the camera moves."""

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp

from shadowjax._checked import checked
from shadowjax._types import Array, Bool, Float, Points
from shadowjax.geometry.camera import Camera
from shadowjax.geometry.light import Light
from shadowjax.geometry.mesh import Mesh
from shadowjax.techniques.base import Shadows, Technique


class Shimmer(NamedTuple):
    """What moves although nothing in the scene does.

    Attributes:
        share: Share of the compared points whose visibility changes by more than the tolerance.
        mean: Mean |change| of visibility over the compared points.
        changed: Which points change, for a picture.
        compared: Points that lie in both views.
    """

    share: Float[Array, ""]
    mean: Float[Array, ""]
    changed: Bool[Array, "*points"]
    compared: Bool[Array, "*points"]


@checked
def in_view(camera: Camera, points: Points) -> Bool[Array, "*points"]:
    """Whether points lie inside a camera's frustum; what hides them does not matter."""
    view = camera.to_view(points)
    depth = view[..., 2]
    inside = jnp.all(jnp.abs(view[..., :2]) <= camera.half_size * depth[..., None], axis=-1)
    return inside & (depth >= camera.near) & (depth <= camera.far)


@eqx.filter_jit
def _compare(
    before: Shadows, after: Shadows, points: Points, normals: Points, compared: Bool[Array, "*points"], tolerance: float
) -> Shimmer:
    change = jnp.abs(after.visibility(points, normals) - before.visibility(points, normals))
    changed = (change > tolerance) & compared
    weight = compared.astype(points.dtype)
    count = jnp.maximum(jnp.sum(weight), 1)
    share = jnp.sum(changed.astype(points.dtype)) / count
    return Shimmer(share, jnp.sum(change * weight) / count, changed, compared)


@checked
def shimmer(
    technique: Technique,
    mesh: Mesh,
    light: Light,
    before: Camera,
    after: Camera,
    points: Points,
    normals: Points,
    tolerance: float = 1e-3,
) -> Shimmer:
    """Build a technique for two cameras and compare what both answer at the *same* world points.

    Only the maps differ, so a perfect technique, or one whose texels keep their places, gives exactly 0.

    Args:
        technique: Any technique.
        mesh: The scene; it does not move.
        light: The light; it does not move.
        before: One view.
        after: The next view.
        points: World points, usually the surface that the first view sees.
        normals: Their unit normals.
        tolerance: Change of visibility that does not count.
    """
    compared = in_view(before, points) & in_view(after, points)
    built = [technique.build(mesh, light, camera) for camera in (before, after)]
    return _compare(built[0], built[1], points, normals, compared, tolerance)


__all__ = ["Shimmer", "in_view", "shimmer"]
