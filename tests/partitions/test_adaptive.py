"""Adaptive maps: the page table against search by hand, tiles against the uniform map, memory, order, and what is told
of bad input."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from adaptive_case import scene, technique
from shapes import bumpy_sphere, lights

from shadowjax import Bias, Camera, Exact, Hard, Mesh, ShadowMapping, astype
from shadowjax._numerics import singular_values
from shadowjax.geometry.polygons import polygon_of_face
from shadowjax.partitions.adaptive.footprint import FOOTPRINTS, mip_value, on_surface
from shadowjax.partitions.adaptive.page_table import TILE_BYTES, PageTable
from shadowjax.partitions.adaptive.refinement import refinement_cost, wishes
from shadowjax.partitions.adaptive.tile_store import TileStore, slots_in
from shadowjax.partitions.adaptive.tile_tree import (
    MAX_LEVEL,
    deinterleaved,
    interleaved,
    place_of,
    span_of,
    tiles_of_level,
)
from shadowjax.partitions.single import SingleMap
from shadowjax.rays.ray_grid import camera_grid
from shadowjax.techniques.adaptive import AdaptiveShadowMapping, placed_on

SMALL, LARGE = 1 << 13, 1 << 16
ROUNDING = {jnp.float32: 2e-6}
read = eqx.filter_jit(lambda shadows, points, normals: shadows.visibility(points, normals))
read_of = eqx.filter_jit(lambda shadows, points, normals, faces: shadows.visibility_of(points, normals, faces))
texels = eqx.filter_jit(lambda map_, square: map_.read(square))


def truth_at(points, normals):
    return exact_at(scene(), points, normals)


@eqx.filter_jit
def exact_at(scene, points, normals):
    return Exact().build(*scene).visibility(points, normals)


def floor_points(num=128, reach=3.0, dtype=jnp.float32):
    spots = jnp.stack(jnp.meshgrid(*[jnp.linspace(-reach, reach, num, dtype=dtype)] * 2), axis=-1).reshape(-1, 2)
    zeros = jnp.zeros(len(spots), dtype)
    return jnp.stack([spots[:, 0], zeros, spots[:, 1]], axis=-1), jnp.stack([zeros, zeros + 1, zeros], axis=-1)


def wrong_in(shadows, view):
    """Pixels of a view whose answer is not the exact one."""
    found, truth = read(shadows, view.points, view.normals), truth_at(view.points, view.normals)
    return int(np.sum(np.asarray((found != truth) & view.counts)))


@pytest.fixture(scope="module")
def small():
    return technique(SMALL).build(*scene())


@pytest.fixture(scope="module")
def built():
    return technique(LARGE).build(*scene())


def random_tiles(rng, num, levels=6):
    """Distinct tiles of every level, after those of level 1, which cover the square."""
    level = rng.integers(1, levels + 1, num)
    keys = np.stack([level, rng.integers(0, 2**level), rng.integers(0, 2**level)], axis=-1).astype(np.int32)
    return np.unique(np.concatenate([tiles_of_level(1), keys]), axis=0)


def test_the_curve_puts_every_tile_on_an_interval_of_its_own():
    x, y = np.random.default_rng(0).integers(0, 1 << MAX_LEVEL, (2, 500)).astype(np.int32)
    np.testing.assert_array_equal(deinterleaved(interleaved(x, y)), (x, y))
    start, end = span_of(tiles_of_level(3))
    np.testing.assert_array_equal(start[1:], end[:-1])
    assert (start[0], end[-1]) == (0, 1 << (2 * MAX_LEVEL))
    centre = (tiles_of_level(3)[:, 1:] + 0.5) / 8
    place = np.asarray(place_of(jnp.asarray(centre)))
    assert ((start <= place) & (place < end)).all()
    assert int(place_of(jnp.asarray([1.5, 1.0]))) == end[-1] - 1  # outside: the nearest cell


def test_the_page_table_finds_the_finest_tile_that_holds_a_position():
    rng = np.random.default_rng(1)
    square = rng.uniform(0, 1, (2000, 2))
    for num in (0, 5, 60, 120):
        tiles = random_tiles(rng, num)
        keys = np.zeros((140, 3), np.int32)
        keys[:, 0] = -1
        slots = rng.permutation(140)[: len(tiles)]
        keys[slots] = tiles
        slot, level = PageTable.of(keys).find(jnp.asarray(square))
        holds = np.all(np.floor(square[:, None] * 2.0 ** tiles[:, :1]) == tiles[:, 1:], axis=-1)
        finest = np.argmax(np.where(holds, tiles[:, 0], -1), axis=1)
        np.testing.assert_array_equal(slot, slots[finest])
        np.testing.assert_array_equal(level, tiles[finest, 0])
        assert PageTable.of(keys).num_bytes == 140 * TILE_BYTES + 8


def test_a_table_with_a_hole_is_refused():
    with pytest.raises(ValueError, match="must cover the unit square"):
        PageTable.of(np.delete(tiles_of_level(2), 7, axis=0))


def test_every_level_has_the_texels_of_the_uniform_map():
    """All 64 tiles of level 3, each of 8², hold what a map of 64² holds."""
    mesh, light, camera = scene()
    shadows = technique(LARGE, base_level=3, max_steps=0).build(mesh, light, camera)
    uniform = ShadowMapping(Hard(), 64).build(mesh, light, camera).maps[0]
    texel = texels(shadows.map, uniform.grid.centres())
    assert shadows.map.store.num_pinned == 64
    np.testing.assert_array_equal(texel.level, 3)
    np.testing.assert_allclose(texel.depth, uniform.depth, rtol=ROUNDING[jnp.float32])
    np.testing.assert_array_equal(texel.centre, uniform.grid.centres())


def test_a_full_store_lets_go_of_the_longest_unused_then_of_the_least_worth():
    store = TileStore.create(6, 0)
    keys = np.array([[1, 0, 0], [1, 1, 0], [1, 0, 1], [1, 1, 1], [2, 0, 0]], np.int32)
    first = store.used(np.array([0])).place(keys, np.array([9, 8, 7, 6, 5]))
    assert (list(first.slots), first.num_evicted, first.num_refused) == ([1, 2, 3, 4, 5], 0, 0)
    pixels = np.repeat([0, 2, 3, 4, 5], 20)
    store = first.store.used(pixels).used(np.repeat([0, 3, 4, 5], [9, 7, 3, 5]))
    # Slot 1 was last read two frames ago, slot 2 one frame ago; of those read now slot 4 serves three pixels.
    new = np.array([[3, i, 0] for i in range(5)], np.int32)
    placed = store.place(new, np.array([4, 1, 3, 4, 5]))
    assert list(placed.slots) == [1, 2, 4]
    # Three is not more than the three pixels of slot 4, nor five more than the five of slot 5.
    np.testing.assert_array_equal(placed.keys, new[[0, 1, 3]])
    assert (placed.num_evicted, placed.num_refused) == (3, 2)
    np.testing.assert_array_equal(placed.store.keys[0], [0, 0, 0])


def test_wishes_count_the_pixels_that_lack_texels_and_follow_benefit_over_cost():
    cells = np.array([[0, 0], [1, 0], [8, 8], [8, 8], [8, 8], [15, 15]]) / 16
    place = np.asarray(place_of(jnp.asarray(cells)))
    cell, level = np.array([0, 0, 1, 1, 1, 2]), np.array([1, 1, 1, 1, 1, 1])
    needed = np.array([5, 4, 2, 2, 1, 1])
    found = wishes(place, cell, level, needed, 3, 64, 1.0, 100.0)
    # One pixel has what it needs already. Cell 0 takes two tiles for two pixels, cell 1 a single one for two.
    np.testing.assert_array_equal(found.keys, [[2, 2, 2], [4, 0, 0], [4, 1, 0]])
    np.testing.assert_array_equal(found.benefit, [2, 1, 1])
    np.testing.assert_array_equal(found.required, [64, 128, 128])
    np.testing.assert_allclose(found.ratio, [2 / 164, 2 / 228, 2 / 228])
    assert len(wishes(place[4:], cell[4:], level[4:], needed[4:], 1, 64, 1.0, 0.0).keys) == 0
    assert refinement_cost(1024, 1, 100) == 1124


@eqx.filter_jit
def spans(view, grid, point, normal):
    return [FOOTPRINTS[name](view, grid, point, normal) for name in ("jacobian", "area", "mip")]


def test_mip_levels_see_the_longer_axis_of_a_footprint_for_both():
    """A camera looks at the floor from above and aside: the estimate exceeds the true area by 1/cos(tilt)."""
    floor = Mesh(*(getattr(scene(jnp.float64)[0], name) for name in ("vertices", "faces", "face_colors")))
    light, point, normal = lights()["directional"], jnp.zeros((1, 3)), jnp.asarray([[0.0, 1.0, 0.0]])
    light = eqx.tree_at(lambda one: one.direction, light, jnp.asarray([0.0, -1.0, 0.0]))
    for tilt_deg in (0.0, 45.0, 60.0, 80.0):
        tilt = np.radians(tilt_deg)
        camera = Camera.look_at((0.0, 9 * np.cos(tilt), 9 * np.sin(tilt)), (0.0, 0, 0), (0.0, 0.1, -1.0), phi_y=0.3,
                                near=1, far=20)  # fmt: skip
        view = camera_grid(camera, 1001, 1001)
        grid = jax.jit(lambda camera: SingleMap().grids(floor, light, camera, 8)[0])(camera)
        true, mean, guess = (float(part[0]) for part in spans(view, grid, point, normal))
        assert guess**2 / mean**2 == pytest.approx(1 / np.cos(tilt), rel=1e-9)
        assert true / mean == pytest.approx(np.cos(tilt) ** 0.5, rel=1e-9)
    across, down = on_surface(view, point, normal)
    assert float(jnp.linalg.norm(down) / jnp.linalg.norm(across)) == pytest.approx(1 / np.cos(tilt), rel=1e-9)
    np.testing.assert_allclose(mip_value(jnp.asarray([0.5, 1.0, 3.0]), jnp.asarray(1.0)), [1, 1, 2.584962500721156])


def test_singular_values_are_those_of_linear_algebra(rounding, dtype):
    matrix = jax.random.normal(jax.random.key(0), (50, 2, 2), dtype)
    found = np.stack(jax.jit(singular_values)(matrix), axis=-1)
    np.testing.assert_allclose(found, np.linalg.svd(matrix, compute_uv=False), rtol=100 * rounding, atol=10 * rounding)
    gradient = jax.jit(jax.grad(lambda m: sum(jnp.sum(part) for part in singular_values(m))))(
        jnp.zeros((1, 2, 2), dtype)
    )
    assert np.isfinite(gradient).all()


def test_coplanar_neighbours_are_one_polygon():
    assert len(np.unique(polygon_of_face(scene()[0]))) == 2
    box = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], float)
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = np.array([[(a, b, c), (a, c, d)] for a, b, c, d in quads]).reshape(-1, 3)
    polygons = np.asarray(polygon_of_face(Mesh.create(box, faces)))
    np.testing.assert_array_equal(polygons[::2], polygons[1::2])
    assert len(np.unique(polygons)) == 6
    sphere = bumpy_sphere()
    assert len(np.unique(polygon_of_face(sphere))) == sphere.num_faces


def test_more_memory_brings_the_shadow_nearer_to_the_exact_one(small, built):
    view = built.look(scene()[2])
    wrong = []
    for shadows, budget in ((small, SMALL), (built, LARGE)):
        assert shadows.map_bytes <= budget
        slots = slots_in(budget, 64, 4)
        assert shadows.map.depth.shape[0] == slots
        wrong.append(wrong_in(shadows, view))
    assert wrong[0] > 2 * wrong[1] > 0


def test_refinement_settles_and_what_does_not_fit_stays_coarse(built):
    """A budget below the need is no error: the least worthy edges keep coarser texels, and nothing goes round."""
    shadows = technique(SMALL).start(*scene())
    view = shadows.look(scene()[2])
    shadows, steps = shadows.refined(view, 40)
    assert steps[-1].num_cast == 0
    assert len(steps) < 40
    assert steps[-1].num_refused > 0
    assert max(step.num_resident for step in steps) <= slots_in(SMALL, 64, 4)
    one, step = shadows.refine(view)
    assert step.num_cast == 0
    np.testing.assert_array_equal(one.map.store.keys, shadows.map.store.keys)
    # With room for all, pixels at edges have what they ask for, up to the finest level.
    _, last = built.refine(built.look(scene()[2]))
    assert last.num_lacking == last.num_refused == 0
    assert last.num_edge > 0


def test_progress_is_made_step_by_step_while_a_view_holds():
    mesh, light, camera = scene()
    shadows = technique(LARGE).start(mesh, light, camera)
    view = shadows.look(camera)
    wrong = [wrong_in(shadows, view)]
    for _ in range(4):
        shadows, step = shadows.refine(view, 8)
        assert step.num_cast <= 8
        wrong.append(wrong_in(shadows, view))
    assert wrong[0] > wrong[1] > wrong[4]


def test_a_walk_reuses_tiles_and_stays_in_its_memory():
    mesh, light, camera = scene()
    shadows = technique(SMALL).start(mesh, light, camera)
    slots, bytes_, cast_again = slots_in(SMALL, 64, 4), shadows.map_bytes, []
    for turn in (0.0, 0.15, 0.3, 0.45):
        at = 7 * np.sin(turn) + 0.3, 5.0, 7 * np.cos(turn)
        moved = Camera.look_at(at, (0.1, 0.2, 0.0), phi_y=0.45, near=2, far=16, dtype=jnp.float32)
        shadows, steps = shadows.refined(shadows.look(moved), 12)
        cast_again.append(sum(step.num_cast for step in steps))
        assert steps[-1].num_resident <= slots
        assert shadows.map_bytes == bytes_ <= SMALL
    assert max(cast_again[1:]) < cast_again[0] / 2


def test_ids_free_planes_of_acne_and_depth_frees_edges_of_ids():
    """Without a bias the depth test speckles the floor; ids darken the far side of every polygon's edge."""
    mesh, light, camera = scene()
    points, normals = floor_points()
    floor = jnp.zeros(len(points), jnp.int32)
    truth = np.asarray(truth_at(points, normals))
    found = {}
    for test in ("depth", "id", "hybrid"):
        shadows = technique(LARGE, test=test, bias=Bias.create(jnp.float32(0))).build(mesh, light, camera)
        found[test] = np.asarray(read_of(shadows, points, normals, floor))
        if test == "id":
            with pytest.raises(ValueError, match="needs the triangle of every receiver"):
                shadows.visibility(points, normals)
        elif test == "hybrid":  # unknown triangles: depth alone
            unknown = read(shadows, points, normals)
            assert (np.asarray(unknown) <= found["hybrid"]).all()
    np.testing.assert_array_equal(found["hybrid"], np.maximum(found["hybrid"], found["id"]))
    speckles = ((found["depth"] == 0) & (truth == 1)).sum()
    assert speckles > 20 * ((found["hybrid"] == 0) & (truth == 1)).sum()
    assert (found["hybrid"] != truth).sum() < (found["depth"] != truth).sum()


