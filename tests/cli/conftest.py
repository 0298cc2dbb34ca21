"""Commands of these tests trace with the reference caster, which compiles quickest; a process takes the default."""

import pytest

from shadowjax.rays import casters


@pytest.fixture(autouse=True)
def quick_caster(monkeypatch):
    monkeypatch.setattr(casters, "DEFAULT_CASTER", "brute")
