"""The command as a user runs it: its own process, float32, no settings of the tests."""

import json
import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]


def shadowjax(*words, **environment):
    kept = {key: value for key, value in os.environ.items() if not key.startswith(("JAX_", "SHADOWJAX_"))}
    return subprocess.run(
        [sys.executable, "-m", "shadowjax", *words],
        cwd=ROOT,
        env={**kept, **environment},
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )


def test_report_of_a_mesh_file(tmp_path):
    mesh = tmp_path / "roof <b>.obj"
    mesh.write_text("v 0 0 0\nv 2 0 0\nv 2 0 2\nv 0 0 2\nv 1 1.5 1\nf 2 1 5\nf 3 2 5\nf 4 3 5\nf 1 4 5\n")
    out = tmp_path / "out"
    done = shadowjax(
        "report", str(mesh), "--out", str(out), "--width", "32", "--height", "24", "--resolution", "24",
        "--techniques", "hard", "--equations", "none", "--no-sweep", "--caster", "brute",
        JAX_COMPILATION_CACHE_DIR=str(ROOT / ".jax_cache"),
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip() == str(out / "index.html")
    assert "hard at 24²" in done.stderr
    results = json.loads((out / "results.json").read_text())
    assert results["machine"]["dtype"] == "float32"
    assert results["scene"]["triangles"] == 4 + 12
    assert results["records"][0]["map_bytes"] == 24 * 24 * 4
    assert results["records"][0]["false_lit"] < 0.1
    page = (out / "index.html").read_text()
    assert "<b>" not in page
    assert "roof &lt;b&gt;.obj" in page


def test_bad_input_is_one_line_and_code_two():
    done = shadowjax("render", "none.obj", "-o", "x.png")
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == "shadowjax: no such mesh file: none.obj\n"


def test_importing_touches_no_device():
    """Whoever imports the package may still choose precision, platform and number of devices."""
    program = (
        "import shadowjax, shadowjax.cli, jax; "
        "jax.config.update('jax_num_cpu_devices', 2); print(jax.device_count('cpu'))"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, timeout=300, check=False
    )
    assert done.stdout == "2\n", done.stderr


def test_the_package_loads_jax_when_it_is_asked_for():
    """Help, versions and refused options need none of it; every public name is there all the same."""
    program = (
        "import sys, shadowjax, shadowjax.__main__, shadowjax.cli, shadowjax.cli.options, experiments.__main__; "
        "assert 'jax' not in sys.modules; "
        "names = [getattr(shadowjax, name) for name in shadowjax.__all__]; assert 'jax' in sys.modules; "
        "assert set(shadowjax.__all__) <= set(dir(shadowjax)); assert not hasattr(shadowjax, 'nothing'); "
        "from shadowjax import *; assert Mesh is shadowjax.geometry.mesh.Mesh"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, timeout=300, check=False
    )
    assert done.returncode == 0, done.stderr
