"""The grid caster against brute force: views, maps, degenerate and straddling triangles, leaks, gradients, vmap."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import trimesh
from shapes import bumpy_sphere, random_soup

from shadowjax import BruteForce, Mesh
from shadowjax.rays.grid import Grid
from shadowjax.rays.light_space import DirectionalSpace, OctahedralSpace, PerspectiveSpace
from shadowjax.rays.plane_map import Box
from shadowjax.rays.ray_grid import RayGrid
from shadowjax.warps.logarithmic import LogarithmicWarp
from shadowjax.warps.perspective import PerspectiveWarp

ROWS, COLS = 26, 31
NUM_FACES, NUM_VERTICES = 400, 1200
jitted_brute = eqx.filter_jit(lambda mesh, grid: BruteForce().closest_on_grid(mesh, grid))
jitted_fast = eqx.filter_jit(lambda mesh, grid: (Grid().closest_on_grid(mesh, grid), Grid().depth_on_grid(mesh, grid)))
jitted_faces = eqx.filter_jit(lambda mesh, grid: Grid().faces_on_grid(mesh, grid))


def padded(mesh: Mesh) -> Mesh:
    """The mesh with empty triangles added, so that all tests share one compiled shape."""
    faces = jnp.zeros((NUM_FACES - mesh.num_faces, 3), jnp.int32)
    vertices = jnp.broadcast_to(mesh.vertices[:1], (NUM_VERTICES - mesh.num_vertices, 3))
    return Mesh.create(jnp.concatenate([mesh.vertices, vertices]), jnp.concatenate([mesh.faces, faces]))


def fast(mesh: Mesh, grid: RayGrid):
    return jitted_fast(padded(mesh), grid)


def brute(mesh: Mesh, grid: RayGrid):
    return jitted_brute(padded(mesh), grid)


def turned(seed: int, dtype):
    """A right-handed frame without special directions."""
    q = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))[0]
    return jnp.asarray(q * np.sign(np.linalg.det(q)), dtype)


def views(dtype) -> dict[str, RayGrid]:
    """One grid of every kind of view and map; both `inside` ones start amid the triangles."""
    frame = turned(5, dtype)

    def box(*sides: float) -> Box:
        return Box(jnp.asarray(sides[:2], dtype), jnp.asarray(sides[2:], dtype))

    def grid(space, plane_map, far=40.0) -> RayGrid:
        return RayGrid(space, plane_map, jnp.asarray(far, dtype), ROWS, COLS)

    rng = np.random.default_rng(1)
    cloud = jnp.asarray(rng.uniform(-0.8, 0.8, (12, 2)), dtype)
    axis = jnp.asarray([0.6, 0.8], dtype)
    warp = PerspectiveWarp.fit(cloud, 1.5, axis)
    outside, inside = DirectionalSpace(5 * frame[1], frame), DirectionalSpace(0.1 * frame[1], frame)
    return {
        "parallel": grid(outside, box(-1.2, -1.5, 1.4, 1.1)),
        "parallel inside": grid(inside, box(1.0, -1.0, -1.3, 1.0)),
        "short": grid(outside, box(-1.2, -1.5, 1.4, 1.1), far=4.9),
        "perspective": grid(PerspectiveSpace(-3 * frame[2], frame), box(-0.5, 0.4, 0.4, -0.5)),
        "perspective inside": grid(PerspectiveSpace(0.05 * frame[2], frame), box(0.8, -0.9, -1.0, 1.0)),
        "perspective warp inside": grid(PerspectiveSpace(0.05 * frame[2], frame), warp),
        "logarithmic warp": grid(outside, LogarithmicWarp.fit(cloud, 4.0, axis)),
    }


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


@pytest.mark.parametrize("name", list(views(jnp.float32)))
def test_agrees_with_brute_force(name, dtype, rounding):
    grid = views(dtype)[name]
    hits = [assert_agrees(random_soup(61, seed, dtype), grid, rounding).is_hit for seed in (1, 2)]
    assert 0.2 < float(jnp.mean(jnp.stack(hits))) <= 1


def test_many_small_triangles_agree(dtype, rounding):
    """Triangles around and below the size of a cell, most of them hitting no ray."""
    big = random_soup(400, 3, dtype)
    corners = big.triangles()
    middle = jnp.mean(corners, axis=1, keepdims=True)
    small = Mesh.create((middle + 0.08 * (corners - middle)).reshape(-1, 3), big.faces)
    for name in ("parallel", "perspective", "logarithmic warp"):
        hit = assert_agrees(small, views(dtype)[name], rounding)
        assert 0.02 < float(jnp.mean(hit.is_hit)) < 0.9


def test_point_light_falls_back(dtype, rounding):
    grid = views(dtype)["parallel"]
    space = OctahedralSpace(jnp.asarray([0.1, 0.2, 0.05], dtype))
    whole = Box(jnp.asarray([-1.0, -1.0], dtype), jnp.asarray([1.0, 1.0], dtype))
    assert_agrees(bumpy_sphere(dtype, 1), RayGrid(space, whole, grid.far, ROWS, COLS), rounding)


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


def test_faces_without_barycentrics(dtype):
    mesh, grid = padded(random_soup(61, 1, dtype)), views(dtype)["perspective inside"]
    hit, depth = jitted_fast(mesh, grid)
    got_depth, face = jitted_faces(mesh, grid)
    np.testing.assert_array_equal(face, hit.face)
    np.testing.assert_array_equal(got_depth, depth)


@pytest.mark.parametrize("method", ["closest_on_grid", "depth_on_grid"])
def test_gradient_is_that_of_brute_force(method):
    dtype, rounding = jnp.float64, 1e-13  # one dtype: what differs between them is tested above
    mesh, grid = padded(random_soup(61, 1, dtype)), views(dtype)["perspective inside"]
    weight = jnp.asarray(np.random.default_rng(3).normal(size=(ROWS, COLS)), dtype)

    def loss(inputs, cast):
        return jnp.sum(weight * cast(*inputs))

    def depth(mesh, grid):
        found = getattr(Grid(), method)(mesh, grid)
        return found if method == "depth_on_grid" else found.depth

    got = eqx.filter_jit(eqx.filter_grad(loss))((mesh, grid), depth)
    want = eqx.filter_grad(loss)((mesh, grid), lambda m, g: BruteForce().closest_on_grid(m, g).depth)
    scale = float(jnp.max(jnp.abs(want[0].vertices)))
    assert scale > 0
    for a, b in zip(jax.tree.leaves(got), jax.tree.leaves(want), strict=True):
        assert bool(jnp.all(jnp.isfinite(a)))
        np.testing.assert_allclose(a, b, atol=100 * rounding * scale)


def test_vmap_over_vertices_is_a_loop():
    dtype, rounding = jnp.float64, 1e-13
    mesh, grid = padded(random_soup(61, 1, dtype)), views(dtype)["perspective inside"]
    moved = mesh.vertices + 0.1 * jnp.arange(3, dtype=dtype)[:, None, None]
    hits, depths = eqx.filter_jit(jax.vmap(lambda v: jitted_fast(eqx.tree_at(lambda m: m.vertices, mesh, v), grid)))(
        moved
    )
    for k in range(3):
        hit, depth = jitted_fast(eqx.tree_at(lambda m: m.vertices, mesh, moved[k]), grid)
        np.testing.assert_array_equal(hits.face[k], hit.face)
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
    hit = Grid().closest_on_grid(mesh, RayGrid(space, box, jnp.asarray(9.0, dtype), 1, 1))
    assert hit.face.tolist() == [[0]]
    assert hit.depth.tolist() == [[2.0]]
