"""Reading maps: which texel answers, what lies outside, and that omnidirectional maps have no seam."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from shadowjax import PointLight
from shadowjax._numerics import far_away
from shadowjax.geometry.light_space import OctahedralSpace
from shadowjax.maps.sampling import read_bilinear, read_nearest, read_texels

MAP = jnp.arange(12.0).reshape(1, 3, 4)


def test_nearest_reads_the_texel_a_position_lies_in():
    position = jnp.asarray([[0.0, 0.0], [0.999, 0.0], [1.0, 0.0], [3.5, 2.5], [2.25, 1.75]])
    np.testing.assert_array_equal(read_nearest(MAP, position)[0], [0, 0, 1, 11, 6])


@pytest.mark.parametrize(("border", "expected"), [("lit", [far_away(jnp.float64)] * 3), ("clamp", [0, 11, 8])])
def test_outside_is_what_was_asked_for(border, expected):
    position = jnp.asarray([[-0.1, 0.0], [9.0, 7.0], [-1e30, 2.5]])
    np.testing.assert_array_equal(read_nearest(MAP, position, border)[0], expected)


def test_unknown_border_is_refused():
    with pytest.raises(ValueError, match="border must be one of 'lit', 'clamp', 'octahedral'; got 'wrap'"):
        read_texels(MAP, jnp.asarray(0), jnp.asarray(0), "wrap")


def test_bilinear_is_exact_on_linear_maps_and_at_centres(dtype, rounding):
    rows, cols = jnp.meshgrid(jnp.arange(5, dtype=dtype), jnp.arange(6, dtype=dtype), indexing="ij")
    linear = 2 * cols - 3 * rows + 1
    rng = np.random.default_rng(0)
    position = jnp.asarray(rng.uniform([0.5, 0.5], [5.5, 4.5], (50, 2)), dtype)
    expected = 2 * (position[:, 0] - 0.5) - 3 * (position[:, 1] - 0.5) + 1
    np.testing.assert_allclose(read_bilinear(linear[None], position)[0], expected, atol=40 * rounding)


def test_bilinear_gradient_is_the_slope_between_centres():
    gradient = jax.grad(lambda p: read_bilinear(MAP, p)[0])(jnp.asarray([1.7, 1.2]))
    np.testing.assert_allclose(gradient, [1, 4], rtol=1e-12)


def test_octahedral_reads_continue_across_every_fold(dtype, rounding):
    """A map of a smooth function of direction reads smoothly half a texel outside each edge of the square."""
    num = 64
    space = OctahedralSpace(jnp.zeros(3, dtype))
    centres = (jnp.arange(-1, num + 1, dtype=dtype) + 0.5) / num * 2 - 1
    cols, rows = jnp.meshgrid(jnp.arange(-1, num + 1, dtype=jnp.int32), jnp.arange(-1, num + 1, dtype=jnp.int32))
    plane = jnp.stack(jnp.meshgrid(centres, centres), axis=-1)
    inside = plane[1:-1, 1:-1]
    smooth = jnp.sum(space.ray(inside)[1] * jnp.asarray([0.3, -0.5, 0.8], dtype), axis=-1)
    (values,) = read_texels(smooth[None], cols, rows, "octahedral")
    np.testing.assert_array_equal(values[1:-1, 1:-1], smooth)
    steps = jnp.maximum(jnp.max(jnp.abs(jnp.diff(values, axis=0))), jnp.max(jnp.abs(jnp.diff(values, axis=1))))
    # Neighbouring directions are at most a few texels apart: nowhere does the fold jump.
    assert float(steps) < 4 * 2 / num


def test_octahedral_map_is_a_bijection_of_the_sphere(dtype, rounding):
    rng = np.random.default_rng(1)
    directions = rng.normal(size=(500, 3))
    directions = np.concatenate([directions, np.eye(3), -np.eye(3)])
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    space = OctahedralSpace(jnp.asarray([1.0, 2, 3], dtype))
    points = space.position + 2 * jnp.asarray(directions, dtype)
    plane, depth = space.project(points)
    np.testing.assert_allclose(depth, 2.0, rtol=8 * rounding)
    assert float(jnp.max(jnp.abs(plane))) <= 1 + 4 * rounding
    np.testing.assert_allclose(space.point(plane, depth), points, atol=64 * rounding)


def test_light_spaces_invert_and_have_finite_gradients_at_their_own_position(dtype):
    light = PointLight.create((0.0, 1.0, 0.0), dtype=dtype)
    space = OctahedralSpace(light.position)
    gradient = jax.grad(lambda p: jnp.sum(space.project(p)[0]) + jnp.sum(space.project(p)[1]))(light.position[None])
    assert np.isfinite(gradient).all()
