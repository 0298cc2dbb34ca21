"""Edges: every one found once, with the right faces, on closed, open, repeated-vertex and non-manifold meshes."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import trimesh
from shapes import bumpy_sphere, plate_over_plane

from shadowjax import DirectionalLight, Mesh, PointLight
from shadowjax.geometry.edges import edge_adjacency, silhouette


def test_closed_mesh_has_euler_many_edges_between_the_right_faces():
    mesh = bumpy_sphere()
    edges = edge_adjacency(mesh)
    assert edges.is_closed
    assert len(edges.faces) == mesh.num_faces * 3 // 2
    assert mesh.num_vertices - len(edges.faces) + mesh.num_faces == 2
    faces = np.asarray(mesh.faces)
    body = trimesh.Trimesh(np.asarray(mesh.vertices), faces, process=False)
    expected = {tuple(sorted(pair)) for pair in body.face_adjacency.tolist()}
    assert {tuple(sorted(pair)) for pair in np.asarray(edges.faces).tolist()} == expected
    for ends, pair in zip(np.asarray(edges.vertices), np.asarray(edges.faces), strict=True):
        assert set(ends) == set(faces[pair[0]]) & set(faces[pair[1]])


def test_repeated_vertices_are_welded_unless_asked_otherwise():
    mesh = bumpy_sphere(subdivisions=1)
    soup = Mesh.create(mesh.triangles().reshape(-1, 3), np.arange(3 * mesh.num_faces).reshape(-1, 3))
    assert edge_adjacency(soup).is_closed
    apart = edge_adjacency(soup, weld=False)
    assert not apart.is_closed
    assert len(apart.faces) == 3 * mesh.num_faces
    assert np.all(np.asarray(apart.faces[:, 1]) == -1)


def test_open_and_over_full_edges_are_counted():
    plate = edge_adjacency(plate_over_plane())
    assert sorted(np.asarray(plate.num_faces).tolist()) == [1] * 8 + [2] * 2
    fan = Mesh.create(
        [[0.0, 0, 0], [0, 1, 0], [1, 0, 0], [-1, 0, 0], [0, 0, 1]], np.array([[0, 1, 2], [1, 0, 3], [0, 1, 4]])
    )
    edges = edge_adjacency(fan)
    spine = np.all(np.sort(np.asarray(edges.vertices), axis=1) == [0, 1], axis=1)
    assert np.asarray(edges.num_faces)[spine].tolist() == [3, 3]
    assert sorted(np.asarray(edges.faces)[spine].tolist()) == [[0, 1], [2, -1]]


def test_silhouette_of_a_cube_is_a_hexagon_or_a_square():
    cube = trimesh.creation.box()
    mesh = Mesh.create(cube.vertices, cube.faces)
    edges = edge_adjacency(mesh)
    mask = eqx.filter_jit(silhouette)
    corner_on = DirectionalLight.create((-1.0, -1.1, -1.2))
    assert int(jnp.sum(mask(mesh, edges, corner_on))) == 6
    above = PointLight.create((0.1, 5.0, -0.2))
    seen = np.asarray(mask(mesh, edges, above))
    assert seen.sum() == 4
    assert np.all(np.asarray(mesh.vertices)[np.asarray(edges.vertices)[seen]][..., 1] == 0.5)


def test_silhouette_of_an_open_plate_is_its_border():
    mesh = plate_over_plane()
    edges = edge_adjacency(mesh)
    mask = silhouette(mesh, edges, DirectionalLight.create((0.2, -1.0, 0.1)))
    np.testing.assert_array_equal(mask, edges.num_faces == 1)
