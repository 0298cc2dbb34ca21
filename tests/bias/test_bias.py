"""Bias units: what they mean in the world, for every light, and that the slope unit is exact on planes."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from shapes import above, lights, plate_over_plane

from shadowjax import Bias
from shadowjax.bias.rule import MAX_SLOPE, depth_change, depth_slope, texel_size
from shadowjax.partitions.single import SingleMap
from shadowjax.warps.fit import PerspectiveFit

UP = jnp.asarray([0.0, 1.0, 0.0])
SPOTS = jnp.asarray([[0.5, 0.0, 0.25], [-1.0, 0.0, 2.0], [2.0, 0.0, -1.5]])


@pytest.mark.parametrize("kind", ["directional", "spot", "point"])
def test_slope_is_the_depth_change_of_the_plane_over_one_texel(kind):
    """Walk one texel along s and along t on the floor itself and measure the depth."""
    grid = SingleMap().grids(plate_over_plane(), lights()[kind], above(), 4096)[0]
    position, _ = grid.locate(SPOTS)
    change = 0.0
    for unit in ([0.5, 0.0], [0.0, 0.5]):
        on_floor = []
        for half in (jnp.asarray(unit), -jnp.asarray(unit)):
            origin, direction = grid.space.ray(grid.plane_map.inverse((position + half) / grid.resolution))
            on_floor.append(-origin[:, 1] / direction[:, 1])
        change = change + jnp.abs(on_floor[0] - on_floor[1])
    slope = depth_slope(grid, SPOTS, jnp.broadcast_to(UP, SPOTS.shape))
    np.testing.assert_allclose(slope, change, rtol=1e-5)


@pytest.mark.parametrize("kind", ["directional", "spot"])
def test_the_change_within_the_reach_bounds_that_of_the_bent_plane(kind):
    """Against the floor itself, followed to many places within 1.5 texels of a coarse warped map.

    Parallel light: exact where the bend adds to the slope. The distance to a lamp bends the other way everywhere.
    """
    grid = SingleMap(PerspectiveFit("psm")).grids(plate_over_plane(), lights()[kind], above(), 16)[0]
    normals = jnp.broadcast_to(UP, SPOTS.shape)
    position, depth = grid.locate(SPOTS)
    steps = jnp.stack(jnp.meshgrid(*[jnp.linspace(-1.5, 1.5, 13)] * 2), -1).reshape(-1, 1, 2)
    origin, direction = grid.space.ray(grid.plane_map.inverse((position + steps) / grid.resolution))
    nearer = jnp.max(depth + origin[..., 1] / direction[..., 1], axis=0)
    straight = 1.5 * depth_slope(grid, SPOTS, normals)
    np.testing.assert_allclose(depth_change(grid, SPOTS, normals, 1.5), jnp.maximum(nearer, straight), rtol=1e-9)
    assert np.all(nearer > 1.002 * straight) == (kind == "directional")


def test_texel_size_of_a_directional_map_is_the_same_everywhere():
    grid = SingleMap().grids(plate_over_plane(), lights()["directional"], above(), 64)[0]
    sides = (grid.plane_map.box.upper - grid.plane_map.box.lower) / 64
    np.testing.assert_allclose(texel_size(grid, SPOTS), np.full(3, np.max(sides)), rtol=1e-12)


def test_texel_size_of_a_spot_grows_with_distance():
    light = lights()["spot"]
    grid = SingleMap().grids(plate_over_plane(), light, above(), 64)[0]
    near, far = light.position + light.direction, light.position + 3 * light.direction
    sizes = texel_size(grid, jnp.stack([near, far]))
    np.testing.assert_allclose(sizes[0], 2 * np.tan(0.7) / 64, rtol=1e-12)
    np.testing.assert_allclose(sizes[1] / sizes[0], 3, rtol=1e-12)


def test_units_convert_to_world(dtype):
    grid = SingleMap().grids(plate_over_plane(dtype), lights(dtype)["directional"], above(dtype), 64)[0]
    points, normals = SPOTS.astype(dtype), jnp.broadcast_to(UP.astype(dtype), SPOTS.shape)
    np.testing.assert_allclose(Bias.create(0.25, "world").in_world(grid, points, normals), 0.25)
    np.testing.assert_allclose(
        Bias.create(2.0, "texel").in_world(grid, points, normals), 2 * texel_size(grid, points), rtol=1e-6
    )
    np.testing.assert_allclose(
        Bias.create(1.5, "slope").in_world(grid, points, normals), 1.5 * depth_slope(grid, points, normals), rtol=1e-6
    )


def test_slope_is_bounded_at_grazing_light_and_its_gradient_finite():
    grid = SingleMap().grids(plate_over_plane(), lights()["directional"], above(), 64)[0]
    sideways = jnp.cross(lights()["directional"].direction, UP)
    grazing = jnp.broadcast_to(sideways / jnp.linalg.norm(sideways), SPOTS.shape)
    slope = depth_slope(grid, SPOTS, grazing)
    assert np.isfinite(slope).all()
    np.testing.assert_allclose(slope, MAX_SLOPE * texel_size(grid, SPOTS), rtol=1e-12)
    gradient = jax.grad(lambda n: jnp.sum(depth_slope(grid, SPOTS, n)))(grazing)
    assert np.isfinite(gradient).all()
    value = jax.grad(lambda v: jnp.sum(Bias(v, "slope").in_world(grid, SPOTS, grazing)))(jnp.asarray(0.5))
    assert float(value) > 0
