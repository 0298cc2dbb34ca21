"""BSP trees: orders against ray casting, visible sets against what a light sees, cuts that still fit, bad input."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from shapes import bumpy_sphere

from shadowjax import DirectionalLight, Mesh, PointLight, make_scene
from shadowjax.geometry.adjacent_edges import find_adjacent_edges
from shadowjax.volumes.bsp import bsp_of_mesh, build_bsp

TRIANGLE = [[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]
front_to_back = eqx.filter_jit(lambda tree, eye: tree.front_to_back(eye))


def soup(seed, count=40, dtype=jnp.float64):
    """Triangles that pass through each other everywhere."""
    corners = np.random.default_rng(seed).uniform(-1, 1, (3 * count, 3))
    return Mesh.create(jnp.asarray(corners, dtype), np.arange(3 * count).reshape(-1, 3))


def pieces(tree):
    """Corners of every piece, without padding."""
    return [np.asarray(c)[:n] for c, n in zip(np.asarray(tree.corners), np.asarray(tree.num_corners), strict=True)]


def depths(tree, eye, directions):
    """Distance along each ray to each piece, by the signs of its sides; infinity where it is missed."""
    points, corners = np.asarray(tree.vertices, float), np.asarray(tree.corners)
    planes = np.asarray(tree.planes, float)[np.asarray(tree.node)]
    slope = directions @ planes[:, :3].T
    grazing = np.abs(slope) < 1e-6
    depth = -(planes[:, :3] @ eye + planes[:, 3]) / np.where(grazing, 1, slope)
    hit = ~grazing & (depth > 1e-9)
    at = eye + depth[..., None] * directions[:, None]
    normal = planes[:, :3] * np.where(np.asarray(tree.turned), -1, 1)[:, None]
    for side in range(corners.shape[1]):
        start, end = points[corners[:, side]], points[np.roll(corners, -1, axis=1)[:, side]]
        hit &= np.einsum("rpi,pi->rp", at - start, np.cross(normal, end - start)) >= 0
    return np.where(hit, depth, np.inf)


def inversions(tree, eye, seed=0, rays=120):
    """Pairs of pieces along rays whose order is wrong, and pairs looked at."""
    rng = np.random.default_rng(seed)
    targets = np.asarray(tree.vertices, float)
    low, high = targets.min(axis=0), targets.max(axis=0)
    directions = rng.uniform(low, high, (rays, 3)) - eye
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    depth = depths(tree, eye, directions)
    rank = np.argsort(np.asarray(front_to_back(tree, jnp.asarray(eye, tree.vertices.dtype))))
    wrong = total = 0
    for row in depth:
        met = np.flatnonzero(np.isfinite(row))
        met = met[np.argsort(row[met])]
        # Pieces that meet at one point of the ray have no order there.
        apart = np.diff(row[met]) > 1e-5
        total += int(apart.sum())
        wrong += int((np.diff(rank[met])[apart] < 0).sum())
    return wrong, total


@pytest.mark.parametrize("balance", [0.0, 1.0])
def test_no_ray_meets_pieces_out_of_order(balance, dtype):
    tree = bsp_of_mesh(soup(1, dtype=dtype), balance)
    assert tree.num_splits > 50
    looked = 0
    for seed, eye in enumerate([[3.0, 0.4, 0.2], [0.1, -0.2, 0.05], [-0.5, 2.0, -0.7]]):
        order = np.asarray(front_to_back(tree, jnp.asarray(eye, dtype)))
        np.testing.assert_array_equal(np.sort(order), np.arange(tree.num_pieces))
        np.testing.assert_array_equal(tree.back_to_front(jnp.asarray(eye, dtype)), order[::-1])
        wrong, total = inversions(tree, np.asarray(eye), seed)
        assert wrong == 0
        looked += total
    assert looked > 500


@pytest.mark.parametrize("name", ["solids", "cubes"])
def test_built_in_scenes_are_in_order_from_the_camera_and_from_inside(name):
    scene = make_scene(name)
    tree = bsp_of_mesh(scene.mesh)
    for eye in (np.asarray(scene.camera.position), np.asarray(scene.mesh.vertices.mean(axis=0))):
        wrong, total = inversions(tree, eye)
        assert wrong == 0
        assert total > 100


def test_three_triangles_that_overlap_in_a_ring_are_cut():
    """No order of whole polygons is right here: the painter's failure that the tree removes."""
    arm = np.array([[-0.2, -1.0, 0.15], [0.2, -1.0, 0.15], [0.0, 2.0, -0.3]])
    turns = [2 * np.pi * k / 3 for k in range(3)]
    ring = np.concatenate([
        (arm + np.array([0.5, 0, 0])) @ np.array([[np.cos(t), np.sin(t), 0], [-np.sin(t), np.cos(t), 0], [0, 0, 1]])
        for t in turns
    ])  # fmt: skip
    tree = build_bsp(ring, np.arange(9).reshape(3, 3))
    assert tree.num_splits >= 1
    assert inversions(tree, np.array([0.0, 0.0, 5.0]), rays=3000)[0] == 0


