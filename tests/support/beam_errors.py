"""Perspective errors of a technique's real maps, from the beams of texels and pixels: no formula of the theory."""

import itertools

import jax.numpy as jnp
import numpy as np
from shapes import plate_over_plane

from shadowjax import Camera, DirectionalLight, camera_grid

SIZE = 1024  # texels of a map, and pixels of the image, along a side


def view_of(near, far, phi, gamma):
    """A camera and a light at this angle to it, a little turned; its planes lie outside the given ones."""
    turn = np.array([[np.cos(0.4), 0, np.sin(0.4)], [0, 1, 0], [-np.sin(0.4), 0, np.cos(0.4)]])
    place = np.array([0.3, 5.0, 0.2])
    camera = Camera.look_at(place, place + turn @ [0, 0, 1], phi_y=phi, near=near / 2, far=2 * far, dtype=jnp.float64)
    # up is the side from which the light comes, so that the top edge is the one that is worst
    return camera, DirectionalLight.create(turn @ [0, -np.sin(gamma), np.cos(gamma)], dtype=jnp.float64)


def _width(ends):
    return np.linalg.norm(np.asarray(ends[1] - ends[0]), axis=-1)


def _texel(grid, points, axis):
    """Distance between the rays half a texel before and behind, across the light."""
    half = 0.5 * jnp.eye(2)[axis]
    at = grid.locate(points)[0]
    rays = [grid.rays_at((at + side * half) / grid.resolution) for side in (-1, 1)]
    return _width([r.origins - jnp.sum(r.origins * r.directions, -1, keepdims=True) * r.directions for r in rays])


def _pixel(image, camera, points, axis):
    """Distance between the rays half a pixel before and behind, in the plane of the point's depth."""
    half = 0.5 * jnp.eye(2)[axis]
    at, depth = image.locate(points)[0], (points - camera.position) @ camera.forward
    rays = [image.rays_at((at + side * half) / image.resolution) for side in (-1, 1)]
    return _width([r.origins + (depth / (r.directions @ camera.forward))[:, None] * r.directions for r in rays])


def slice_errors(technique, view, cuts, section="axis"):
    """(M_x, M_z) of every slice: the largest over its part of the view axis, or of the vertical section."""
    camera, light = view_of(*view)
    mesh = plate_over_plane()
    grids = technique.partition.fit(mesh, light, camera).grids(mesh, light, camera, SIZE)
    image = camera_grid(camera, SIZE, SIZE)
    up = camera.rotation[1]
    heights = [0.0] if section == "axis" else np.linspace(-1, 1, 9)
    errors = []
    for grid, (low, high) in zip(grids, itertools.pairwise(np.asarray(cuts)), strict=True):
        depth = np.geomspace(low, high, 33)
        points = jnp.concatenate(
            [camera.position + depth[:, None] * (camera.forward + share * np.tan(view[2]) * up) for share in heights]
        )
        errors.append([(_texel(grid, points, a) / _pixel(image, camera, points, a)).max() for a in (0, 1)])
    return np.array(errors)
