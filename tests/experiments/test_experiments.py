"""Every figure runs quickly, all its claims hold, and its drawing shows something; bad configs are named."""

import dataclasses
import json
import re

import numpy as np
import pytest
from matplotlib.figure import Figure
from PIL import Image, ImageSequence

from experiments import EXPERIMENTS, Claim, Outcome, default_path, find, read_config
from experiments.__main__ import main

# Each takes less than ten seconds of processor time from an empty cache; the others build shadows of meshes.
ALWAYS = (
    "mdsm_fig_4_1", "mdsm_figs_4_7_to_4_11", "mdsm_fig_5_2", "mdsm_cost_5_6_to_5_8", "warping_fig_18", "warping_fig_19",
    "warping_fig_20", "warping_fig_22", "warping_fig_23", "warping_fig_26", "warping_partitions_needed",
    "warping_published_and_optimal", "warping_when_a_warp_hurts", "warping_errata", "filtering_figs_2_5_and_2_6",
    "filtering_fig_2_7", "filtering_figs_2_8_and_2_9", "filtering_xcsm_is_not_csm", "filtering_table_4_2",
    "filtering_tables_4_1_and_4_3",
)  # fmt: skip


def test_those_that_always_run_exist():
    assert set(ALWAYS) < set(EXPERIMENTS)


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[] if name in ALWAYS else pytest.mark.long) for name in EXPERIMENTS]
)
def test_quick_run_through_the_command_line(name, tmp_path, capsys):
    code = main([name, "--quick", "--out", str(tmp_path)])
    record = json.loads((tmp_path / f"{name}.json").read_text(encoding="utf-8"))
    assert [claim["name"] for claim in record["claims"] if not (claim["holds"] or claim["timed"])] == []
    assert len([claim for claim in record["claims"] if not claim["timed"]]) >= 2
    assert len(record["claims"]) >= 4
    assert code == 0
    assert set(record) == {"experiment", "config", "claims", "numbers"}
    told = capsys.readouterr().out
    assert all(claim["name"] in told for claim in record["claims"])
    pixels = np.asarray(Image.open(tmp_path / f"{name}.png").convert("L"), float)
    assert pixels.shape[0] >= 300
    assert pixels.shape[1] >= 600
    # Not blank anywhere: each ninth of the figure has ink.
    for band in np.array_split(pixels, 3, axis=0):
        for part in np.array_split(band, 3, axis=1):
            assert part.std() > 1
    moves = hasattr(EXPERIMENTS[name], "animate")
    written = [f"{name}.{kind}" for kind in (["gif"] if moves else []) + ["json", "png"]]
    assert sorted(path.name for path in tmp_path.iterdir()) == written
    if moves:
        assert (tmp_path / f"{name}.gif").stat().st_size <= 300_000
        with Image.open(tmp_path / f"{name}.gif") as movie:
            frames = [np.asarray(frame.convert("L"), float) for frame in ImageSequence.Iterator(movie)]
        assert len(frames) >= 5
        assert np.abs(frames[0] - frames[-1]).max() > 60


@pytest.mark.parametrize("name", list(EXPERIMENTS))
def test_config_files_hold_every_key_and_the_defaults(name):
    config_type = find(name).Config
    path = default_path(name)
    assert read_config(config_type, path) == config_type()
    assert read_config(config_type, path, quick=True) != config_type()
    written = {line.split("=")[0].strip() for line in path.read_text().split("[quick]")[0].splitlines() if "=" in line}
    assert written == {field.name for field in dataclasses.fields(config_type)}


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("max_element = 3", "unknown key 'max_element'"),
        ("max_elements = 'many'", "max_elements must be a whole number"),
        ("max_elements = true", "max_elements must be a whole number"),
        ("max_elements = 2.5", "max_elements must be a whole number"),
        ("max_elements = 0", "max_elements must be an integer of at least 1"),
        ("max_bits = 40", "max_bits must be at most 20"),
        ("num_levels = 3", "num_levels must be a list"),
        ("num_levels = [2, 'x']", "num_levels must be a whole number"),
        ("num_levels = []", "num_levels must hold at least one"),
        ("[quick]\nmax_elements = 0", "[quick]: max_elements"),
        ("quick = 3", "quick must be a table"),
        ("max_elements = = 3", "not valid TOML"),
    ],
)
def test_bad_configs_name_the_key_and_the_file(text, told, tmp_path, capsys):
    path = tmp_path / "wrong.toml"
    path.write_text(text)
    with pytest.raises(ValueError, match="wrong") as error:
        read_config(find("mdsm_fig_4_1").Config, path)
    assert told in str(error.value)
    assert main(["mdsm_fig_4_1", "--config", str(path), "--out", str(tmp_path / "out")]) == 2
    captured = capsys.readouterr()
    assert captured.err.count("\n") == 1
    assert told.split(":")[0] in captured.err
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["mdsm_fig_41"], "mdsm_fig_4_1"),
        (["all", "--config", "x.toml"], "--config belongs to one experiment"),
        (["mdsm_fig_4_1", "--config", "missing.toml"], "no such configuration file"),
        (["mdsm_fig_4_1", "--fast"], "--fast"),
        ([], "NAME"),
    ],
)
def test_bad_command_lines_exit_2_with_one_line(arguments, told, capsys):
    assert main(arguments) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.count("\n") == 1
    assert told in captured.err


