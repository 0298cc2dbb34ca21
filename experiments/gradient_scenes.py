"""Casters of shadows over one plane, padded to one size so that their pictures share a program; and fine sampling."""

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from shadowjax import Mesh, MeshEdges, PointLight, RayGrid, Receiver, mesh_edges, plane_receiver, shadow_picture
from shadowjax._types import Array
from shadowjax.rays.brute import BruteForceCaster
from shadowjax.rays.grid.caster import GridCaster
from shadowjax.scenes.closed_forms import ReceivingPlane, project
from shadowjax.scenes.plate_over_plane import PlateOverPlane
from shadowjax.scenes.shadow_moments import ShadowMoments, convex_shadow_moments, polygon_moments, union_moments
from shadowjax.scenes.sphere_over_plane import SphereOverPlane
from shadowjax.scenes.two_plates import TwoPlates

LOWER, UPPER = (-3.2, -3.0), (2.6, 3.1)
LAMP = (0.9, 4.1, -0.4)
TETRAHEDRON = [(0.5, 0.8, 0.1), (-0.6, 0.9, 0.7), (-0.2, 0.7, -0.8), (-0.1, 1.6, 0.05)]
TETRAHEDRON_FACES = [[0, 1, 2], [0, 3, 1], [1, 3, 2], [2, 3, 0]]
# A closed form: vertices and light → area and centroid.
Closed = Callable[[Array, PointLight], ShadowMoments]


@dataclass(frozen=True)
class Size:
    """What every mesh is filled up to."""

    vertices: int
    faces: int
    edges: int


def size_of(frequency: int) -> Size:
    """Of a sphere of so many pieces along an edge of its icosahedron; at least that of 12 triangles apart."""
    return Size(max(10 * frequency**2 + 2, 36), max(20 * frequency**2, 12), max(30 * frequency**2, 36))


def padded(vertices: Any, faces: Any, size: Size) -> tuple[Mesh, MeshEdges]:
    """A mesh filled up with triangles without area, and its edges, with edges without length."""
    vertices, faces = np.asarray(vertices, float), np.asarray(faces)
    found = mesh_edges(Mesh.create(vertices, faces, dtype=jnp.float64))
    spare = np.repeat(vertices[:1], size.vertices - len(vertices), axis=0)
    filled = np.concatenate([faces, np.zeros((size.faces - len(faces), 3), int)])
    mesh = Mesh.create(np.concatenate([vertices, spare]), filled, dtype=jnp.float64)

    def fill(name: str) -> Array:
        value = np.asarray(getattr(found, name))
        num = size.faces if name == "corners" else size.edges
        return jnp.asarray(np.concatenate([value, np.zeros((num - len(value), *value.shape[1:]), value.dtype)]))

    return mesh, MeshEdges(*(fill(field.name) for field in dataclasses.fields(found)))


