"""The registry of scenes: counts, closed bodies, reproducibility, framing, and shadows that fall in sight."""

import itertools
import re

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import trimesh
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from trimesh.ray.ray_pyembree import RayMeshIntersector

from shadowjax import scenes
from shadowjax.scenes import SCENES, primitives, recursive_tetrahedron, solids, surfaces
from shadowjax.scenes.parts import make_part, random_rotations, rotation, scatter

EXPECTED = {
    "smooth-and-abrupt", "plant", "rubble", "fence", "curved-bodies", "geodesic-sphere", "solids",
    "recursive-tetrahedron", "cubes", "cad-assembly", "colonnade", "avenue", "terrain", "plate-over-plane",
    "two-plates", "comb", "sphere-over-plane",
}  # fmt: skip
SCALING = [name for name, family in SCENES.items() if family.scales]
ALL_SHADOW_ON_GROUND = sorted(EXPECTED - {"colonnade"})  # whose walls take what leaves the floor


@pytest.fixture(scope="module")
def built():
    """Every scene at its default size in float64, built once."""
    return {name: scenes.make_scene(name, dtype=jnp.float64) for name in SCENES}


def as_trimesh(mesh):
    return trimesh.Trimesh(np.asarray(mesh.vertices), np.asarray(mesh.faces), process=False)


def bodies(vertices, faces):
    """Number of bodies and which one each vertex belongs to."""
    ends = np.concatenate([faces[:, :2], faces[:, 1:]])
    graph = coo_array((np.ones(len(ends)), (ends[:, 0], ends[:, 1])), shape=(len(vertices),) * 2)
    return connected_components(graph, directed=False)


def view_rays(camera, width=64, height=48):
    x = ((np.arange(width) + 0.5) / width * 2 - 1) * float(camera.half_size[0])
    y = ((np.arange(height) + 0.5) / height * 2 - 1) * float(camera.half_size[1])
    plane = np.stack([*np.meshgrid(x, y), np.ones((height, width))], -1).reshape(-1, 3)
    directions = plane @ np.asarray(camera.rotation)
    return np.broadcast_to(np.asarray(camera.position), directions.shape), directions


def test_the_recursive_tetrahedron_is_of_closed_bodies_apart_and_has_the_source_s_shadow_polygons():
    """161 bodies: 4 free faces, then 3 each; a side of one of two always has the other before it."""
    assert [recursive_tetrahedron.num_tetrahedra(depth) for depth in range(5)] == [1, 5, 17, 53, 161]
    # mean silhouette of a regular tetrahedron: 6 edges whose normals differ by π − acos ⅓; and the ground's 4
    np.testing.assert_allclose(161 * 6 * (np.pi - np.arccos(1 / 3)) / np.pi + 4, 596, rtol=0.01)
    corners = recursive_tetrahedron.corners(3)
    edges = np.linalg.norm(corners[:, [0, 0, 0, 1, 2, 3]] - corners[:, [1, 2, 3, 2, 3, 1]], axis=-1)
    np.testing.assert_allclose(edges, edges[:, :1] * np.ones(6), rtol=1e-12)
    sides = np.array([[0, 1, 2], [0, 2, 3], [0, 3, 1], [1, 2, 3]])
    lines = np.array(list(itertools.combinations(range(4), 2)))
    for i, one in enumerate(corners):
        others = corners[:i]
        faces = np.concatenate([np.broadcast_to(one, others.shape)[:, sides], others[:, sides]], axis=1)
        normals = np.cross(faces[:, :, 1] - faces[:, :, 0], faces[:, :, 2] - faces[:, :, 0])
        own, theirs = one[lines[:, 0]] - one[lines[:, 1]], others[:, lines[:, 0]] - others[:, lines[:, 1]]
        crossed = np.cross(own[None, :, None], theirs[:, None]).reshape(len(others), 36, 3)
        axes = np.concatenate([normals, crossed], axis=1)
        a, b = np.einsum("nkd,cd->nkc", axes, one), np.einsum("nkd,ncd->nkc", axes, others)
        gap = np.maximum(b.min(axis=2) - a.max(axis=2), a.min(axis=2) - b.max(axis=2))
        assert (gap.max(axis=1, initial=0) > 0).all()


