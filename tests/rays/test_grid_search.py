"""The searches of the grid caster, what they store, the derivative by vertices, and where plane maps are regular."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from grids import COLS, ROWS, brute, fast, jitted_fast, padded, views
from shapes import random_soup

from shadowjax import Mesh
from shadowjax.rays.grid._pairs import search_pairs
from shadowjax.rays.grid._plane import depth_tangent
from shadowjax.rays.grid._project import depth_of_key, place, view
from shadowjax.rays.grid._store import unpack, words
from shadowjax.rays.grid.caster import GridCaster
from shadowjax.rays.ray import intersect

SOUP = 61


@eqx.filter_jit
def pairs(mesh, grid, with_face):
    """Depth and face by the search for accelerators, which runs on a processor too."""
    table = view(grid)
    key, face = search_pairs(grid, table, mesh, place(grid, table, mesh.vertices), with_face)
    return depth_of_key(grid, table, key), face


@eqx.filter_jit
def tangent(mesh, change, grid, depth, face):
    return depth_tangent(grid, view(grid), mesh, change, depth, face)


def test_both_searches_agree(dtype, rounding):
    """Also where triangles cross the start. Twice the same triangles: the first of each pair wins, exactly."""
    where = "perspective inside" if dtype == jnp.float32 else "parallel"
    soup = random_soup(SOUP, 1, dtype)
    mesh, grid = padded(Mesh.merge([soup, soup])), views(dtype)[where]
    (depth, face), alone = jitted_fast(mesh, grid)
    assert int(jnp.max(face)) < SOUP
    found_depth, found = pairs(mesh, grid, True)
    assert found is not None
    assert int(jnp.max(found)) < SOUP
    same = np.asarray(found) == np.asarray(face)
    assert 0.2 < np.mean(np.asarray(face) >= 0) <= 1
    # Rounding may decide between two triangles only where they meet at one depth.
    np.testing.assert_allclose(found_depth, depth, rtol=20 * rounding)
    assert (~same).sum() <= 0.002 * same.size
    if dtype == jnp.float32:
        np.testing.assert_allclose(pairs(mesh, grid, False)[0], alone, rtol=20 * rounding)


def test_loops_are_compiled_whole(dtype):
    """All but the loops over groups for the general test, one a search; a larger body would be dispatched in steps."""
    if jax.default_backend() != "cpu":
        pytest.skip("a processor's loops")
    mesh, grid = padded(random_soup(SOUP, 1, dtype)), views(dtype)["parallel"]
    program = jitted_fast.lower(mesh, grid).compile().compiled.as_text()
    whole, loops = program.count('xla_cpu_small_call="true"'), program.count(" while(")
    assert whole >= 5
    assert loops - whole == 2


def test_words_are_ordered_like_key_and_face():
    """Negative keys too, as those of rays through a point are; and nothing is lost."""
    rng = np.random.default_rng(0)
    spread = rng.normal(size=60) * 10.0 ** rng.integers(-30, 30, 60)
    keys = np.concatenate([spread, [0.0, np.finfo(np.float32).tiny, np.finfo(np.float32).max / 4, -1, -1]])
    keys = np.repeat(np.concatenate([keys, -keys]).astype(np.float32), 3)
    keys[keys == 0] = 0.0  # −0.0 comes below
    faces = np.tile([-1, 0, 2**31 - 1], keys.size // 3).astype(np.int32)
    word = np.asarray(words(jnp.asarray(keys), jnp.asarray(faces)))
    # Unsigned, no face (−1) comes after every face: a hit at the limit beats it.
    order = np.lexsort((faces.astype(np.uint32), keys))
    assert np.all(np.diff(word[order]) >= 0)
    assert np.all((np.diff(word[order]) > 0) | (np.diff(keys[order]) == 0) & (np.diff(faces[order]) == 0))
    got_keys, got_faces = unpack(jnp.asarray(word))
    np.testing.assert_array_equal(np.asarray(got_keys).view(np.int32), keys.view(np.int32))
    np.testing.assert_array_equal(got_faces, faces)
    zero, one = words(jnp.asarray([-0.0, 0.0], jnp.float32), jnp.asarray([5, 5], jnp.int32)).tolist()
    tiny = words(-jnp.finfo(jnp.float32).tiny * jnp.ones(1, jnp.float32), jnp.asarray([5], jnp.int32)).tolist()[0]
    assert tiny < zero < one
    assert np.signbit(np.asarray(unpack(jnp.asarray([zero]))[0])).all()


@pytest.mark.parametrize("where", ["parallel", "perspective", "perspective inside"])
def test_derivative_by_vertices(where):
    """Against the one intersection, forward and reverse, and against differences; float64."""
    dtype = jnp.float64
    mesh, grid = padded(random_soup(SOUP, 1, dtype)), views(dtype)[where]
    rng = np.random.default_rng(2)
    change = jnp.asarray(rng.normal(size=mesh.vertices.shape), dtype)
    weight = jnp.asarray(rng.normal(size=(ROWS, COLS)), dtype)
    depth = brute(mesh, grid).depth
    face = brute(mesh, grid).face
    got = tangent(mesh, change, grid, depth, face)
    wanted, gradient = _by_intersection(mesh, grid, face, change, weight)
    scale = float(jnp.max(jnp.abs(wanted)))
    assert scale > 0.1
    np.testing.assert_allclose(got, wanted, rtol=1e-9, atol=1e-9)
    assert float(jnp.sum(weight * got)) == pytest.approx(float(jnp.sum(gradient * change)), rel=1e-9)
    if where == "perspective":
        # More triangles than cells go another way.
        times = 1 + ROWS * COLS // mesh.num_faces
        many = Mesh(mesh.vertices, jnp.tile(mesh.faces, (times, 1)), jnp.tile(mesh.face_colors, (times, 1)))
        np.testing.assert_allclose(tangent(many, change, grid, depth, face), got, rtol=1e-12, atol=1e-12)
    if where == "perspective inside":
        reverse = _by_grid(mesh, grid, weight)
        np.testing.assert_allclose(reverse, gradient, rtol=1e-9, atol=1e-9 * float(jnp.max(jnp.abs(gradient))))
    step = 1e-6

    def moved(by):
        found, _ = fast(eqx.tree_at(lambda m: m.vertices, mesh, mesh.vertices + by * change), grid)
        return np.asarray(found.depth), np.asarray(found.face)

    (after, face_after), (before, face_before) = moved(step), moved(-step)
    steady = (face_after == face_before) & (face_after == np.asarray(face))
    assert steady.mean() > 0.99
    # The second derivative of depth on a triangle seen almost edge-on is large, and differences see it.
    difference = (after - before)[steady] / (2 * step)
    error = np.abs(difference - np.asarray(got)[steady])
    assert np.quantile(error, 0.95) < 1e-6 * scale
    assert np.max(error) < 1e-3 * scale


@eqx.filter_jit
def _by_intersection(mesh, grid, face, change, weight):
    def depth(vertices):
        return intersect(eqx.tree_at(lambda m: m.vertices, mesh, vertices), grid.rays(), face).depth

    value, pullback = jax.vjp(depth, mesh.vertices)
    return jax.jvp(depth, (mesh.vertices,), (change,))[1], pullback(weight.astype(value.dtype))[0]


@eqx.filter_jit
def _by_grid(mesh, grid, weight):
    def total(vertices):
        return jnp.sum(weight * GridCaster().depth_on_grid(eqx.tree_at(lambda m: m.vertices, mesh, vertices), grid))

    return jax.grad(total)(mesh.vertices)


@pytest.mark.parametrize("where", ["parallel", "perspective inside"])
def test_derivative_is_finite_on_triangles_without_area(where):
    """A ray cannot hit one; were it said to, its derivative must still be a number."""
    dtype = jnp.float64
    mesh, grid = padded(random_soup(SOUP, 1, dtype)), views(dtype)[where]
    face = jnp.full((ROWS, COLS), SOUP, jnp.int32)
    assert float(jnp.max(jnp.abs(mesh.triangles()[SOUP] - mesh.vertices[0]))) == 0
    got = tangent(mesh, jnp.ones_like(mesh.vertices), grid, jnp.ones((ROWS, COLS), dtype), face)
    assert bool(jnp.all(jnp.isfinite(got)))
    missed = tangent(mesh, jnp.ones_like(mesh.vertices), grid, jnp.ones((ROWS, COLS), dtype), -jnp.ones_like(face))
    np.testing.assert_array_equal(missed, np.zeros((ROWS, COLS)))


@pytest.mark.parametrize("name", ["perspective warp inside", "logarithmic warp"])
def test_regular_corners_bound_their_triangle(name):
    """Also outside the map's region, down to the centre of projection."""
    plane_map = views(jnp.float64)[name].plane_map
    rng = np.random.default_rng(0)
    corners = jnp.asarray(rng.normal(0, 1, (400, 3, 2)) * np.array([0.5, 4])[rng.integers(0, 2, (400, 1, 1))])
    regular = np.asarray(jnp.all(plane_map.regular(corners), axis=1))
    assert 0.2 < regular.mean() < 0.95
    weights = jnp.asarray(rng.dirichlet((0.5, 0.5, 0.5), (400, 50)))
    within = np.asarray(plane_map.forward(jnp.sum(corners[:, None] * weights[..., None], axis=-2)))[regular]
    ends = np.asarray(plane_map.forward(corners))[regular]
    slack = 1e-9 * (1 + np.abs(ends).max(axis=1, keepdims=True))
    assert np.all(within >= ends.min(axis=1, keepdims=True) - slack)
    assert np.all(within <= ends.max(axis=1, keepdims=True) + slack)
    outside = np.any((ends < 0) | (ends > 1), axis=(1, 2))
    assert outside.mean() > 0.2
