"""Spheres, a torus and a knot over gently curved ground: curved occluders, curved receivers, curved shadow edges."""

from typing import Any

import numpy as np

from shadowjax._checked import checked
from shadowjax.geometry.camera import Camera
from shadowjax.geometry.light import Light
from shadowjax.geometry.mesh import Mesh
from shadowjax.scenes import palette
from shadowjax.scenes.base import SceneFamily, framed, sun, to_mesh
from shadowjax.scenes.parts import Part
from shadowjax.scenes.primitives import geodesic_sphere, torus
from shadowjax.scenes.surfaces import circle, landscape, sweep

DEFAULT = 5600


@checked
def ground_height(x: Any, z: Any) -> Any:
    """Height of the ground, metres: a shallow dome next to a shallow bowl."""
    dome = 0.5 * np.exp(-((x + 0.95) ** 2 + (z - 0.25) ** 2) / 1.3)
    bowl = 0.3 * np.exp(-((x - 1.5) ** 2 + (z - 0.9) ** 2) / 1.2)
    return dome - bowl


@checked
def torus_knot(radius: float, tube: float, segments: int, sides: int, p: int = 2, q: int = 3) -> Part:
    """Tube along the (p, q) torus knot that winds p times round the y axis and q times round the ring."""
    angle = 2 * np.pi * np.arange(segments) / segments
    distance = radius * (1.0 + 0.42 * np.cos(q * angle))
    path = np.stack([distance * np.cos(p * angle), 0.42 * radius * np.sin(q * angle), distance * np.sin(p * angle)], -1)
    ring_centre = radius * np.stack([np.cos(p * angle), np.zeros(segments), np.sin(p * angle)], -1)
    return sweep(circle(tube, sides), path, path - ring_centre, loop=True)


@checked
def build(num_triangles: int) -> tuple[Mesh, Camera, tuple[Light, ...]]:
    """Every surface gets finer with the wish."""
    fineness = np.sqrt(num_triangles / DEFAULT)

    def count(at_default: float, least: int = 3) -> int:
        return max(least, round(at_default * fineness))

    parts = [
        landscape(3.2, 2.3, count(28), count(21), ground_height, -0.5).painted(palette.PLASTER),
        torus_knot(0.58, 0.135, count(96, 24), count(11)).turned((1, 0, 0), 1.15).turned((0, 1, 0), -0.35)
        .moved(0.75, 1.25, -0.15).painted(palette.TEAL),
        torus(0.5, 0.14, count(30, 8), count(12)).turned((0, 0, 1), -0.35).moved(1.75, 0.28, 1.1)
        .painted(palette.OCHRE),
        geodesic_sphere(0.42, count(5, 2)).moved(-1.9, 0.53, -0.95).painted(palette.TERRACOTTA),
        geodesic_sphere(0.3, count(4, 2)).moved(-0.15, 0.42, 1.25).painted(palette.PLUM),
        geodesic_sphere(0.36, count(4, 2)).moved(2.35, 0.36, -1.2).painted(palette.SLATE),
        geodesic_sphere(0.24, count(3, 2)).moved(-1.75, 0.36, 1.3).painted(palette.SAGE),
    ]  # fmt: skip
    mesh = to_mesh(parts)
    return mesh, framed(mesh, 0.0, 36.0), sun(72.0, 40.0)


FAMILY = SceneFamily(
    name="curved-bodies",
    description="spheres, a torus and a torus knot over a dome and a bowl: smooth depth and curved shadow edges",
    source="mdsm, figures 5.1 (d) and 5.4, in kind",
    build=build,
    default_triangles=DEFAULT,
    min_triangles=500,
    max_triangles=3_000_000,
)
