"""Cameras and lights: frames, angles, frusta, falloff, and what their constructors refuse."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from shapes import above, lights

from shadowjax import Camera, DirectionalLight, PointLight, SpotLight
from shadowjax.geometry.transforms import light_frame, view_frame

GOOD = {"position": (0.0, 0, 5), "target": (0.0, 0, 0), "phi_y": 0.4, "near": 1.0, "far": 9.0}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"near": 0.0}, "near must be positive"),
        ({"near": 9.0}, "near must be less than far; got near = 9.0, far = 9.0"),
        ({"near": 12.0}, "near must be less than far"),
        ({"phi_y": 0.0}, r"\(0, π/2\)"),
        ({"phi_y": 1.6}, r"\(0, π/2\)"),
        ({"phi_y": float("nan")}, "phi_y must be finite"),
        ({"target": (0.0, 0, 5)}, "must differ"),
        ({"up": (0.0, 0, 0)}, "zero vector"),
        ({"aspect": -1.0}, "aspect must be positive"),
        ({"position": (0.0, 0)}, r"shape \(3,\)"),
    ],
)
def test_look_at_names_what_is_wrong(change, message):
    with jax.debug_nans(False), pytest.raises(ValueError, match=message):
        Camera.look_at(**(GOOD | change))


def test_look_at_complains_at_run_time_when_traced():
    bad = jax.jit(lambda near: Camera.look_at(**(GOOD | {"near": near})).near)
    with pytest.raises(Exception, match="near must be less than far"):
        jax.block_until_ready(bad(20.0))


def test_camera_frame_is_orthonormal_and_right_handed(dtype, rounding):
    camera = above(dtype)
    assert camera.rotation.dtype == dtype
    np.testing.assert_allclose(camera.rotation @ camera.rotation.T, np.eye(3), atol=8 * rounding)
    np.testing.assert_allclose(jnp.cross(camera.right, camera.forward), camera.up, atol=8 * rounding)
    assert camera.up[1] > 0


def test_frustum_corners_lie_at_near_and_far_and_on_the_view_angle(dtype, rounding):
    camera = above(dtype)
    local = camera.to_view(camera.frustum_corners())
    np.testing.assert_allclose(local[:, 2], [2.0] * 4 + [16.0] * 4, rtol=16 * rounding)
    np.testing.assert_allclose(jnp.abs(local[:, 1]) / local[:, 2], np.full(8, np.tan(0.45)), rtol=32 * rounding)


@pytest.mark.parametrize("degrees", [0.0, 1e-3, 30.0, 89.999, 90.0])
def test_gamma_of_known_angles(degrees):
    camera = Camera.look_at((0.0, 0, 0), (0.0, 0, -1), phi_y=0.5, near=1, far=2)
    angle = np.radians(degrees)
    direction = np.array([0.0, -np.sin(angle), -np.cos(angle)])
    for sign in (1, -1):
        np.testing.assert_allclose(np.degrees(camera.gamma(jnp.asarray(sign * direction))), degrees, atol=1e-12)


def test_looking_along_up_still_gives_a_frame():
    frame = view_frame(jnp.asarray([0.0, 1, 0]), jnp.asarray([0.0, 1, 0]))
    np.testing.assert_allclose(frame @ frame.T, np.eye(3), atol=1e-14)


def test_light_frame_follows_the_warping_chapter():
    to_light, view = jnp.asarray([0.3, 1.0, 0.2]), jnp.asarray([0.1, -0.4, -1.0])
    x, y, z = light_frame(to_light, view)
    np.testing.assert_allclose(y, to_light / jnp.linalg.norm(to_light), atol=1e-14)
    np.testing.assert_allclose(jnp.cross(y, z), x, atol=1e-14)
    assert z @ view > 0
    np.testing.assert_allclose(jnp.linalg.det(jnp.stack([y, z, view])), 0, atol=1e-14)
    parallel = light_frame(view, view)
    np.testing.assert_allclose(parallel @ parallel.T, np.eye(3), atol=1e-14)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: DirectionalLight.create((0.0, 0, 0)), "must not be the zero vector"),
        (lambda: DirectionalLight.create((0.0, float("nan"), 0)), "finite"),
        (lambda: DirectionalLight.create((0.0, 1.0)), r"shape \(3,\)"),
        (lambda: DirectionalLight.create((0.0, 1, 0), color=-1.0), "not be negative"),
        (lambda: PointLight.create((0.0, float("inf"), 0)), "finite"),
        (lambda: SpotLight.create((0.0, 1, 0), (0.0, -1, 0), 0.0), r"half_angle.*\(0, π/2\)"),
        (lambda: SpotLight.create((0.0, 1, 0), (0.0, -1, 0), 1.6), r"half_angle.*\(0, π/2\)"),
        (lambda: SpotLight.create((0.0, 1, 0), (0.0, 0, 0), 0.5), "zero vector"),
    ],
)
def test_lights_name_what_is_wrong(make, message):
    with jax.debug_nans(False), pytest.raises(ValueError, match=message):
        make()


def test_falloff_is_inverse_square_and_the_cone_ends(dtype, rounding):
    points = jnp.asarray([[0.0, 0, 0], [0, -2, 0], [5, -2, 0]], dtype)
    point = PointLight.create((0.0, 2, 0), 8.0, dtype=dtype)
    np.testing.assert_allclose(point.radiance(points)[:2, 0], [2.0, 0.5], rtol=8 * rounding)
    spot = SpotLight.create((0.0, 2, 0), (0.0, -1, 0), 0.5, 8.0, dtype=dtype)
    np.testing.assert_allclose(spot.covers(points), [1, 1, 0])
    np.testing.assert_allclose(spot.radiance(points)[:, 0], [2.0, 0.5, 0], rtol=8 * rounding)


def test_radiance_and_its_gradient_are_finite_at_the_light_itself(dtype):
    for light in lights(dtype).values():
        where = getattr(light, "position", jnp.zeros(3, dtype))[None]
        assert np.isfinite(light.radiance(where)).all()
        assert np.isfinite(jax.grad(lambda p, light=light: jnp.sum(light.radiance(p)))(where)).all()
