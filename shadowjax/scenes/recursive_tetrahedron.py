"""A recursive tetrahedron on a floor, smaller ones on every free face: the third scene of the stencil source."""

import numpy as np

from shadowjax._checked import checked
from shadowjax.geometry.camera import Camera
from shadowjax.geometry.light import Light
from shadowjax.geometry.mesh import Mesh
from shadowjax.scenes import palette
from shadowjax.scenes.base import SceneFamily, framed, sun, to_mesh
from shadowjax.scenes.parts import Part, scatter
from shadowjax.scenes.primitives import convex_hull, floor

EDGE = 2.4  # of the largest, metres
RATIO = 0.45  # of the edges of a tetrahedron and the one it stands on: from a half on, neighbours would touch
GAP = 0.002  # between a tetrahedron and the face it stands on, of its edge: bodies stay apart, each closed


def regular_tetrahedron() -> np.ndarray:
    """(4, 3) corners with edges of length 1 around the origin: the top, then the three of the base, level."""
    angles = np.radians([20.0, 260.0, 140.0])
    ring = np.stack([np.cos(angles), np.zeros(3), np.sin(angles)], -1) / np.sqrt(3.0)
    height = np.sqrt(2.0 / 3.0)
    return np.concatenate([[[0.0, 0.75 * height, 0.0]], ring - [0.0, 0.25 * height, 0.0]])


@checked
def num_tetrahedra(depth: int) -> int:
    """1 + 4 + 12 + 36 + …: the first has four free faces, every other one three."""
    return 2 * 3**depth - 1


@checked
def corners(depth: int) -> np.ndarray:
    """(tetrahedra, 4, 3) corners, the top first, in order of level.

    Args:
        depth: Levels beyond the first, ≥ 0.
    """
    first = EDGE * regular_tetrahedron()
    levels, base = [first[None]], first[None, 1:]
    for level in range(depth):
        top, ring = levels[-1][:, 0], levels[-1][:, 1:]
        sides = [np.stack([top, ring[:, i], ring[:, (i + 1) % 3]], axis=1) for i in range(3)]
        faces = np.concatenate([*sides, base[:, ::-1]] if level == 0 else sides)
        middle = faces.mean(axis=1, keepdims=True)
        outward = np.cross(faces[:, 1] - faces[:, 0], faces[:, 2] - faces[:, 0])
        outward /= np.linalg.norm(outward, axis=1, keepdims=True)
        edge = RATIO ** (level + 1) * EDGE
        # The parent's face shrunk about its middle and lifted by the gap is the child's base.
        ring = middle + RATIO * (faces - middle) + GAP * edge * outward[:, None]
        top = ring.mean(axis=1) + np.sqrt(2.0 / 3.0) * edge * outward
        levels.append(np.concatenate([top[:, None], ring], axis=1))
    return np.concatenate(levels)


@checked
def recursive_tetrahedron(depth: int) -> Part:
    """2·3^depth − 1 closed tetrahedra that touch nowhere, the lowest point in the plane y = 0.

    Args:
        depth: Levels beyond the first, ≥ 0.
    """
    places = corners(depth)
    unit = convex_hull(regular_tetrahedron())
    # the affine map of the template onto each, by three edges from the top
    frame = regular_tetrahedron()
    edges = (frame[1:] - frame[0]).T
    matrices = (places[:, 1:] - places[:, :1]).transpose(0, 2, 1) @ np.linalg.inv(edges)
    offsets = places[:, 0] - matrices @ frame[0]
    lowest, highest = places[..., 1].min(), places[..., 1].max()
    height = (places[..., 1].mean(axis=1) - lowest)[:, None] / (highest - lowest)
    tint = (1.0 - height) * palette.TEAL + height * palette.SAND
    return scatter(unit, matrices, offsets, tint).moved(y=-lowest)


@checked
def build(num_triangles: int) -> tuple[Mesh, Camera, tuple[Light, ...]]:
    """4·(2·3^depth − 1) triangles and a floor of 12: the depth nearest in ratio to the wish."""
    depth = max(0, round(np.log((max(num_triangles - 12, 4) / 4 + 1) / 2) / np.log(3.0)))
    parts = [
        recursive_tetrahedron(depth).moved(y=0.02),
        floor(2.6, 2.0).moved(x=-0.65, z=-0.15).painted(palette.LIMESTONE),
    ]
    mesh = to_mesh(parts)
    return mesh, framed(mesh, 0.0, 34.0), sun(72.0, 42.0)


FAMILY = SceneFamily(
    name="recursive-tetrahedron",
    description="a tetrahedron with smaller ones on every free face: shadows with detail at every scale",
    source="stencil, figure 11 and table 1",
    build=build,
    default_triangles=1952,
    min_triangles=16,
    max_triangles=5_000_000,
)
