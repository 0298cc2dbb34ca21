"""What a view can see of a light's shadows: its frustum cut to the scene and the light's cone, as points of a plane."""

import dataclasses
import itertools
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from shadowjax._checked import checked
from shadowjax._numerics import dot, norm, normalize
from shadowjax._types import Array, Bool, Float, Points
from shadowjax.geometry.camera import Camera
from shadowjax.geometry.light import Light
from shadowjax.geometry.light_space import LightSpace, OctahedralSpace
from shadowjax.geometry.mesh import Mesh
from shadowjax.rays.ray_grid import RayGrid

# Planes that meet in an angle of less have no corner worth a float32: what is lost is as thin.
LEAST_DETERMINANT = 1e-5
# A corner counts if it lies this share of the frustum's length outside at most: more than rounding moves it.
SLACK = 1e-5
# Steps in which the depth that a view sees is rounded up, for each factor of two.
STEPS = 8


@checked
def receiver_corners(
    space: LightSpace, light: Light, mesh: Mesh, camera: Camera
) -> tuple[Points, Bool[Array, "corners"]]:
    """Corners of the convex body in which the camera can see a shadow of this light.

    The body is the camera's frustum between its planes, cut to the box around the mesh and, for a spot light, to the
    pyramid around its cone. Everything that can receive a visible shadow lies in it. Casters need not: they stand on
    the same rays of the light.

    Args:
        space: The light's rays.
        light: The light they belong to.
        mesh: Everything that casts or receives.
        camera: The view, or a slice of one: its near and far planes count.

    Returns:
        World points, and which of them are corners; none if nothing of the scene is in the view and the light.
    """
    normals, offsets = [], []
    length = camera.far * jnp.sqrt(1 + jnp.sum(camera.half_size**2))
    forward, half = camera.forward, camera.half_size
    zero = jnp.zeros_like(camera.near)
    # inward normals n and offsets d of half-spaces n·p ≥ d, with the camera at the origin
    # Sides of the frustum: |p·axis| ≤ reach·p·forward.
    for axis, reach in ((camera.rotation[0], half[0]), (camera.rotation[1], half[1])):
        normals += [normalize(reach * forward + axis), normalize(reach * forward - axis)]
        offsets += [zero, zero]
    normals += [forward, -forward]
    offsets += [camera.near, -camera.far]
    # The box's six half-spaces relative to the camera.
    lower, upper = (corner - camera.position for corner in mesh.bounds())
    for axis in range(3):
        unit = jnp.zeros_like(forward).at[axis].set(1.0)
        normals += [unit, -unit]
        offsets += [lower[axis], -upper[axis]]
    if (tangent := light.cone) is not None:
        right, up, ahead = space.rows
        # The pyramid around the cone: |p·axis| ≤ tan·p·ahead about the light, whose place gives the offset.
        for axis in (right, -right, up, -up):
            normals.append(normalize(tangent * ahead + axis))
            offsets.append(dot(normals[-1], space.source - camera.position))
    found, inside = _corners(jnp.stack(normals), jnp.stack(offsets), SLACK * length)
    found = found + camera.position
    if light.cone is not None:
        # The pyramid's apex is the light itself, which is at no place of the plane but the one that rounding gives it.
        # Every ray through the body leaves it elsewhere, so the other corners bound its places.
        inside = inside & (norm(found - space.source) > SLACK * length)
    return found, inside & space.in_front(found)


def _corners(
    normals: Float[Array, "planes 3"], offsets: Float[Array, "planes"], slack: Float[Array, ""]
) -> tuple[Float[Array, "corners 3"], Bool[Array, "corners"]]:
    """Points in which three planes meet, and which of them lie in all half-spaces n·p ≥ d."""
    triples = np.array(list(itertools.combinations(range(normals.shape[0]), 3)))
    a, b, c = (normals[triples[:, i]] for i in range(3))
    d, e, f = (offsets[triples[:, i], None] for i in range(3))
    cross = jnp.cross(b, c)
    determinant = dot(a, cross)
    meets = jnp.abs(determinant) > LEAST_DETERMINANT
    whole = jnp.where(meets, determinant, jnp.ones_like(determinant))[:, None]
    # Cramer's rule for a·p = d, b·p = e, c·p = f.
    points = (d * cross + e * jnp.cross(c, a) + f * jnp.cross(a, b)) / whole
    # (corners × planes) signed distances: a corner of the body lies inside all half-spaces.
    inside = jnp.min(points @ normals.T - offsets, axis=1) >= -slack
    return points, meets & inside


