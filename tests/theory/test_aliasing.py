"""The warping theory three ways: closed form, derivative of the real matrix map, and beams cut by surfaces."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from shapes import above, lights, plate_over_plane
from views import random_frusta

from shadowjax.evaluate import measure
from shadowjax.partitions.cascades import logarithmic_splits
from shadowjax.rays.ray_grid import RayGrid, camera_grid
from shadowjax.theory.aliasing import error as aliasing_error
from shadowjax.theory.aliasing import near_distances, optimal, overhead, storage
from shadowjax.theory.aliasing.light_frustum import LightFrustum
from shadowjax.warps.fit import PerspectiveFit
from shadowjax.warps.logarithmic import log_distance, log_error_z

# One number of views, so that tests share compiled operations.
COUNT = 1200


def random_points(frusta, seed=1):
    """n', depth and y/z of a point of each frustum."""
    rng = np.random.default_rng(seed)
    count, dtype = len(frusta.near), frusta.near.dtype
    distance = frusta.extent * jnp.asarray(10 ** rng.uniform(-3, 4, count), dtype=dtype)
    depth = frusta.near * (frusta.far / frusta.near) ** jnp.asarray(rng.uniform(0, 1, count), dtype=dtype)
    return distance, depth, frusta.tan_y * jnp.asarray(rng.uniform(-1, 1, count), dtype=dtype)


@jax.jit
@jax.vmap
def errors_of_the_map(frustum, distance, depth, slope):
    """m_x and m_z by differentiating homogeneous transform and divide across the light."""
    matrix, axes = measure.warp_matrix(frustum, distance), measure.light_axes(frustum.gamma)
    point = jnp.stack([0 * depth, slope * depth, depth])
    rate = jax.jacfwd(lambda move: measure.warp_point(matrix, point + move @ axes))(jnp.zeros_like(point))
    return 1 / (rate[0, 0] * 2 * depth * frustum.tan_x), 1 / (rate[1, 2] * 2 * depth * frustum.tan_y)


def test_closed_form_is_the_derivative_of_the_map_for_1200_views():
    frusta = random_frusta(COUNT)
    distance, depth, slope = random_points(frusta)
    across, along = errors_of_the_map(frusta, distance, depth, slope)
    np.testing.assert_allclose(aliasing_error.error_x(frusta, distance, depth, slope * depth), across, rtol=1e-10)
    np.testing.assert_allclose(aliasing_error.error_z(frusta, distance, depth, slope * depth), along, rtol=1e-10)


cut = jax.jit(jax.vmap(measure.beams))


def test_beams_agree_to_the_stated_second_order():
    """m of cut beams is eq. 12 times (1 − h² …)/(1 − (W z'/(2 res n' f'))²), both corrections known exactly.

    Views with f/n from 1.01 to 10⁶, γ at its corner cases, any n', depth and angle, 64 to 4096 rows of image and map.
    """
    frusta = random_frusta(COUNT)
    distance, depth, slope = random_points(frusta)
    distance = jnp.maximum(distance, 0.05 * frusta.extent)
    rng = np.random.default_rng(8)
    angle = jnp.asarray(rng.uniform(0.3, np.pi - 0.3, COUNT))
    rows = [jnp.asarray(np.round(2 ** rng.uniform(6, 12, COUNT))) for _ in range(2)]
    found = cut(frusta, distance, depth, slope, angle, *rows)
    view = jnp.arctan(slope)
    ratio = rows[0] / rows[1]
    perspective = aliasing_error.error_z(frusta, distance, depth, slope * depth, ratio) / jnp.cos(view)
    m12 = overhead.aliasing(
        perspective, jnp.ones(COUNT), jnp.abs(jnp.sin(angle - view)), jnp.abs(jnp.sin(angle + frusta.gamma))
    )
    high = distance + frusta.offset(depth, slope * depth)
    texel = 1 - (frusta.extent * high / (2 * rows[1] * distance * (distance + frusta.extent))) ** 2
    pixel = 1 - (frusta.tan_y / rows[0] * jnp.cos(angle) / (jnp.sin(angle) - slope * jnp.cos(angle))) ** 2
    clear = (jnp.abs(jnp.sin(angle - view)) > 0.2) & (jnp.abs(jnp.sin(angle + frusta.gamma)) > 1e-3)
    keep = lambda x: np.asarray(x)[np.asarray(clear)]  # noqa: E731
    assert keep(frusta.far / frusta.near).max() > 3e5
    assert len(keep(angle)) > 500
    # the two sides of a texel differ by 1/rows of positions as large as f + n' + W: their difference loses that much
    lost = 5e-16 * rows[1] * (frusta.far + distance + frusta.extent) / (depth * jnp.minimum(frusta.tan_y, 1))
    error = jnp.abs(found.aliasing / (m12 * pixel / texel) - 1)
    assert (keep(error) < 1e-10 + keep(lost)).all()
    assert (keep(lost) < 1e-6).mean() > 0.9
    small = jnp.minimum(rows[0], rows[1])
    assert np.max(keep(jnp.abs(found.aliasing / m12 - 1) * small**2)) < 150


