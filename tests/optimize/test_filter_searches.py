"""Searches over biases, exponents and taps: against brute force on one small view, and through the command line."""

import json

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

from shadowjax import Bias, MultiDepth, Neighbourhood, PercentageCloser, make_scene
from shadowjax.cli.main import main
from shadowjax.filters.chosen_depths import Cells, Ranks, neighbourhood_cells
from shadowjax.filters.exponential import Exponential
from shadowjax.filters.multi_depth import max_neighbour, min_max_neighbours, shifted
from shadowjax.filters.offset_pcf import OffsetPercentageCloser
from shadowjax.filters.registry import FILTERS
from shadowjax.optimize.viewed import taps
from shadowjax.optimize.viewed.bias import bias
from shadowjax.optimize.viewed.filter_numbers import FAMILIES, exponent
from shadowjax.optimize.viewed.views import as_views, error_of, view_scene
from shadowjax.presets.names import make_technique

NAMED = {"msm": "msm-hamburger"}
DEPTH = jnp.asarray(np.random.default_rng(3).uniform(1, 2, (7, 9)))


@pytest.fixture(scope="module")
def viewed():
    return view_scene("plate-over-plane", 32, 24, 32)


def applied(found):
    """Error of the technique that a solution makes, cast anew over the same view."""
    scene = make_scene("plate-over-plane")
    shadows = found.technique(32).build(scene.mesh, scene.lights[0], scene.camera)
    return float(error_of(shadows, view_scene(scene, 32, 24, 32)))


def test_published_policies_are_ranks_and_cells():
    np.testing.assert_array_equal(Ranks((9,)).planes(DEPTH), max_neighbour(DEPTH))
    np.testing.assert_array_equal(Ranks((9, 1)).planes(DEPTH), min_max_neighbours(DEPTH))
    middle = np.median(np.stack([shifted(DEPTH, *cell) for cell in neighbourhood_cells(3)]), axis=0)
    np.testing.assert_array_equal(Ranks((5,)).planes(DEPTH)[1], middle)
    np.testing.assert_array_equal(Cells(((1, -2),)).planes(DEPTH)[1], shifted(DEPTH, 1, -2))
    assert (Cells(((1, -2),)).radius, Ranks((3, 7)).num_depths) == (2.0, 3)
    with pytest.raises(ValueError, match="lies between 1 and 9; got 10"):
        Ranks((10,))
    with pytest.raises(ValueError, match="at least one"):
        Cells(())


def test_the_best_bias_is_the_best_of_a_fine_scan(viewed):
    found = bias((viewed,), PercentageCloser(3), "slope", 9)
    assert found.objective_value <= min(found.baselines["default"], found.baselines["none"])
    assert found.certificate.default_slope == 1.5
    assert applied(found) == pytest.approx(float(found.objective_value), rel=1e-3)
    named = bias((viewed,), "pcf-3x3", "slope", 5)
    assert applied(named) == pytest.approx(float(named.objective_value), rel=1e-3)
    offset = bias((viewed,), PercentageCloser(3), "normal", 5)
    assert applied(offset) == pytest.approx(float(offset.objective_value), rel=1e-3)
    scan = [float(error_of(viewed.read(PercentageCloser(3), Bias.create(v)), viewed)) for v in (0.5, 1.0, 1.5, 3.0)]
    assert found.objective_value <= min(scan) + 1e-12
    assert 0 < found.certificate.needed_slope <= 1.5 + 1e-9
    assert list(found.certificate.values) == sorted(found.certificate.values)
    assert found.objective_value == float(found.certificate.errors.min())


def test_errors_of_sets_are_those_of_the_filter(viewed):
    """The matrix of inner products gives what the composite test of those planes gives."""
    for members, policy in (((9,), Neighbourhood("max")), ((1, 9), Neighbourhood("min-max"))):
        planes = taps._plane_visibilities(viewed.shadows, viewed, "ranks", 1)
        found = taps.set_errors(planes, viewed, jnp.asarray([members]))[0]
        direct = float(error_of(viewed.read(MultiDepth(policy)), viewed))
        assert float(found) == pytest.approx(direct, rel=1e-9)


def test_the_best_set_is_the_best_of_all(viewed):
    found = taps.depths((viewed,), (viewed,), 3)
    assert found.certificate.num_sets == 36
    others = [
        float(error_of(viewed.read(MultiDepth(Ranks(pair))), viewed)) for pair in ((1, 9), (3, 7), (4, 6), (2, 8))
    ]
    assert found.objective_value <= min(others) + 1e-12
    assert float(error_of(viewed.read(MultiDepth(found.value)), viewed)) == pytest.approx(
        float(found.objective_value), rel=1e-9
    )
    assert float(found.baselines["min-max"]) == pytest.approx(others[0], rel=1e-9)
    cells = taps.depths((viewed,), (viewed,), 2, "hard", "cells")
    assert isinstance(cells.value, Cells)
    for one in (found, cells):
        assert applied(one) == pytest.approx(float(one.objective_value), rel=1e-3)
    assert cells.objective_value <= cells.baselines["ring"]


