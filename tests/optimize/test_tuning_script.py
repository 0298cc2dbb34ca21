"""The tuning script of the documentation: short, from one import, and it writes what it says."""

import json
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PYRAMID = "v 0 0 0\nv 2 0 0\nv 2 0 2\nv 0 0 2\nv 1 1.5 1\nf 2 1 5\nf 3 2 5\nf 4 3 5\nf 1 4 5\n"


def script():
    page = (ROOT / "docs" / "optimize.md").read_text()
    (found,) = (code for code in re.findall(r"^```python\n(.*?)^```", page, re.M | re.S) if "load_scene" in code)
    return found


def test_the_tuning_script_is_short():
    lines = [line for line in script().splitlines() if line.strip()]
    assert len(lines) <= 25
    assert sum(line.startswith(("import ", "from ")) for line in lines) <= 2


@pytest.mark.long
def test_the_tuning_script_runs(tmp_path):
    (tmp_path / "scene.obj").write_text(PYRAMID)
    ran = subprocess.run(
        [sys.executable, "-c", script()], cwd=tmp_path, capture_output=True, text=True, check=False,
        env={"PYTHONPATH": str(ROOT), "PATH": "", "MPLBACKEND": "agg", "HOME": str(tmp_path)},
    )  # fmt: skip
    assert ran.returncode == 0, ran.stderr
    assert (tmp_path / "comparison.png").read_bytes().startswith(b"\x89PNG")
    read = {path.stem: json.loads(path.read_text()) for path in tmp_path.glob("*.json")}
    assert len(read["maps"]["splits"]) == 5
    assert read["maps"]["certificate"]["seam_jump"] <= 2.0 + 1e-6
    assert read["bias"]["error"] <= read["bias"]["default_error"]
    assert len(read["sweep"]["near_distance"]) == 4
    errors = {record["technique"]: record["light_rmse"] for record in read["comparison"]}
    assert set(errors) == {"tuned", "one map", "cascades", "godot"}
    assert errors["tuned"] < errors["one map"]
