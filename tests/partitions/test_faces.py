"""Faces: the right sides for every γ, each point inside its own map, n' that nothing beats, shadows that converge."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from shapes import above, lights, plate_over_plane

from shadowjax import Camera, DirectionalLight, Exact, ShadowMapping
from shadowjax.evaluate.shimmer import in_view
from shadowjax.partitions.faces import FacePartition, face_near_distance, faces_that_apply
from shadowjax.partitions.registry import PARTITIONS, make_partition

MESH = plate_over_plane()
UPRIGHT = Camera.look_at((0.0, 0.0, 0.0), (0.0, 0.0, -1.0), phi_y=np.pi / 6, near=1.0, far=60.0, aspect=1.3)
GAMMAS = np.deg2rad([0, 1e-4, 10, 29.9, 30.1, 45, 75, 89, 89.9, 89.999, 90])


def light_at(gamma, roll=0.0, side=1.0):
    """Travels along the view (against it for side −1) turned by γ, downwards or, with roll, sideways."""
    turned = np.cos(roll) * np.asarray([0, -1.0, 0]) + np.sin(roll) * np.asarray([1.0, 0, 0])
    return DirectionalLight.create(side * np.cos(gamma) * np.asarray([0, 0, -1.0]) + np.sin(gamma) * turned)


def points_in_the_view(camera, count=4000):
    rng = np.random.default_rng(0)
    depth = float(camera.near) * float(camera.far / camera.near) ** rng.uniform(0, 1, (count, 1))
    depth[:200], depth[200:400] = camera.near, camera.far
    spread = rng.uniform(-1, 1, (count, 2))
    spread[::7] = np.sign(spread[::7])  # the frustum's four edges too
    plane = np.concatenate([spread * np.asarray(camera.half_size), np.ones((count, 1))], axis=1)
    return camera.position + jnp.asarray(depth * plane) @ camera.rotation


@eqx.filter_jit
def places(camera, light, points):
    """Region of every point, its (s, t) there, and which faces apply."""
    faces = FacePartition(tight=False)
    grids = faces.grids(MESH, light, camera, 8)
    region = faces.select(grids, camera, points)
    square = jnp.stack([grid.locate(points)[0] / 8 for grid in grids])
    return region, jnp.take_along_axis(square, region[None, :, None], axis=0)[0], faces_that_apply(camera, light)


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize("roll", [0.0, 0.6])
def test_every_visible_point_lies_in_the_map_of_its_face(roll, side):
    points = points_in_the_view(UPRIGHT)
    for gamma in GAMMAS:
        region, square, applies = places(UPRIGHT, light_at(gamma, roll, side), points)
        assert applies[region].all()
        assert square.min() >= 0, gamma
        # a face seen almost edge-on presses all its depths against t = 1, where one division rounds
        assert square.max() <= 1 + 2 * np.finfo(float).eps, gamma
        assert np.isfinite(square).all()


def test_four_faces_below_phi_three_above_one_overhead():
    count = [int(faces_that_apply(UPRIGHT, light_at(gamma)).sum()) for gamma in np.deg2rad([0, 20, 29.9, 30.1, 60, 90])]
    assert count == [4, 4, 4, 3, 3, 1]
    assert faces_that_apply(UPRIGHT, light_at(1.0)).tolist() == [False, True, True, True]  # light from above: no bottom
    assert faces_that_apply(UPRIGHT, light_at(1.0, side=-1.0)).tolist() == [True, True, False, True]


def test_near_distance_of_a_face_is_the_least_worst_on_a_grid():
    rng = np.random.default_rng(1)
    near, ratio, share = 10 ** rng.uniform(-1, 1, 200), 10 ** rng.uniform(0.05, 4, 200), rng.uniform(0, 1, 200)
    length, far = near * ratio, near * ratio
    start = near / far * length
    low = share * start
    found = face_near_distance(*(jnp.asarray(x) for x in (low, start, length, near, far)))

    def worst(q):
        extent = length - low
        ends = (q + start - low) ** 2 / near, (q + extent) ** 2 / far
        return np.maximum(*ends) * extent / (q * (q + extent))

    grid = np.exp(np.linspace(-14, 14, 3001))[:, None] * (length - low)
    assert (worst(np.asarray(found)) <= worst(grid).min(axis=0) * (1 + 1e-9)).all()
    # with the light overhead a face is the whole frustum and n' is Wimmer's
    one, hundred = jnp.ones(()), jnp.full((), 100.0)
    np.testing.assert_allclose(face_near_distance(one, one, hundred, one, hundred), 11, rtol=1e-12)


read = eqx.filter_jit(lambda shadows, points, normals: shadows.visibility(points, normals))


@pytest.mark.parametrize("gamma_deg", [0, 25, 50, 90])
def test_shadows_are_the_exact_ones_but_for_a_texel_at_their_edges(gamma_deg):
    """Under a light along the view, across it, and between."""
    camera, gamma = above(), np.deg2rad(gamma_deg)
    spots = jnp.stack(jnp.meshgrid(*[jnp.linspace(-3.0, 3.0, 70)] * 2), axis=-1).reshape(-1, 2)
    points = jnp.stack([spots[:, 0], jnp.zeros(len(spots)), spots[:, 1]], axis=-1)
    normals = jnp.broadcast_to(jnp.asarray([0.0, 1.0, 0.0]), points.shape)
    keep = in_view(camera, points)
    light = DirectionalLight.create(np.cos(gamma) * np.asarray(camera.forward) - np.sin(gamma) * np.asarray(camera.up))
    exact = read(Exact().build(MESH, light, camera), points, normals)
    built = ShadowMapping(resolution=256, partition=FacePartition()).build(MESH, light, camera)
    value = read(built, points, normals)
    wrong = jnp.abs(value - exact) > 0
    assert 0.02 < float(jnp.mean(exact, where=keep)) < 0.98
    assert float(jnp.mean(wrong, where=keep)) < 0.015
    # the shadow's edge on the floor, and how far a texel of the point's own map reaches there
    shift = np.asarray(light.direction)[[0, 2]] / -float(light.direction[1])
    away = np.abs(np.max(np.abs(np.asarray(spots) - shift), axis=-1) - 1)
    region = built.partition.select(built.grids, camera, points)
    carried = []
    for grid in built.grids:
        steps = [step - light.direction * (step[:, 1:2] / light.direction[1]) for step in grid.cell_vectors(points)]
        carried.append(sum(np.max(np.abs(np.asarray(step)), axis=-1) for step in steps) / 2)
    texel = np.take_along_axis(np.stack(carried), np.asarray(region)[None], axis=0)[0]
    # texels grow by a few percent from one to the next
    beside = (away <= 1.1 * texel)[np.asarray(wrong & keep)]
    # the slope bias is exact for texels of one size: at the very corner of a growing one the floor may shade itself
    assert np.sum(~beside) <= 1e-3 * np.sum(np.asarray(keep))


def test_registry_and_bad_light():
    assert isinstance(make_partition("faces"), FacePartition)
    assert {"single", "z4", "faces"} <= set(PARTITIONS)
    with pytest.raises(ValueError, match="'single'"):
        make_partition("cubes")
    for kind in ("spot", "point"):
        with pytest.raises(ValueError, match="directional light; got"):
            FacePartition().grids(MESH, lights()[kind], above(), 8)


def test_gradient_of_every_warp_by_the_light_is_finite():
    @jax.jit
    @jax.grad
    def slope(direction):
        grids = FacePartition(tight=False).grids(MESH, DirectionalLight(direction, jnp.ones(3)), UPRIGHT, 8)
        return sum(jnp.sum(grid.plane_map.inverse(jnp.full((1, 2), 0.3))) for grid in grids)

    for gamma in (0.0, 0.3, np.pi / 2):
        assert np.isfinite(slope(light_at(gamma).direction)).all()
