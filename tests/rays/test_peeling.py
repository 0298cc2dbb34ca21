"""Depth peeling on the grid: layer after layer against all sorted hits of its rays; gradients, vmap, both searches."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from grids import COLS, NUM_FACES, NUM_VERTICES, ROWS, jitted_rays, views
from shapes import bumpy_sphere, random_soup

from shadowjax import Mesh, Rays
from shadowjax._types import Array, Bool
from shadowjax.geometry.light_space import OctahedralSpace
from shadowjax.rays.caster import Caster
from shadowjax.rays.grid._pairs import search_pairs
from shadowjax.rays.grid.caster import GridCaster
from shadowjax.rays.layers import hit_rounding, second_layer
from shadowjax.rays.ray import Hit
from shadowjax.rays.ray_grid import RayGrid

SOUP, SHEET, NUM_SHEETS = 61, 32, 5


class NoRays(Caster):
    """Refuses to trace: whoever asks has not drawn."""

    def closest(self, mesh: Mesh, rays: Rays) -> Hit:
        del mesh, rays
        pytest.fail("a ray was traced")

    def blocked(self, mesh: Mesh, rays: Rays) -> Bool[Array, "*points"]:
        del mesh, rays
        pytest.fail("a ray was traced")


class Starts(Caster):
    """Answers with the depths that rays start from."""

    def closest(self, mesh: Mesh, rays: Rays) -> Hit:
        del mesh
        return Hit(rays.t_min, jnp.zeros(rays.shape, jnp.int32), jnp.zeros_like(rays.origins))

    def blocked(self, mesh: Mesh, rays: Rays) -> Bool[Array, "*points"]:
        del mesh
        return jnp.zeros(rays.shape, bool)


peel = eqx.filter_jit(lambda mesh, grid, first: second_layer(GridCaster(NoRays()), mesh, grid, first))
peel_by_pairs = eqx.filter_jit(lambda mesh, grid, first: second_layer(GridCaster(NoRays()), mesh, grid, first))

# Both searches, both kinds of projective space, both dtypes, and a plane map that is a table of cells.
CASES = {
    "parallel": (peel, "parallel", jnp.float64),
    "perspective": (peel, "perspective inside", jnp.float32),
    "pairs, warped": (peel_by_pairs, "perspective warp inside", jnp.float32),
}


def filled(vertices: np.ndarray, faces: np.ndarray, dtype) -> Mesh:
    """A mesh of the shape that tests of grids share, filled up with empty triangles."""
    spare = np.zeros((NUM_VERTICES - len(vertices), 3)), np.zeros((NUM_FACES - len(faces), 3), np.int32)
    return Mesh.create(np.concatenate([vertices, spare[0]]), np.concatenate([faces, spare[1]]), dtype=dtype)


def soup_twice(dtype) -> Mesh:
    soup = random_soup(SOUP, 1)
    return filled(np.asarray(soup.vertices), np.concatenate([soup.faces, soup.faces]), dtype)


def closed_body(dtype) -> Mesh:
    body = bumpy_sphere()
    return filled(np.asarray(body.vertices), np.asarray(body.faces), dtype)


def sheets(dtype) -> Mesh:
    """Open sheets in a stack, tilted; then the middle one again as it is, and again with its diagonals turned."""
    x, z = np.meshgrid(np.linspace(-1.1, 1.1, 5), np.linspace(-1.1, 1.1, 5))
    at = np.arange(25).reshape(5, 5)
    a, b, c, d = (part.reshape(-1) for part in (at[:-1, :-1], at[:-1, 1:], at[1:, 1:], at[1:, :-1]))
    faces = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    turned = np.concatenate([np.stack([a, b, d], 1), np.stack([b, c, d], 1)])
    levels = [np.stack([x, 0.3 * (k - 2) + 0.2 * x - 0.1 * z, z], -1).reshape(-1, 3) for k in range(NUM_SHEETS)]
    every = [*(25 * k + faces for k in range(NUM_SHEETS + 1)), 25 * (NUM_SHEETS + 1) + turned]
    return filled(np.concatenate([*levels, levels[2], levels[2]]), np.concatenate(every), dtype)


MESHES = {"soup twice": soup_twice, "closed body": closed_body, "sheets": sheets}


def nothing_at(depth: Array) -> Hit:
    """Hits of no triangle: the next layer begins right there."""
    return Hit(depth, jnp.full(depth.shape, -1, jnp.int32), jnp.zeros((*depth.shape, 3), depth.dtype))


def gap(mesh: Mesh, grid: RayGrid, hit: Hit) -> np.ndarray:
    """How far behind each hit the next layer begins, world units."""
    return np.asarray(hit_rounding(mesh, grid, hit), float).reshape(-1)


def all_hits(mesh: Mesh, grid: RayGrid) -> tuple[np.ndarray, np.ndarray]:
    """Depth of every ray on every triangle, infinite for a miss; and rays that pass an edge within roundings."""
    a, b, c = np.moveaxis(np.asarray(mesh.vertices, np.float64)[np.asarray(mesh.faces)], 1, 0)
    rays = jitted_rays(grid)
    origins, directions = (np.asarray(part, np.float64).reshape(-1, 1, 3) for part in (rays.origins, rays.directions))
    normal = np.cross(b - a, c - a)
    slope = np.sum(normal * directions, -1)
    safe = np.where(slope == 0, 1.0, slope)
    depth = np.sum(normal * (a - origins), -1) / safe
    across = np.cross(directions, a - origins)
    second, third = np.sum(across * (a - c), -1) / safe, np.sum(across * (b - a), -1) / safe
    least = np.minimum(np.minimum(second, third), 1 - second - third)
    ahead = (slope != 0) & (depth >= 0) & (depth <= float(grid.far))
    doubt = ahead & (np.abs(least) < 100 * float(jnp.finfo(grid.far.dtype).eps))
    return np.where(ahead & (least >= 0), depth, np.inf), np.any(doubt, axis=1)


@pytest.mark.parametrize("case", list(CASES))
def test_layers_are_the_sorted_hits(case, monkeypatch):
    """Peeled until nothing follows. Hits within the gap of the last one are one layer with it."""
    peel, name, dtype = CASES[case]
    if peel is peel_by_pairs:
        monkeypatch.setattr("shadowjax.rays.grid.caster.search_tiles", search_pairs)
        # Several windows, the last one with room left.
        monkeypatch.setattr("shadowjax.rays.grid._pairs.WINDOW", 1 << 12)
    grid = views(dtype)[name]
    far = float(grid.far)
    layers = {}
    for kind, make in MESHES.items():
        mesh = make(dtype)
        depths, doubt = all_hits(mesh, grid)
        layers[kind] = 0
        # Behind the start follows everything.
        hit, start = peel(mesh, grid, nothing_at(jnp.zeros((ROWS, COLS), dtype))), np.zeros((ROWS * COLS, 1))
        behind = np.zeros(ROWS * COLS)
        while True:
            # Half the gap on either side tells a hit that was met from one that follows.
            doubt |= np.any(np.abs(depths - start) <= 0.5 * behind[:, None], axis=1)
            behind = gap(mesh, grid, hit)
            sure, following = ~doubt, np.where(depths >= start, depths, np.inf)
            want, face = np.min(following, axis=1), np.argmin(following, axis=1)
            found = np.isfinite(want)
            np.testing.assert_array_equal(np.ravel(hit.is_hit)[sure], found[sure])
            if not np.any(found):
                break
            depth = np.where(found, want, far)
            assert np.all(np.abs(np.ravel(hit.depth) - depth)[sure] <= 0.5 * behind[sure])
            same = np.ravel(hit.face) == np.where(found, face, -1)
            if kind == "sheets":
                # Rounding chooses among sheets in one plane, but never the copy with the very same triangles.
                assert not np.any(np.asarray(hit.face) // SHEET == NUM_SHEETS)
                own = depths[np.arange(len(face)), np.ravel(hit.face)]
                same |= found & (np.abs(own - depth) <= 0.5 * behind)
            assert np.all(same[sure]), kind
            layers[kind] += 1
            start = np.minimum(depth + behind, far)[:, None]
            hit = peel(mesh, grid, hit)
        assert np.mean(doubt) < 0.03
    assert min(layers["soup twice"], layers["sheets"]) >= 3


def test_loop_with_a_floor_is_compiled_whole():
    """One loop, over groups for the general test, may be dispatched in steps; see `test_loops_are_compiled_whole`."""
    if jax.default_backend() != "cpu":
        pytest.skip("a processor's loops")
    for case in ("parallel", "perspective"):
        _, name, dtype = CASES[case]
        arguments = soup_twice(dtype), views(dtype)[name], nothing_at(jnp.zeros((ROWS, COLS), dtype))
        program = peel.lower(*arguments).compile().compiled.as_text()
        whole = program.count('xla_cpu_small_call="true"')
        assert whole >= 3
        assert program.count(" while(") - whole == 1


def test_gradients_under_vmap():
    """Views one after the other; derivatives by vertices against differences, none by the depth to start from."""
    _, name, dtype = CASES["parallel"]
    mesh, grid = soup_twice(dtype), views(dtype)[name]
    rng = np.random.default_rng(2)
    change = jnp.asarray(rng.normal(size=mesh.vertices.shape), dtype)
    step = 1e-6
    moved = [eqx.tree_at(lambda m: m.vertices, mesh, mesh.vertices + by * change) for by in (0.0, 0.1, step, -step)]
    # Further behind the first hit than it moves.
    first = peel(mesh, grid, nothing_at(jnp.zeros((ROWS, COLS), dtype))).depth + 1e-3
    here, _, after, before = hits = [peel(m, grid, nothing_at(first)) for m in moved]
    steady = (here.face == after.face) & (here.face == before.face)
    assert float(jnp.mean(steady)) > 0.98
    weight = jnp.where(steady, jnp.asarray(rng.normal(size=(ROWS, COLS)), dtype), 0.0)

    @eqx.filter_jit
    @jax.vmap
    def both(vertices, first):
        def total(vertices, first):
            moved = eqx.tree_at(lambda m: m.vertices, mesh, vertices)
            hit = second_layer(GridCaster(NoRays()), moved, grid, nothing_at(first))
            return jnp.sum(weight * hit.depth), hit

        return jax.value_and_grad(total, (0, 1), has_aux=True)(vertices, first)

    (_, found), (by_vertices, by_first) = both(jnp.stack([m.vertices for m in moved[:2]]), jnp.stack([first, first]))
    for k in range(2):
        np.testing.assert_array_equal(found.face[k], hits[k].face)
        np.testing.assert_allclose(found.depth[k], hits[k].depth, rtol=1e-12)
    assert bool(jnp.all(jnp.isfinite(by_vertices)))
    np.testing.assert_array_equal(by_first, np.zeros((2, ROWS, COLS)))
    slope = float(jnp.sum(by_vertices[0] * change))
    assert abs(slope) > 0.1
    assert slope == pytest.approx(float(jnp.sum(weight * (after.depth - before.depth))) / (2 * step), rel=1e-5)


def test_rays_of_a_point_light_are_traced():
    """Its space bends lines, so nothing can be drawn: rays start a gap behind the first hit, never beyond the end."""
    _, name, dtype = CASES["parallel"]
    mesh, grid = soup_twice(dtype), views(dtype)[name]
    first = jnp.linspace(0.0, float(grid.far), ROWS * COLS, dtype=dtype).reshape(ROWS, COLS)
    bent = eqx.tree_at(lambda g: g.space, grid, OctahedralSpace(jnp.asarray([0.1, 0.2, 0.05], dtype)))
    face = jnp.arange(ROWS * COLS, dtype=jnp.int32).reshape(ROWS, COLS) % (mesh.num_faces + 1) - 1
    met = Hit(first, face, jnp.zeros((ROWS, COLS, 3), dtype))
    starts = eqx.filter_jit(second_layer)(GridCaster(Starts()), mesh, bent, met).depth
    behind = np.asarray(first).reshape(-1) + gap(mesh, bent, met)
    np.testing.assert_allclose(np.ravel(starts), np.minimum(behind, float(grid.far)), rtol=1e-12)
    assert np.all((gap(mesh, bent, met) > 0) == (np.ravel(face) >= 0))
    with pytest.raises(ValueError, match=r"the shape of the grid, \(26, 31\); got \(3, 4\)"):
        GridCaster(NoRays()).closest_beyond_on_grid(mesh, grid, first[:3, :4])
