"""Errors over seen pixels: the closed form is the measured mean, nothing beats the optimum, gradients are implicit."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from shapes import above, lights, plate_over_plane

from shadowjax import BruteForceCaster, DirectionalLight, Scene, camera_grid, trace_surface
from shadowjax.evaluate.measure import aliasing_map
from shadowjax.optimize import near_distance, view_of
from shadowjax.optimize.viewed.near_distance_and_splits import (
    mean_error,
    near_distance_for_view,
    seen_pixels,
    splits_for_view,
)
from shadowjax.optimize.viewed.seen_pixels import chart_between, moments, total_error
from shadowjax.rays.ray_grid import RayGrid
from shadowjax.warps.fit import corners, view_axis
from shadowjax.warps.perspective import PerspectiveWarp

MESH, CAMERA = plate_over_plane(), above()
LIGHT = lights()["directional"]  # leans to the side: the camera is rolled about the light's plane
SIZE = 40


@pytest.fixture(scope="module")
def surface():
    return trace_surface(MESH, CAMERA, SIZE, SIZE, BruteForceCaster())


@pytest.fixture(scope="module")
def pixels(surface):
    return seen_pixels(surface, CAMERA, LIGHT)


@pytest.mark.parametrize("projection", [False, True])
def test_predicted_mean_is_the_mean_of_the_measured_jacobians(surface, projection):
    """Pixels per texel by differentiating both projections of the real map, against four moments."""
    pixels = seen_pixels(surface, CAMERA, LIGHT, projection)
    space = LIGHT.space(CAMERA.forward, *MESH.bounds())
    body = space.project(corners(CAMERA, pixels.frustum.near, pixels.frustum.far))[0]
    valid = np.asarray(pixels.weight > 0)
    assert valid.sum() > 300
    for distance in (1.0, 7.0, 1e6):
        warp = PerspectiveWarp.fit(body, 1 / distance, view_axis(space, CAMERA))
        grid = RayGrid(space, warp, space.farthest(*MESH.bounds()), SIZE, SIZE)
        found = aliasing_map(camera_grid(CAMERA, SIZE, SIZE), grid, surface.points, surface.normals)
        measured = np.asarray(found.total if projection else found.perspective).reshape(-1)
        mean = measured[valid].sum() / np.asarray(pixels.weight).sum()
        np.testing.assert_allclose(mean_error(pixels, jnp.asarray(distance)), mean, rtol=1e-9)


def applied(found, surface, pixels, cuts):
    """Mean pixels per texel of the technique that a solution makes, by differentiating its maps' real projections."""
    partition = found.technique(SIZE).partition.fit(MESH, LIGHT, CAMERA)
    image = camera_grid(CAMERA, SIZE, SIZE)
    depth = np.asarray((surface.points - CAMERA.position) @ CAMERA.forward).reshape(-1)
    index = np.clip(np.searchsorted(np.asarray(cuts), depth, "right") - 1, 0, len(cuts) - 2)
    each = [
        np.asarray(aliasing_map(image, grid, surface.points, surface.normals).perspective).reshape(-1)
        for grid in partition.grids(MESH, LIGHT, CAMERA, SIZE)
    ]
    valid, weight = np.asarray(pixels.weight > 0), np.asarray(pixels.weight)
    return np.stack(each)[index, np.arange(len(index))][valid].sum() / weight.sum()


@pytest.mark.parametrize("objective", ["mean", "function"])
def test_the_applied_near_distance_has_the_error_that_is_told(surface, pixels, objective):
    asked = "mean" if objective == "mean" else lambda q, pixels: mean_error(pixels, q)
    found = near_distance_for_view(pixels, asked)
    view = pixels.frustum
    np.testing.assert_allclose(applied(found, surface, pixels, [view.near, view.far]), found.objective_value, rtol=1e-3)
    assert found.converged
    assert found.baselines["uniform"] > found.objective_value


def test_the_applied_splits_have_the_error_that_is_told(surface, pixels):
    found = splits_for_view(pixels, 2, 16)
    assert found.gain > 1
    measured = applied(found, surface, pixels, found.value.cuts)
    np.testing.assert_allclose(measured, found.objective_value, rtol=1e-3)


def test_a_scene_s_view_is_told_in_four_numbers():
    view = view_of(Scene(MESH, CAMERA, (LIGHT,), "plate", "A plate."))
    depth = np.asarray(CAMERA.to_view(MESH.vertices)[:, 2])
    np.testing.assert_allclose([view.near, view.far], [depth.min(), depth.max()], rtol=1e-12)
    cosine = abs(float(LIGHT.direction @ CAMERA.forward))
    np.testing.assert_allclose(view.gamma, np.arccos(cosine), rtol=1e-9)
    assert near_distance(*view).converged
    with pytest.raises(ValueError, match="needs a directional light; got SpotLight"):
        view_of(Scene(MESH, CAMERA, (lights()["spot"],), "plate", "A plate."))