def test_largest_errors_are_at_the_near_or_far_plane():
    frusta = random_frusta(COUNT, largest=4)
    distance, _, _ = random_points(frusta)
    share = jnp.linspace(0, 1, 201)[:, None]
    depth = frusta.near + share * (frusta.far - frusta.near)
    depth = depth.at[-1].set(frusta.far)
    for section, slopes in (("axis", [0.0]), ("whole", [-1.0, -0.3, 0.4, 1.0])):
        heights = [depth * frusta.tan_y * slope for slope in slopes]
        worst_z = jnp.stack([aliasing_error.error_z(frusta, distance, depth, y) for y in heights]).max((0, 1))
        worst_x = jnp.stack([aliasing_error.error_x(frusta, distance, depth, y) for y in heights]).max((0, 1))
        np.testing.assert_allclose(aliasing_error.max_error_z(frusta, distance, section), worst_z, rtol=1e-12)
        np.testing.assert_allclose(aliasing_error.max_error_x(frusta, distance, section), worst_x, rtol=1e-12)


def test_general_forms_become_the_source_s_for_a_light_overhead():
    frusta = random_frusta(COUNT)
    over = LightFrustum(frusta.near, frusta.far, frusta.phi_y, frusta.phi_x, jnp.full(COUNT, jnp.pi / 2))
    distance = over.near * 10 ** jnp.linspace(0, 3, COUNT)
    depth = jnp.sqrt(over.near * over.far)
    np.testing.assert_allclose(
        aliasing_error.error_z(over, distance, depth), overhead.overhead_error_z(over, distance, depth), rtol=1e-9
    )
    np.testing.assert_allclose(
        aliasing_error.error_x(over, distance, depth), overhead.overhead_error_x(over, distance, depth), rtol=1e-9
    )
    np.testing.assert_allclose(
        aliasing_error.storage_factor(over, distance), storage.overhead_storage(over, distance), rtol=1e-9
    )


def test_limits_are_finite_and_meet_the_uniform_map(dtype, rounding):
    """γ → 0 and η → −1: no NaN in values or gradients, S → (f/n)², n' → ∞ as a finite number."""
    gamma = jnp.asarray([0.0, 1e-9, 1e-5, 1e-2], dtype=dtype)
    frusta = LightFrustum.create(jnp.ones(4, dtype), jnp.full(4, 50, dtype), jnp.full(4, 0.5, dtype), gamma)
    rules = [
        near_distances.generalised,
        near_distances.wimmer_over_sine,
        optimal.minimax,
        optimal.least_storage,
        optimal.balanced,
    ]

    @jax.jit
    def of_every_rule(gamma):
        """Distances, storage, and the slope of the error by γ."""

        def total(gamma, rule):
            view = LightFrustum(frusta.near, frusta.far, frusta.phi_y, frusta.phi_x, gamma)
            return jnp.sum(jnp.log(aliasing_error.max_error_z(view, rule(view))))

        distances = [rule(frusta) for rule in rules]
        storages = [aliasing_error.storage_factor(frusta, distance) for distance in distances]
        return distances, storages, [jax.grad(total)(gamma, rule) for rule in rules]

    for distance, storage_factor, slope in zip(*of_every_rule(gamma), strict=True):
        assert distance.dtype == dtype
        assert np.isfinite(distance).all()
        np.testing.assert_allclose(storage_factor[0], 2500, rtol=20 * rounding)
        assert np.isfinite(slope).all()
    literal = overhead.literal_error_z(frusta, near_distances.uniform(frusta), frusta.near)
    assert np.isfinite(literal).all()
    eta = jnp.asarray([-1.0, -0.999999, 0.0, 1.0], dtype=dtype)
    along = near_distances.near_distance_from_eta(frusta, eta)
    np.testing.assert_allclose(along[2:], [1 + 50**0.5, 1], rtol=10 * rounding)
    assert np.isfinite(along).all()
    assert along[0] > along[1] > along[2]
    np.testing.assert_allclose(near_distances.eta_from_near_distance(frusta, along), eta, atol=20 * rounding)


