"""Simple solids on a floor: the second scene of the stencil source."""

import itertools

import numpy as np

from shadowjax._checked import checked
from shadowjax.geometry.camera import Camera
from shadowjax.geometry.light import Light
from shadowjax.geometry.mesh import Mesh
from shadowjax.scenes import palette
from shadowjax.scenes.base import SceneFamily, framed, sun, to_mesh
from shadowjax.scenes.parts import Part
from shadowjax.scenes.primitives import GOLDEN_RATIO, cone, convex_hull, cylinder, floor, icosahedron


def dodecahedron() -> Part:
    """Regular dodecahedron of circumradius 1: 36 triangles."""
    cube = np.array(list(itertools.product((-1.0, 1.0), repeat=3)))
    short, long = 1.0 / GOLDEN_RATIO, GOLDEN_RATIO
    edges = np.array(list(itertools.product((0.0,), (-short, short), (-long, long))))
    points = np.concatenate([cube, *(np.roll(edges, shift, axis=1) for shift in range(3))])
    return convex_hull(points / np.sqrt(3.0))


def octahedron() -> Part:
    """Regular octahedron of circumradius 1: 8 triangles."""
    return convex_hull(np.concatenate([np.eye(3), -np.eye(3)]))


def tetrahedron() -> Part:
    """Regular tetrahedron of circumradius 1: 4 triangles."""
    return convex_hull(np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]]) / np.sqrt(3.0))


def cube() -> Part:
    """Cube of circumradius 1: 12 triangles."""
    return convex_hull(np.array(list(itertools.product((-1.0, 1.0), repeat=3))) / np.sqrt(3.0))


@checked
def standing(part: Part, face: int = 0) -> Part:
    """The convex body turned so that one of its faces lies in the plane y = 0."""
    a, b, c = part.vertices[part.faces[face]]
    normal = np.cross(b - a, c - a)
    normal = normal / np.linalg.norm(normal)
    axis = np.cross(normal, [0.0, -1.0, 0.0])
    if np.linalg.norm(axis) > 1e-9:
        part = part.turned(axis, float(np.arccos(np.clip(-normal[1], -1.0, 1.0))))
    elif normal[1] > 0:
        part = part.turned((1.0, 0.0, 0.0), np.pi)
    return part.moved(y=-float(part.vertices[:, 1].min()))


@checked
def build(num_triangles: int) -> tuple[Mesh, Camera, tuple[Light, ...]]:
    """The five regular solids with a cylinder, a cone and a pyramid; the count does not change."""
    del num_triangles
    placed = [
        (standing(dodecahedron()).scaled(0.72), (-0.1, -0.2), 0.2, palette.TERRACOTTA),
        (standing(icosahedron()).scaled(0.62), (-2.05, 0.35), 0.7, palette.OCHRE),
        (standing(octahedron()).scaled(0.72), (1.55, 0.75), 0.3, palette.TEAL),
        (standing(tetrahedron()).scaled(0.78), (-0.75, 1.35), 0.5, palette.PLUM),
        (standing(cube()).scaled(0.7), (-1.35, -1.45), 0.45, palette.SLATE),
        (cylinder(0.36, 0.0, 1.7, 16), (1.3, -1.15), 0.0, palette.SAGE),
        (cone(0.5, 0.0, 1.25, 16), (0.45, 1.5), 0.0, palette.SAND),
        (cone(0.62, 0.0, 0.95, 4), (2.35, -0.3), 0.35, palette.NAVY),
    ]
    parts = [body.turned((0, 1, 0), turn).moved(x, -0.003, z).painted(color) for body, (x, z), turn, color in placed]
    parts.append(floor(3.35, 2.3).moved(x=-0.35, z=0.05).painted(palette.PLASTER))
    mesh = to_mesh(parts)
    return mesh, framed(mesh, 0.0, 36.0), sun(80.0, 38.0)


FAMILY = SceneFamily(
    name="solids",
    description="the five regular solids with a cylinder, a cone and a pyramid",
    source="stencil, figure 10 and table 1",
    build=build,
    default_triangles=196,
    min_triangles=196,
    max_triangles=196,
)
