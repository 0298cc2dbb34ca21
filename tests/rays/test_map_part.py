"""The box around what lies on a map's rays: holds every point there, and is tight; rays start and end outside it."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from shapes import random_soup

from shadowjax import Camera, DirectionalLight, Mesh, PointLight, SpotLight
from shadowjax.geometry.light_space import DirectionalSpace, OctahedralSpace, PerspectiveSpace
from shadowjax.geometry.transforms import view_frame
from shadowjax.rays.map_part import part_on_map, seen_space, starting_outside
from shadowjax.rays.plane_map import Box
from shadowjax.warps.perspective import PerspectiveWarp

SPACES = {
    "parallel": lambda f, dtype: DirectionalSpace(jnp.asarray([0.2, 0.1, -0.3], dtype), f),
    "perspective": lambda f, dtype: PerspectiveSpace(jnp.asarray([0.1, 0.2, -2.0], dtype), f),
}
MAPS = {
    "box": lambda dtype: Box(jnp.asarray([-0.3, -0.2], dtype), jnp.asarray([0.4, 0.5], dtype)),
    "warp": lambda dtype: PerspectiveWarp.fit(
        jnp.asarray([[-0.3, -0.2], [0.4, -0.2], [0.6, 0.5], [-0.5, 0.5]], dtype), 1.5
    ),
}


def on_triangles(mesh, count):
    """Many points of each triangle, its corners and edges among them."""
    weights = np.random.default_rng(0).dirichlet([0.5] * 3, count)
    edges = np.linspace(0, 1, 40)
    rims = [np.roll(np.stack([edges, 1 - edges, 0 * edges], 1), k, 1) for k in range(3)]
    weights = np.concatenate([weights, *rims])
    return np.einsum("pk,fkx->fpx", weights, np.asarray(mesh.triangles(), float)).reshape(-1, 3)


@pytest.mark.parametrize("space", SPACES)
@pytest.mark.parametrize("plane_map", MAPS)
def test_the_box_is_that_of_all_points_on_the_rays(space, plane_map, dtype):
    frame = view_frame(jnp.asarray([0.1, -0.2, 1.0], dtype), jnp.asarray([0.0, 1.0, 0.0], dtype))
    rays, region = SPACES[space](frame, dtype), MAPS[plane_map](dtype)
    mesh = random_soup(30, 3, dtype)
    lower, upper = (np.asarray(corner + rays.source) for corner in part_on_map(rays, region, mesh))
    points = on_triangles(mesh, 20000)
    square = np.asarray(region.forward(rays.project(jnp.asarray(points, dtype))[0]))
    held = points[np.all((square > 0) & (square < 1), axis=-1)]
    assert len(held) > 1000
    assert np.all(held >= lower - 1e-5)
    assert np.all(held <= upper + 1e-5)
    # the region is taken a hundredth wider, and samples end a little before the extremes
    size = np.max(held, axis=0) - np.min(held, axis=0)
    assert np.all(np.min(held, axis=0) - lower < 0.06 * size)
    assert np.all(upper - np.max(held, axis=0) < 0.06 * size)


def test_a_wide_ground_counts_as_far_as_the_map_reaches():
    light = DirectionalLight.create((0.5, -1.0, 0.75), dtype=jnp.float32)
    camera = Camera.look_at((3.0, 4, 5), (0.0, 0, 0), phi_y=0.35, near=1, far=20, dtype=jnp.float32)
    found = []
    for half in (1e2, 1e4, 1e6):
        corners = half * np.array([[-1, 0, -1], [1, 0, -1], [1, 0, 1], [-1, 0, 1]], float)
        mesh = Mesh.create(corners, np.array([[0, 2, 1], [0, 3, 2]]), dtype=jnp.float32)
        space = seen_space(light, mesh, camera)
        size = jnp.asarray([3.0, 3.0], jnp.float32)
        grid = starting_outside(space, Box(-size, size), mesh, 8)
        depth = np.asarray(grid.space.project(jnp.zeros((1, 3), jnp.float32))[1])
        assert 0 < depth < float(grid.far)
        found.append(float(grid.far))
    # to the rounding of a thousand kilometres
    assert found[0] < 20
    assert max(found) < 30


def test_nothing_on_the_rays_or_bent_rays_take_the_whole_mesh():
    mesh = random_soup(5, 3, jnp.float32)
    lower, upper = mesh.bounds()
    frame = jnp.eye(3, dtype=jnp.float32)
    far_off = Box(jnp.asarray([50.0, 50.0], jnp.float32), jnp.asarray([51.0, 51.0], jnp.float32))
    for space in (DirectionalSpace(jnp.zeros(3, jnp.float32), frame), OctahedralSpace(jnp.zeros(3, jnp.float32))):
        for found, expected in zip(part_on_map(space, far_off, mesh), (lower, upper), strict=True):
            np.testing.assert_array_equal(found, expected)


@pytest.mark.parametrize("kind", ["directional", "spot", "point"])
def test_the_grid_of_a_whole_scene_has_finite_gradients(kind):
    soup = random_soup(30, 3, jnp.float32)
    camera = Camera.look_at((3.0, 4, 5), (0.0, 0, 0), phi_y=0.35, near=1, far=20, dtype=jnp.float32)
    light = {
        "directional": lambda: DirectionalLight.create((0.5, -1.0, 0.75), dtype=jnp.float32),
        "spot": lambda: SpotLight.create((0.0, 4.0, 0.0), (0.1, -1.0, 0.0), 0.6, dtype=jnp.float32),
        "point": lambda: PointLight.create((0.0, 4.0, 0.0), dtype=jnp.float32),
    }[kind]()
    size = jnp.asarray([0.3, 0.3], jnp.float32)

    def far(points):
        mesh = eqx.tree_at(lambda m: m.vertices, soup, points)
        return starting_outside(seen_space(light, mesh, camera), Box(-size, size), mesh, 8).far

    slope = jax.jit(jax.grad(far))(soup.vertices)
    assert bool(jnp.all(jnp.isfinite(slope)))
    assert float(jnp.max(jnp.abs(slope))) > 0
