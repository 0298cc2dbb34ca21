"""The tree caster: what it refuses, moved vertices, ties, leaks, degenerate scenes, jit, vmap and gradients."""

import gc

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from grids import closest
from shapes import bumpy_sphere, plate_over_plane, random_soup

from shadowjax import BruteForceCaster, Mesh, Rays
from shadowjax.geometry.light_space import OctahedralSpace
from shadowjax.rays.bvh import caster as caster_module
from shadowjax.rays.bvh._build import LEAF_SIZE, build_topology
from shadowjax.rays.bvh.caster import _TREES, BvhCaster
from shadowjax.rays.grid.caster import GridCaster
from shadowjax.rays.plane_map import Box
from shadowjax.rays.ray_grid import RayGrid

NUM_FACES, NUM_RAYS = 200, 512
brute = eqx.filter_jit(lambda mesh, rays: BruteForceCaster().closest(mesh, rays))
cast = eqx.filter_jit(lambda caster, mesh, rays: caster.closest(mesh, rays))


def make_rays(seed: int, dtype) -> Rays:
    rng = np.random.default_rng(seed)
    return Rays.create(jnp.asarray(rng.uniform(-2, 2, (NUM_RAYS, 3)), dtype), rng.normal(size=(NUM_RAYS, 3)))


def assert_same(hit, expected):
    np.testing.assert_array_equal(hit.face, expected.face)
    np.testing.assert_array_equal(hit.depth, expected.depth)


def test_it_is_brute_force_for_its_own_mesh_for_moved_vertices_and_for_other_triangles(dtype):
    mesh, rays = random_soup(NUM_FACES, 1, dtype), make_rays(2, dtype)
    caster = BvhCaster.build(mesh)
    assert_same(cast(caster, mesh, rays), brute(mesh, rays))
    moved = Mesh(mesh.vertices * jnp.asarray([-1.5, 0.1, 1], dtype) + 0.3, mesh.faces, mesh.face_colors)
    turned = Mesh(mesh.vertices, mesh.faces[::-1], mesh.face_colors)
    for other in (moved, turned):
        expected = brute(other, rays)
        assert 0 < int(jnp.sum(expected.is_hit)) < NUM_RAYS
        assert_same(cast(caster, other, rays), expected)
        refitted = eqx.filter_jit(lambda caster, mesh: caster.refit(mesh))(caster, other)
        np.testing.assert_array_equal(refitted.tree.vertices, other.vertices)
        assert_same(cast(refitted, other, rays), expected)


def test_without_a_tree_it_builds_one_for_a_mesh_at_hand_or_traced_and_forgets_it_with_the_mesh():
    mesh, rays = random_soup(NUM_FACES, 1, jnp.float32), make_rays(2, jnp.float32)
    expected, before = brute(mesh, rays), set(_TREES)
    unbound = BvhCaster()
    assert_same(unbound.closest(mesh, rays), expected)
    (added,) = set(_TREES) - before
    tree = _TREES[added].tree
    unbound.closest(mesh, rays)
    assert _TREES[added].tree is tree
    assert_same(cast(unbound, mesh, rays), expected)
    small = Mesh(mesh.vertices, mesh.faces[:3], mesh.face_colors[:3])
    assert_same(cast(unbound, small, rays), brute(small, rays))
    del mesh, small
    assert added not in _TREES


