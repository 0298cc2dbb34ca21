"""Frames from two directions are orthonormal to rounding at every angle between them, with right gradients."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from shadowjax import Camera
from shadowjax.geometry.light_space import DirectionalSpace
from shadowjax.geometry.transforms import any_perpendicular, light_frame, view_frame
from shadowjax.warps.fit import light_frustum, view_axis

ANGLES = np.concatenate([[0.0], np.geomspace(1e-8, np.pi / 2, 40), [np.pi / 2, 3.0, np.pi - 1e-6, np.pi]])
NUM_AXES = 24


def pairs(dtype):
    """Pairs of directions at each angle, about random axes and about the world's own, of many lengths."""
    rng = np.random.default_rng(5)
    axes = np.concatenate([rng.normal(size=(NUM_AXES, 3)), np.eye(3), -np.eye(3), [[1, 1, 0], [1, -1, 1e-9]]])
    axes = axes / np.linalg.norm(axes, axis=1, keepdims=True)
    aside = np.cross(axes, rng.normal(size=axes.shape))
    aside = aside / np.linalg.norm(aside, axis=1, keepdims=True)
    first = np.broadcast_to(axes, (len(ANGLES), *axes.shape))
    second = np.cos(ANGLES)[:, None, None] * axes + np.sin(ANGLES)[:, None, None] * aside
    lengths = 10.0 ** rng.uniform(-25, 15, (2, len(ANGLES), len(axes), 1))
    return (jnp.asarray((x * length).reshape(-1, 3), dtype) for x, length in zip((first, second), lengths, strict=True))


def exact(array):
    return np.asarray(array).astype(np.longdouble)


@pytest.mark.parametrize("make", [light_frame, view_frame])
def test_frames_are_orthonormal_to_four_roundings(make, dtype):
    first, second = pairs(dtype)
    frames = exact(jax.jit(jax.vmap(make))(first, second))
    away = np.abs(np.einsum("nij,nkj->nik", frames, frames) - np.eye(3))
    assert away.max() <= 4 * jnp.finfo(dtype).eps
    # Right, up, forward is a left-handed order of a right-handed viewer's axes.
    assert np.all(np.sign(np.linalg.det(frames.astype(float))) == (1 if make is light_frame else -1))


def test_light_frames_hold_the_directions_they_are_made_of(dtype):
    """y is the first direction; z lies in the plane of both, to what the rounding of the directions leaves of it."""
    first, second = pairs(dtype)
    frames, y, view = exact(jax.jit(jax.vmap(light_frame))(first, second)), exact(first), exact(second)
    y = y / np.linalg.norm(y.astype(float), axis=1, keepdims=True)
    view = view / np.linalg.norm(view.astype(float), axis=1, keepdims=True)
    eps = float(jnp.finfo(dtype).eps)
    assert np.abs(frames[:, 1] - y).max() <= 4 * eps
    sine = np.linalg.norm(np.cross(y, view).astype(float), axis=1)
    told = sine > 16 * eps
    assert np.all(np.einsum("ni,ni->n", frames[:, 2], view)[told] > 0)
    sideways = np.abs(np.einsum("ni,ni->n", frames[:, 0], view))
    assert sideways.max() <= 8 * eps


def test_any_perpendicular_is_one(dtype):
    first, _ = pairs(dtype)
    found, along = exact(jax.jit(jax.vmap(any_perpendicular))(first)), exact(first)
    along = along / np.linalg.norm(along.astype(float), axis=1, keepdims=True)
    eps = float(jnp.finfo(dtype).eps)
    assert np.abs(np.einsum("ni,ni->n", found, along)).max() <= 4 * eps
    assert np.abs(np.linalg.norm(found.astype(float), axis=1) - 1).max() <= 4 * eps


def weighted(weights, y, view):
    return jnp.sum(weights * light_frame(y, view)) + jnp.sum(weights * view_frame(view, y))


VALUE, SLOPES = jax.jit(weighted), jax.jit(jax.grad(weighted, argnums=(1, 2)))


@pytest.mark.parametrize("gamma", [1e-6, 1e-4, 1e-2, 1.0, 1.5])
def test_gradients_of_frames_equal_differences(gamma):
    """Far from parallel to far below the square root of a rounding."""
    rng = np.random.default_rng(3)
    y, aside = np.linalg.qr(rng.normal(size=(3, 2)))[0].T
    view = jnp.asarray(np.cos(gamma) * y + np.sin(gamma) * aside)
    weights = jnp.asarray(rng.normal(size=(3, 3)))
    y, step = jnp.asarray(y), 1e-4 * gamma
    slopes = SLOPES(weights, y, view)
    for _ in range(3):
        one, two = jnp.asarray(rng.normal(size=(2, 3)))
        ends = [VALUE(weights, y + sign * step * one, view + sign * step * two) for sign in (1, -1)]
        difference = (ends[0] - ends[1]) / (2 * step)
        slope = slopes[0] @ one + slopes[1] @ two
        scale = np.linalg.norm(slopes[0]) + np.linalg.norm(slopes[1])
        assert abs(float(slope - difference)) <= 1e-5 * scale


def test_gradients_stay_finite_at_every_angle(dtype):
    first, second = pairs(dtype)

    def value(first, second):
        # Of any nonzero length: what a direction's length scales is divided out.
        return jnp.sum(light_frame(first, second)[:, 0] + view_frame(first, second)[1])

    unit = jax.vmap(lambda v: v / jnp.max(jnp.abs(v)))
    slopes = jax.jit(jax.vmap(jax.grad(value, argnums=(0, 1))))(unit(first), unit(second))
    assert all(np.isfinite(slope).all() for slope in slopes)


@pytest.mark.parametrize("gamma", [0.0, 1e-8, 1e-6, 1e-4, 1e-2, 1.0, np.pi / 2])
def test_gamma_keeps_its_digits_towards_zero(gamma, dtype):
    """The camera's γ against the angle in long doubles between the very directions it was given."""
    camera = Camera.look_at((0.0, 3.0, 0.0), (0.0, 0.0, 0.0), phi_y=0.5, near=1, far=9, dtype=dtype)
    direction = jnp.asarray([np.sin(gamma), -np.cos(gamma), 0.0], dtype)
    true = np.arctan2(exact(direction)[0], -exact(direction)[1])
    eps = float(jnp.finfo(dtype).eps)
    for sign in (1, -1):
        assert abs(float(camera.gamma(sign * direction)) - true) <= 8 * eps * true
    frustum = light_frustum(camera, direction, camera.near, camera.far)
    assert np.isfinite(frustum.extent)
    assert frustum.gamma <= jnp.asarray(np.pi / 2, dtype)


def test_view_axis_is_a_unit_vector_at_every_angle(dtype):
    first, second = pairs(dtype)
    camera = Camera.look_at((0.0, 3.0, 0.0), (0.0, 0.0, 0.0), phi_y=0.5, near=1, far=9, dtype=dtype)

    def axis(first, second):
        frame = light_frame(first, second)
        seen = Camera(camera.position, view_frame(second, first), *jax.tree.leaves(camera)[2:])
        return view_axis(DirectionalSpace(jnp.zeros_like(first), frame), seen)

    found = exact(jax.jit(jax.vmap(axis))(first, second))
    assert np.abs(found - [0, 1]).max() <= 16 * jnp.finfo(dtype).eps
