"""Presets on the command line, and the picture of error against memory and time."""

import json

import numpy as np
import pytest
from PIL import Image

from shadowjax.cli.main import main
from shadowjax.plotting.pareto import front

SMALL = ["--width", "24", "--height", "18", "--resolution", "16", "--caster", "brute"]


def test_compare_takes_presets_keeps_its_keys_and_draws(tmp_path, capsys):
    target = tmp_path / "error.png"
    names = ["hard", "preset:three-js", "exact"]
    assert (
        main(["compare", "plate-over-plane", "--techniques", *names, *SMALL, "--pareto", str(target), "--json", "-"])
        == 0
    )
    records = json.loads(capsys.readouterr().out)
    assert [one["technique"] for one in records] == names
    kept = "technique rmse mean_abs_error false_lit false_shadow tones tones_bound map_bytes build_ms visibility_ms"
    for one in records:
        assert set(kept.split()) <= set(one)
        assert {"bleed", "acne", "flip", "texture_bytes", "ssim", "edge_distance"} <= set(one)
    assert records[0]["texture_bytes"] == 16 * 16 * 4
    assert records[2]["bleed"] == records[2]["acne"] == 0
    pixels = np.asarray(Image.open(target).convert("L"), float)
    assert all(part.std() > 1 for part in np.array_split(pixels, 2, axis=1))
    assert [path.name for path in tmp_path.iterdir()] == ["error.png"]


def test_presets_are_listed_and_exported(tmp_path, capsys):
    assert main(["presets"]) == 0
    assert "filament" in capsys.readouterr().out
    assert main(["presets", "mjp-evsm4"]) == 0
    told = capsys.readouterr().out
    assert "positive exponent" in told
    assert "no counterpart" in told
    target = tmp_path / "bevy.json"
    assert main(["presets", "bevy", "--json", str(target)]) == 0
    record = json.loads(target.read_text())
    assert record["engine"] == "bevy"
    assert {"name": "constant bias", "value": 0.02, "unit": "world units", "verified": True, "here": "Bias"} in record[
        "parameters"
    ]


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["presets", "filamint"], "did you mean filament"),
        (["compare", "plate-over-plane", "--techniques", "preset:godott"], "godot-4"),
        (["compare", "plate-over-plane", "--pareto", "error.svg"], "must end in .png"),
    ],
)
def test_bad_names_exit_2(arguments, told, capsys):
    assert main(arguments) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert told in error


def test_the_front_holds_what_nothing_beats():
    assert front([1, 2, 3, 4], [5.0, 3.0, 4.0, 1.0]) == [0, 1, 3]
    assert front([1, 1], [2.0, 1.0]) == [1]
