"""The registry of casters."""

import pytest

from shadowjax.rays.caster import Caster
from shadowjax.rays.casters import CASTERS, DEFAULT_CASTER, default_caster, make_caster


def test_every_entry_makes_a_caster_and_the_default_is_one():
    assert all(isinstance(make(), Caster) for make in CASTERS.values())
    assert type(default_caster()) is type(CASTERS[DEFAULT_CASTER]())


def test_an_unknown_name_is_said():
    with pytest.raises(ValueError, match="caster must be one of 'brute'"):
        make_caster("slow")
