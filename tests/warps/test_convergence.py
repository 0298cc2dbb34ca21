"""Shadows through every warp: wrong only along the edge, by the area that the size of its texels predicts."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from shapes import above, lights, plate_over_plane

from shadowjax import BruteForceCaster, Hard, build_shadow_map
from shadowjax.filters.base import Lookup
from shadowjax.rays.ray_grid import RayGrid
from shadowjax.warps.fit import NEAR_DISTANCES, corners, light_frustum, padded, view_axis
from shadowjax.warps.logarithmic import LogarithmicWarp, log_distance
from shadowjax.warps.perspective import PerspectiveWarp

MESH, CAMERA, LIGHT = plate_over_plane(), above(), lights()["directional"]
ALONG, ACROSS = 400, 32
RESOLUTIONS = (192, 384, 768)
REACH = 40.0  # half width of the strips next to the edges over 1/resolution, metres


def edge_points():
    """Places along the four edges of the plate's shadow on the floor, its outward normals, and distances in [−1, 1]."""
    shift = np.asarray(LIGHT.direction)[[0, 2]] / -float(LIGHT.direction[1])
    place = (np.arange(ALONG) + 0.5) / ALONG * 2 - 1
    away = (np.arange(ACROSS) + 0.5) / ACROSS * 2 - 1
    place, away = (x.reshape(-1) for x in np.meshgrid(place, away, indexing="ij"))
    spots, normals = [], []
    for axis in (0, 1):
        for sign in (-1.0, 1.0):
            spot = np.empty((len(place), 2))
            spot[:, axis], spot[:, 1 - axis] = sign, place
            normal = np.zeros(2)
            normal[axis] = sign
            spots.append(spot + shift)
            normals.append(np.broadcast_to(normal, spot.shape))
    return jnp.asarray(np.concatenate(spots)), jnp.asarray(np.concatenate(normals)), jnp.asarray(np.tile(away, 4))


SPOTS, NORMALS, AWAY = edge_points()
SPACE = LIGHT.space(CAMERA.forward, *MESH.bounds())


@eqx.filter_jit
def warps():
    """Every rule's warp, stacked, and the logarithmic one, for the plate under the directional light."""
    frustum = light_frustum(CAMERA, LIGHT.direction, CAMERA.near, CAMERA.far)
    points, axis = padded(SPACE.project(corners(CAMERA, CAMERA.near, CAMERA.far))[0]), view_axis(SPACE, CAMERA)
    distances = jnp.stack([rule(frustum) for rule in NEAR_DISTANCES.values()])
    perspective = jax.vmap(lambda q: PerspectiveWarp.fit(points, 1 / q, axis))(distances)
    logarithmic = jax.vmap(lambda c: LogarithmicWarp.fit(points, 1 / c, axis))(log_distance(frustum)[None])
    return perspective, logarithmic


@eqx.filter_jit
def wrong_areas(warp, resolution):
    """Area next to the edges that a map of one warp gets wrong, measured and predicted.

    A point reads the texel whose centre lies within half a texel of it, evenly spread, so it is wrong at a distance
    from the edge with the chance that this offset reaches over it: for texels that span A ≥ B across the edge the wrong
    area is A/4 + B²/(12A) for each length of edge.
    """
    reach = REACH / resolution
    spots, zero = SPOTS + reach * AWAY[:, None] * NORMALS, jnp.zeros(len(SPOTS))
    points = jnp.stack([spots[:, 0], zero, spots[:, 1]], axis=-1)
    grid = RayGrid(SPACE, warp, SPACE.farthest(*MESH.bounds()), resolution, resolution)
    shadow_map = build_shadow_map(BruteForceCaster(), MESH, grid)
    position, depth = grid.locate(points)
    visibility = Hard().visibility(shadow_map.depth[None], Lookup(position, depth, zero + 0.3, zero + 1))
    exact = (AWAY > 0).astype(visibility.dtype)
    measured = jnp.mean(jnp.abs(visibility - exact)) * 2 * reach
    carried = [step - LIGHT.direction * (step[:, 1:2] / LIGHT.direction[1]) for step in grid.cell_vectors(points)]
    spans = jnp.stack([jnp.abs(jnp.sum(step[:, ::2] * NORMALS, axis=-1)) for step in carried])
    wide, narrow = jnp.max(spans, axis=0), jnp.min(spans, axis=0)
    return measured, jnp.mean(wide / 4 + narrow**2 / (12 * wide)), jnp.max(jnp.sum(spans, axis=0)) / 2


@pytest.fixture(scope="module")
def areas():
    return [
        [jax.lax.map(lambda warp, size=size: wrong_areas(warp, size), kind) for kind in warps()] for size in RESOLUTIONS
    ]


@pytest.mark.parametrize("name", [*NEAR_DISTANCES, "logarithmic"])
def test_wrong_area_is_what_the_texels_predict_and_halves_with_them(areas, name):
    kind, index = (1, 0) if name == "logarithmic" else (0, list(NEAR_DISTANCES).index(name))
    measured, predicted, reach = (np.asarray([size[kind][i][index] for size in areas]) for i in range(3))
    assert (reach < REACH / np.asarray(RESOLUTIONS)).all()  # nothing wrong lies next to the strips
    # phases of the staircase and the four corners add what is of second order in the texels
    assert (np.abs(measured / predicted - 1) < 3 * reach).all()
    np.testing.assert_allclose(predicted[:-1] / predicted[1:], 2, rtol=2e-3)
