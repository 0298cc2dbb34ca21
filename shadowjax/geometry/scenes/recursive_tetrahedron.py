"""A recursive (Sierpiński) tetrahedron on a floor: the third scene of the stencil source."""

import numpy as np

from shadowjax.geometry.camera import Camera
from shadowjax.geometry.light import Light
from shadowjax.geometry.mesh import Mesh
from shadowjax.geometry.scenes import palette
from shadowjax.geometry.scenes.base import SceneFamily, framed, sun, to_mesh
from shadowjax.geometry.scenes.parts import Part, scatter
from shadowjax.geometry.scenes.primitives import convex_hull, floor

EDGE = 3.2  # metres


def corners() -> np.ndarray:
    """(4, 3) corners of the whole tetrahedron, its base in the plane y = 0."""
    angles = np.radians([20.0, 140.0, 260.0])
    ring = EDGE / np.sqrt(3.0) * np.stack([np.cos(angles), np.zeros(3), np.sin(angles)], -1)
    return np.concatenate([ring, [[0.0, EDGE * np.sqrt(2.0 / 3.0), 0.0]]])


def recursive_tetrahedron(depth: int) -> Part:
    """4^depth tetrahedra, each half the size of its parent; siblings touch at corners only."""
    whole = corners()
    offsets = np.zeros((1, 3))
    for level in range(depth):
        offsets = (offsets[:, None] + whole[None] * 0.5 ** (level + 1)).reshape(-1, 3)
    small = convex_hull(whole * 0.5**depth)
    height = offsets[:, 1:2] / whole[3, 1]
    tint = (1.0 - height) * palette.TEAL + height * palette.SAND
    return scatter(small, np.broadcast_to(np.eye(3), (len(offsets), 3, 3)), offsets, tint)


def build(num_triangles: int) -> tuple[Mesh, Camera, tuple[Light, ...]]:
    """4^(depth + 1) triangles and a floor of 12: the power of 4 nearest in ratio to the wish."""
    depth = max(0, round(np.log(max(num_triangles - 12, 4)) / np.log(4.0)) - 1)
    parts = [
        recursive_tetrahedron(depth).moved(y=0.02),
        floor(2.6, 2.0).moved(x=-0.65, z=-0.15).painted(palette.LIMESTONE),
    ]
    mesh = to_mesh(parts)
    return mesh, framed(mesh, 0.0, 34.0), sun(72.0, 42.0)


FAMILY = SceneFamily(
    name="recursive-tetrahedron",
    description="a Sierpiński tetrahedron: shadows with detail at every scale",
    source="stencil, figure 11 and table 1",
    build=build,
    default_triangles=4108,
    min_triangles=28,
    max_triangles=5_000_000,
)
