"""A heap of tumbled blocks: sudden overlaps everywhere."""

import numpy as np

from shadowjax._checked import checked
from shadowjax.geometry.camera import Camera
from shadowjax.geometry.light import Light
from shadowjax.geometry.mesh import Mesh
from shadowjax.scenes import palette
from shadowjax.scenes.base import SceneFamily, framed, sun, to_mesh
from shadowjax.scenes.parts import random_rotations, scatter
from shadowjax.scenes.primitives import box, floor

HEAP_VOLUME = 4.2  # cubic metres of stone, however finely it is broken
HUES = np.stack([palette.LIMESTONE, palette.SAND, palette.SLATE, palette.TERRACOTTA, palette.BARK, palette.OCHRE])
SHARES = np.array([0.34, 0.26, 0.17, 0.12, 0.08, 0.03])


@checked
def build(num_triangles: int) -> tuple[Mesh, Camera, tuple[Light, ...]]:
    """Boxes of 12 triangles in a mound and, fewer and smaller, around it."""
    rng = np.random.default_rng(51)
    count = max(8, round((num_triangles - 12) / 12))
    edge = (HEAP_VOLUME / count) ** (1 / 3)
    sizes = edge * np.exp(rng.normal(0.0, 0.33, size=(count, 3)))
    strayed = rng.uniform(size=count) < 0.18
    angle = rng.uniform(0.0, 2 * np.pi, size=count)
    distance = np.where(strayed, rng.uniform(1.2, 2.15, size=count), 1.5 * rng.uniform(size=count) ** 0.62)
    sizes *= np.where(strayed, 0.75, 1.0)[:, None]
    profile = 1.45 * np.clip(1.0 - (distance / 1.75) ** 1.3, 0.0, None)
    turns = random_rotations(rng, count)
    reach = np.sum(np.abs(turns[:, 1]) * sizes, axis=1) / 2  # half the height of the turned box
    height = np.where(strayed, 0.0, rng.uniform(size=count) ** 0.6 * profile) + 0.85 * reach
    offsets = np.stack([1.25 * distance * np.cos(angle), height, distance * np.sin(angle)], -1)
    tint = palette.varied(rng, HUES[rng.choice(len(HUES), size=count, p=SHARES)], 0.15)
    unit = box((-0.5, -0.5, -0.5), (0.5, 0.5, 0.5))
    parts = [
        scatter(unit, turns * sizes[:, None, :], offsets, tint),
        floor(3.05, 2.25).moved(x=-0.25).painted(palette.PLASTER),
    ]
    mesh = to_mesh(parts)
    return mesh, framed(mesh, 0.0, 34.0), sun(72.0, 36.0)


FAMILY = SceneFamily(
    name="rubble",
    description="a heap of tumbled blocks: sudden overlaps of many depths",
    source="mdsm, figure 5.1 (b), in kind",
    build=build,
    default_triangles=3012,
    min_triangles=216,
    max_triangles=3_000_000,
)
