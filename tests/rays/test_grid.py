"""The grid caster against brute force: views, maps, degenerate and straddling triangles, leaks, gradients, vmap."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import trimesh
from grids import COLS, ROWS, brute, fast, jitted_fast, padded, turned, views
from shapes import bumpy_sphere, random_soup

from shadowjax import Mesh
from shadowjax.geometry.light_space import DirectionalSpace, OctahedralSpace
from shadowjax.rays.grid.caster import GridCaster
from shadowjax.rays.plane_map import Box
from shadowjax.rays.ray import intersect
from shadowjax.rays.ray_grid import RayGrid


def assert_agrees(mesh: Mesh, grid: RayGrid, rounding: float, exact: bool = True):
    """Same face, or the same depth; on a silhouette (`exact` off) rounding may decide a few rays either way."""
    hit, depth = fast(mesh, grid)
    expected = brute(mesh, grid)
    tolerance = 20 * rounding * float(jnp.maximum(mesh.extent, grid.far))
    same = (np.asarray(hit.face) == np.asarray(expected.face)) | (
        np.abs(np.asarray(hit.depth) - np.asarray(expected.depth)) <= tolerance
    )
    assert (~same).sum() <= (0 if exact else 1e-3 * same.size)
    np.testing.assert_allclose(depth, hit.depth, atol=tolerance, rtol=0)
    return hit


# Warps in one dtype: what differs between dtypes is in the boxes, which both share.
@pytest.mark.parametrize("name", list(views(jnp.float32)))
def test_agrees_with_brute_force(name, dtype, rounding):
    if dtype == jnp.float64 and "warp" in name:
        pytest.skip("maps are the same for both dtypes")
    grid = views(dtype)[name]
    hits = [assert_agrees(random_soup(61, seed, dtype), grid, rounding).is_hit for seed in (1, 2)]
    assert 0.2 < float(jnp.mean(jnp.stack(hits))) <= 1


def test_many_small_triangles_agree():
    """Triangles around and below the size of a cell, most of them hitting no ray."""
    dtype, rounding = jnp.float32, 2e-6
    big = random_soup(400, 3, dtype)
    corners = big.triangles()
    middle = jnp.mean(corners, axis=1, keepdims=True)
    small = Mesh.create((middle + 0.08 * (corners - middle)).reshape(-1, 3), big.faces)
    for name in ("parallel", "perspective", "logarithmic warp"):
        hit = assert_agrees(small, views(dtype)[name], rounding)
        assert 0.02 < float(jnp.mean(hit.is_hit)) < 0.9


def test_point_light_falls_back():
    dtype = jnp.float32
    mesh = random_soup(61, 1, dtype)
    space = OctahedralSpace(jnp.asarray([0.1, 0.2, 0.05], dtype))
    whole = Box(jnp.asarray([-1.0, -1.0], dtype), jnp.asarray([1.0, 1.0], dtype))
    grid = RayGrid(space, whole, jnp.asarray(40.0, dtype), ROWS, COLS)
    want = brute(mesh, grid)
    assert 0.2 < float(jnp.mean(want.is_hit)) <= 1
    found = GridCaster().closest_on_grid(padded(mesh), grid)
    depth, face = GridCaster().faces_on_grid(padded(mesh), grid)
    for got in (found.face, face):
        np.testing.assert_array_equal(got, want.face)
    for got in (found.depth, depth, GridCaster().depth_on_grid(padded(mesh), grid)):
        np.testing.assert_allclose(got, want.depth, rtol=4e-6)


@pytest.mark.parametrize("where", ["perspective inside", "parallel inside"])
def test_closed_mesh_leaks_no_ray(where, dtype):
    """From inside a closed body every ray hits, also of a view whose start cuts the triangles."""
    mesh = bumpy_sphere(dtype)
    grid = views(dtype)[where]
    for seed in range(20):
        frame = turned(seed, dtype)
        plane_map = Box(jnp.asarray([-0.3, -0.3], dtype), jnp.asarray([0.3, 0.3], dtype))
        turned_grid = eqx.tree_at(lambda g: (g.space.frame, g.plane_map), grid, (frame, plane_map))
        hit, _ = fast(mesh, turned_grid)
        assert int(jnp.sum(~hit.is_hit)) == 0


def test_rays_exactly_through_lattice_vertices_and_edges_do_not_leak(dtype):
    """Cell centres on the vertices, edges and diagonals of a subdivided cube: nothing but ties."""
    cube = trimesh.creation.box().subdivide().subdivide()
    mesh = Mesh.create(cube.vertices * 2, cube.faces, dtype=dtype)
    reach = jnp.asarray([COLS / 16, ROWS / 16], dtype) / 2
    for shift in (0.0, 1 / 32):
        offset = jnp.asarray([shift, shift], dtype)
        box = Box(-reach + offset, reach + offset)
        down = DirectionalSpace(jnp.asarray([0.0, 0.0, 0.0], dtype), jnp.eye(3, dtype=dtype))
        grid = RayGrid(down, box, jnp.asarray(9.0, dtype), ROWS, COLS)
        hit, depth = fast(mesh, grid)
        np.testing.assert_array_equal(hit.depth, np.ones((ROWS, COLS)))
        np.testing.assert_array_equal(depth, np.ones((ROWS, COLS)))


def test_degenerate_and_duplicate_triangles(dtype, rounding):
    soup = random_soup(40, 4, dtype)
    rng = np.random.default_rng(0)
    line = rng.normal(size=(1, 1, 3)) * rng.normal(size=(10, 3, 1)) + rng.normal(size=(10, 1, 3))
    point = np.repeat(rng.normal(size=(11, 1, 3)), 3, axis=1)
    flat = np.concatenate([line, point]).reshape(-1, 3)
    junk = Mesh.create(flat, np.arange(63).reshape(-1, 3), dtype=dtype)
    both = Mesh.merge([soup, soup, junk])
    for name in ("parallel", "perspective inside"):
        grid = views(dtype)[name]
        hit, depth = fast(both, grid)
        alone, alone_depth = fast(soup, grid)
        real = np.asarray(hit.face) < 80
        # A triangle that rounding gave a sliver of area may be met, never by more than a few rays.
        assert real.mean() > 0.99
        np.testing.assert_array_equal(np.asarray(hit.face)[real], np.asarray(alone.face)[real])
        np.testing.assert_array_equal(np.asarray(depth)[real], np.asarray(alone_depth)[real])


def test_everything_behind_or_beside_is_missed(dtype):
    grid = views(dtype)["perspective"]
    behind = random_soup(61, 1, dtype)
    away = eqx.tree_at(lambda m: m.vertices, behind, behind.vertices - 20 * grid.space.frame[2])
    beside = eqx.tree_at(lambda m: m.vertices, behind, behind.vertices + 20 * grid.space.frame[0])
    for mesh in (away, beside):
        hit, depth = fast(mesh, grid)
        assert not bool(jnp.any(hit.is_hit))
        np.testing.assert_array_equal(depth, np.full((ROWS, COLS), float(grid.far), dtype))


def test_faces_are_those_of_the_closest_hit():
    dtype = jnp.float32
    mesh, grid = padded(random_soup(61, 1, dtype)), views(dtype)["perspective inside"]
    hit = eqx.filter_jit(GridCaster().closest_on_grid)(mesh, grid)
    (depth, face), alone = jitted_fast(mesh, grid)
    np.testing.assert_array_equal(face, hit.face)
    np.testing.assert_array_equal(depth, alone)
    np.testing.assert_allclose(depth, hit.depth, rtol=2e-6)


def test_gradient_by_vertices_and_light_is_that_of_brute_force():
    """With the pose of the light among what is differentiated, the general rule is taken."""
    dtype, rounding = jnp.float64, 1e-13
    mesh, grid = padded(random_soup(61, 1, dtype)), views(dtype)["perspective inside"]
    weight = jnp.asarray(np.random.default_rng(3).normal(size=(ROWS, COLS)), dtype)
    face = brute(mesh, grid).face

    @eqx.filter_jit
    @eqx.filter_grad
    def want(inputs):
        return jnp.sum(weight * intersect(inputs[0], inputs[1].rays(), face).depth)

    @eqx.filter_jit
    @eqx.filter_grad
    def got(inputs):
        return jnp.sum(weight * GridCaster().depth_on_grid(*inputs))

    expected = want((mesh, grid))
    scale = float(jnp.max(jnp.abs(expected[0].vertices)))
    assert scale > 0
    assert float(jnp.max(jnp.abs(expected[1].space.position))) > 0
    for a, b in zip(jax.tree.leaves(got((mesh, grid))), jax.tree.leaves(expected), strict=True):
        assert bool(jnp.all(jnp.isfinite(a)))
        np.testing.assert_allclose(a, b, atol=100 * rounding * scale)


def test_vmap_over_vertices_is_a_loop():
    dtype, rounding = jnp.float32, 2e-6
    mesh, grid = padded(random_soup(61, 1, dtype)), views(dtype)["perspective inside"]
    moved = mesh.vertices + 0.1 * jnp.arange(3, dtype=dtype)[:, None, None]
    depths = eqx.filter_jit(
        jax.vmap(lambda v: GridCaster().depth_on_grid(eqx.tree_at(lambda m: m.vertices, mesh, v), grid))
    )(moved)
    for k in range(3):
        _, depth = jitted_fast(eqx.tree_at(lambda m: m.vertices, mesh, moved[k]), grid)
        # Two compiled programs may fuse a multiplication and an addition differently: roundings, not bits.
        np.testing.assert_allclose(depths[k], depth, rtol=rounding)


def test_huge_triangles_cost_no_precision(dtype):
    """A floor a million units wide under a view of one unit still lies at its exact depth."""
    corners = np.array([[-1e6, -1, -1e6], [1e6, -1, -1e6], [1e6, -1, 1e6], [-1e6, -1, 1e6]])
    floor = Mesh.create(corners, [[0, 1, 2], [0, 2, 3]], dtype=dtype)
    box = Box(jnp.asarray([-0.5, -0.5], dtype), jnp.asarray([0.5, 0.5], dtype))
    down = DirectionalSpace(jnp.zeros(3, dtype), jnp.eye(3, dtype=dtype))
    hit, depth = fast(floor, RayGrid(down, box, jnp.asarray(9.0, dtype), ROWS, COLS))
    assert bool(jnp.all(hit.is_hit))
    np.testing.assert_array_equal(depth, np.ones((ROWS, COLS)))


def test_one_cell_and_one_triangle():
    dtype = jnp.float64
    mesh = Mesh.create([[-1.0, 0, -1], [3, 0, -1], [-1, 0, 3]], [[0, 1, 2]], dtype=dtype)
    box = Box(jnp.asarray([-0.5, -0.5], dtype), jnp.asarray([0.5, 0.5], dtype))
    space = DirectionalSpace(jnp.asarray([0.0, 2.0, 0.0], dtype), jnp.eye(3, dtype=dtype))
    hit = GridCaster().closest_on_grid(mesh, RayGrid(space, box, jnp.asarray(9.0, dtype), 1, 1))
    assert hit.face.tolist() == [[0]]
    assert hit.depth.tolist() == [[2.0]]
