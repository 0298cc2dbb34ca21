"""Exact shadows by the irregular depth buffer against a traced ray for every point."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from grids import padded, turned
from shapes import plate_over_plane, random_soup

from shadowjax import BruteForceCaster, Mesh, shading, visibility_on
from shadowjax.geometry.light_space import DirectionalSpace, OctahedralSpace, PerspectiveSpace
from shadowjax.rays.grid import _visible, _visible_pairs
from shadowjax.rays.grid.caster import GridCaster
from shadowjax.shading import Surface
from shadowjax.techniques.exact import ExactShadows

ROWS, COLS = 21, 26
SOUP = 61

jitted_grid = eqx.filter_jit(lambda mesh, space, points, normals: GridCaster().visible(mesh, space, points, normals))


def spaces(dtype):
    """Lights of each kind; `inside` ones amid the triangles, which their start then cuts."""
    frame = turned(5, dtype)
    return {
        "directional": DirectionalSpace(5 * frame[1], frame),
        "directional inside": DirectionalSpace(0.1 * frame[1], frame),
        "spot": PerspectiveSpace(-3 * frame[2], frame),
        "spot inside": PerspectiveSpace(0.05 * frame[2], frame),
    }


def surface(mesh: Mesh, seed: int = 0):
    """Points on random triangles of the soup with a normal each, as an image."""
    rng = np.random.default_rng(seed)
    face = rng.integers(0, SOUP, (ROWS, COLS))
    corners = np.asarray(mesh.triangles())[face]
    weights = rng.dirichlet((1, 1, 1), (ROWS, COLS))
    points = np.sum(corners * weights[..., None], axis=-2)
    normals = np.asarray(mesh.face_normals())[face] * np.where(rng.random((ROWS, COLS, 1)) < 0.5, -1, 1)
    dtype = mesh.vertices.dtype
    return jnp.asarray(points, dtype), jnp.asarray(normals, dtype)


def assert_same(mesh, space, points, normals) -> np.ndarray:
    """Both agree, but for points which brute force itself judges otherwise within a few roundings next to them."""
    shape = points.shape[:-1]
    got = np.asarray(jitted_grid(mesh, space, points, normals))
    flat = points.reshape(-1, 3)
    beside = None if normals is None else normals.reshape(-1, 3)

    def traced(points):
        return np.asarray(BruteForceCaster().visible(mesh, space, points, beside)).reshape(shape)

    want = traced(flat)
    differ = got != want
    assert differ.sum() <= 0.01 * differ.size
    if differ.any():
        step = 16 * float(jnp.finfo(points.dtype).eps) * max(float(mesh.extent), float(jnp.max(jnp.abs(points))))
        shifts = step * np.concatenate([np.eye(3), -np.eye(3)])
        undecided = np.any([traced(flat + jnp.asarray(shift, flat.dtype)) != want for shift in shifts], axis=0)
        assert not np.any(differ & ~undecided)
    return got


# Two programs that differ in everything: light, dtype, shape of the points, normals.
CASES = [("directional", jnp.float32, True, True), ("spot", jnp.float64, False, False)]


@pytest.mark.parametrize("where", ["", " inside"])
@pytest.mark.parametrize(("kind", "dtype", "is_image", "has_normals"), CASES)
def test_agrees_with_a_ray_for_every_point(kind, dtype, is_image, has_normals, where):
    mesh = padded(random_soup(SOUP, 3, dtype))
    space = spaces(dtype)[kind + where]
    points, normals = surface(mesh)
    shape = (ROWS, COLS, 3) if is_image else (ROWS * COLS, 3)
    got = assert_same(mesh, space, points.reshape(shape), normals.reshape(shape) if has_normals else None)
    assert got.shape == shape[:-1]
    assert 0.02 < got.mean() < 0.98
    if kind == "spot":
        plane, _ = space.project(points)
        behind = np.asarray(jnp.abs(plane[..., 0]) >= 1e6)
        # Amid the triangles some points lie behind the light: outside its cone, where no ray arrives.
        assert behind.any() == (where == " inside")


def test_points_that_all_face_away_are_dark():
    dtype = jnp.float32
    mesh, space = padded(random_soup(SOUP, 3, dtype)), spaces(dtype)["directional"]
    points, _ = surface(mesh)
    away = jnp.broadcast_to(-space.frame[1], points.shape)
    assert not bool(jnp.any(jitted_grid(mesh, space, points, away)))
    towards = jnp.broadcast_to(space.frame[1], points.shape)
    assert bool(jnp.any(jitted_grid(mesh, space, points, towards)))


def test_rays_through_edges_of_a_lattice_agree_exactly():
    """Nothing but ties: points under the border, the corners and the diagonal of a plate are all in its shadow."""
    dtype = jnp.float32
    mesh = padded(plate_over_plane(dtype))
    frame = jnp.eye(3, dtype=dtype)
    space = DirectionalSpace(jnp.asarray([0.0, 2.0, 0.0], dtype), frame)
    x, z = np.meshgrid((np.arange(COLS) - 12) / 8, (np.arange(ROWS) - 10) / 8)
    points = jnp.asarray(np.stack([x, np.zeros_like(x), z], axis=-1), dtype)
    up = jnp.broadcast_to(frame[1], points.shape)
    lit = np.asarray(jitted_grid(mesh, space, points, up))
    np.testing.assert_array_equal(lit, (np.abs(x) > 1) | (np.abs(z) > 1))
    np.testing.assert_array_equal(lit, BruteForceCaster().visible(mesh, space, points, up))


def test_triangles_in_line_with_a_ray_but_beside_it_block_nothing():
    """Corners on one line through the ray, up to a rounding, all on one side of it: products tie, and yet no hit."""
    dtype = jnp.float32
    rng = np.random.default_rng(4)
    along = np.stack([np.ones(SOUP), 1 + rng.random(SOUP), 1 + rng.random(SOUP)], axis=1)
    place = along[..., None] * rng.uniform(-0.1, 0.1, (SOUP, 1, 2))
    place[:, 2, 0] *= 1 + rng.uniform(-1e-6, 1e-6, SOUP)
    corners = np.insert(place, 1, rng.uniform(0.5, 1.5, (SOUP, 3)), axis=2)
    mesh = padded(Mesh.create(jnp.asarray(corners.reshape(-1, 3), dtype), np.arange(3 * SOUP).reshape(-1, 3)))
    space = DirectionalSpace(jnp.asarray([0.0, 2.0, 0.0], dtype), jnp.eye(3, dtype=dtype))
    # One ray for all but two points, which make cells so wide that the triangles lie in that of the ray.
    points = jnp.zeros((ROWS, COLS, 3), dtype).at[0, 0].set(-1).at[0, 1].set(1).at[..., 1].set(0)
    assert bool(jnp.all(jitted_grid(mesh, space, points, jnp.broadcast_to(space.frame[1], points.shape))))


def test_one_point_and_many_lights_at_once():
    """Under `vmap`, inside `jit`, for a list of one point: each light as alone."""
    dtype = jnp.float32
    mesh = plate_over_plane(dtype)
    point = jnp.asarray([[0.5, 0.0, 0.5]], dtype)
    # Above the plate; next to it; between plate and floor; behind a light no ray arrives and so none is blocked.
    positions = jnp.asarray([[0.0, 4, 0], [6.0, 2, 0], [0.5, 0.5, 0.5], [0.0, -4, 0]], dtype)
    frame = jnp.asarray([[1.0, 0, 0], [0, 0, -1], [0, -1, 0]], dtype)

    def lit(position):
        return GridCaster().visible(mesh, PerspectiveSpace(position, frame), point, None)

    assert jax.jit(jax.vmap(lit))(positions).tolist() == [[False], [True], [True], [True]]


def test_a_wide_world_is_no_exception():
    """Plane positions beyond a million units still are positions of rays."""
    dtype = jnp.float32
    mesh = plate_over_plane(dtype)
    mesh = padded(eqx.tree_at(lambda m: m.vertices, mesh, mesh.vertices * 2.0**23))
    space = DirectionalSpace(jnp.asarray([0.0, 2.0**24, 0.0], dtype), jnp.eye(3, dtype=dtype))
    x, z = np.meshgrid((np.arange(COLS) - 12) / 8, (np.arange(ROWS) - 10) / 8)
    points = jnp.asarray(np.stack([x, np.zeros_like(x), z], axis=-1) * 2.0**23, dtype)
    lit = jitted_grid(mesh, space, points, jnp.broadcast_to(space.frame[1], points.shape))
    np.testing.assert_array_equal(lit, (np.abs(x) > 1) | (np.abs(z) > 1))


def test_a_bent_space_is_traced():
    dtype = jnp.float32
    mesh = padded(random_soup(SOUP, 3, dtype))
    points, normals = surface(mesh)
    space = OctahedralSpace(jnp.asarray([0.1, 0.2, 0.05], dtype))
    got = GridCaster().visible(mesh, space, points, normals)
    np.testing.assert_array_equal(got, BruteForceCaster().visible(mesh, space, points, normals))


def test_exact_shadows_of_a_picture_come_in_bands(monkeypatch):
    """The exact technique takes whole images with this caster, cut into bands where they are large."""
    dtype = jnp.float32
    mesh, space = padded(random_soup(SOUP, 3, dtype)), spaces(dtype)["directional"]
    points, normals = surface(mesh)
    drawn = ExactShadows(mesh, space, GridCaster())
    assert drawn.prefers_images
    assert not ExactShadows(mesh, space, BruteForceCaster()).prefers_images
    assert not ExactShadows(mesh, OctahedralSpace(space.origin), GridCaster()).prefers_images
    seen = jnp.arange(COLS) != 3
    face = jnp.broadcast_to(jnp.where(seen, 0, -1), (ROWS, COLS)).astype(jnp.int32)
    picture = Surface(points, normals, normals, normals, normals, points[..., 0], face)
    monkeypatch.setattr(shading, "IMAGE_CHUNK", 8 * COLS)
    want = np.asarray(jitted_grid(mesh, space, points, normals)) | ~np.asarray(seen)
    got = np.asarray(visibility_on(picture, drawn))
    assert 0.05 < want.mean() < 0.95
    # Another program may round a shadow's edge otherwise.
    assert np.mean(got != want) <= 0.005


def test_points_in_chunks_get_the_same_answers(monkeypatch):
    dtype = jnp.float32
    mesh = padded(random_soup(SOUP, 3, dtype))
    points, normals = surface(mesh)
    space = spaces(dtype)["directional"]
    whole = np.asarray(jitted_grid(mesh, space, points, normals))
    # Two chunks of two parts; the last is not full.
    monkeypatch.setattr(_visible, "POINTS", 150)
    monkeypatch.setattr(_visible, "POINTS_PER_TRIANGLE", 0)
    assert 3 * 150 < ROWS * COLS < 4 * 150
    chunked = eqx.filter_jit(lambda *given: GridCaster().visible(*given))(mesh, space, points, normals)
    np.testing.assert_array_equal(chunked, whole)


@pytest.mark.parametrize(("name", "dtype"), [("directional inside", jnp.float32), ("spot inside", jnp.float64)])
def test_pairs_for_an_accelerator_get_the_same_answers(monkeypatch, name, dtype):
    """Over several windows of triangles, runs and pairs."""
    mesh, space = padded(random_soup(SOUP, 3, dtype)), spaces(dtype)[name]
    points, normals = surface(mesh)
    for bound, value in (("CHUNK", 150), ("RUNS", 64), ("WINDOW", 256)):
        monkeypatch.setattr(_visible_pairs, bound, value)
    by_loops = np.asarray(jitted_grid(mesh, space, points, normals))
    monkeypatch.setattr(_visible, "_blocked", _visible_pairs.blocked_by_pairs)
    by_pairs = np.asarray(eqx.filter_jit(lambda *given: GridCaster().visible(*given))(mesh, space, points, normals))
    assert 0.2 < by_loops.mean() < 0.8
    # Slopes of keys are set up in another order of operations.
    assert np.mean(by_pairs != by_loops) <= 0.002
