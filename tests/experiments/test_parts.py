"""What the experiments are made of: ideal maps, close-ups, lines through times, plain values."""

import importlib
import json
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest

import experiments
from experiments.base import Claim, plain
from experiments.claiming import agrees, all_true, at_most, equals
from experiments.edge_maps import FAR, NEAR, POLICIES, detected, edge_texels, lone_texel, occluder_maps
from experiments.ideal_edge import edge_reach, spot_visibility
from experiments.mdsm_cost_5_6_to_5_8 import slope_of
from experiments.pictures import CloseUp, close_up
from experiments.warped_views import refined_largest
from shadowjax import scenes
from shadowjax.filters.hard import Hard
from shadowjax.filters.pcf import PercentageCloser


def test_an_edge_at_0_degrees_lies_along_the_rows_and_at_90_along_the_columns():
    along, across = (occluder_maps(17, angle, np.zeros(1))[0] for angle in (0.0, 90.0))
    assert (along == along[:, :1]).all()
    assert (across == across[:1]).all()
    assert set(along[:, 0]) == set(across[0]) == {NEAR, FAR}
    assert (occluder_maps(17, 90.0, np.full(1, 0.5), 1.0) == NEAR).sum() == 17


@pytest.mark.parametrize("angle", [0.0, 30.0, 45.0, 90.0, 120.0])
def test_occluders_cover_the_area_they_should(angle):
    offsets = (np.arange(8) + 0.5) / 8
    half = occluder_maps(33, angle, offsets)
    strip = occluder_maps(33, angle, offsets, 2.0)
    # Half of the map and what the offset adds, less than a texel wide; and a strip two texels wide across the map.
    assert abs((half == NEAR).mean() - 0.5) < 1.5 / 33
    length = 33 / max(abs(np.cos(np.radians(angle))), abs(np.sin(np.radians(angle))))
    assert (strip == NEAR).sum((1, 2)).mean() == pytest.approx(2.0 * length, rel=0.05)


def test_edge_texels_are_the_two_rows_along_a_straight_edge():
    maps = occluder_maps(17, 0.0, np.full(1, 0.25))
    both = edge_texels(maps, "both")[0]
    rows = np.flatnonzero(both.any(axis=1))
    assert rows.size == 2
    assert maps[0, rows[0], 0] != maps[0, rows[1], 0]
    assert (edge_texels(maps, "near")[0] ^ edge_texels(maps, "far")[0] == both).all()


def test_a_lone_texel_is_seen_by_all_eight_neighbours_through_a_minimum_and_by_one_through_a_fixed_offset():
    maps = lone_texel(17)
    around = edge_texels(maps, "far")
    assert around.sum() == 8
    assert (detected(POLICIES["2-SM min"], maps) & around).sum() == 8
    assert (detected(POLICIES["fixed"], maps) & around).sum() == 1
    assert (detected(POLICIES["2-SM max"], maps) & edge_texels(maps, "near")).sum() == 1


def test_ideal_filters():
    assert edge_reach(Hard()) == pytest.approx(0.5 / 64)  # no tone at all: the resolution of the measurement
    assert edge_reach(PercentageCloser(3)) == 1.0
    assert spot_visibility(Hard(), 2) == 1.0
    assert spot_visibility(PercentageCloser(3), 1) == pytest.approx(1 / 9)
    # Three texels wide: the middle sees 9 lit taps, the sides 6, the corners 4.
    assert spot_visibility(PercentageCloser(3), 3) == pytest.approx((9 + 4 * 6 + 4 * 4) / 81)


def test_a_close_up_looks_at_its_part():
    camera = scenes.make_scene("two-plates", dtype=jnp.float32).camera
    part = CloseUp(0.3, 0.6, 0.2)
    near = close_up(camera, part)
    half = np.asarray(camera.half_size)
    view = np.asarray(camera.to_view(near.position + near.forward))
    np.testing.assert_allclose(view[:2] / view[2] / half, [2 * part.x - 1, 1 - 2 * part.y], atol=1e-5)
    np.testing.assert_allclose(np.asarray(near.half_size) / half, part.size, rtol=1e-5)


def test_the_line_through_times_finds_a_line_and_its_noise():
    fragments = np.array([0, 10, 20, 50, 100])
    slope, error = slope_of(fragments, 0.5 + 0.25 * fragments)
    assert slope == pytest.approx(0.25)
    assert error == pytest.approx(0.0, abs=1e-12)
    rng = np.random.default_rng(0)
    estimates = [
        slope_of(fragments, 0.25 * fragments + np.sqrt(fragments) * 0.1 * rng.standard_normal(5)) for _ in range(400)
    ]
    slopes, errors = np.array(estimates).T
    assert slopes.mean() == pytest.approx(0.25, abs=3 * slopes.std() / 20)
    assert np.sqrt((errors**2).mean()) == pytest.approx(slopes.std(), rel=0.15)


def test_plain_values_are_json():
    value = {"a": np.float32(0.1), 2: (np.arange(3), Claim("c", True, "v", "e")), "n": None}
    assert json.loads(json.dumps(plain(value), allow_nan=False)) == {
        "a": 0.100000001,
        "2": [[0, 1, 2], {"name": "c", "holds": True, "value": "v", "expected": "e", "timed": False}],
        "n": None,
    }


def test_claims_from_numbers_can_fail():
    assert agrees("a", [1.0, 2.0], [1.0, 2.0 + 1e-9], 1e-9).holds
    assert not agrees("a", [1.0, 2.0], [1.0, 2.1], 1e-3).holds
    assert not agrees("a", [np.nan], [1.0], 1.0).holds
    assert equals("a", 3.0, 3.0).holds
    assert not equals("a", 3.0, 3.0001).holds
    assert at_most("a", [1.0, 2.0], 2.0).holds
    assert not at_most("a", [1.0, 2.1], 2.0).holds
    assert all_true("a", [True, True], "cases").value == "2 cases"
    assert not all_true("a", [True, False], "cases").holds


def test_a_refined_maximum_is_the_maximum():
    at, value = refined_largest(lambda x: 3 - (x - 0.123456) ** 2, -1.0, 2.0)
    assert at == pytest.approx(0.123456, abs=1e-7)  # values around a maximum agree to the root of a rounding
    assert value == pytest.approx(3.0, abs=1e-15)
    assert refined_largest(lambda x: x, 0.0, 2.0) == (2.0, 2.0)


def test_every_module_of_a_figure_is_registered_and_documented():
    folder = Path(experiments.__file__).parent
    names = [path.stem for path in folder.glob("[a-z]*.py")]
    # The other modules are parts that several experiments share.
    modules = {name for name in names if hasattr(importlib.import_module(f"experiments.{name}"), "claims")}
    assert modules == set(experiments.EXPERIMENTS)
    for name in modules:
        documentation = experiments.find(name).__doc__
        assert documentation is not None
        assert "Measured" in documentation
        assert "How to read it" in documentation
