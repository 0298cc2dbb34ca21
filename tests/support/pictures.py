"""Casters of shadows over one receiver, all padded to one size, so that every picture of them shares a program."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np

from shadowjax import Mesh, PointLight, mesh_edges, plane_receiver, shadow_picture
from shadowjax.geometry.scenes.closed_forms import ReceivingPlane
from shadowjax.geometry.scenes.plate_over_plane import PlateOverPlane
from shadowjax.geometry.scenes.sphere_over_plane import SphereOverPlane
from shadowjax.geometry.scenes.two_plates import TwoPlates

NUM_VERTICES, NUM_FACES, NUM_EDGES = 42, 80, 120
ROWS = COLS = 32
LOWER, UPPER = jnp.asarray([-3.2, -3.0]), jnp.asarray([2.6, 3.1])
CELL = float(jnp.prod(UPPER - LOWER)) / (ROWS * COLS)
PLANE = ReceivingPlane.horizontal(0.0)
RECEIVER, VIEW = plane_receiver(PLANE.origin, PLANE.axis_u, PLANE.axis_v, LOWER, UPPER, (ROWS, COLS))
LIGHT = PointLight.create((0.9, 4.1, -0.4), dtype=jnp.float64)
TETRAHEDRON = np.array([[0, 1, 2], [0, 3, 1], [1, 3, 2], [2, 3, 0]])


def padded(vertices, faces):
    """A mesh of the common size, filled up with triangles without area, and its edges, with edges without length."""
    vertices, faces = np.asarray(vertices, float), np.asarray(faces)
    found = mesh_edges(Mesh.create(vertices, faces))
    spare = np.repeat(vertices[:1], NUM_VERTICES - len(vertices), axis=0)
    mesh = Mesh.create(
        np.concatenate([vertices, spare]), np.concatenate([faces, np.zeros((NUM_FACES - len(faces), 3), int)])
    )

    def fill(name):
        value = np.asarray(getattr(found, name))
        num = NUM_FACES if name == "corners" else NUM_EDGES
        return jnp.asarray(np.concatenate([value, np.zeros((num - len(value), *value.shape[1:]), value.dtype)]))

    return mesh, type(found)(*(fill(field.name) for field in dataclasses.fields(found)))


def quads(corners):
    """Two triangles for each four corners."""
    corners = np.asarray(corners).reshape(-1, 4, 3)
    faces = np.array([[0, 1, 2], [0, 2, 3]])[None] + 4 * np.arange(len(corners))[:, None, None]
    return corners.reshape(-1, 3), faces.reshape(-1, 3)


def plate():
    return padded(*quads(PlateOverPlane().corners()))


def two_plates():
    return padded(*quads(TwoPlates(upper_x=0.4, upper_z=0.35).corners()))


def tetrahedron():
    return padded([(0.5, 0.8, 0.1), (-0.6, 0.9, 0.7), (-0.2, 0.7, -0.8), (-0.1, 1.6, 0.05)], TETRAHEDRON)


def sphere():
    ball = SphereOverPlane(frequency=2).ball()
    return padded(ball.vertices, ball.faces)


def random_triangles(seed, count=12):
    """Triangles that hide each other, none crossing another."""
    rng = np.random.default_rng(seed)
    layers = np.linspace(0.4, 1.9, count)[:, None]
    middle = np.concatenate([rng.uniform(-1, 0.8, (count, 1)), layers, rng.uniform(-1, 1, (count, 1))], axis=1)
    corners = middle[:, None] + rng.uniform(-1, 1, (count, 3, 3)) * [0.9, 0.05, 0.9]
    return padded(corners.reshape(-1, 3), np.arange(3 * count).reshape(-1, 3))


def picture(vertices, position, mesh, edges):
    """The shadow picture of moved vertices in the light of a moved lamp."""
    moved = Mesh(vertices, mesh.faces, mesh.face_colors)
    return shadow_picture(moved, edges, PointLight(position, LIGHT.color), VIEW, receiver=RECEIVER)


def summed(weights, mesh, edges):
    """The picture's dark part times weights, as a function of vertices and of the light's position."""
    return lambda vertices, position: jnp.sum(weights * (1 - picture(vertices, position, mesh, edges)))


def gradient(weights, mesh, edges):
    """Of `summed`, in vertices and position, by reverse mode."""
    return jax.grad(summed(weights, mesh, edges), (0, 1))(mesh.vertices, LIGHT.position)
