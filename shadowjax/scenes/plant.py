"""A potted plant: many thin leaves over each other, the hardest case for a depth map."""

import numpy as np

from shadowjax._checked import checked
from shadowjax.geometry.camera import Camera
from shadowjax.geometry.light import Light
from shadowjax.geometry.mesh import Mesh
from shadowjax.scenes import palette
from shadowjax.scenes.base import SceneFamily, framed, sun, to_mesh
from shadowjax.scenes.parts import Part, scatter
from shadowjax.scenes.primitives import floor, revolve
from shadowjax.scenes.surfaces import circle, sweep

DEFAULT = 4200
SOIL = 0.6  # height of the soil in the pot, metres
POT = [
    (0.29, 0.0), (0.41, 0.52), (0.47, 0.52), (0.48, 0.68), (0.42, 0.68), (0.41, SOIL), (0.0, SOIL + 0.03),
]  # fmt: skip
GOLDEN_ANGLE = np.pi * (3.0 - 5.0**0.5)


@checked
def leaf(cells: int) -> Part:
    """Pointed leaf of unit length along x, folded along its midrib and drooping; 8 cells + 8 triangles."""
    along = np.linspace(0.0, 1.0, cells + 1)
    path = np.stack([along, 0.1 * np.sin(np.pi * along) - 0.22 * along**2, np.zeros_like(along)], -1)
    width = 0.012 + 0.21 * np.sin(np.pi * along**0.75) ** 0.9
    section = np.array([(0.0, -0.035), (1.0, 0.22), (0.0, 0.035), (-1.0, 0.22)])
    return sweep(section, path, (0.0, 0.0, -1.0), scale=width)


@checked
def stem(turn: float, lean: float, height: float, along: np.ndarray) -> np.ndarray:
    """Points (n, 3) at `along` in [0, 1] of a stem that rises from the soil and leans towards `turn` radians."""
    outwards = 0.1 + lean * along**1.7
    rise = SOIL - 0.05 + height * (along - 0.18 * along**2)
    return np.stack([outwards * np.cos(turn), rise, outwards * np.sin(turn)], -1)


@checked
def build(num_triangles: int) -> tuple[Mesh, Camera, tuple[Light, ...]]:
    """With the wish grow the number of leaves and stems and the fineness of each."""
    rng = np.random.default_rng(66)
    fineness = np.sqrt(num_triangles / DEFAULT)
    num_stems = max(4, round(11 * np.sqrt(fineness)))
    leaves_each = max(3, round(6 * np.sqrt(fineness)))
    turns = GOLDEN_ANGLE * np.arange(num_stems)
    leans = 0.15 + 0.75 * np.sqrt((np.arange(num_stems) + 0.5) / num_stems)
    heights = 1.75 - 0.75 * leans + rng.uniform(-0.15, 0.15, num_stems)
    steps = np.linspace(0.0, 1.0, max(3, round(7 * fineness)))
    stems = [
        sweep(circle(0.022, max(4, round(5 * np.sqrt(fineness)))), stem(turn, lean, height, steps), (0.0, 0.0, 1.0))
        for turn, lean, height in zip(turns, leans, heights, strict=True)
    ]
    where = np.linspace(0.3, 1.0, leaves_each)
    feet = np.concatenate([stem(t, s, h, where) for t, s, h in zip(turns, leans, heights, strict=True)])
    count = len(feet)
    order = np.tile(np.arange(leaves_each), num_stems)
    azimuth = np.repeat(turns, leaves_each) + np.where(order == leaves_each - 1, 0.0, 2.4 * order + 0.8)
    azimuth += rng.uniform(-0.35, 0.35, count)
    rise = rng.uniform(-0.15, 0.55, count)
    forward = np.stack([np.cos(azimuth) * np.cos(rise), np.sin(rise), np.sin(azimuth) * np.cos(rise)], -1)
    across = np.stack([-np.sin(azimuth), np.zeros(count), np.cos(azimuth)], -1)
    length = 0.62 * fineness**-0.3 * rng.uniform(0.7, 1.1, count) * (1.12 - 0.3 * np.tile(where, num_stems))
    axes = np.stack([forward, np.cross(across, forward), across], -1) * length[:, None, None]
    shade = rng.uniform(size=(count, 1))
    tint = palette.varied(rng, shade * palette.MOSS + (1.0 - shade) * palette.LEAF, 0.12)
    parts = [
        scatter(leaf(max(3, round(5 * fineness))), axes, feet, tint),
        *(part.painted(palette.MOSS) for part in stems),
        revolve(POT, max(10, round(22 * fineness))).moved(y=-0.005).painted(palette.TERRACOTTA),
        floor(2.3, 1.65).moved(x=-0.7, z=-0.05).painted(palette.LIMESTONE),
    ]
    mesh = to_mesh(parts)
    return mesh, framed(mesh, 0.0, 30.0), sun(75.0, 44.0)


FAMILY = SceneFamily(
    name="plant",
    description="a potted plant: thin leaves over each other and sudden overlaps of many depths",
    source="mdsm, figure 5.1 (b), in kind",
    build=build,
    default_triangles=DEFAULT,
    min_triangles=1500,
    max_triangles=2_000_000,
)