def test_logarithmic_errors_are_constant_overhead_and_least_for_any_angle():
    frusta = random_frusta(COUNT, largest=4)
    over = LightFrustum(frusta.near, frusta.far, frusta.phi_y, frusta.phi_x, jnp.full(COUNT, jnp.pi / 2))
    depth = over.near * (over.far / over.near) ** jnp.linspace(0, 1, 7)[:, None]
    constant = jnp.log(over.far / over.near) / (2 * over.tan_y)
    np.testing.assert_allclose(log_error_z(over, log_distance(over), depth), constant + 0 * depth, rtol=1e-9)

    ends = jnp.stack([frusta.near, frusta.far])
    best = log_error_z(frusta, log_distance(frusta), ends).max(0)
    for factor in (0.5, 0.99, 1.01, 2.0):
        other = log_error_z(frusta, factor * log_distance(frusta), ends).max(0)
        assert (other >= best * (1 - 1e-12)).all()


def test_critical_resolution_removes_aliasing():
    frusta = random_frusta(COUNT, largest=3)
    distance = optimal.minimax(frusta, "whole")
    columns, rows = storage.critical_resolution(frusta, distance, 640, 480, "whole")
    np.testing.assert_allclose(aliasing_error.max_error_x(frusta, distance, "whole", 640 / columns), 1, rtol=1e-13)
    np.testing.assert_allclose(aliasing_error.max_error_z(frusta, distance, "whole", 480 / rows), 1, rtol=1e-13)


def test_slices_approach_the_logarithmic_map():
    view = LightFrustum.create(1.0, 300.0, 0.6)
    bound, counts = storage.storage_logarithmic(view), (1, 16, 64)
    measured = jax.jit(lambda splits: storage.storage_of_splits(view, splits, near_distances.wimmer))
    sums = [float(measured(logarithmic_splits(1.0, 300.0, k))) for k in counts]
    np.testing.assert_allclose(sums, [float(storage.storage_z_partitions(view, k)) for k in counts], rtol=1e-12)
    excess = np.asarray(sums) / float(bound) - 1
    assert (np.diff(sums) < 0).all()
    np.testing.assert_allclose(excess[2] / excess[1], 0.25, rtol=0.1)
    needed = storage.partitions_needed(
        jnp.asarray([10.0, 100.0, 1000.0, 1e4]), 2 * jnp.log(jnp.asarray([10, 100, 1e3, 1e4]))
    )
    np.testing.assert_array_equal(needed, [2, 4, 6, 8])


def test_aliasing_map_of_a_scene_is_the_limit_of_its_footprints():
    """Areas of texel and pixel quadrilaterals on real surfaces: their ratio meets the Jacobian at second order."""
    mesh, camera, light = plate_over_plane(), above(), lights()["directional"]
    space = light.space(camera.forward, *mesh.bounds())
    warp = jax.jit(lambda camera: PerspectiveFit().fit(space, light, mesh, camera))(camera)
    spots = np.random.default_rng(5).uniform(-1.5, 1.5, (30, 2))
    points = jnp.stack([jnp.asarray(spots[:, 0]), jnp.zeros(30), jnp.asarray(spots[:, 1])], axis=-1)
    normals = jnp.broadcast_to(jnp.asarray([0.0, 1.0, 0.0]), points.shape)

    @partial(jax.jit, static_argnums=0)
    def both_ways(size, points):
        shadow_map = RayGrid(space, warp, space.farthest(*mesh.bounds()), size, size)
        image = camera_grid(camera, size, size)
        found = measure.aliasing_map(image, shadow_map, points, normals)
        texel = measure.footprint(shadow_map, shadow_map.locate(points)[0], points, normals)
        return found, texel / measure.footprint(image, image.locate(points)[0], points, normals)

    worst = []
    for size in (64, 256):
        found, measured = both_ways(size, points)
        worst.append(float(jnp.max(jnp.abs(measured / found.total - 1))))
        np.testing.assert_allclose(found.major * found.minor, found.total, rtol=1e-9)
        np.testing.assert_allclose(found.projection * found.perspective, found.total, rtol=1e-12)
        assert (found.major >= found.minor).all()
    assert worst[0] < 5e-3
    np.testing.assert_allclose(worst[1], worst[0] / 16, rtol=0.05)


def test_l_infinity_and_bad_views():
    assert overhead.l_infinity(jnp.asarray([1.0, -3.0, 9.0]), jnp.asarray([True, True, False])) == 3
    for bad in ({"near": 2.0}, {"near": -1.0}, {"gamma": 1.6}, {"gamma": -0.1}, {"phi_y": 1.6}):
        with pytest.raises(ValueError, match="must"):
            LightFrustum.create(**{"near": 1.0, "far": 2.0, "phi_y": 0.5, "gamma": 0.3, **bad})
