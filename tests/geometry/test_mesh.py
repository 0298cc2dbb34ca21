"""Meshes: what the constructor refuses, what loading merges, and what normals, areas and gradients are."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import trimesh
from shapes import bumpy_sphere, plate_over_plane

from shadowjax import Mesh, load
from shadowjax.geometry.mesh import zero_area_faces
from shadowjax.geometry.smoothing import corner_normals, smooth_corner_groups
from shadowjax.geometry.transforms import rotation, scaling, translation

CORNERS = [[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]


@pytest.mark.parametrize(
    ("vertices", "faces", "message"),
    [
        ([[0.0, 0]], [[0, 0, 0]], r"shape \(V, 3\)"),
        (np.zeros((0, 3)), [[0, 0, 0]], "V ≥ 1"),
        (CORNERS, np.zeros((0, 3), int), "needs triangles, not points"),
        (CORNERS, [[0, 1, 3]], r"indices must lie in \[0, 3\).*got 0 … 3"),
        (CORNERS, [[0, 1, -1]], r"got -1 … 1"),
        (CORNERS, [[0.0, 1.0, 2.0]], "integers"),
        ([[0.0, 0, np.nan], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]], "1 of 9 numbers are NaN"),
        ([[0.0, 0, np.inf], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]], "vertices must be finite"),
    ],
)
def test_create_names_what_is_wrong(vertices, faces, message):
    with pytest.raises(ValueError, match=message):
        Mesh.create(np.asarray(vertices), np.asarray(faces))


def test_colors_broadcast_or_are_refused():
    assert Mesh.create(CORNERS, [[0, 1, 2]], (0.1, 0.2, 0.3)).face_colors.tolist() == [[0.1, 0.2, 0.3]]
    with pytest.raises(ValueError, match=r"face_colors must have shape \(1, 3\)"):
        Mesh.create(CORNERS, [[0, 1, 2]], np.ones((2, 3)))


def test_areas_normals_and_bounds_of_a_known_mesh(dtype, rounding):
    mesh = plate_over_plane(dtype)
    assert mesh.vertices.dtype == dtype
    np.testing.assert_allclose(mesh.areas(), [32, 32, 2, 2], rtol=rounding)
    np.testing.assert_allclose(mesh.face_normals(), np.tile([0.0, 1, 0], (4, 1)), atol=rounding)
    np.testing.assert_allclose(mesh.extent, np.sqrt(64 + 1 + 64), rtol=rounding)


def test_normals_of_a_triangle_without_area_are_zero_and_so_is_their_gradient():
    mesh = Mesh.create([[0.0, 0, 0], [1, 1, 1], [2, 2, 2], [0, 0, 0]], [[0, 1, 2], [0, 0, 1]])
    assert not np.any(mesh.face_normals())
    gradient = jax.grad(lambda v: jnp.sum(Mesh(v, mesh.faces, mesh.face_colors).face_normals()))(mesh.vertices)
    assert np.isfinite(gradient).all()
    assert zero_area_faces(mesh) == 2


def test_transforms_compose_and_mirroring_keeps_normals_outside(dtype, rounding):
    mesh = bumpy_sphere(dtype)
    turn = rotation(jnp.asarray([1.0, 2, 3], dtype), jnp.asarray(0.7, dtype))
    shift = translation(jnp.asarray([1.0, -2, 0.5], dtype))
    once = mesh.transformed(shift @ turn)
    twice = mesh.transformed(turn).transformed(shift)
    np.testing.assert_allclose(once.vertices, twice.vertices, atol=8 * rounding)
    np.testing.assert_allclose(turn[:3, :3] @ turn[:3, :3].T, np.eye(3), atol=4 * rounding)
    mirrored = mesh.transformed(scaling(jnp.asarray([-1.0, 1, 1], dtype)))
    outward = jnp.sum(mirrored.face_normals() * jnp.mean(mirrored.triangles(), axis=1), axis=-1)
    assert np.all(np.asarray(outward) > 0)


def test_smooth_groups_join_a_sphere_and_split_a_cube():
    sphere, cube = bumpy_sphere(subdivisions=2), trimesh.creation.box()
    cube = Mesh.create(cube.vertices, cube.faces)
    cube_groups = smooth_corner_groups(cube)
    np.testing.assert_allclose(
        corner_normals(cube, cube_groups), np.repeat(np.asarray(cube.face_normals())[:, None], 3, axis=1), atol=1e-12
    )
    assert len(np.unique(smooth_corner_groups(sphere, crease_angle=3.2))) == sphere.num_vertices
    smooth = corner_normals(sphere, smooth_corner_groups(sphere, crease_angle=3.2))
    np.testing.assert_allclose(smooth, sphere.vertex_normals()[sphere.faces], atol=1e-12)


def test_a_scene_graph_is_merged_with_its_transforms(tmp_path):
    scene = trimesh.Scene()
    box = trimesh.creation.box()
    for x in (0.0, 10.0):
        scene.add_geometry(box, transform=trimesh.transformations.translation_matrix([x, 0, 0]))
    scene.export(tmp_path / "two.glb")
    mesh = load(tmp_path / "two.glb")
    assert mesh.num_faces == 24
    lower, upper = mesh.bounds()
    np.testing.assert_allclose(lower, [-0.5, -0.5, -0.5])
    np.testing.assert_allclose(upper, [10.5, 0.5, 0.5])


@pytest.mark.parametrize("ending", ["obj", "ply", "stl", "glb"])
def test_load_reads_what_trimesh_writes(tmp_path, ending):
    sphere = trimesh.creation.icosphere(1)
    sphere.export(tmp_path / f"sphere.{ending}")
    mesh = load(tmp_path / f"sphere.{ending}")
    assert mesh.num_faces == 80
    np.testing.assert_allclose(jnp.sum(mesh.areas()), sphere.area, rtol=1e-5)


def _write(path, text):
    path.write_text(text)
    return path


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda folder: folder / "missing.obj", "no such mesh file"),
        (lambda folder: folder, "is a folder"),
        (lambda folder: _write(folder / "mesh.txt2", "hello"), "no mesh reader knows"),
        (lambda folder: _write(folder / "empty.obj", ""), "no triangles|cannot be read"),
        (lambda folder: _write(folder / "empty.stl", ""), "no triangles|cannot be read"),
        (lambda folder: _write(folder / "garbage.glb", "not a model"), "cannot be read"),
        (lambda folder: _write(folder / "points.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\n"), "no triangles"),
        (lambda folder: _write(folder / "nan.obj", "v 0 0 nan\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"), "NaN"),
        (lambda folder: _write(folder / "range.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n"), "range.obj"),
    ],
)
def test_load_explains_files_it_cannot_use(tmp_path, make, message):
    path = make(tmp_path)
    with pytest.raises(ValueError, match=message) as caught:
        load(path)
    assert path.name in str(caught.value)
