"""Closed bodies in NumPy: boxes, solids of revolution, geodesic spheres and convex hulls."""

import itertools
from collections.abc import Sequence

import numpy as np
from scipy.spatial import ConvexHull

from shadowjax._checked import checked
from shadowjax.scenes.parts import Part, Vector, make_part

GOLDEN_RATIO = (1.0 + 5.0**0.5) / 2.0

_BOX_FACES = np.array(
    [
        [0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1],
        [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3],
    ]
)  # fmt: skip


@checked
def box(lower: Vector, upper: Vector) -> Part:
    """Axis-aligned box between two corners in metres: 12 triangles."""
    corners = np.array(list(itertools.product(*zip(lower, upper, strict=True))), float)
    return make_part(corners, _BOX_FACES)


@checked
def block(x: float, y: float, z: float) -> Part:
    """Box of the given sizes that stands on the origin's plane, centred on the y axis."""
    return box((-x / 2, 0.0, -z / 2), (x / 2, y, z / 2))


@checked
def floor(half_x: float, half_z: float, thickness: float = 0.2) -> Part:
    """Closed slab whose top lies in the plane y = 0, centred on the origin."""
    return box((-half_x, -thickness, -half_z), (half_x, 0.0, half_z))


@checked
def revolve(profile: Sequence[Sequence[float]] | np.ndarray, segments: int, loop: bool = False) -> Part:
    """Closed solid of revolution about the y axis.

    Args:
        profile: (rows, 2) radius ≥ 0 and height of the outline. Flat caps join its ends to the axis, unless they lie
            on it already.
        segments: How many slices the turn has, 3 or more.
        loop: The outline closes on itself away from the axis (a ring) instead.
    """
    profile = np.asarray(profile, float)
    if not loop:
        ends = [[[0.0, row[1]]] if row[0] > 0 else np.zeros((0, 2)) for row in (profile[0], profile[-1])]
        profile = np.concatenate([ends[0], profile, ends[1]])
    angles = 2 * np.pi * np.arange(segments) / segments
    ring = np.stack([np.cos(angles), np.zeros(segments), np.sin(angles)], -1)
    vertices = profile[:, :1, None] * ring[None] + profile[:, 1, None, None] * np.array([0.0, 1.0, 0.0])
    index = np.arange(profile.shape[0] * segments).reshape(-1, segments)
    on_axis = profile[:, 0] == 0
    index[on_axis] = index[on_axis, :1]  # one pole instead of a ring of equal points
    return compact(vertices.reshape(-1, 3), quads_to_triangles(index, wrap_rows=loop, wrap_columns=True)).outward()


@checked
def cylinder(radius: float, bottom: float, top: float, segments: int) -> Part:
    """Closed cylinder about the y axis between two heights."""
    return revolve([(radius, bottom), (radius, top)], segments)


@checked
def cone(radius: float, bottom: float, top: float, segments: int) -> Part:
    """Closed cone about the y axis with its base at `bottom` and its tip at `top`."""
    return revolve([(radius, bottom), (0.0, top)], segments)


@checked
def torus(radius: float, tube: float, segments: int, sides: int) -> Part:
    """Torus about the y axis: `segments` around it, `sides` around its tube."""
    angles = 2 * np.pi * np.arange(sides) / sides
    return revolve(np.stack([radius + tube * np.cos(angles), tube * np.sin(angles)], -1), segments, loop=True)


@checked
def convex_hull(points: np.ndarray) -> Part:
    """The convex hull of points (points, 3), oriented outwards."""
    hull = ConvexHull(np.asarray(points, float))
    a, b, c = np.moveaxis(hull.points[hull.simplices], 1, 0)
    flipped = np.einsum("ij,ij->i", np.cross(b - a, c - a), hull.equations[:, :3]) < 0
    faces = np.where(flipped[:, None], hull.simplices[:, ::-1], hull.simplices)
    return compact(hull.points, faces)


def icosahedron() -> Part:
    """Regular icosahedron of circumradius 1."""
    signs = np.array(list(itertools.product((0.0,), (-1, 1), (-GOLDEN_RATIO, GOLDEN_RATIO))))
    points = np.concatenate([np.roll(signs, shift, axis=1) for shift in range(3)])
    return convex_hull(points / np.linalg.norm(points[0]))


@checked
def geodesic_sphere(radius: float, frequency: int) -> Part:
    """Icosahedron whose edges are cut into `frequency` pieces, pushed out onto a sphere: 20 frequency² triangles.

    Every vertex lies on the sphere, so the body is inscribed in it.
    """
    base = icosahedron()
    grid = [(i, j) for i in range(frequency + 1) for j in range(frequency + 1 - i)]
    number = {cell: k for k, cell in enumerate(grid)}
    upright = [(number[i, j], number[i + 1, j], number[i, j + 1]) for i, j in grid if i + j < frequency]
    inverted = [(number[i + 1, j], number[i + 1, j + 1], number[i, j + 1]) for i, j in grid if i + j < frequency - 1]
    # Barycentric weights of the lattice on a face: every point is a mean of its three corners.
    weights = np.array([(frequency - i - j, i, j) for i, j in grid], float) / frequency
    points = np.einsum("gk,fkd->fgd", weights, base.vertices[base.faces]).reshape(-1, 3)
    faces = np.array(upright + inverted)[None] + len(grid) * np.arange(20)[:, None, None]
    # neighbouring faces of the icosahedron share the points of their common edge
    _, first, inverse = np.unique(np.round(points, 9), axis=0, return_index=True, return_inverse=True)
    points = points[first] / np.linalg.norm(points[first], axis=1, keepdims=True)
    return make_part(radius * points, inverse.reshape(-1)[faces.reshape(-1, 3)]).outward()


@checked
def quads_to_triangles(index: np.ndarray, wrap_rows: bool = False, wrap_columns: bool = False) -> np.ndarray:
    """Triangles (faces, 3) of a grid of vertex numbers; degenerate ones, at poles, are left out."""
    if wrap_rows:
        index = np.concatenate([index, index[:1]])
    if wrap_columns:
        index = np.concatenate([index, index[:, :1]], axis=1)
    a, b, c, d = index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]
    faces = np.stack([np.stack([a, b, c], -1), np.stack([a, c, d], -1)], axis=2).reshape(-1, 3)
    twice = (faces == np.roll(faces, 1, axis=1)).any(axis=1)
    return faces[~twice]


@checked
def compact(vertices: np.ndarray, faces: np.ndarray) -> Part:
    """A part without the vertices that no face uses."""
    used, inverse = np.unique(faces, return_inverse=True)
    return make_part(vertices[used], inverse.reshape(faces.shape))
