"""The four scenes of the stencil source's tables, rebuilt, and the places of their lights.

The source shows pictures and counts, no models. What is known: all scenes are made of triangles; the cubes are
125 · 12 triangles and a ground of two, since 1502 polygons and 754 shadow polygons come out in no other way. The
recursive tetrahedron is 1 + 4 + 12 + 36 + 108 = 161 closed tetrahedra, one on every free face of the level before: a
regular one has 6 (π − acos ⅓)/π = 3.65 outer edges in the mean over directions, which with the ground's 4 makes 591.5,
and the source has 596. (Sierpiński's 256 tetrahedra, each with 3 outer edges at least, would have 772 or more.) Not
told, and so chosen here: how the sphere is divided (a tetrahedron divided eight times along each edge has its 256
triangles; the ground comes on top), which solids stand there (the five regular ones, a box and the ground have its 94
triangles), how large each tetrahedron is next to the one it stands on, where the ground ends, where camera and lights
are.
"""

import itertools
from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np

from shadowjax.geometry.camera import Camera
from shadowjax.geometry.light import PointLight
from shadowjax.geometry.mesh import Mesh
from shadowjax.scenes import palette
from shadowjax.scenes.base import SUNLIGHT, framed
from shadowjax.scenes.parts import Part, join, make_part, scatter
from shadowjax.scenes.primitives import block, box, convex_hull, icosahedron
from shadowjax.scenes.recursive_tetrahedron import recursive_tetrahedron
from shadowjax.scenes.solids import cube, dodecahedron, octahedron, standing, tetrahedron

SPHERE, SOLIDS, TETRAHEDRON, CUBES = SCENES = ("geodesic sphere", "solids", "recursive tetrahedron", "cubes")
# Polygons of the tree and shadow polygons a frame: table 1 of the source.
PUBLISHED = {SPHERE: (256, 27), SOLIDS: (94, 34), TETRAHEDRON: (752, 596), CUBES: (1502, 754)}
# Milliseconds a frame for generation, capping and rendering: tables 2 (accelerated) and 3 (emulated).
ACCELERATED = {
    SPHERE: (0.86, 0.18, 0.92), SOLIDS: (0.36, 0.08, 1.12), TETRAHEDRON: (3.54, 0.64, 37.48), CUBES: (6.56, 1.42, 52.08)
}  # fmt: skip
EMULATED = {
    SPHERE: (1.26, 0.32, 55.34), SOLIDS: (0.54, 0.12, 99.14), TETRAHEDRON: (4.98, 0.96, 611.26),
    CUBES: (9.28, 1.88, 1001.5),
}  # fmt: skip


@dataclass(frozen=True)
class Built:
    """A scene.

    Attributes:
        part: Its triangles.
        mesh: The same, filled up with triangles without area to a common count, so that programs compile once.
        camera: Looks at all of it.
        lights: Where the light stands in each run.
    """

    part: Part
    mesh: Mesh
    camera: Camera
    lights: tuple[PointLight, ...]


def divided_tetrahedron(depth: int) -> Part:
    """A tetrahedron whose triangles are cut into four, `depth` times, its corners pushed out onto the unit sphere.

    Their convex hull: pushed out, some triangles would meet at a hollow edge.
    """
    body = tetrahedron()
    corners = body.vertices[body.faces]
    for _ in range(depth):
        middles = (corners + np.roll(corners, -1, axis=1)) / 2
        both = np.concatenate([corners, middles], axis=1)
        corners = both[:, [[0, 3, 5], [3, 1, 4], [5, 4, 2], [3, 4, 5]]].reshape(-1, 3, 3)
    points = np.unique(np.round(corners.reshape(-1, 3), 12), axis=0)
    return convex_hull(points / np.linalg.norm(points, axis=1, keepdims=True))


def ground(half_x: float, half_z: float) -> Part:
    """Two triangles in the plane y = 0."""
    corners = np.array([[-half_x, 0, -half_z], [half_x, 0, -half_z], [half_x, 0, half_z], [-half_x, 0, half_z]])
    return make_part(corners, np.array([[0, 2, 1], [0, 3, 2]]), palette.PLASTER)