def test_lookups_have_finite_gradients_and_tiles_follow_the_mesh(built):
    mesh = scene()[0]
    points, normals = floor_points(8)

    def gap(points):
        square, depth = placed_on(built.map, points, normals)
        forgiven = built.bias.in_world(built.map.grid, points, normals)
        return jnp.sum((built.map.read(square).depth - depth) ** 2 + forgiven)

    gradient = jax.jit(jax.grad(gap))(points)
    assert np.isfinite(gradient).all()
    assert np.abs(gradient).max() > 0
    np.testing.assert_array_equal(jax.grad(lambda p: jnp.sum(read(built, p, normals)))(points), 0)

    square, depth = placed_on(built.map, points, normals)
    sees_floor = jnp.abs(built.map.read(square).depth - depth) < 0.3

    def lifted(height):
        """Stored depth with the floor lifted, as far as floor is seen: the light is at a slant."""
        up = jnp.zeros_like(mesh.vertices).at[:4, 1].set(height)
        moved = built.recast(Mesh(mesh.vertices + up, mesh.faces, mesh.face_colors))
        return jnp.where(sees_floor, moved.map.read(square).depth, 0)

    compiled = jax.jit(lambda height: jax.jvp(lifted, (height,), (jnp.ones_like(height),)))
    before, slope = compiled(jnp.float32(0))
    expected = jnp.where(sees_floor, 1 / scene()[1].direction[1], 0)
    assert int(sees_floor.sum()) > 40
    np.testing.assert_allclose(slope, expected, rtol=1e-5)
    np.testing.assert_allclose(compiled(jnp.float32(0.01))[0] - before, 0.01 * expected, atol=1e-5)
    with pytest.raises(ValueError, match="the mesh's own faces, 4 of them; got 2"):
        built.recast(Mesh(mesh.vertices, mesh.faces[:2], mesh.face_colors[:2]))


