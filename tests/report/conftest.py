"""A small report that several tests look at, made once."""

import pytest

from shadowjax.rays.brute import BruteForceCaster
from shadowjax.report import ReportSettings, collect
from shadowjax.scenes import make_scene

TINY = ReportSettings(
    techniques=("hard", "pcf-2x2", "3sm", "exact"), width=32, height=24, resolution=24, equations=("asm",), sweep=False
)


@pytest.fixture(scope="session")
def findings():
    steps = []
    # The reference caster compiles quickest, and all casters give the same pictures.
    scene, command = make_scene("sphere-over-plane"), "shadowjax report sphere-over-plane"
    found = collect(scene, TINY, command, BruteForceCaster(), steps.append)
    assert "hard at 24²" in steps
    return found