def parts() -> dict[str, Part]:
    """The triangles of all four scenes."""
    solids = [
        (standing(dodecahedron()).scaled(0.72), (-0.1, -0.2), 0.2, palette.TERRACOTTA),
        (standing(icosahedron()).scaled(0.62), (-2.05, 0.35), 0.7, palette.OCHRE),
        (standing(octahedron()).scaled(0.72), (1.55, 0.75), 0.3, palette.TEAL),
        (standing(tetrahedron()).scaled(0.78), (-0.75, 1.35), 0.5, palette.PLUM),
        (standing(cube()).scaled(0.7), (-1.35, -1.45), 0.45, palette.SLATE),
        (block(0.55, 1.5, 0.55), (1.3, -1.15), 0.25, palette.SAGE),
    ]
    # A hair above the ground: solids that stand in its plane would share it.
    placed = [body.turned((0, 1, 0), turn).moved(x, 0.01, z).painted(color) for body, (x, z), turn, color in solids]
    cells = np.array(list(itertools.product(range(5), repeat=3)))
    cubes = scatter(
        box((-0.115,) * 3, (0.115,) * 3), np.broadcast_to(np.eye(3), (125, 3, 3)),
        (cells + 0.5) * 0.48 - np.array([1.2, -0.25, 1.2]), np.broadcast_to(palette.OCHRE, (125, 3)),
    )  # fmt: skip
    return {
        SPHERE: join([divided_tetrahedron(3).moved(y=1.15).painted(palette.TERRACOTTA), ground(3.0, 2.2)]),
        SOLIDS: join([*placed, ground(3.6, 2.6)]),
        TETRAHEDRON: join([recursive_tetrahedron(4).moved(y=0.02).painted(palette.TEAL), ground(3.4, 2.6)]),
        CUBES: join([cubes.turned((0, 1, 0), np.radians(33.0)), ground(3.4, 2.6)]),
    }


def light_places(part: Part, count: int, distance: float) -> np.ndarray:
    """(count, 3) places above the scene, spread evenly by the golden angle over elevations of 30° to 70°.

    Args:
        part: The scene.
        count: How many.
        distance: From the middle of the scene, in halves of its diagonal.
    """
    lower, upper = part.vertices.min(axis=0), part.vertices.max(axis=0)
    height = np.sin(np.radians(30)) + (np.arange(count) + 0.5) / count * (
        np.sin(np.radians(70)) - np.sin(np.radians(30))
    )
    turn = 0.3 + np.arange(count) * np.pi * (3 - np.sqrt(5))
    flat = np.sqrt(1 - height**2)
    directions = np.stack([flat * np.sin(turn), height, flat * np.cos(turn)], axis=1)
    return 0.5 * (lower + upper) + distance * 0.5 * np.linalg.norm(upper - lower) * directions


def build(num_lights: int, distance: float) -> dict[str, Built]:
    """All four scenes with their lights; in the default dtype."""
    made = parts()
    most_vertices = max(len(part.vertices) for part in made.values())
    most_faces = max(part.num_faces for part in made.values())
    scenes = {}
    for name, part in made.items():
        vertices = np.concatenate([part.vertices, np.repeat(part.vertices[:1], most_vertices - len(part.vertices), 0)])
        faces = np.concatenate([part.faces, np.zeros((most_faces - part.num_faces, 3), int)])
        colors = np.concatenate([part.colors, np.full((most_faces - part.num_faces, 3), 0.5)])
        mesh = Mesh.create(vertices, faces, colors)
        places = light_places(part, num_lights, distance)
        reach = np.linalg.norm(places - part.vertices.mean(axis=0), axis=1)
        lights = tuple(
            PointLight(jnp.asarray(at), jnp.asarray(np.asarray(SUNLIGHT) * far**2))
            for at, far in zip(places, reach, strict=True)
        )
        scenes[name] = Built(part, mesh, framed(mesh, 0.0, 34.0), lights)
    return scenes


def padded_rows(values: np.ndarray, length: int) -> jnp.ndarray:
    """Rows filled up with zeros."""
    return jnp.asarray(np.concatenate([values, np.zeros((length - len(values), *values.shape[1:]), values.dtype)]))
