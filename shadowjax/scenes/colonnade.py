"""A roofless nave: columns, arches and vault ribs in low sun, seen from inside."""

import itertools

import numpy as np

from shadowjax._checked import checked
from shadowjax.geometry.camera import Camera
from shadowjax.geometry.light import Light
from shadowjax.geometry.mesh import Mesh
from shadowjax.scenes import palette
from shadowjax.scenes.base import SceneFamily, sun, to_mesh, view
from shadowjax.scenes.parts import Part, join, scatter
from shadowjax.scenes.primitives import block, box, revolve
from shadowjax.scenes.surfaces import circle, extrude, landscape, rectangle, sweep

DEFAULT = 8000
BAYS = 6
BAY = 3.0  # metres along the nave from column to column
HALF_WIDTH = 2.8  # from the middle of the nave to the columns
SPRINGING = 4.4  # height at which the arches begin
WALL_X = -5.2
SHAFT = [
    (0.46, 0.28), (0.5, 0.34), (0.46, 0.41), (0.36, 0.46), (0.34, 2.2), (0.31, 3.85), (0.36, 3.9), (0.31, 3.96),
    (0.46, 4.2),
]  # fmt: skip


@checked
def column(segments: int) -> Part:
    """Plinth, moulded shaft and abacus, 4.4 m tall."""
    plinth = block(1.05, 0.29, 1.05)
    abacus = block(0.98, 0.24, 0.98).moved(y=SPRINGING - 0.23)
    return join([plinth, revolve(SHAFT, segments), abacus])


@checked
def arch(start: np.ndarray, end: np.ndarray, rise: float, width: float, depth: float, cells: int) -> Part:
    """Half an ellipse from `start` to `end` (3,) with a rectangular section, `depth` measured across the curve."""
    angle = np.linspace(np.pi, 0.0, cells + 1)
    # From angle π, at the start, to 0, at the end; `reach` is the half axis along the span, `rise` the upright one.
    middle, reach = (start + end) / 2, (end - start) / 2
    path = middle + np.cos(angle)[:, None] * reach + rise * np.sin(angle)[:, None] * np.array([0.0, 1.0, 0.0])
    return sweep(rectangle(width, depth), path, np.cross(reach, [0.0, 1.0, 0.0]))


@checked
def end_wall(segments: int) -> Part:
    """Wall across the nave with a round-headed portal and a round window."""
    outline = rectangle(9.6, 7.6, 40) + np.array([0.0, 3.8])
    half_turn = np.linspace(0.0, np.pi, segments + 1)
    head = np.stack([1.0 * np.cos(half_turn), 2.6 + 1.0 * np.sin(half_turn)], -1)
    jamb = np.linspace(0.0, 1.0, 14)[1:-1, None]
    sill = np.linspace((-1.0, 0.75), (1.0, 0.75), 13)
    door = np.concatenate([sill, sill[-1] + jamb * (head[0] - sill[-1]), head, head[-1] + jamb * (sill[0] - head[-1])])
    return extrude([outline, door, circle(0.95, 2 * segments, (0.0, 5.6))], 0.5)


@checked
def build(num_triangles: int) -> tuple[Mesh, Camera, tuple[Light, ...]]:
    """Columns, arches and ribs get finer with the wish; the plan stays."""
    fineness = num_triangles / DEFAULT
    segments, cells = max(5, round(12 * fineness)), max(4, round(8 * fineness))
    stations = -BAY * np.arange(BAYS + 1.0)
    feet = np.array([(side * HALF_WIDTH, 0.0, z) for side in (-1, 1) for z in stations])
    heads = feet.reshape(2, BAYS + 1, 3) + np.array([0.0, SPRINGING, 0.0])
    arcade = [arch(a, b, 0.5 * BAY, 0.5, 0.4, cells) for row in heads for a, b in itertools.pairwise(row)]
    across = [arch(a, b, 2.5, 0.4, 0.42, round(1.4 * cells)) for a, b in zip(*heads, strict=True)]
    ribs = [
        arch(heads[side, k], heads[1 - side, k + 1], 2.62, 0.17, 0.22, round(1.6 * cells))
        for k in range(BAYS)
        for side in (0, 1)
    ]
    far_end = stations[-1] - 2.2
    length = 6.0 - far_end
    tiles = landscape(5.0, length / 2, 10, round(length), lambda x, z: np.zeros_like(x), -0.4)
    row, tile = np.divmod(np.arange(tiles.num_faces) // 2, 10)
    checker = ((row + tile) % 2 == 0)[:, None] & (np.arange(tiles.num_faces) < 20 * round(length))[:, None]
    parts = [
        tiles.painted(np.where(checker, palette.LIMESTONE, 0.78 * palette.SAND)).moved(z=6.0 - length / 2, x=-0.3),
        scatter(column(segments).painted(palette.LIMESTONE), np.broadcast_to(np.eye(3), (len(feet), 3, 3)), feet),
        join(arcade).painted(palette.PLASTER),
        join(across).painted(palette.SAND),
        join(ribs).painted(palette.TERRACOTTA),
        end_wall(max(10, segments)).moved(x=-0.3, z=far_end - 0.2).painted(palette.PLASTER),
        box((WALL_X, -0.3, far_end), (WALL_X + 0.4, 5.2, 4.0)).painted(palette.PLASTER),
        *(
            box(
                (-2.2 - 0.35 * (3 - k), -0.1, far_end), (2.2 + 0.35 * (3 - k), 0.18 * k, far_end + 2.4 - 0.45 * k)
            ).painted(palette.SLATE * 0.6 + palette.LIMESTONE * 0.4)
            for k in (1, 2, 3, 4)
        ),
    ]
    return to_mesh(parts), view((1.2, 1.75, 4.4), (-0.75, 2.7, -8.0), 25.0, 3.3, 26.0), sun(74.0, 40.0)


FAMILY = SceneFamily(
    name="colonnade",
    description="a roofless nave of columns, arches and vault ribs: a deep view for warps and partitions",
    source="filtering, the cathedral of its demonstration program, in kind",
    build=build,
    default_triangles=DEFAULT,
    min_triangles=3600,
    max_triangles=200_000,
)
