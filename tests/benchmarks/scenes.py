"""What is measured: one displaced sphere over a plane at any triangle count, files given, and the views of a mesh."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import trimesh

from shadowjax import Camera, DirectionalLight, RayGrid, camera_grid, load
from shadowjax.geometry.light_space import DirectionalSpace
from shadowjax.rays.plane_map import Box

# Subdivisions of an icosahedron and the number of triangles that each gives (20 · 4^k, and 2 of the plane).
SPHERES = {"1 k": 3, "20 k": 5, "80 k": 6, "330 k": 7, "1.3 M": 8}
PROJECTIONS = ("orthographic", "perspective")


@dataclass(frozen=True)
class Geometry:
    """A mesh as every contestant gets it.

    Attributes:
        name: For tables.
        vertices: (V, 3) float32 positions.
        faces: (F, 3) int32 indices.
        centre: What views look at.
        radius: Of the sphere around `centre` that views show.
    """

    name: str
    vertices: np.ndarray
    faces: np.ndarray
    centre: tuple[float, float, float]
    radius: float

    @property
    def num_faces(self) -> int:
        """Number of triangles."""
        return len(self.faces)

    def moved(self, step: int) -> np.ndarray:
        """New vertices for the same faces: pushed about by less than a tenth of a per cent of the radius."""
        x, y, z = self.vertices.T
        push = 1e-3 * self.radius * np.sin(3 * x + step) * np.cos(3 * z - step)
        return np.stack([x, y + push, z], 1).astype(np.float32)


@dataclass(frozen=True)
class View:
    """Coherent rays of one light or camera.

    Attributes:
        projection: "orthographic" or "perspective".
        grid: The rays.
        near: Least depth along the view direction of anything in sight, world units (a rasteriser needs it).
        far: Greatest depth along the view direction, world units.
    """

    projection: str
    grid: RayGrid
    near: float
    far: float

    @cached_property
    def rays(self) -> tuple[np.ndarray, np.ndarray]:
        """Origins and unit directions, (N, 3) float32, row by row: the same numbers for every program."""
        rays = self.grid.rays()
        origins, directions = (np.array(x, np.float32).reshape(-1, 3) for x in (rays.origins, rays.directions))
        return origins, directions


def sphere_over_plane(size: str) -> Geometry:
    """The displaced sphere of radius about 1 that floats over a square of two triangles."""
    sphere = trimesh.creation.icosphere(SPHERES[size])
    x, y, z = sphere.vertices.T
    radius = 1 + 0.08 * np.sin(7 * x) * np.sin(6 * y + 1) * np.sin(5 * z + 2) + 0.01 * np.sin(31 * x + 23 * y - 27 * z)
    body = sphere.vertices * radius[:, None] + [0.0, 1.3, 0.0]
    side = 12.0
    plane = side * np.array([[-1, 0, -1], [1, 0, -1], [1, 0, 1], [-1, 0, 1]])
    faces = np.concatenate([sphere.faces, len(body) + np.array([[0, 2, 1], [0, 3, 2]])])
    vertices = np.concatenate([body, plane]).astype(np.float32)
    return Geometry(size, vertices, faces.astype(np.int32), (0.0, 1.3, 0.0), 1.1)


def from_file(path: str) -> Geometry:
    """A mesh file, seen so that it fills the image; no plane is added."""
    mesh = load(path, dtype=jnp.float32)
    vertices, faces = np.asarray(mesh.vertices), np.asarray(mesh.faces)
    lower, upper = vertices.min(0), vertices.max(0)
    x, y, z = (float(middle) for middle in 0.5 * (lower + upper))
    name = path.replace("\\", "/").rsplit("/", 1)[-1]
    return Geometry(name, vertices, faces, (x, y, z), float(0.5 * np.linalg.norm(upper - lower)))


def view(geometry: Geometry, projection: str, resolution: int, step: int = 0) -> View:
    """Rays of a light ("orthographic") or a camera that is turned a little about the vertical with every step."""
    angle = 0.7 + 0.02 * step
    towards = np.array([0.8 * np.cos(angle), 1.0, 0.8 * np.sin(angle)])
    towards /= np.linalg.norm(towards)
    make = _light_grid if projection == "orthographic" else _camera_grid
    grid = make(geometry, towards, resolution)
    return View(projection, jax.block_until_ready(grid), *_depth_range(geometry, grid))


def _light_grid(geometry: Geometry, towards: np.ndarray, resolution: int) -> RayGrid:
    lower, upper = (jnp.asarray(bound(geometry.vertices, 0)) for bound in (np.min, np.max))
    light = DirectionalLight.create(-towards, dtype=jnp.float32)
    space = light.space(jnp.asarray([0.0, 0.0, 1.0], jnp.float32), lower, upper)
    middle = space.project(jnp.asarray(geometry.centre, jnp.float32))[0]
    box = Box(middle - 1.2 * geometry.radius, middle + 1.2 * geometry.radius)
    return RayGrid(space, box, space.farthest(lower, upper), resolution, resolution)


def _camera_grid(geometry: Geometry, towards: np.ndarray, resolution: int) -> RayGrid:
    distance = 4 * geometry.radius
    camera = Camera.look_at(
        np.asarray(geometry.centre) + distance * towards,
        geometry.centre,
        phi_y=float(np.arctan(1.2 / 4)),
        near=0.1 * distance,
        far=20 * distance,
        dtype=jnp.float32,
    )
    return camera_grid(camera, resolution, resolution)


def _depth_range(geometry: Geometry, grid: RayGrid) -> tuple[float, float]:
    """Depths of all that the view can show, for a rasteriser's clip planes: the whole mesh, in front of the viewer."""
    frame, origin = along(grid)
    depth = (geometry.vertices.astype(np.float64) - origin) @ frame[2]
    size = depth.max() - depth.min()
    near = depth.min() - 0.01 * size
    if not isinstance(grid.space, DirectionalSpace):
        near = max(near, 0.25 * geometry.radius)
    return float(near), float(depth.max() + 0.01 * size)


def along(grid: RayGrid) -> tuple[np.ndarray, np.ndarray]:
    """Rows across, up, view direction of a grid's rays in double precision, and where their depth is 0."""
    space: Any = grid.space
    frame = np.asarray(space.frame, np.float64)
    if isinstance(space, DirectionalSpace):
        return np.stack([frame[0], frame[2], -frame[1]]), np.asarray(space.origin, np.float64)
    return frame, np.asarray(space.position, np.float64)