class Outline(NamedTuple):
    """Receivers in a view, as a light sees them.

    Attributes:
        plane: Places on the light's plane whose convex hull holds every receiver.
        corners: The world points there; only if there is any receiver.
        some: Whether there is any. Without, places of the frustum's corners stand in, as far as rays reach them, or
            the whole cone.
    """

    plane: Float[Array, "corners 2"]
    corners: Points
    some: Bool[Array, ""]


@checked
def with_seen_depth(grid: RayGrid, light: Light, mesh: Mesh, camera: Camera) -> RayGrid:
    """The grid of a lamp's map that knows within which depth the view sees; any other grid as it is.

    Rays of a lamp may run to the horizon although the view sees a room. The depth is the grid's `far` divided by a
    power of 2^(1/8), so that it holds still while the camera moves but for jumps of 9 %, and has no derivative by it.

    Args:
        grid: The light rays of a map.
        light: The light they belong to.
        mesh: Everything that casts or receives.
        camera: The view.
    """
    if grid.space.is_parallel:
        return grid
    # Of a lamp without a cone, all receivers count for each of its maps, which cut them.
    space = OctahedralSpace(grid.space.source) if light.cone is None else grid.space
    corners, valid = receiver_corners(space, light, mesh, camera)
    reach = jnp.max(jnp.where(valid, norm(corners - grid.space.source), 0.0))
    ratio = jax.lax.stop_gradient(jnp.where(reach > 0, grid.far / jnp.where(reach > 0, reach, 1.0), 1.0))
    octaves = jnp.floor(STEPS * jnp.log2(jnp.maximum(ratio, 1.0))) / STEPS
    return dataclasses.replace(grid, seen=grid.far * jnp.exp2(-octaves))


@checked
def receiver_outline(space: LightSpace, light: Light, mesh: Mesh, camera: Camera) -> Outline:
    """What a map for a view has to hold.

    Args:
        space: The rays of a directional or a spot light, whose planes keep lines straight.
        light: The light.
        mesh: Everything that casts or receives.
        camera: The view, or a slice of one.
    """
    corners, valid = receiver_corners(space, light, mesh, camera)
    some = jnp.any(valid)
    # what is no corner repeats one, so that extremes and their derivatives are those of the corners
    corners = jnp.where(valid[:, None], corners, corners[jnp.argmax(valid)])
    instead = _without_receivers(space, light, camera)
    instead = jnp.concatenate([instead, jnp.broadcast_to(instead[:1], (len(corners) - len(instead), 2))])
    return Outline(jnp.where(some, space.project(corners)[0], instead), corners, some)


def _without_receivers(space: LightSpace, light: Light, camera: Camera) -> Float[Array, "8 2"]:
    """An area of the plane where nothing is to be seen: the frustum's, cut to the cone, or all of the cone."""
    frustum = camera.frustum_corners()
    plane, _ = space.project(frustum)
    if light.cone is None:
        return plane
    signs = jnp.asarray([[-1, -1], [1, -1], [1, 1], [-1, 1]] * 2, plane.dtype)
    cone = light.cone * signs
    cut = jnp.clip(plane, cone[0], cone[2])
    has_area = jnp.all(jnp.max(cut, axis=0) > jnp.min(cut, axis=0))
    return jnp.where(jnp.all(space.in_front(frustum)) & has_area, cut, cone)


__all__ = ["Outline", "receiver_corners", "receiver_outline", "with_seen_depth"]
