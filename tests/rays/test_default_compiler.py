"""The casters with the code generator that users get: the rest of the suite runs with one that compiles faster."""

import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]
EMITTERS = "--xla_cpu_use_fusion_emitters"
# The edge rule, random scenes of every bad kind, and shadows through lattices.
CHOSEN = (
    "test_edge_rule.py",
    "test_soups.py",
    "test_grid.py::test_rays_exactly_through_lattice_vertices_and_edges_do_not_leak",
)


def test_edges_scenes_and_leaks():
    others = [flag for flag in os.environ.get("XLA_FLAGS", "").split() if not flag.startswith(EMITTERS)]
    flags = " ".join([*others, f"{EMITTERS}=true"])
    words = ["-m", "pytest", "-q", "-p", "no:xdist", *(str(ROOT / "tests" / "rays" / name) for name in CHOSEN)]
    environment = {name: value for name, value in os.environ.items() if not name.startswith(("PYTEST_", "JAX_DISABLE"))}
    done = subprocess.run(
        [sys.executable, *words],
        cwd=ROOT,
        env={**environment, "XLA_FLAGS": flags},
        capture_output=True,
        text=True,
        timeout=500,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
