"""The commands in this process, on tiny pictures: what they write and the codes they return."""

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from shadowjax.cli import main
from shadowjax.cli.main import COMMANDS
from shadowjax.ledger import equation
from shadowjax.scenes import SCENES

TINY = ["--width", "32", "--height", "24", "--resolution", "24"]
RECORD = [
    "technique", "rmse", "mean_abs_error", "false_lit", "false_shadow", "tones", "tones_bound", "map_bytes", "build_ms",
    "visibility_ms",
]  # fmt: skip


def test_help_lists_every_command(capsys):
    assert main(["--help"]) == 0
    shown = capsys.readouterr().out
    assert all(name in shown for name in COMMANDS)
    assert main([]) == 2


@pytest.mark.parametrize("name", list(COMMANDS))
def test_every_command_has_help(name, capsys):
    assert main([*name.split(), "--help"]) == 0
    assert "--json" in (shown := capsys.readouterr().out) or "--out" in shown


def test_scenes(capsys, tmp_path):
    assert main(["scenes"]) == 0
    shown = capsys.readouterr().out
    assert all(name in shown for name in SCENES)
    assert main(["scenes", "--json", "-"]) == 0
    assert [one["name"] for one in json.loads(capsys.readouterr().out)] == list(SCENES)


def test_render_writes_and_replaces_a_picture(tmp_path, capsys):
    target = tmp_path / "new" / "picture.png"
    words = ["render", "sphere-over-plane", "--technique", "hard", "--samples", "1", *TINY, "-o", str(target)]
    for _ in range(2):
        assert main(words) == 0
    assert str(target) in capsys.readouterr().out
    image = np.asarray(Image.open(target))
    assert image.shape == (24, 32, 3)
    assert image.std() > 10
    assert [path.name for path in target.parent.iterdir()] == ["picture.png"]


def test_compare_writes_a_record_for_each_technique(tmp_path, capsys):
    target = tmp_path / "records.json"
    words = ["compare", "sphere-over-plane", "--techniques", "hard", "pcf-2x2", *TINY]
    assert main([*words, "--json", str(target)]) == 0
    assert "pcf-2x2" in capsys.readouterr().out
    records = json.loads(target.read_text())
    assert [record["technique"] for record in records] == ["hard", "pcf-2x2"]
    assert all(list(record)[: len(RECORD)] == RECORD for record in records)
    assert main([*words, "--json", "-"]) == 0
    out, err = capsys.readouterr()
    assert [record["technique"] for record in json.loads(out)] == ["hard", "pcf-2x2"]
    assert "pcf-2x2" in err  # progress goes to standard error


def test_report_writes_page_and_results(tmp_path, capsys):
    (tmp_path / "mine.txt").write_text("keep")
    words = ["report", "sphere-over-plane", "--techniques", "hard", "pcf-2x2", "--equations", "none", "--no-sweep"]
    assert main([*words, *TINY, "--out", str(tmp_path)]) == 0
    assert sorted(path.name for path in tmp_path.iterdir()) == ["index.html", "mine.txt", "results.json"]
    results = json.loads((tmp_path / "results.json").read_text())
    assert results["equations"] == []
    assert results["command"] == " ".join(["shadowjax", *words[:2], "--out", str(tmp_path), *words[2:], *TINY])


def test_verify_writes_the_ledgers_results(capsys, tmp_path):
    assert main(["verify", "--only", "asm", "--json", "-"]) == 0
    (only,) = json.loads(capsys.readouterr().out).items()
    assert only[0] == "equations"
    wanted = [name for name in equation.ledger() if name.startswith("asm")]
    assert [one["id"] for one in only[1]] == wanted
    assert set(only[1][0]) == {"id", "source", "verdict", "passed", "kind", "checks"}
    assert {one["verdict"] for one in only[1]} <= {"holds", "conditional", "erratum"}


def test_a_failed_equation_is_exit_one(capsys, monkeypatch):
    right = equation.verify

    def wrong(chosen, progress=None):
        return [
            equation.Result(r.id, r.source, r.verdict, False, r.kind, r.checks)
            for r in right(list(chosen)[:1], progress)
        ]

    monkeypatch.setattr(equation, "verify", wrong)
    assert main(["verify", "--only", "asm"]) == 1
    out, err = capsys.readouterr()
    assert "FAILED" in out
    assert "failed" in err


def test_optimize_near_distance(capsys, tmp_path):
    target = tmp_path / "n.json"
    words = ["optimize", "near-distance", "--near", "1", "--far", "100", "--gamma-deg", "90", "--phi-deg", "30"]
    assert main([*words, "--json", str(target)]) == 0
    answer = json.loads(target.read_text())
    assert list(answer) == ["near_distance", "error", "published", "gain", "certificate"]
    np.testing.assert_allclose(answer["near_distance"], 1 + 100**0.5, rtol=1e-8)  # with the light overhead: n + √(fn)


def test_optimize_splits(capsys):
    assert main(["optimize", "splits", "--near", "1", "--far", "81", "--num-partitions", "4", "--json", "-"]) == 0
    answer = json.loads(capsys.readouterr().out)
    np.testing.assert_allclose(answer["splits"], [1, 3, 9, 27, 81], rtol=1e-7)
    assert answer["storage"] > 0


def test_configuration_file_and_flags_over_it(tmp_path, capsys):
    config = tmp_path / "n.toml"
    config.write_text('near = 2\nfar = 50.0\nphi_deg = 30\nsection = "axis"\n[quick]\nfar = 3\n')
    words = ["optimize", "near-distance", "--json", "-", "--config", str(config)]
    assert main(words) == 0
    np.testing.assert_allclose(json.loads(capsys.readouterr().out)["near_distance"], 12, rtol=1e-8)
    assert main([*words, "--far", "32"]) == 0
    np.testing.assert_allclose(json.loads(capsys.readouterr().out)["near_distance"], 10, rtol=1e-8)


@pytest.mark.parametrize("name", ["near-distance", "splits"])
def test_configurations_of_the_repository_are_good(name, capsys):
    """Each file of configs for an optimisation is read, and its limits hold in the answer."""
    config = Path(__file__).resolve().parents[2] / "configs" / f"optimize_{name.replace('-', '_')}.toml"
    assert main(["optimize", name, "--config", str(config), "--json", "-"]) == 0
    answer = json.loads(capsys.readouterr().out)
    if name == "splits":
        assert set(answer) == {
            "splits", "storage", "near_distances", "baselines", "gain", "certificate", "result",
        }  # fmt: skip
        assert answer["certificate"]["seam_jump"] <= 1.5 * (1 + 1e-6)
        assert answer["certificate"]["residual"] < 1e-6
    else:
        np.testing.assert_allclose(answer["gain"], 1.502231, rtol=1e-6)