def test_registry_holds_the_promised_families():
    assert set(SCENES) == EXPECTED
    for name, family in SCENES.items():
        assert family.name == name
        assert re.fullmatch(r"[a-z]+(-[a-z]+)*", name)
        assert family.description
        assert family.source
        assert family.min_triangles <= family.default_triangles <= family.max_triangles


def test_unknown_name_is_answered_with_near_ones():
    with pytest.raises(ValueError, match=r"'fense'.*did you mean fence"):
        scenes.make_scene("fense")
    with pytest.raises(ValueError, match=r"'qqqq'.*colonnade"):
        scenes.make_scene("qqqq")


@pytest.mark.parametrize("wish", [0, 100, 10**9])
def test_impossible_number_of_triangles_is_refused(wish):
    with pytest.raises(ValueError, match=r"num_triangles.*" + re.escape(str(wish))):
        scenes.make_scene("rubble", num_triangles=wish)


def test_scene_of_one_size_says_so():
    with pytest.raises(ValueError, match="one size"):
        scenes.make_scene("solids", num_triangles=1000)


@pytest.mark.parametrize("name", SCENES)
def test_default_size_is_small_and_near_the_promise(built, name):
    family, count = SCENES[name], built[name].mesh.num_faces
    assert count <= 8000
    if family.scales:
        assert count == pytest.approx(family.default_triangles, rel=0.02)
    else:
        assert count == family.default_triangles == family.min_triangles


@pytest.mark.parametrize("name", SCALING)
def test_count_stays_within_a_factor_of_two_of_the_wish(name):
    family = SCENES[name]
    for wish in (family.min_triangles, 3 * family.min_triangles, 40_000):
        assert 0.5 <= scenes.make_scene(name, wish).mesh.num_faces / wish <= 2.0


def test_terrain_passes_a_million_triangles_and_stays_closed():
    mesh = scenes.make_scene("terrain", 1_050_000).mesh
    assert mesh.num_faces > 1_000_000
    start = np.asarray(mesh.faces).astype(np.int64).ravel()
    end = np.asarray(mesh.faces)[:, [1, 2, 0]].astype(np.int64).ravel()
    there, back = np.sort(start * mesh.num_vertices + end), np.sort(end * mesh.num_vertices + start)
    assert (np.diff(there) > 0).all()
    np.testing.assert_array_equal(there, back)  # each edge once in each direction: closed


@pytest.mark.parametrize("name", SCENES)
def test_same_arguments_give_the_same_scene(built, name):
    again = scenes.make_scene(name, dtype=jnp.float64)
    for old, new in zip(jax.tree.leaves(built[name]), jax.tree.leaves(again), strict=True):
        np.testing.assert_array_equal(old, new)


@pytest.mark.parametrize("name", SCENES)
def test_arrays_are_finite_and_of_the_dtype_asked_for(name, dtype):
    scene = scenes.make_scene(name, dtype=dtype)
    leaves = [np.asarray(leaf) for leaf in jax.tree.leaves(scene)]
    floating = [leaf for leaf in leaves if np.issubdtype(leaf.dtype, np.floating)]
    assert {leaf.dtype for leaf in floating} == {np.dtype(dtype)}
    assert all(np.isfinite(leaf).all() for leaf in floating)
    assert scene.mesh.faces.dtype == jnp.int32
    colors, vertices = np.asarray(scene.mesh.face_colors), np.asarray(scene.mesh.vertices)
    assert colors.min() >= 0.0
    assert colors.max() <= 1.0
    a, b, c = np.moveaxis(vertices[np.asarray(scene.mesh.faces)], 1, 0)
    areas = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)
    assert areas.min() > 1e-12 * np.sum(np.ptp(vertices, axis=0) ** 2)


@pytest.mark.parametrize("name", SCENES)
def test_every_vertex_is_used_and_no_face_is_repeated(built, name):
    faces = np.asarray(built[name].mesh.faces)
    np.testing.assert_array_equal(np.unique(faces), np.arange(built[name].mesh.num_vertices))
    assert len(np.unique(np.sort(faces, axis=1), axis=0)) == len(faces)


