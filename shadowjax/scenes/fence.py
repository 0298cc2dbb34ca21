"""A winding picket fence: long, thin, slanted steps of depth."""

import numpy as np

from shadowjax._checked import checked
from shadowjax.geometry.camera import Camera
from shadowjax.geometry.light import Light
from shadowjax.geometry.mesh import Mesh
from shadowjax.scenes import palette
from shadowjax.scenes.base import SceneFamily, framed, sun, to_mesh
from shadowjax.scenes.parts import rotation, scatter
from shadowjax.scenes.primitives import block, convex_hull, floor
from shadowjax.scenes.surfaces import rectangle, sweep

PICKET_TRIANGLES = 16
RAIL_CELLS = 40
FIXED_TRIANGLES = 12 + 2 * (8 * RAIL_CELLS + 8) + 5 * 24
LENGTH = 7.0  # of the fence seen from above, metres


@checked
def centre_line(along: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Points (n, 3) on the ground and headings (n,) in radians of the fence, at `along` in [0, 1]."""
    x = LENGTH * (along - 0.5)
    turn = 2 * np.pi * along
    z = 0.85 * np.sin(turn) - 0.35
    slope = 0.85 * np.cos(turn) * 2 * np.pi / LENGTH
    return np.stack([x, np.zeros_like(x), z], -1), np.arctan2(-slope, np.ones_like(x))


@checked
def build(num_triangles: int) -> tuple[Mesh, Camera, tuple[Light, ...]]:
    """Pickets, as many as the wish allows and ever narrower, on two bent rails between five posts."""
    rng = np.random.default_rng(51)
    pickets = max(8, round((num_triangles - FIXED_TRIANGLES) / PICKET_TRIANGLES))
    pitch = LENGTH / pickets
    half = 0.27 * pitch
    outline = np.array([(-half, 0.0), (half, 0.0), (half, 1.0), (0.0, 1.0 + 1.2 * half), (-half, 1.0)])
    depth = min(0.02, half)
    picket = convex_hull(np.concatenate([np.insert(outline, 2, side, axis=1) for side in (-depth, depth)]))
    feet, heading = centre_line((np.arange(pickets) + 0.5) / pickets)
    lean = np.radians(2.5) * np.sin(12.9898 * np.arange(pickets))
    turned = rotation((0.0, 1.0, 0.0), heading) @ rotation((0.0, 0.0, 1.0), lean)
    heights = 1.5 + 0.2 * np.sin(np.arange(pickets) * pitch * 3.0)
    stretch = np.stack([np.ones(pickets), heights, np.ones(pickets)], -1)
    front = depth + 0.025  # pickets stand before the rails
    feet = feet + np.stack([front * np.sin(heading), np.full(pickets, -0.05), front * np.cos(heading)], -1)
    hues = np.stack([palette.LIMESTONE, palette.TEAL, palette.LIMESTONE, palette.SAGE, palette.LIMESTONE])
    tint = palette.varied(rng, hues[np.arange(pickets) % len(hues)], 0.08)
    parts = [
        floor(4.15, 2.6).moved(x=-0.25, z=0.75).painted(palette.SAND),
        scatter(picket, turned * stretch[:, None, :], feet, tint),
    ]
    rail_path, _ = centre_line(np.linspace(0.0, 1.0, RAIL_CELLS + 1))
    for height in (0.42, 1.1):
        path = rail_path + np.array([0.0, height, 0.0])
        parts.append(sweep(rectangle(0.09, 0.05), path, (0.0, 1.0, 0.0)).painted(palette.BARK))
    for foot, angle in zip(*centre_line(np.linspace(0.0, 1.0, 5)), strict=True):
        post = block(0.12, 1.95, 0.12)
        cap = block(0.18, 0.06, 0.18).moved(y=1.94)
        parts += [
            piece.moved(y=-0.05).turned((0, 1, 0), float(angle)).moved(*foot).painted(palette.BARK)
            for piece in (post, cap)
        ]
    mesh = to_mesh(parts)
    return mesh, framed(mesh, 0.0, 32.0), sun(167.0, 38.0)


FAMILY = SceneFamily(
    name="fence",
    description="a winding picket fence: long thin shadows at every slant",
    source="mdsm, figure 5.1 (c), in kind",
    build=build,
    default_triangles=1748,
    min_triangles=1000,
    max_triangles=500_000,
)
