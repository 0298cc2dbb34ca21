"""The second layer of depth on a box over a floor, where every layer is known; footprints against differences."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
import trimesh
from shapes import above, lights

from shadowjax import BruteForceCaster, Mesh, build_shadow_map, camera_grid, make_technique
from shadowjax.partitions.single import SingleMap
from shadowjax.rays.ray_grid import pixel_footprint


def box_over_floor():
    """A 2 × 2 × 0.5 box whose bottom lies 1 above an 8 × 8 floor."""
    box = trimesh.creation.box((2, 0.5, 2), trimesh.transformations.translation_matrix((0, 1.25, 0)))
    floor = np.array([[-4, 0, -4], [4, 0, -4], [4, 0, 4], [-4, 0, 4]], float)
    faces = np.concatenate([box.faces, np.array([[0, 2, 1], [0, 3, 2]]) + len(box.vertices)])
    return Mesh.create(np.concatenate([box.vertices, floor]), faces, dtype=jnp.float64)


@pytest.fixture(scope="module")
def layers():
    mesh, light = box_over_floor(), lights()["directional"]
    (grid,) = SingleMap().grids(mesh, light, above(), 24)
    return grid, {name: build_shadow_map(BruteForceCaster(), mesh, grid, name) for name in ("first", "second", "back")}


def test_layers_of_a_box(layers):
    """Behind the box's top or side comes its far side; behind the floor nothing."""
    grid, maps = layers
    first, second, back = (np.asarray(maps[name].depth) for name in ("first", "second", "back"))
    on_box = (np.asarray(maps["first"].face) >= 0) & (np.asarray(maps["first"].face) < 12)
    assert 20 < on_box.sum() < 200
    assert np.all(second[on_box] > first[on_box])
    np.testing.assert_array_equal(np.asarray(maps["second"].face)[on_box] < 12, True)
    np.testing.assert_allclose(back[on_box], second[on_box], rtol=1e-12)
    floor = np.asarray(maps["first"].face) >= 12
    np.testing.assert_array_equal(second[floor], float(grid.far))


def test_second_depth_shadows_a_closed_box_without_bias():
    """The shadow on the floor is that of the first layer; the floor and the top are lit without any bias."""
    mesh, camera, light = box_over_floor(), above(), lights()["directional"]
    spots = jnp.asarray([[0.4, 0.0, -0.2], [3.0, 0.0, 3.0], [-2.9, 0.0, -2.0], [0.0, 1.5, 0.0]])
    normals = jnp.broadcast_to(jnp.asarray([0.0, 1.0, 0.0]), spots.shape)
    shadows = make_technique("second-depth", 24).build(mesh, light, camera)
    assert float(shadows.bias.value) == 0
    np.testing.assert_array_equal(eqx.filter_jit(shadows.visibility)(spots, normals), [0, 1, 1, 1])


def test_footprints_are_the_jacobian_of_map_position_over_pixels(layers):
    """Against rays of neighbouring pixels that meet the floor's plane."""
    grid, _ = layers
    view = camera_grid(above(), 32, 24)
    place, step = jnp.asarray([17.3, 15.2]), 1e-4

    def on_floor(at):
        rays = view.rays_at(at / view.resolution)
        return rays.at(-rays.origins[..., 1] / rays.directions[..., 1])

    point = on_floor(place)
    found = pixel_footprint(view, grid, point, jnp.asarray([0.0, 1.0, 0.0]))
    steps = [jnp.asarray([step, 0.0]), jnp.asarray([0.0, step])]
    columns = [(grid.locate(on_floor(place + s))[0] - grid.locate(on_floor(place - s))[0]) / (2 * step) for s in steps]
    np.testing.assert_allclose(found, jnp.stack(columns, axis=-1), rtol=1e-6)