@pytest.mark.parametrize("name", SCENES)
def test_closed_scenes_are_watertight_and_others_admit_it(built, name):
    mesh = as_trimesh(built[name].mesh)
    assert mesh.is_winding_consistent
    assert mesh.is_watertight == SCENES[name].closed


@pytest.mark.parametrize("name", [name for name, family in SCENES.items() if family.closed])
def test_every_closed_body_looks_outwards(built, name):
    vertices, faces = np.asarray(built[name].mesh.vertices), np.asarray(built[name].mesh.faces)
    count, owner = bodies(vertices, faces)
    middle = np.stack([np.bincount(owner, axis) for axis in vertices.T], -1) / np.bincount(owner)[:, None]
    corners = vertices[faces] - middle[owner[faces[:, 0]]][:, None]  # about each body's own middle: no cancellation
    six_volumes = np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2]))
    assert np.bincount(owner[faces[:, 0]], six_volumes, minlength=count).min() > 0


@pytest.mark.parametrize("name", SCENES)
def test_camera_frames_the_scene_tightly_and_sees_shadows(built, name):
    scene = built[name]
    mesh, camera = as_trimesh(scene.mesh), scene.camera
    caster = RayMeshIntersector(mesh)
    origins, directions = view_rays(camera)
    face = caster.intersects_first(origins, directions)
    origins, directions, face = origins[face >= 0], directions[face >= 0], face[face >= 0]
    corner, normal = mesh.vertices[mesh.faces[face, 0]], mesh.face_normals[face]
    # directions have length 1 along the view, so this is the depth that near and far bound
    depth = np.einsum("ij,ij->i", corner - origins, normal) / np.einsum("ij,ij->i", directions, normal)
    assert len(depth) > 0.3 * 64 * 48
    assert 0.85 * depth.min() < float(camera.near) < depth.min()
    assert depth.max() < float(camera.far) < 1.15 * depth.max()
    assert np.radians(18) < float(camera.phi_y) < np.radians(27)

    to_sun = -np.asarray(scene.lights[0].direction)
    assert np.radians(35) <= np.arcsin(to_sun[1]) + 1e-12 <= np.radians(50)
    lit_side = np.einsum("ij,j->i", normal, to_sun) > 1e-3
    points = (origins + depth[:, None] * directions + 1e-3 * normal)[lit_side]
    shaded = caster.intersects_any(points, np.broadcast_to(to_sun, points.shape))
    assert 0.05 < shaded.mean() < 0.6


@pytest.mark.parametrize("name", ALL_SHADOW_ON_GROUND)
def test_the_whole_shadow_falls_on_the_ground(built, name):
    scene = built[name]
    vertices, faces = np.asarray(scene.mesh.vertices), np.asarray(scene.mesh.faces)
    _, owner = bodies(vertices, faces)
    ground = owner == owner[np.argmin(vertices[:, 1])]
    if not SCENES[name].closed:
        ground = vertices[:, 1] == 0.0
    bodies_above = vertices[~ground & (vertices[:, 1] > 0)]
    travel = np.asarray(scene.lights[0].direction)
    landed = bodies_above - bodies_above[:, 1:2] / travel[1] * travel
    lower, upper = vertices[ground].min(axis=0), vertices[ground].max(axis=0)
    assert len(bodies_above) > 0
    assert (landed[:, [0, 2]] >= lower[[0, 2]]).all()
    assert (landed[:, [0, 2]] <= upper[[0, 2]]).all()


# --- the bricks -----------------------------------------------------------------------------------------------------


def test_geodesic_sphere_is_inscribed_and_converges_with_second_order():
    exact = 4 / 3 * np.pi * 2.0**3
    missing = []
    for frequency in (8, 16, 32):
        ball = primitives.geodesic_sphere(2.0, frequency)
        assert ball.num_faces == 20 * frequency**2
        np.testing.assert_allclose(np.linalg.norm(ball.vertices, axis=1), 2.0, rtol=1e-14)
        missing.append(exact - ball.volume())
    assert np.log2(np.array(missing[:-1]) / np.array(missing[1:])) == pytest.approx([2.0, 2.0], abs=0.02)