def test_offset_taps_on_the_grid_are_bilinear_pcf_and_their_gradient_is_right(viewed):
    offsets = jnp.asarray([[-0.4, -0.3], [0.35, 0.2]])
    built = (viewed.read(OffsetPercentageCloser(offsets, 1.5)),)
    slope = eqx.filter_grad(lambda o: taps._taps_error(o, (viewed,), built))(offsets)
    step = 1e-6
    for i, j in ((0, 0), (1, 1)):
        up, down = (taps._taps_error(offsets.at[i, j].add(s * step), (viewed,), built) for s in (1, -1))
        assert float(slope[i, j]) == pytest.approx(float((up - down) / (2 * step)), rel=1e-4, abs=1e-9)
    found = taps.taps((viewed,), (viewed,), "pcf-bilinear", 4)
    assert found.objective_value <= found.baselines["start"]
    assert np.abs(np.asarray(found.value)).max() < 1.0
    assert applied(found) == pytest.approx(float(found.objective_value), rel=1e-3)
    with pytest.raises(ValueError, match=r"must have shape \(taps, 2\)"):
        OffsetPercentageCloser.create([1.0, 2.0])


def test_a_search_of_numbers_never_ends_above_its_start(viewed):
    found = exponent((viewed,), "vsm", 3, 4, (viewed,))
    assert len(found.certificate.tried) == 4
    assert found.objective_value == min(error for _, error in found.certificate.tried)
    assert found.gain >= 1
    assert found.text.startswith("The maximum number of steps was reached")
    assert applied(found) == pytest.approx(float(found.objective_value), rel=1e-3)
    assert found.certificate.test_error == pytest.approx(float(found.objective_value))
    for family, held in FAMILIES.items():
        filter_ = Exponential(space="linear") if family == "esm-linear" else FILTERS[NAMED.get(family, family)]()
        assert [name for name, one in FAMILIES.items() if one.holds(filter_)] == [family]
        own = held.values(filter_)
        assert eqx.tree_equal(held.make(filter_, own), filter_)
        for index, (knob, value) in enumerate(zip(held.knobs, own, strict=True)):
            assert knob.low <= value <= knob.high
            moved = knob.move(value, -1)
            assert knob.low <= moved <= knob.high
            assert held.values(held.make(filter_, (*own[:index], moved, *own[index + 1 :])))[index] == moved


def test_searches_tune_a_technique_as_a_whole(viewed):
    """Partition, warp and filter stay; only the number is new. What is measured is what the tuned technique gives."""
    ours = make_technique("z2+minimax+vsm", 32)
    found = exponent(viewed, ours, evaluations=3)
    tuned = found.technique(32)
    assert tuned.partition == ours.partition
    assert tuned.filter.prefilter == ours.filter.prefilter
    assert tuned.filter.bleed_low == found.value["bleed_low"]
    assert found.certificate.default_numbers["bleed_low"] == pytest.approx(ours.filter.bleed_low)
    assert applied(found) == pytest.approx(float(found.objective_value), rel=1e-3)
    several = taps.depths(viewed, viewed, 2, "z2+minimax+pcf-2x2")
    assert several.technique(32).partition == ours.partition
    assert several.technique(32).filter == MultiDepth(several.value, 2)
    assert applied(several) == pytest.approx(float(several.objective_value), rel=1e-3)
    for search, wrong, message in (
        (exponent, "pcf-3x3", "PercentageCloser has no numbers to search"),
        (exponent, "exact", "needs shadow maps of one resolution each; got Exact"),
        (lambda views, name: taps.taps(views, views, name), "vsm", "take a technique with hard, pcf-KxK"),
        (lambda views, name: taps.depths(views, views, 2, name), "pcss", "count tests one texel apart"),
    ):
        with pytest.raises(ValueError, match=message):
            search(viewed, wrong)


def test_the_error_of_a_picture_is_a_name_or_a_function():
    """Mean absolute error as a function; scenes and names are looked at by the search itself."""
    mean = lambda seen, exact, cosine: jnp.mean(jnp.abs(seen - exact), where=cosine > 0)  # noqa: E731
    viewed = view_scene("plate-over-plane", 32, 24, 32, mean)
    found = bias(viewed, PercentageCloser(3), "slope", 5)
    shadows = viewed.read(PercentageCloser(3), found.value)
    off = np.abs(np.asarray(shadows.visibility(viewed.points, viewed.normals) - viewed.exact))[np.asarray(viewed.valid)]
    assert float(found.objective_value) == pytest.approx(off.mean(), rel=1e-9)
    assert all(one is viewed for one in as_views([viewed, viewed]))
    with pytest.raises(ValueError, match="'light', 'visibility'"):
        view_scene("plate-over-plane", 32, 24, 32, "darkness")
    with pytest.raises(ValueError, match="at least one scene"):
        bias([], PercentageCloser(3))


@pytest.mark.parametrize("command", ["bias", "taps"])
def test_commands_write_json_from_their_quick_configs(command, tmp_path, capsys):
    config = tmp_path / "quick.toml"
    scenes = 'scenes = ["plate-over-plane"]\nwidth = 32\nheight = 24\nresolution = 32\n'
    config.write_text(scenes + ('test_scenes = ["two-plates"]\ntechnique = "hard"\n' if command == "taps" else ""))
    assert main(["optimize", command, "--config", str(config), "--json", "-"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["error"] > 0
    assert {"bias": "needed_slope", "taps": "chosen"}[command] in found


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["taps", "--scenes", "fence", "--test-scenes", "fence"], "both have fence"),
        (["bias", "--technique", "exact"], "needs shadow maps of one resolution each; got Exact"),
        (["bias", "--technique", "pcf33"], "did you mean"),
        (["exponent", "--technique", "esm3"], "did you mean"),
        (["bias", "--resolution", "0"], "--resolution must lie in [1, 16384]"),
    ],
)
def test_bad_input_exits_2_with_one_line(arguments, told, capsys):
    assert main(["optimize", *arguments]) == 2
    captured = capsys.readouterr()
    assert captured.err.strip().splitlines()[-1].startswith("shadowjax: ")
    assert told in captured.err
