"""The registry of casters."""

import pytest
from shapes import random_soup

from shadowjax import BruteForceCaster
from shadowjax.rays.bvh.caster import BvhCaster
from shadowjax.rays.caster import Caster
from shadowjax.rays.casters import CASTERS, DEFAULT_CASTER, default_caster, make_caster
from shadowjax.rays.grid.caster import GridCaster, tree_is_faster


def test_every_entry_makes_a_caster_and_the_default_is_one():
    assert all(isinstance(make(), Caster) for make in CASTERS.values())
    assert type(default_caster()) is type(CASTERS[DEFAULT_CASTER]())


def test_an_unknown_name_is_said():
    with pytest.raises(ValueError, match="caster must be one of 'brute'"):
        make_caster("slow")


def test_bent_rays_go_to_a_tree_where_building_one_is_worth_it():
    """A map of a point light over thousands of triangles takes half a minute by brute force."""
    many, few = 1024 * 1024, 64
    assert tree_is_faster(3624, many)
    assert tree_is_faster(80, many)
    assert not tree_is_faster(12, many)
    assert not tree_is_faster(1282, few)
    grid = GridCaster()
    assert isinstance(grid._others(random_soup(200, 0), many), BvhCaster)
    assert isinstance(grid._others(random_soup(200, 0), few), BruteForceCaster)
    assert grid.prepared(random_soup(200, 0)).others.tree is not None
