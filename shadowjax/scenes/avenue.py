"""A long avenue of trees seen by a walker: shadows at every distance, where warps and partitions earn their keep."""

import numpy as np

from shadowjax._checked import checked
from shadowjax.geometry.camera import Camera
from shadowjax.geometry.light import Light
from shadowjax.geometry.mesh import Mesh
from shadowjax.scenes import palette
from shadowjax.scenes.base import SceneFamily, sun, to_mesh, view
from shadowjax.scenes.parts import scatter
from shadowjax.scenes.primitives import box, cylinder, geodesic_sphere

TREES_A_SIDE, SPACING = 12, 5.0
LENGTH = TREES_A_SIDE * SPACING
HALF_WIDTH = 13.0  # of the ground, metres
ROAD = 2.6  # half the width of the road, metres
BOLLARD_TRIANGLES, TRUNK_TRIANGLES = 8 * 4, 7 * 4
FIXED_TRIANGLES = 3 * 12 + 4 * TREES_A_SIDE * BOLLARD_TRIANGLES + 2 * TREES_A_SIDE * TRUNK_TRIANGLES


@checked
def build(num_triangles: int) -> tuple[Mesh, Camera, tuple[Light, ...]]:
    """The crowns get finer with the wish; everything else stays."""
    rng = np.random.default_rng(44)
    frequency = max(1, round(np.sqrt((num_triangles - FIXED_TRIANGLES) / (2 * TREES_A_SIDE * 20))))
    count = 2 * TREES_A_SIDE
    side = np.repeat([-1.0, 1.0], TREES_A_SIDE)
    z = np.tile(-SPACING * np.arange(TREES_A_SIDE), 2) - 1.5 + rng.uniform(-0.4, 0.4, count)
    feet = np.stack([side * 4.4, np.full(count, -0.05), z], -1)
    size = rng.uniform(0.85, 1.15, count)
    upright = size[:, None, None] * np.eye(3)
    greens = rng.uniform(size=(count, 1))
    crowns = palette.varied(rng, greens * palette.MOSS + (1 - greens) * palette.LEAF, 0.1)
    crown = geodesic_sphere(1.0, frequency).scaled(1.45, 1.9, 1.45).moved(y=3.6)
    bollard_z = np.tile(-0.5 * SPACING * np.arange(2 * TREES_A_SIDE), 2) - 0.2
    bollard_x = np.repeat([-1.0, 1.0], 2 * TREES_A_SIDE) * (ROAD + 0.25)
    bollards = np.stack([bollard_x, np.zeros(len(bollard_x)), bollard_z], -1)
    straight = np.broadcast_to(np.eye(3), (len(bollards), 3, 3))
    near, far = 6.0, 4.0 - LENGTH - 4.0
    parts = [
        box((-HALF_WIDTH, -0.5, far), (HALF_WIDTH, 0.0, near)).painted(palette.SAGE),
        box((-ROAD, -0.1, far + 0.1), (ROAD, 0.03, near - 0.1)).painted(palette.LIMESTONE),
        box((-0.07, 0.0, far + 0.2), (0.07, 0.034, near - 0.2)).painted(palette.OCHRE),
        scatter(crown, upright, feet, crowns),
        scatter(cylinder(0.2, 0.0, 2.4, 7).painted(palette.BARK), upright, feet),
        scatter(cylinder(0.09, -0.05, 0.75, 8).painted(palette.GRAPHITE), straight, bollards),
    ]
    return to_mesh(parts), view((1.0, 1.7, 4.6), (-0.2, 1.35, -8.0), 22.0, 3.6, 66.5), sun(72.0, 38.0)


FAMILY = SceneFamily(
    name="avenue",
    description="a long avenue of trees: a view from a few metres to sixty, for warps and partitions",
    source="shadowjax",
    build=build,
    default_triangles=6564,
    min_triangles=2800,
    max_triangles=3_000_000,
)