@pytest.mark.parametrize("kind", ["point"])
def test_local_lights_have_adaptive_maps_too(kind):
    """The floor alone is lit; with the plate, what a view sees differs from the exact shadow at its edges only."""
    mesh, light, camera = scene()[0], lights(jnp.float32)[kind], scene()[2]
    shadows = technique(LARGE, max_steps=6).build(mesh, light, camera)
    view = shadows.look(camera)
    found = read(shadows, view.points, view.normals)
    truth = exact_at((mesh, light, camera), view.points, view.normals)
    wrong = (np.asarray(found) != np.asarray(truth)) & np.asarray(view.counts)
    assert 0.02 < np.mean(np.asarray(truth)[np.asarray(view.counts)] == 0) < 0.5
    assert wrong.sum() < 0.005 * np.asarray(view.counts).sum()


@pytest.mark.parametrize(
    ("options", "told"),
    [
        ({"budget_bytes": 100}, "budget of 100 bytes holds no tile of 8 × 8"),
        ({"budget_bytes": 4096, "base_level": 3}, "holds 15 tiles, but level 3 alone has 64"),
        ({"budget_bytes": 0}, "budget_bytes must be an integer of at least 1"),
        ({"tile_size": 12}, "power of two; got 12"),
        ({"max_level": 16}, "too fine: at most level 15"),
        ({"base_level": 8}, "base_level 8 must not exceed max_level 7"),
        ({"footprint": "circle"}, "footprint must be one of 'jacobian', 'area', 'mip'"),
        ({"test": "colour"}, "test must be one of 'depth', 'id', 'hybrid'"),
        ({"texels_per_pixel": 0.0}, "texels_per_pixel must be positive"),
        ({"levels_per_step": 0}, "levels_per_step"),
        ({"per_texel": 0.0, "fixed": 0.0}, "per_texel and fixed"),
        ({"num_rows": 0}, "num_rows must"),
    ],
)
def test_bad_settings_are_named(options, told):
    with pytest.raises(ValueError, match=told):
        technique(**options).start(*scene())


def test_it_is_built_on_the_host():
    mesh, light, camera = scene()

    def total(vertices):
        return jnp.sum(technique().build(Mesh(vertices, mesh.faces, mesh.face_colors), light, camera).map.depth)

    with pytest.raises(ValueError, match="refined on the host"):
        jax.grad(total)(mesh.vertices)
    with pytest.raises(ValueError, match="on the host"):
        jax.jit(lambda v: polygon_of_face(Mesh(v, mesh.faces, mesh.face_colors)))(mesh.vertices)


def test_defaults_reach_65536_texels_and_cast_to_float32():
    assert AdaptiveShadowMapping(tile_size=16).finest_level == 12
    assert AdaptiveShadowMapping(tile_size=4).finest_level == 14
    assert AdaptiveShadowMapping(tile_size=1).finest_level == 15
    assert astype(AdaptiveShadowMapping(), jnp.float32).num_tones == 2