def area(corners):
    """Of a flat polygon, as the length of its fan's summed normals."""
    spokes = corners[1:] - corners[0]
    return np.linalg.norm(np.cross(spokes[:-1], spokes[1:]).sum(axis=0)) / 2


def test_pieces_cover_their_polygons():
    mesh = soup(2)
    tree = bsp_of_mesh(mesh, 0.5)
    points = np.asarray(tree.vertices)
    total = np.zeros(mesh.num_faces)
    for ring, source in zip(pieces(tree), np.asarray(tree.source), strict=True):
        total[source] += area(points[ring])
    np.testing.assert_allclose(total, mesh.areas(), rtol=1e-7)
    assert tree.num_nodes <= tree.num_pieces
    # Every piece lies on the side of every plane above it that its place in the tree says.
    above, planes, in_front = np.asarray(tree.parent), np.asarray(tree.planes), np.asarray(tree.in_front)
    for ring, node in zip(pieces(tree), np.asarray(tree.node), strict=True):
        while (parent := above[node]) >= 0:
            height = points[ring] @ planes[parent, :3] + planes[parent, 3]
            assert (height if in_front[node] else -height).min() > -1e-8
            node = parent


def t_junctions(tree, num_polygons):
    """Corners of the first polygons' pieces that lie inside a side of another of these pieces, by brute force."""
    points = np.asarray(tree.vertices, float)
    rings = [ring for ring, source in zip(pieces(tree), np.asarray(tree.source), strict=True) if source < num_polygons]
    sides = np.concatenate([np.stack([ring, np.roll(ring, -1)], axis=1) for ring in rings])
    start, along = points[sides[:, 0]], points[sides[:, 1]] - points[sides[:, 0]]
    offset = points[np.unique(sides)] - start[:, None]
    place = np.einsum("spi,si->sp", offset, along) / (along**2).sum(axis=1)[:, None]
    off = np.linalg.norm(offset - place[..., None] * along[:, None], axis=2)
    return int(((place > 1e-6) & (place < 1 - 1e-6) & (off < 1e-9)).sum())


def test_cuts_leave_t_junctions_and_the_repair_removes_them():
    """A closed body and a blade through it: both are cut, and the body's sides match again, corner by corner."""
    body = bumpy_sphere(subdivisions=1)
    blade = np.array([[-9.0, 0.1, -8], [9, 0.0, -9], [0, 0.2, 12]])
    vertices = np.concatenate([np.asarray(body.vertices), blade])
    faces = np.concatenate([np.asarray(body.faces), [[len(vertices) - 3, len(vertices) - 2, len(vertices) - 1]]])
    torn, whole = (build_bsp(vertices, faces, balance=1.0, repair=repair) for repair in (False, True))
    assert torn.num_pieces == whole.num_pieces
    assert torn.num_splits > 10
    assert t_junctions(torn, body.num_faces) > 0
    assert t_junctions(whole, body.num_faces) == 0


def test_a_silhouette_of_pieces_is_that_of_the_polygons():
    """What the repair is for: between the pieces that face a light all inner edges cancel, although they were cut."""
    mesh = soup(4, count=25)
    light = PointLight.create((0.3, 2.5, 0.1))
    lengths = {}
    for repair in (False, True):
        tree = bsp_of_mesh(mesh, 1.0, repair=repair)
        points, facing = np.asarray(tree.vertices), np.asarray(tree.facing(light))
        sides = find_adjacent_edges([ring for ring, seen in zip(pieces(tree), facing, strict=True) if seen]).external
        lengths[repair] = float(np.linalg.norm(points[sides[:, 1]] - points[sides[:, 0]], axis=1).sum())
    seen = np.asarray(tree.sources_facing(light, mesh.num_faces))
    corners = np.asarray(mesh.triangles())[seen]
    outline = float(np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).sum())
    np.testing.assert_allclose(lengths[True], outline, rtol=1e-6)
    assert lengths[False] > 1.05 * outline


