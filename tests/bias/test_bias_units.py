"""Bias units: conversions there and back, depth buffers by their derivative, and figures that users reported."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from shapes import above, lights, plate_over_plane

from shadowjax.bias.units import UNITS, BiasScale, DepthBuffer, cascade_scales
from shadowjax.evaluate.acne import contact_gap, least_plane_bias
from shadowjax.partitions.cascades import Cascades
from shadowjax.warps.fit import PerspectiveFit


@pytest.mark.parametrize("encoding", ["linear", "reciprocal"])
@pytest.mark.parametrize("span", [1.0, 2.0])
def test_rate_is_the_derivative_of_the_encoding(encoding, span):
    depth = DepthBuffer.create(0.5, 40.0, encoding, span)
    where = jnp.asarray([0.5, 3.0, 40.0])
    np.testing.assert_allclose(depth.rate(where), jax.vmap(jax.grad(depth.encode))(where), rtol=1e-12)
    np.testing.assert_allclose(depth.encode(where)[jnp.asarray([0, 2])], [1 - span, 1.0], atol=1e-12)


def test_every_pair_of_units_goes_there_and_back():
    scale = BiasScale.of_plane(0.02, 0.8, 0.3, DepthBuffer.create(1.0, 90.0, "reciprocal"), 30.0)
    for unit in UNITS:
        for to in UNITS:
            there = scale.convert(0.7, unit, to)
            np.testing.assert_allclose(scale.convert(there, to, unit), 0.7, rtol=1e-13)
    np.testing.assert_allclose(scale.convert(1.0, "texel", "world"), 0.02, rtol=1e-13)
    np.testing.assert_allclose(
        scale.convert(1.0, "normal-texel", "slope"), 0.02 / np.cos(0.8) / scale.slope, rtol=1e-13
    )


def test_closed_form_of_a_plane_is_what_the_map_says():
    grids = Cascades(2, warp=PerspectiveFit("uniform")).grids(plate_over_plane(), lights()["directional"], above(), 64)
    points, normals = jnp.asarray([[0.5, 0.0, 0.25]]), jnp.asarray([[0.0, 1.0, 0.0]])
    ranges = [DepthBuffer.create(0.0, 10.0), DepthBuffer.create(0.0, 25.0)]
    for scale, depth, grid in zip(cascade_scales(grids, points, normals, ranges), ranges, grids, strict=True):
        incidence = jnp.arccos(scale.cosine[0])
        across, down = (np.asarray(v[0]) for v in grid.cell_vectors(points))
        spread = np.abs([across[1], down[1]])
        np.testing.assert_allclose(scale.slope[0], spread.sum() / np.cos(incidence), rtol=1e-9)
        np.testing.assert_allclose(scale.convert(0.01, "ndc", "world")[0], 0.01 * depth.far, rtol=1e-12)


def test_reported_cascades_of_one_normalised_bias():
    """0.005 of normalised depth was measured as 2.02, 4.12, 6.71 and 13.29 m in cascades 0 to 3, and its ground gap at
    52° as 1.6 to 10.4 m. Those metres are multiples of the bias by the cascade's number; that gap takes the bias for a
    height. Depth along the light leaves g = b cos ε."""
    metres = np.array([2.02, 4.12, 6.71, 13.29])
    ranges = metres / (0.005 * np.arange(1, 5))
    scales = [BiasScale.of_plane(1.0, 0.66, 0.0, DepthBuffer.create(0.0, far), 1.0) for far in ranges]
    converted = [float(scale.convert(0.005 * (i + 1), "ndc", "world")) for i, scale in enumerate(scales)]
    np.testing.assert_allclose(converted, metres, rtol=1e-12)
    assert np.all(np.diff(ranges) > 0)
    assert ranges[0] == pytest.approx(404)
    elevation = np.radians(52)
    as_height = np.asarray(converted) / np.tan(elevation)
    np.testing.assert_allclose(as_height[[0, 1, 3]], [1.6, 3.2, 10.4], atol=0.05)
    along_light = contact_gap(jnp.asarray(converted), elevation)
    np.testing.assert_allclose(along_light, as_height * np.sin(elevation), rtol=1e-12)
    np.testing.assert_allclose(np.asarray(along_light)[[0, 3]], [1.24, 8.18], atol=0.005)


def test_least_plane_bias_has_the_gradients_of_its_formula():
    extent, resolution, incidence, reach = 20.0, 512.0, 0.9, 1.5
    value, slopes = jax.value_and_grad(least_plane_bias, argnums=(0, 1, 2, 3))(extent, resolution, incidence, reach)
    np.testing.assert_allclose(value, reach * extent / resolution * np.tan(incidence), rtol=1e-13)
    expected = [value / extent, -value / resolution, value / np.sin(incidence) / np.cos(incidence), value / reach]
    np.testing.assert_allclose(slopes, expected, rtol=1e-12)
    gap = jax.grad(contact_gap, argnums=(0, 1))(0.3, 0.8)
    np.testing.assert_allclose(gap, [np.cos(0.8), -0.3 * np.sin(0.8)], rtol=1e-12)


def test_bad_input_says_what_to_do():
    with pytest.raises(ValueError, match=r"incidence must lie in \[0, π/2\)"):
        BiasScale.of_plane(1.0, 2.0)
    with pytest.raises(ValueError, match="need a depth buffer"):
        BiasScale.of_plane(1.0, 0.5).convert(1.0, "ndc", "world")
    with pytest.raises(ValueError, match="bias unit must be one of 'world'"):
        BiasScale.of_plane(1.0, 0.5).convert(1.0, "metres", "world")
    with pytest.raises(ValueError, match="no size in 'slope' units"):
        BiasScale.of_plane(1.0, 0.0).convert(1.0, "world", "slope")
    with pytest.raises(ValueError, match="near must be positive where depth is stored as z/w"):
        DepthBuffer.create(0.0, 1.0, "reciprocal")
    with pytest.raises(ValueError, match="elevation must lie"):
        contact_gap(1.0, 0.0)
