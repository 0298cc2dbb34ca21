"""Bands of rows are the whole grid, bit for bit, in memory and on disk; what does not fit is refused beforehand."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from shapes import random_soup

from shadowjax import BruteForceCaster, _checks
from shadowjax.geometry.light_space import PerspectiveSpace
from shadowjax.rays.bands import depth_bands, depth_by_bands, row_band
from shadowjax.rays.bvh.caster import BvhCaster
from shadowjax.rays.grid.caster import GridCaster
from shadowjax.rays.plane_map import Box
from shadowjax.rays.ray_grid import RayGrid

ROWS, COLS = 21, 12
whole_depth = eqx.filter_jit(lambda caster, mesh, grid: caster.depth_on_grid(mesh, grid))


def whole_grid(dtype=jnp.float32) -> RayGrid:
    box = Box(jnp.asarray([-0.7, 0.9], dtype), jnp.asarray([0.8, -0.75], dtype))
    space = PerspectiveSpace(jnp.asarray([0.2, 0.1, -3.0], dtype), jnp.eye(3, dtype=dtype))
    return RayGrid(space, box, jnp.asarray(9.0, dtype), ROWS, COLS)


@pytest.mark.parametrize("caster", ["brute", "bvh", "grid"])
def test_bands_are_the_whole_map_bit_for_bit(caster, tmp_path):
    mesh, grid = random_soup(50, 1, jnp.float32), whole_grid()
    made = {"brute": BruteForceCaster(), "bvh": BvhCaster.build(mesh), "grid": GridCaster()}[caster]
    expected = np.asarray(whole_depth(BruteForceCaster(), mesh, grid))
    assert np.mean(expected < 9) > 0.1
    bands = dict(depth_bands(made, mesh, grid, rows=8))
    assert {start: len(band) for start, band in bands.items()} == {0: 8, 8: 8, 16: 5}
    if caster == "grid":
        # It takes depth from a triangle's plane in cells of the grid, which rounds differently.
        np.testing.assert_allclose(np.concatenate(list(bands.values())), expected, rtol=1e-5)
    else:
        np.testing.assert_array_equal(np.concatenate(list(bands.values())), expected)
        disk = np.lib.format.open_memmap(tmp_path / "depth.npy", "w+", np.float32, (ROWS, COLS))
        assert depth_by_bands(made, mesh, grid, disk, rows=8) is disk
        np.testing.assert_array_equal(np.load(tmp_path / "depth.npy"), expected)


def test_a_band_has_exactly_the_rays_of_the_whole(dtype):
    grid = whole_grid(dtype)
    directions = eqx.filter_jit(lambda grid: grid.rays().directions)
    whole = directions(grid)

    @eqx.filter_jit
    def found_again(band):
        points = band.space.point(band.plane_map.inverse(band.centres()), jnp.full((band.num_rows, COLS), 2, dtype))
        return band.locate(points)[0], band.centres() * band.resolution

    for first, num in ((0, 16), (5, 16), (20, 1)):
        band = row_band(grid, first, num)
        np.testing.assert_array_equal(directions(band), whole[first : first + num])
        np.testing.assert_allclose(*found_again(band), atol=1e-4)


def test_what_does_not_fit_is_said_before_it_is_tried(monkeypatch):
    mesh, grid = random_soup(50, 1, jnp.float32), whole_grid()
    huge = RayGrid(grid.space, grid.plane_map, grid.far, 2**14, 2**14)
    monkeypatch.setattr(_checks, "available_memory", lambda: 2**29)
    with pytest.raises(ValueError, match=r"16384 × 16384 needs about 1.0 GiB, and 0.5 GiB are left; use .*`out`"):
        depth_by_bands(BruteForceCaster(), mesh, huge)
    with pytest.raises(ValueError, match="fewer rows in a band"):
        next(depth_bands(BruteForceCaster(), mesh, huge, rows=1024))
    monkeypatch.setattr(_checks, "available_memory", lambda: 2**10)
    with pytest.raises(ValueError, match="a tree over 50 triangles needs about"):
        BvhCaster.build(mesh)


def test_bands_refuse_wrong_sizes():
    mesh, grid = random_soup(50, 1, jnp.float32), whole_grid()
    with pytest.raises(ValueError, match="power of two: rays are exact then; got 12"):
        next(depth_bands(BruteForceCaster(), mesh, grid, rows=12))
    with pytest.raises(ValueError, match=r"rows 20 to 22 do not fit a grid of 21 rows"):
        row_band(grid, 20, 2)
    with pytest.raises(ValueError, match=r"shape of the grid, \(21, 12\); got \(3, 3\)"):
        depth_by_bands(BruteForceCaster(), mesh, grid, np.zeros((3, 3), np.float32))