def test_torus_volume_is_that_of_its_polygons():
    segments, sides = 24, 10
    # a revolved polygon of n chords about a centroid at R (Pappus), corrected for the chords of the turn
    section = 0.5 * sides * 0.3**2 * np.sin(2 * np.pi / sides)
    expected = section * 1.0 * segments * np.sin(2 * np.pi / segments)
    assert primitives.torus(1.0, 0.3, segments, sides).volume() == pytest.approx(expected, rel=1e-12)


def test_extrusion_with_holes_has_the_volume_of_its_outline():
    outline, hole = surfaces.rectangle(4.0, 3.0, 8), surfaces.circle(0.7, 24, (0.4, -0.2))
    part = surfaces.extrude([outline, hole], 0.5)
    expected = 0.5 * (12.0 - 0.5 * 24 * 0.7**2 * np.sin(2 * np.pi / 24))
    assert part.volume() == pytest.approx(expected, rel=1e-12)


def test_outline_that_is_too_coarse_is_refused():
    slotted = np.array([(0, 0), (10, 0), (10, 1), (1, 1), (1, 1.1), (7, 1.1), (7, 2), (0, 2)], float)
    with pytest.raises(ValueError, match="more points"):
        surfaces.triangulate([slotted])


def test_sweep_along_a_straight_path_is_a_prism():
    path = np.linspace((0.0, 0.0, 0.0), (1.0, 2.0, 2.0), 4)
    part = surfaces.sweep(surfaces.rectangle(0.5, 0.2), path, (0.0, 1.0, 0.0))
    assert part.volume() == pytest.approx(0.5 * 0.2 * 3.0, rel=1e-12)


def test_landscape_has_the_volume_below_its_height_field():
    part = surfaces.landscape(2.0, 3.0, 5, 7, lambda x, z: 0.1 * x - 0.2 * z + 1.0, -0.5)
    assert part.volume() == pytest.approx(4.0 * 6.0 * 1.5, rel=1e-12)
    assert part.num_faces == 2 * 5 * 7 + 6 * (5 + 7)


@pytest.mark.parametrize(
    ("make", "num_edges"),
    [
        (solids.tetrahedron, 6), (solids.cube, 12), (solids.octahedron, 12), (solids.dodecahedron, 30),
        (primitives.icosahedron, 30),
    ],
)  # fmt: skip
def test_regular_solids_are_regular(make, num_edges):
    part = make()
    np.testing.assert_allclose(np.linalg.norm(part.vertices, axis=1), 1.0, rtol=1e-12)
    mesh = trimesh.Trimesh(part.vertices, part.faces, process=False)
    real = mesh.face_adjacency_edges[mesh.face_adjacency_angles > 1e-6]
    lengths = np.linalg.norm(np.diff(part.vertices[real], axis=1), axis=-1).ravel()
    assert len(real) == num_edges
    np.testing.assert_allclose(lengths, lengths[0], rtol=1e-12)
    assert solids.standing(part).vertices[:, 1].min() == pytest.approx(0.0, abs=1e-12)


def test_rotations_are_rotations():
    turns = np.concatenate([random_rotations(np.random.default_rng(0), 20), rotation((1, 2, 3), np.linspace(0, 6, 5))])
    np.testing.assert_allclose(turns @ turns.swapaxes(1, 2), np.broadcast_to(np.eye(3), turns.shape), atol=1e-14)
    np.testing.assert_allclose(np.linalg.det(turns), 1.0, rtol=1e-13)
    np.testing.assert_allclose(rotation((0, 0, 1), np.pi / 2) @ [1, 0, 0], [0, 1, 0], atol=1e-15)


def test_scattered_copies_keep_volume_and_colour():
    part = primitives.box((0, 0, 0), (1, 2, 3)).painted((0.1, 0.2, 0.3))
    turns = random_rotations(np.random.default_rng(1), 4)
    copies = scatter(part, turns, np.arange(12.0).reshape(4, 3))
    assert copies.volume() == pytest.approx(4 * 6.0, rel=1e-12)
    np.testing.assert_array_equal(copies.colors, np.tile([0.1, 0.2, 0.3], (48, 1)))


def test_inside_out_body_is_turned_round():
    part = primitives.box((0, 0, 0), (1, 1, 1))
    wrong = make_part(part.vertices, part.faces[:, ::-1])
    assert wrong.volume() == pytest.approx(-1.0)
    assert wrong.outward().volume() == pytest.approx(1.0)