def quads(corners: Any) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and faces: two triangles for each four corners."""
    corners = np.asarray(corners).reshape(-1, 4, 3)
    faces = np.array([[0, 1, 2], [0, 2, 3]])[None] + 4 * np.arange(len(corners))[:, None, None]
    return corners.reshape(-1, 3), faces.reshape(-1, 3)


@dataclass(frozen=True)
class Stage:
    """Receiver, view and light that all scenes share.

    Attributes:
        plane: With the coordinates (u, v).
        receiver, view: From `plane_receiver`.
        light: A lamp.
        cell: Area of a pixel, square metres.
    """

    plane: ReceivingPlane
    receiver: Receiver
    view: RayGrid
    light: PointLight
    cell: float

    @classmethod
    def create(cls, resolution: int) -> "Stage":
        """A square picture."""
        plane = ReceivingPlane.horizontal(jnp.asarray(0.0, jnp.float64))
        lower, upper = (jnp.asarray(corner, jnp.float64) for corner in (LOWER, UPPER))
        receiver, view = plane_receiver(
            plane.origin, plane.axis_u, plane.axis_v, lower, upper, (resolution, resolution)
        )
        light = PointLight.create(LAMP, dtype=jnp.float64)
        return cls(plane, receiver, view, light, float(jnp.prod(upper - lower)) / resolution**2)

    def picture(self, vertices: Array, position: Array, mesh: Mesh, edges: MeshEdges) -> Array:
        """The shadow picture of moved vertices in the light of a moved lamp."""
        moved = Mesh(vertices, mesh.faces, mesh.face_colors)
        lamp = PointLight(position, self.light.color)
        return shadow_picture(moved, edges, lamp, self.view, BruteForceCaster(), self.receiver)

    def summed(self, weights: Array, mesh: Mesh, edges: MeshEdges) -> Callable[[Array, Array], Array]:
        """The dark part of the picture times weights, as a function of vertices and of the lamp's position."""
        return lambda vertices, position: jnp.sum(weights * (1 - self.picture(vertices, position, mesh, edges)))

    def closed_scenes(self, frequency: int) -> dict[str, tuple[Mesh, MeshEdges, Closed]]:
        """Scenes with a closed form."""
        size, plane = size_of(frequency), self.plane

        def polygon(vertices: Array, light: PointLight) -> ShadowMoments:
            return polygon_moments(project(vertices[:4], light, plane))

        def union(vertices: Array, light: PointLight) -> ShadowMoments:
            return union_moments(project(vertices[:8].reshape(2, 4, 3), light, plane))

        def convex(faces: Any) -> Closed:
            return lambda vertices, light: convex_shadow_moments(vertices[np.asarray(faces)], light, plane)

        ball = SphereOverPlane(frequency=frequency).ball()
        return {
            "plate": (*padded(*quads(PlateOverPlane().corners()), size), polygon),
            "two plates": (*padded(*quads(TwoPlates(upper_x=0.4, upper_z=0.35).corners()), size), union),
            "tetrahedron": (*padded(TETRAHEDRON, TETRAHEDRON_FACES, size), convex(TETRAHEDRON_FACES)),
            "sphere": (*padded(ball.vertices, ball.faces, size), convex(ball.faces)),
        }

    def fine_spots(self, samples: int) -> Array:
        """(u, v) of samples × samples places in each pixel."""
        rows, cols = self.view.num_rows * samples, self.view.num_cols * samples
        fine = RayGrid(self.view.space, self.view.plane_map, self.view.far, rows, cols)
        return self.view.plane_map.inverse(fine.centres())

    def sampled(self, vertices: Array, mesh: Mesh, spots: Array) -> Array:
        """1 where a place of the plane is lit, else 0, by the exact test."""
        space = self.light.space(jnp.asarray([1.0, 0.0, 0.0]), *self.receiver.mesh.bounds())
        return _lit(Mesh(vertices, mesh.faces, mesh.face_colors), space, self.plane.to_world(spots))

    def in_pixels(self, values: Array) -> Array:
        """Means over the pixels of values at fine places."""
        rows, cols = self.view.num_rows, self.view.num_cols
        return jnp.mean(values.reshape(rows, values.shape[0] // rows, cols, values.shape[1] // cols), axis=(1, 3))


@jax.jit
def _lit(mesh: Mesh, space: Any, points: Array) -> Array:
    return GridCaster().visible(mesh, space, points).astype(points.dtype)


def random_triangles(seed: int, count: int, size: Size) -> tuple[Mesh, MeshEdges]:
    """Triangles in layers: they hide one another and none crosses another."""
    rng = np.random.default_rng(seed)
    height = np.linspace(0.4, 1.9, count)[:, None]
    middle = np.concatenate([rng.uniform(-1, 0.8, (count, 1)), height, rng.uniform(-1, 1, (count, 1))], axis=1)
    corners = middle[:, None] + rng.uniform(-1, 1, (count, 3, 3)) * [0.9, 0.6 / count, 0.9]
    return padded(corners.reshape(-1, 3), np.arange(3 * count).reshape(-1, 3), size)