@pytest.mark.parametrize("reused", [False, True], ids=["numbers of their own", "one number for all"])
@pytest.mark.parametrize("dies", ["vertices", "faces"])
def test_a_remembered_tree_goes_with_the_first_of_its_arrays(monkeypatch, dies, reused):
    """One array lives on; the other is freed, and what comes after it has its number: another size, other contents."""
    if reused:
        monkeypatch.setattr(caster_module, "id", lambda _: 7, raising=False)
    rays, whole, unbound = make_rays(2, jnp.float32), random_soup(NUM_FACES, 1, jnp.float32), BvhCaster()
    half = whole.faces[: NUM_FACES // 2]
    colors = jnp.full((NUM_FACES, 3), 0.5, jnp.float32)
    gc.collect()
    before = set(_TREES)
    first = Mesh(whole.vertices, jnp.copy(half), colors[: NUM_FACES // 2])
    if dies == "vertices":
        first = Mesh(jnp.copy(whole.vertices), half, colors[: NUM_FACES // 2])
    assert_same(unbound.closest(first, rays), brute(first, rays))
    assert len(set(_TREES) - before) == 1
    # Both alive: the number alone does not say which mesh is asked for.
    second = whole if dies == "faces" else Mesh(-whole.vertices, half, first.face_colors)
    assert_same(unbound.closest(second, rays), brute(second, rays))
    del first
    gc.collect()
    assert len(set(_TREES) - before) == 1
    assert_same(unbound.closest(second, rays), brute(second, rays))
    del second, whole, half
    gc.collect()
    assert set(_TREES) == before


def test_every_triangle_is_in_one_leaf_and_every_order_visits_every_node():
    rng = np.random.default_rng(0)
    lower = rng.normal(size=(1000, 3)) ** 3
    tree = build_topology(lower, lower + rng.uniform(size=(1000, 3)))
    np.testing.assert_array_equal(np.sort(tree.order), np.arange(1000))
    sizes = np.diff(tree.first)
    assert sizes.min() >= 0
    assert sizes.max() <= LEAF_SIZE
    for links in tree.links:
        node, seen = 0, []
        while node < len(links):
            seen.append(node)
            node = links[node, 1]
        np.testing.assert_array_equal(np.sort(seen), np.arange(len(links)))


@pytest.mark.parametrize("kind", ["equal", "no area", "geometric", "one far away"])
def test_no_arrangement_of_triangles_makes_the_tree_deep(kind):
    """Depth bounds the time of a ray; a tree that splits off one triangle a level would have thousands of levels."""
    num = 100_000
    lower = np.zeros((num, 3), np.float32)
    if kind == "geometric":
        # Each half as far out as the last: equal bins never split them evenly.
        lower[:, 0] = 2.0 ** -(np.arange(num) % 120).astype(np.float32)
    if kind == "one far away":
        lower[0] = 1e30
    upper = lower + (0 if kind == "no area" else 1e-3)
    tree = build_topology(lower, upper)
    np.testing.assert_array_equal(np.sort(tree.order), np.arange(num))
    depth = np.zeros(len(tree.first), int)
    for node, second in zip(tree.inner[::-1], tree.second[::-1], strict=True):
        depth[[node + 1, second]] = depth[node] + 1
    assert depth.max() <= 41 + np.log2(num)


def test_of_copies_of_a_triangle_the_first_wins(dtype):
    mesh = random_soup(NUM_FACES // 4, 3, dtype)
    four = Mesh.merge([mesh, mesh, mesh, mesh])
    rays = make_rays(4, dtype)
    hit = cast(BvhCaster.build(four), four, rays)
    assert_same(hit, brute(four, rays))
    assert int(jnp.max(hit.face)) < mesh.num_faces


def test_closed_mesh_leaks_no_ray_aimed_at_edges_and_vertices(dtype):
    mesh = bumpy_sphere(dtype)
    rng = np.random.default_rng(3)
    vertices, faces = np.asarray(mesh.vertices), np.asarray(mesh.faces)
    num = 30_000
    share = rng.uniform(size=(num, 1)).astype(vertices.dtype)
    edge = faces[rng.integers(len(faces), size=num)]
    targets = np.concatenate(
        [
            vertices[rng.integers(len(vertices), size=num)],
            vertices[edge[:, 0]] * share + vertices[edge[:, 1]] * (1 - share),
        ]
    )
    pool = np.concatenate([np.zeros((1, 3)), rng.integers(-2, 3, (4, 3)) / 8, rng.uniform(-0.2, 0.2, (59, 3))])
    origins = pool[rng.integers(len(pool), size=len(targets))].astype(vertices.dtype)
    rays = Rays.create(jnp.asarray(origins), jnp.asarray(targets - origins))
    caster = BvhCaster.build(mesh)
    assert int(jnp.sum(~cast(caster, mesh, rays).is_hit)) == 0


def test_rays_parallel_to_triangles_and_along_the_axes_of_boxes(dtype, rounding):
    """Flat boxes, directions with exact zeros of both signs, origins in the planes of triangles."""
    line = np.linspace(-1, 1, 11)
    x, z = (a.reshape(-1) for a in np.meshgrid(line, line))
    corner = np.stack([x, np.zeros_like(x), z], axis=1)
    vertices = np.concatenate([corner, corner + np.array([0.2, 0, 0]), corner + np.array([0, 0, 0.2])])
    faces = np.arange(len(corner))[:, None] + np.array([0, 1, 2]) * len(corner)
    mesh = Mesh.create(vertices, faces, dtype=dtype)
    rng = np.random.default_rng(7)
    origins = rng.choice(np.append(line, 0.05), (NUM_RAYS, 3))
    directions = rng.choice([-1.0, -0.0, 0.0, 1.0], (NUM_RAYS, 3))
    directions[np.all(directions == 0, axis=1)] = [0, -1, 0]
    # Half the rays run in the plane of the triangles; none of the others starts in it.
    inside = np.arange(NUM_RAYS) % 2 == 0
    origins[:, 1] = np.where(inside, 0, rng.choice([-0.5, 0.5], NUM_RAYS))
    directions[inside, 1] = 0
    directions[inside & np.all(directions == 0, axis=1), 2] = -1
    rays = Rays.create(jnp.asarray(origins, dtype), jnp.asarray(directions, dtype))
    hit, expected = cast(BvhCaster.build(mesh), mesh, rays), brute(mesh, rays)
    assert int(jnp.sum(expected.is_hit)) > 40
    # A ray may meet six corners at once: which of them is nearest by a rounding is not asked.
    np.testing.assert_array_equal(hit.is_hit, expected.is_hit)
    np.testing.assert_allclose(hit.depth, expected.depth, rtol=rounding)
    assert not np.any(hit.is_hit[inside])


def test_point_light_amid_the_triangles_through_the_grid_casters_field():
    """The octahedral map of a light inside the geometry; shadow rays agree with brute force too."""
    dtype = jnp.float32  # the other one is compared above, without a grid
    mesh = random_soup(NUM_FACES, 9, dtype)
    box = Box(jnp.asarray([-1, -1], dtype), jnp.asarray([1, 1], dtype))
    space = OctahedralSpace(jnp.asarray([0.1, 0, -0.1], dtype))
    grid = RayGrid(space, box, jnp.asarray(9.0, dtype), 16, 32)
    caster = GridCaster(others=BvhCaster.build(mesh))
    hit = caster.closest_on_grid(mesh, grid)
    assert int(jnp.sum(hit.is_hit)) > 100
    assert_same(hit, BruteForceCaster().closest_on_grid(mesh, grid))
    points = make_rays(10, dtype).origins
    lit = caster.others.visible(mesh, space, points)
    assert 0 < int(jnp.sum(lit)) < NUM_RAYS
    np.testing.assert_array_equal(lit, BruteForceCaster().visible(mesh, space, points))


def test_gradients_and_vmap_over_meshes_rays_and_trees():
    mesh, rays = random_soup(NUM_FACES, 1, jnp.float32), make_rays(2, jnp.float32)
    caster = BvhCaster.build(mesh)

    def total(vertices, caster):
        hit = caster.closest(Mesh(vertices, mesh.faces, mesh.face_colors), rays)
        return jnp.sum(jnp.where(hit.is_hit, hit.depth, 0))

    gradient = eqx.filter_jit(jax.grad(total))(mesh.vertices, caster)
    np.testing.assert_array_equal(gradient, eqx.filter_jit(jax.grad(total))(mesh.vertices, BruteForceCaster()))
    assert float(jnp.max(jnp.abs(gradient))) > 0
    shifts = jnp.asarray([[0, 0, 0], [0.5, 0, -0.2]], jnp.float32)

    def shifted(shift):
        moved = Mesh(mesh.vertices + shift, mesh.faces, mesh.face_colors)
        return caster.closest(moved, Rays(rays.origins - shift, rays.directions, rays.t_min, rays.t_max)), moved

    hits, meshes = jax.jit(jax.vmap(shifted))(shifts)
    for k, shift in enumerate(shifts):
        moved = Rays(rays.origins - shift, rays.directions, rays.t_min, rays.t_max)
        hit, mesh_k = (jax.tree.map(lambda x, k=k: x[k], tree) for tree in (hits, meshes))
        assert_same(hit, brute(mesh_k, moved))


def test_a_few_triangles_are_one_leaf():
    mesh = plate_over_plane()
    rays = Rays.create(jnp.asarray([[0.3, 2.0, 0.2], [3.0, 2.0, 0.2], [9.0, 2.0, 0.0]]), [[0.0, -1, 0]] * 3)
    tree = BvhCaster.build(mesh)
    np.testing.assert_array_equal(tree.closest(mesh, rays).face, closest(mesh, rays).face)


def test_it_refuses_a_mesh_of_another_size_and_building_under_jit():
    mesh, rays = random_soup(NUM_FACES, 1, jnp.float32), make_rays(2, jnp.float32)
    caster = BvhCaster.build(mesh)
    other = random_soup(NUM_FACES + 1, 1, jnp.float32)
    for wrong in (lambda: caster.closest(other, rays), lambda: caster.refit(other)):
        with pytest.raises(ValueError, match=r"holds 200 triangles, the mesh 201; make a tree .*build\(mesh\)"):
            wrong()
    with pytest.raises(ValueError, match="outside jit"):
        jax.jit(BvhCaster.build)(mesh)
    with pytest.raises(ValueError, match="no tree to refit"):
        BvhCaster().refit(mesh)