def test_nothing_on_a_grid_beats_the_best_near_distance(pixels):
    grid = jnp.exp(jnp.linspace(-6, 12, 4001))
    found = near_distance_for_view(pixels)
    errors = jax.vmap(lambda q: mean_error(pixels, q))(grid)
    assert float(found.objective_value) <= float(jnp.min(errors)) * (1 + 1e-12)
    np.testing.assert_allclose(mean_error(pixels, found.value), found.objective_value, rtol=1e-9)
    # the light leans: the optimum is a kink, where another corner begins to bound the map's width
    assert found.certificate.slope_below < -1e-3
    assert found.certificate.slope_above > 1e-3
    assert found.gain >= 1
    worst = near_distance_for_view(pixels, "worst")
    chart = chart_between(pixels, pixels.frustum.near, pixels.frustum.far)
    stretch = 1 + jnp.clip(pixels.rise - chart.lowest, 0, None) / grid[:, None]
    tried = jnp.max(pixels.weight / pixels.depth * stretch**2, axis=-1) * chart.extent / (1 + chart.extent / grid)
    assert float(worst.objective_value) <= float(jnp.min(tried / (2 * CAMERA.half_size[1]))) * (1 + 1e-9)
    with pytest.raises(ValueError, match="objective"):
        near_distance_for_view(pixels, "median")


def test_best_near_distance_carries_the_implicit_derivative(surface):
    """Weigh the nearer pixels more: the derivative of n' against central differences of the whole search."""
    upright = DirectionalLight.create(0.6 * np.asarray(CAMERA.forward) - 0.8 * np.asarray(CAMERA.up))
    pixels = seen_pixels(surface, CAMERA, upright)
    smooth = near_distance_for_view(pixels)
    assert abs(float(smooth.certificate.slope_below)) < 1e-6
    assert abs(float(smooth.certificate.slope_above)) < 1e-6
    assert not smooth.certificate.uniform

    @jax.jit
    def best(power):
        weight = pixels.weight * (pixels.depth / 8) ** power
        changed = eqx.tree_at(lambda p: p.weight, pixels, weight)
        return jnp.log(near_distance_for_view(changed).value)

    at, step = jnp.asarray(0.3), 1e-4
    expected = (best(at + step) - best(at - step)) / (2 * step)
    np.testing.assert_allclose(jax.jvp(best, (at,), (jnp.ones(()),))[1], expected, rtol=1e-5)


def test_planes_are_the_best_of_all_on_the_grid(pixels):
    """k = 2: every cut tried one by one; more maps and a finer grid never cost more."""
    found = splits_for_view(pixels, 2, 16)
    view = pixels.frustum
    edges = np.exp(np.linspace(np.log(float(view.near)), np.log(float(view.far)), 17))
    grid = np.exp(np.linspace(-7, 14, 3000))
    raw, depth = np.asarray(moments(pixels)), np.asarray(pixels.depth)
    costs = []
    for cut in edges[1:-1]:
        total = 0.0
        for low, high, inside in ((edges[0], cut, depth < cut), (cut, edges[-1], depth >= cut)):
            chart = chart_between(pixels, jnp.asarray(low), jnp.asarray(high))
            sums = jnp.asarray(raw[:, inside].sum(axis=1))
            total += float(np.min(jax.vmap(lambda q, s=sums, c=chart: total_error(s, c, 1 / q))(jnp.asarray(grid))))
        costs.append(total / float(jnp.sum(pixels.weight)))
    assert found.objective_value <= min(costs) * (1 + 1e-9)
    np.testing.assert_allclose(found.objective_value, min(costs), rtol=1e-3)  # the trial n' lie apart
    np.testing.assert_allclose(found.value.cuts[1], edges[1 + int(np.argmin(costs))], rtol=1e-9)
    assert found.certificate.coarser >= -1e-12
    single = splits_for_view(pixels, 1, 16)
    np.testing.assert_allclose(single.objective_value, near_distance_for_view(pixels).objective_value, rtol=1e-6)
    assert found.objective_value < single.objective_value
    assert (jnp.diff(found.value.cuts) > 0).all()
    for bad, message in (((0,), "at least 1"), ((2, 3), "num_bins"), ((2, 5), "even")):
        with pytest.raises(ValueError, match=message):
            splits_for_view(pixels, *bad)


def test_a_view_of_nothing_and_a_wrong_light(surface):
    away = DirectionalLight.create((0.1, 1.0, 0.05))  # lights the floor from below: no valid receiver
    empty = seen_pixels(surface, CAMERA, away)
    for tree in (near_distance_for_view(empty), splits_for_view(empty, 2, 16)):
        assert all(np.isfinite(x).all() for x in jax.tree.leaves(tree))
    with pytest.raises(ValueError, match="directional light; got SpotLight"):
        seen_pixels(surface, CAMERA, lights()["spot"])
