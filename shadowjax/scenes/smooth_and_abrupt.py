"""Rolling ground with a sphere, a ring and blocks on it: smooth and sudden changes of depth side by side."""

from typing import Any

import numpy as np

from shadowjax._checked import checked
from shadowjax.geometry.camera import Camera
from shadowjax.geometry.light import Light
from shadowjax.geometry.mesh import Mesh
from shadowjax.scenes import palette
from shadowjax.scenes.base import SceneFamily, framed, sun, to_mesh
from shadowjax.scenes.primitives import block, geodesic_sphere, torus
from shadowjax.scenes.surfaces import landscape

DEFAULT = 3700
BLOCKS = [  # x, z, width, height, depth, turn in degrees, colour
    (-0.95, -1.05, 0.55, 1.7, 0.55, 20.0, palette.SLATE),
    (-0.2, -1.3, 0.5, 1.1, 0.5, 50.0, palette.TEAL),
    (-1.9, 0.1, 0.75, 0.6, 0.5, -15.0, palette.SAGE),
    (1.75, 0.95, 0.5, 0.75, 0.5, 30.0, palette.PLUM),
    (2.35, -0.85, 0.42, 1.55, 0.42, 10.0, palette.NAVY),
]  # fmt: skip


@checked
def ground_height(x: Any, z: Any) -> Any:
    """Height of the rolling ground, metres."""
    return 0.16 * np.sin(1.5 * x + 0.4) * np.cos(1.2 * z - 0.3) + 0.07 * np.sin(2.3 * z + 0.8 * x)


@checked
def build(num_triangles: int) -> tuple[Mesh, Camera, tuple[Light, ...]]:
    """All curved surfaces get finer with the wish; the blocks stay."""
    fineness = np.sqrt(max(num_triangles - 12 * len(BLOCKS), 1) / DEFAULT)
    cells = max(4, round(32 * fineness))
    parts = [
        landscape(3.3, 2.4, cells, max(3, round(24 * fineness)), ground_height, -0.45).painted(palette.SAND),
        geodesic_sphere(0.72, max(2, round(7.5 * fineness)))
        .moved(0.85, 0.62 + ground_height(0.85, -0.2), -0.2)
        .painted(palette.TERRACOTTA),
        torus(0.62, 0.17, max(8, round(30 * fineness)), max(5, round(13 * fineness)))
        .turned((1, 0, 0), np.pi / 2)
        .turned((0, 1, 0), np.radians(38.0))
        .moved(-0.75, 0.74 + ground_height(-0.75, 1.1), 1.1)
        .painted(palette.OCHRE),
    ]
    parts += [
        block(width, height + 0.15, depth)
        .turned((0, 1, 0), np.radians(turn))
        .moved(x, ground_height(x, z) - 0.15, z)
        .painted(color)
        for x, z, width, height, depth, turn, color in BLOCKS
    ]
    mesh = to_mesh(parts)
    return mesh, framed(mesh, 0.0, 36.0), sun(75.0, 40.0)


FAMILY = SceneFamily(
    name="smooth-and-abrupt",
    description="a sphere, a ring and blocks on rolling ground: smooth and sudden changes of depth",
    source="mdsm, figure 5.1 (a), in kind",
    build=build,
    default_triangles=DEFAULT,
    min_triangles=400,
    max_triangles=3_000_000,
)
