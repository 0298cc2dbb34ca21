"""One geodesic sphere over a floor: the first scene of the stencil source."""

import numpy as np

from shadowjax._checked import checked
from shadowjax.geometry.camera import Camera
from shadowjax.geometry.light import Light
from shadowjax.geometry.mesh import Mesh
from shadowjax.scenes import palette
from shadowjax.scenes.base import SceneFamily, framed, sun, to_mesh
from shadowjax.scenes.primitives import floor, geodesic_sphere

RADIUS = 1.0
CENTRE_HEIGHT = 1.15
FLOOR_TRIANGLES = 12


@checked
def build(num_triangles: int) -> tuple[Mesh, Camera, tuple[Light, ...]]:
    """A sphere of 20 n² triangles whose count is the nearest to the wish, and a floor of 12."""
    frequency = max(1, round(np.sqrt((num_triangles - FLOOR_TRIANGLES) / 20)))
    ball = geodesic_sphere(RADIUS, frequency)
    panels = palette.varied(np.random.default_rng(9), np.broadcast_to(palette.TERRACOTTA, (ball.num_faces, 3)), 0.12)
    parts = [
        ball.painted(panels).moved(y=CENTRE_HEIGHT),
        floor(2.3, 1.6).moved(x=-0.85, z=-0.1).painted(palette.LIMESTONE),
    ]
    mesh = to_mesh(parts)
    return mesh, framed(mesh, 0.0, 34.0), sun(78.0, 42.0)


FAMILY = SceneFamily(
    name="geodesic-sphere",
    description="a faceted geodesic sphere that floats over a floor",
    source="stencil, figure 9 and table 1",
    build=build,
    default_triangles=1292,
    min_triangles=32,
    max_triangles=2_000_000,
)
