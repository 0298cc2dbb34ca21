"""Closed bodies from curves and outlines: sweeps, extrusions and height fields on a slab."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from scipy.spatial import Delaunay

from shadowjax._checked import checked
from shadowjax.scenes.parts import Part, Vector, make_part
from shadowjax.scenes.primitives import compact, quads_to_triangles


@checked
def circle(radius: float, segments: int, centre: Vector = (0.0, 0.0)) -> np.ndarray:
    """(segments, 2) points of a regular polygon, counter-clockwise."""
    angles = 2 * np.pi * np.arange(segments) / segments
    return np.asarray(centre) + radius * np.stack([np.cos(angles), np.sin(angles)], -1)


@checked
def rectangle(width: float, height: float, pieces: int = 1) -> np.ndarray:
    """(4 pieces, 2) points of a rectangle about the origin, counter-clockwise, each side in equal pieces."""
    x, y = width / 2, height / 2
    corners = np.array([(-x, -y), (x, -y), (x, y), (-x, y)])
    steps = np.arange(pieces)[:, None] / pieces
    sides = [a + (b - a) * steps for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True)]
    return np.concatenate(sides)


@checked
def sweep(
    section: np.ndarray,
    path: np.ndarray,
    side: Vector,
    loop: bool = False,
    scale: np.ndarray | float = 1.0,
) -> Part:
    """Closed body that a section leaves along a path.

    Args:
        section: (corners, 2) outline, counter-clockwise, all of it in sight of the path; `side` is its first axis.
        path: (points, 3) the way of the section's centre.
        side: (3,) or (points, 3) direction, not parallel to the path, that fixes the section's turn.
        loop: The path closes on itself; otherwise fans close both ends.
        scale: Factor on the section, one or one a point of the path.
    """
    path = np.asarray(path, float)
    tangent = (np.roll(path, -1, 0) - np.roll(path, 1, 0)) if loop else np.gradient(path, axis=0)
    tangent = tangent / np.linalg.norm(tangent, axis=1, keepdims=True)
    first = np.broadcast_to(np.asarray(side, float), path.shape)
    # The given side made perpendicular to the path (Gram–Schmidt), so that sections do not shear.
    first = first - np.sum(first * tangent, axis=1, keepdims=True) * tangent
    first = first / np.linalg.norm(first, axis=1, keepdims=True)
    second = np.cross(tangent, first)
    size = np.broadcast_to(np.asarray(scale, float), len(path))[:, None, None]
    offsets = section[None, :, :1] * first[:, None] + section[None, :, 1:] * second[:, None]
    vertices = (path[:, None] + size * offsets).reshape(-1, 3)
    index = np.arange(len(vertices)).reshape(len(path), len(section))
    faces = quads_to_triangles(index, wrap_rows=loop, wrap_columns=True)
    if not loop:
        ends = np.array([len(vertices), len(vertices) + 1])
        vertices = np.concatenate([vertices, path[[0, -1]]])
        caps = [
            np.stack([np.full(len(rim), end), rim, np.roll(rim, turn)], -1)
            for rim, end, turn in ((index[0], ends[0], -1), (index[-1], ends[1], 1))
        ]
        faces = np.concatenate([faces, *(cap[:, ::-1] for cap in caps)])
    return make_part(vertices, faces).outward()


@checked
def triangulate(loops: Sequence[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Triangles of a flat region bounded by loops: an outline and its holes.

    The triangulation is Delaunay's, so loops must be sampled finely enough for their edges to appear in it.

    Args:
        loops: Outline and holes, each (points, 2), in any orientation.

    Returns:
        Points (points, 2) and counter-clockwise triangles (triangles, 3).

    Raises:
        ValueError: If an edge of a loop is missing, which shows as a wrong area.
    """
    points = np.concatenate(loops)
    triangles = Delaunay(points).simplices
    centre = points[triangles].mean(axis=1)
    crossings = np.zeros(len(centre), bool)
    for loop in loops:
        (x0, y0), (x1, y1) = loop.T, np.roll(loop, -1, 0).T
        cx, cy = centre[:, :1], centre[:, 1:]
        # Even–odd rule: a ray from the triangle's middle crosses each loop's edges an odd number of times inside.
        spans = (y0 > cy) != (y1 > cy)
        rise = np.where(y1 == y0, 1.0, y1 - y0)
        crossings ^= (np.sum(spans & (cx < x0 + (cy - y0) * (x1 - x0) / rise), axis=1) % 2).astype(bool)
    triangles = triangles[crossings]
    a, b, c = np.moveaxis(points[triangles], 1, 0)
    twice = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]
    areas = [abs(np.sum(p[:, 0] * np.roll(p[:, 1], -1) - p[:, 1] * np.roll(p[:, 0], -1))) for p in loops]
    # Twice the outline's area less that of the holes; the outline is the largest loop.
    expected = 2 * max(areas) - sum(areas)
    found = float(np.abs(twice).sum())
    if abs(found - expected) > 1e-9 * expected:
        raise ValueError(f"the outline needs more points: triangles cover {found / 2}, the region has {expected / 2}")
    return points, np.where((twice < 0)[:, None], triangles[:, ::-1], triangles)


@checked
def extrude(loops: Sequence[np.ndarray], thickness: float) -> Part:
    """Closed body between z = 0 and z = thickness over the flat region that loops bound in the xy plane."""
    points, triangles = triangulate(loops)
    count = len(points)
    heights = np.repeat([0.0, thickness], count)[:, None]
    vertices = np.concatenate([np.tile(points, (2, 1)), heights], axis=1)
    edges = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    # One number for each directed edge; the rim's edges have no reverse among them.
    keys = edges[:, 0] * count + edges[:, 1]
    rim = edges[~np.isin(keys, edges[:, 1] * count + edges[:, 0])]  # no neighbour runs along it the other way
    a, b = rim.T
    walls = [np.stack([a, b, b + count], -1), np.stack([a, b + count, a + count], -1)]
    return compact(vertices, np.concatenate([triangles[:, ::-1], triangles + count, *walls])).outward()


@checked
def landscape(
    half_x: float,
    half_z: float,
    cells_x: int,
    cells_z: int,
    height: Callable[[Any, Any], Any],
    bottom: float,
) -> Part:
    """Closed slab with a height field for its top; 2 cells_x cells_z + 6 (cells_x + cells_z) triangles.

    Args:
        half_x: Half the extent along x, metres.
        half_z: Half the extent along z, metres.
        cells_x: Cells of the grid along x.
        cells_z: Cells of the grid along z.
        height: Maps x, z to y, metres; everywhere above `bottom`.
        bottom: Height of the flat underside, metres.
    """
    z, x = np.meshgrid(
        np.linspace(-half_z, half_z, cells_z + 1), np.linspace(-half_x, half_x, cells_x + 1), indexing="ij"
    )
    top = np.stack([x, height(x, z), z], -1).reshape(-1, 3)
    index = np.arange(len(top)).reshape(x.shape)
    rim = np.concatenate([index[0, :-1], index[:-1, -1], index[-1, :0:-1], index[:0:-1, 0]])
    base = top[rim] * np.array([1.0, 0.0, 1.0]) + np.array([0.0, bottom, 0.0])
    vertices = np.concatenate([top, base, [[0.0, bottom, 0.0]]])
    below = len(top) + np.arange(len(rim))
    skirt = quads_to_triangles(np.stack([rim, below]), wrap_columns=True)
    underside = np.stack([np.full(len(rim), len(vertices) - 1), below, np.roll(below, -1)], -1)
    return make_part(vertices, np.concatenate([quads_to_triangles(index)[:, ::-1], skirt, underside]))