@pytest.mark.parametrize("light", [PointLight.create((0.5, 3.0, -1.0)), DirectionalLight.create((0.3, -1.0, 0.5))])
def test_the_visible_set_is_what_faces_the_light(light):
    mesh = soup(5)
    tree = bsp_of_mesh(mesh)
    to_light, _ = light.to_light(mesh.triangles()[:, 0])
    facing = np.asarray(jnp.sum(mesh.area_vectors() * to_light, axis=1) > 0)
    visible = eqx.filter_jit(lambda tree, light: tree.sources_facing(light, mesh.num_faces))(tree, light)
    np.testing.assert_array_equal(visible, facing)


def test_overlapping_polygons_of_one_plane_keep_the_order_of_the_input():
    """No order is right for them; the later one is painted last, from both sides and however they are turned."""
    stack = np.array([[0, 1, 2], [3, 4, 5], [8, 7, 6]])
    corners = np.concatenate([np.asarray(TRIANGLE) + np.array([0.1 * k, 0, 0]) for k in range(3)])
    tree = build_bsp(corners, stack)
    assert tree.num_nodes == 1
    assert tree.turned.tolist() == [False, False, True]
    for height in (2.0, -2.0):
        assert tree.source[tree.back_to_front(jnp.asarray([0.0, 0, height]))].tolist() == [0, 1, 2]
        assert tree.facing(PointLight.create((0.0, 0, height))).tolist() == [height > 0, height > 0, height < 0]
    # A light in the plane sees none of them.
    assert not tree.facing(PointLight.create((5.0, 5.0, 0.0))).any()


def test_polygons_without_area_are_left_out_and_listed():
    corners = [*TRIANGLE, [2.0, 0, 0], [0, 0, 1]]
    tree = build_bsp(corners, [[0, 1, 3], [0, 1, 2], [1, 1, 4], [0, 1, 4]])
    assert tree.dropped == (0, 2)
    assert sorted(tree.source.tolist()) == [1, 3]


def test_balance_buys_a_lower_tree_with_cuts():
    mesh = make_scene("cubes").mesh
    few, low = (bsp_of_mesh(mesh, balance) for balance in (0.0, 1.0))
    assert few.num_splits < low.num_splits
    assert few.height > low.height
    # The same input gives the same tree.
    again = bsp_of_mesh(mesh, 1.0)
    np.testing.assert_array_equal(again.corners, low.corners)


@pytest.mark.parametrize(
    ("polygons", "told"),
    [
        ([], "at least one polygon"),
        ([[0, 1]], "three corners or more; polygon 0 has 2"),
        ([[0, 1, 9]], r"corners must lie in \[0, 5\), the vertices; got 0 … 9"),
        ([[0, 1, 0]], "none of the 1 polygons has an area"),
        ([[0, 1, 2], [0, 1, 3, 4]], "polygons must be flat: corners of polygon 1 lie up to"),
        ([[0, 1, 3, 2]], "polygons must be convex; polygon 0 is not"),
    ],
)
def test_bad_polygons_are_named(polygons, told):
    corners = [*TRIANGLE, [0.2, 0.2, 0], [0, 0, 1]]
    with pytest.raises(ValueError, match=told):
        build_bsp(corners, polygons)


def test_bad_numbers_are_named():
    with pytest.raises(ValueError, match="finite"):
        build_bsp(np.array([[0.0, 0, 0], [1, 0, 0], [0, np.nan, 0]]), [[0, 1, 2]])
    with pytest.raises(ValueError, match=r"balance must lie in \[0, 1\].*got 2"):
        build_bsp(TRIANGLE, [[0, 1, 2]], balance=2.0)
    with pytest.raises(ValueError, match="candidates must be an integer of at least 1; got 0"):
        build_bsp(TRIANGLE, [[0, 1, 2]], candidates=0)
    with pytest.raises(ValueError, match=r"shape \(V, 3\)"):
        build_bsp(np.zeros((3, 2)), [[0, 1, 2]])