def test_an_output_folder_keeps_what_it_holds_and_a_file_is_refused(tmp_path, capsys):
    kept = tmp_path / "mine.txt"
    kept.write_text("keep")
    assert main(["mdsm_fig_4_1", "--quick", "--out", str(tmp_path)]) == 0
    assert kept.read_text() == "keep"
    assert main(["mdsm_fig_4_1", "--quick", "--out", str(kept)]) == 2
    assert "mine.txt is a file" in capsys.readouterr().err


def test_a_failed_claim_exits_1(tmp_path, monkeypatch, capsys):
    module = find("mdsm_fig_4_1")
    claims = module.claims

    def one_fails(result):
        first, *others = claims(result)
        return (dataclasses.replace(first, holds=False), *others)

    monkeypatch.setattr(module, "claims", one_fails)
    assert main(["mdsm_fig_4_1", "--quick", "--out", str(tmp_path)]) == 1
    assert capsys.readouterr().out.count("FAILS") == 1
    record = json.loads((tmp_path / "mdsm_fig_4_1.json").read_text(encoding="utf-8"))
    assert [claim["holds"] for claim in record["claims"]].count(False) == 1


def test_a_claim_that_rests_on_a_clock_is_told_in_a_quick_run_and_judged_in_a_full_one():
    slow = Claim("faster", holds=False, value="×1.0", expected="×1.5", timed=True)
    right = Claim("equal", holds=True, value="0", expected="0")
    for quick in (True, False):
        outcome = Outcome("any", None, (slow, right), {}, Figure(), quick)
        assert outcome.passed is quick
    assert not Outcome("any", None, (dataclasses.replace(right, holds=False),), {}, Figure(), quick=True).passed


def test_settings_of_pictures_are_checked():
    config_type = find("mdsm_fig_5_2").Config
    with pytest.raises(ValueError, match="resolution must be an integer of at least 1; got 0"):
        config_type(resolution=0)
    with pytest.raises(ValueError, match="did you mean plant"):
        config_type(scene="plan")
    with pytest.raises(ValueError, match="num_triangles must lie between 400 and"):
        config_type(num_triangles=3)
    with pytest.raises(ValueError, match="a detail is"):
        config_type(detail=(0.5, 1.5, 0.2))
    with pytest.raises(ValueError, match="angle_step_deg must divide 90; got 7"):
        find("mdsm_figs_4_7_to_4_11").Config(angle_step_deg=7.0)
    with pytest.raises(ValueError, match="map_size must be a multiple of 64; got 100"):
        find("mdsm_cost_5_6_to_5_8").Config(map_size=100)


def test_a_detail_without_a_shadow_edge_exits_2(tmp_path, capsys):
    path = tmp_path / "sky.toml"
    quick = default_path("mdsm_fig_5_2").read_text().split("[quick]")[1]
    path.write_text(f"{quick}\ndetail = [0.1, 0.1, 0.05]\n")
    assert main(["mdsm_fig_5_2", "--config", str(path), "--out", str(tmp_path)]) == 2
    assert "the detail shows no shadow edge" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("name", "settings", "told"),
    [
        ("warping_fig_19", {"near": 0.0}, "0 < near < far; got 0.0 and 100.0"),
        ("warping_fig_19", {"rows": 32}, "rows must exceed far/(2·near); got 32"),
        ("warping_fig_20", {"phi_deg": 90.0}, "strictly between 0 and 90; got 90.0"),
        ("warping_fig_23", {"gammas_deg": (90.0, 91.0)}, "must lie in [0, 90]; got 91.0"),
        ("warping_fig_26", {"partitions": (2, 1)}, "partitions must begin with 1"),
        ("warping_fig_27", {"gamma_deg": 24.0}, "gamma_deg must lie below phi_deg; got 24.0"),
        ("warping_partitions_needed", {"factor": 1.0}, "nothing beats the least possible; got 1.0"),
        ("warping_aliasing_maps", {"resolution": 65}, "resolution must be even; got 65"),
    ],
)
def test_settings_of_views_are_checked(name, settings, told):
    with pytest.raises(ValueError, match=re.escape(told)):
        find(name).Config(**settings)
