"""The softened, expected error of a map: its slope, what it says of the map itself, and bad input."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

from shadowjax import DirectionalLight, PerspectiveFit, make_scene
from shadowjax.geometry.light import PointLight
from shadowjax.optimize.viewed.expected import ExpectedError, MapSettings, error_and_slope
from shadowjax.rays.brute import BruteForceCaster

SIZES = {"width": 24, "height": 18, "resolution": 24, "caster": BruteForceCaster()}


@pytest.fixture(scope="module")
def expected():
    return ExpectedError.create(make_scene("two-plates", dtype=jnp.float64), num_placements=2, **SIZES)


def test_the_slope_is_that_of_central_differences(expected):
    at, step = np.array([0.35, 1.3, 0.7]), 1e-6
    slope = np.asarray(error_and_slope(expected, at)[1])
    for index, unit in enumerate(np.eye(3)):
        ends = [float(error_and_slope(expected, at + side * step * unit)[0]) for side in (-1, 1)]
        np.testing.assert_allclose(slope[index], (ends[1] - ends[0]) / (2 * step), rtol=1e-4, atol=1e-7)


def test_it_tells_the_error_of_the_map_itself(expected):
    # One map has one placement: the bound is the spread over placements of so few pixels.
    for at in (np.asarray(expected.published), np.array([0.1, 1.0, 0.3])):
        soft = float(jnp.exp(error_and_slope(expected, at)[0]))
        assert expected.measured(MapSettings.of(jnp.asarray(at)), SIZES["caster"]) == pytest.approx(soft, rel=0.15)


def test_the_published_bend_is_the_warp_of_that_rule(expected):
    space = expected.fine.grid.space
    arguments = space, expected.light, expected.mesh, expected.camera
    bent = eqx.filter_jit(PerspectiveFit.fit)(PerspectiveFit(bend=expected.published[0]), *arguments)
    usual = expected.fine.grid.plane_map
    # The rule's W is that of the view, the bend's that of the padded map: a fifth of a per cent.
    np.testing.assert_allclose(bent.strength, usual.strength, rtol=5e-3)
    np.testing.assert_allclose(bent.extent, usual.extent, rtol=1e-12)


@pytest.mark.parametrize(
    ("options", "told"),
    [
        ({"finer": 1}, "finer must be an integer of at least 2"),
        ({"num_placements": 0}, "num_placements must be an integer of at least 1"),
        ({"softness": 0.0}, "softness must be positive"),
        ({"sun_radius": 1.0}, "sun_radius must lie in"),
    ],
)
def test_bad_input_is_named(options, told):
    scene = make_scene("two-plates", dtype=jnp.float64)
    with pytest.raises(ValueError, match=told):
        ExpectedError.create(scene, **SIZES, **options)
    lamp = PointLight.create((0.0, 4.0, 0.0), dtype=jnp.float64)
    with pytest.raises(ValueError, match="directional"):
        ExpectedError.create(eqx.tree_at(lambda s: s.lights, scene, (lamp,)), **SIZES)
    assert isinstance(scene.lights[0], DirectionalLight)
