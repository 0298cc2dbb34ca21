"""Mountains above a wooded valley: the scene that grows beyond a million triangles."""

from typing import Any

import numpy as np

from shadowjax._checked import checked
from shadowjax.geometry.camera import Camera
from shadowjax.geometry.light import Light
from shadowjax.geometry.mesh import Mesh
from shadowjax.scenes import palette
from shadowjax.scenes.base import SceneFamily, framed, sun, to_mesh
from shadowjax.scenes.parts import Part, scatter
from shadowjax.scenes.primitives import cone
from shadowjax.scenes.surfaces import landscape

HALF_X, HALF_Z = 60.0, 46.0  # metres
DEFAULT = 5000
NUM_TREES, TREE_TRIANGLES = 90, 10
OCTAVES = 8
_LATTICES = [np.random.default_rng(1 + octave).uniform(size=(3 * 2**octave + 2,) * 2) for octave in range(OCTAVES)]


@checked
def noise(octave: int, x: np.ndarray, z: np.ndarray) -> np.ndarray:
    """Smooth value noise in [0, 1] whose cells halve with every octave; the same at every resolution of the mesh."""
    lattice = _LATTICES[octave]
    scale = 3 * 2**octave
    u = scale * np.clip((x + HALF_X) / (2 * HALF_X), 0.0, 1.0)
    v = scale * np.clip((z + HALF_Z) / (2 * HALF_Z), 0.0, 1.0)
    i, j = np.floor(u).astype(int), np.floor(v).astype(int)
    # Smoothstep of the fractions, whose slope vanishes at the lattice: no creases between cells.
    fu, fv = ((3.0 - 2.0 * f) * f * f for f in (u - i, v - j))
    near = (1 - fu) * lattice[j, i] + fu * lattice[j, i + 1]
    far = (1 - fu) * lattice[j + 1, i] + fu * lattice[j + 1, i + 1]
    return (1 - fv) * near + fv * far


@checked
def ground_height(x: Any, z: Any) -> Any:
    """Height of the land, metres: ridges at the back, a gentle valley in front."""
    # 1 − |2n − 1| has a crest wherever the noise crosses ½; its square narrows it.
    ridges = sum(0.5**k * (1.0 - np.abs(2.0 * noise(k, x, z) - 1.0)) ** 2 for k in range(OCTAVES))
    hills = sum(0.45**k * noise(k, z * HALF_X / HALF_Z, x * HALF_Z / HALF_X) for k in range(OCTAVES))
    upland = np.clip((10.0 - z) / 42.0, 0.0, 1.0) ** 1.3
    return 26.0 * upland * ridges * (0.55 + 0.45 * np.cos(x / 26.0 - 0.35)) + 4.0 * hills


@checked
def painted_by_height(part: Part) -> Part:
    """Grass where it is low, rock where it is steep, snow where it is high, earth on the sides of the slab."""
    corners = part.vertices[part.faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    upright = (normal[:, 1] / np.linalg.norm(normal, axis=1))[:, None]
    height = corners[:, :, 1].mean(axis=1)[:, None]
    grass = palette.varied(np.random.default_rng(3), np.broadcast_to(palette.SAGE, (part.num_faces, 3)), 0.06)
    rock = np.clip((height - 9.0) / 7.0 + (0.8 - upright) * 3.0, 0.0, 1.0)
    snow = np.clip((height - 24.0) / 4.0, 0.0, 1.0) * np.clip((upright - 0.45) / 0.25, 0.0, 1.0)
    color = (1 - rock) * grass + rock * (0.6 * palette.SLATE + 0.4 * palette.SAND)
    color = (1 - snow) * color + snow * palette.SNOW
    return part.painted(np.where(upright <= 1e-6, palette.BARK, color))


def woods() -> Part:
    """Ninety conifers on the valley floor."""
    rng = np.random.default_rng(21)
    x = rng.normal(0.0, 0.62, NUM_TREES).clip(-1.4, 1.4) * 0.62 * HALF_X
    z = rng.uniform(0.18, 0.9, NUM_TREES) * HALF_Z
    size = rng.uniform(0.75, 1.35, NUM_TREES)
    matrices = size[:, None, None] * np.eye(3)
    tint = palette.varied(rng, np.broadcast_to(palette.MOSS, (NUM_TREES, 3)), 0.2)
    tree = cone(1.5, -0.6, 6.0, TREE_TRIANGLES // 2)
    return scatter(tree, matrices, np.stack([x, ground_height(x, z), z], -1), tint)


@checked
def build(num_triangles: int) -> tuple[Mesh, Camera, tuple[Light, ...]]:
    """The height field takes all triangles that the trees leave."""
    per_area = max(num_triangles - NUM_TREES * TREE_TRIANGLES, 200) / 2 / (HALF_X * HALF_Z)
    cells = [max(4, round(half * np.sqrt(per_area) - 3.0)) for half in (HALF_X, HALF_Z)]
    ground = landscape(HALF_X, HALF_Z, cells[0], cells[1], ground_height, -5.0)
    mesh = to_mesh([painted_by_height(ground), woods()])
    return mesh, framed(mesh, 0.0, 27.0), sun(68.0, 35.0)


FAMILY = SceneFamily(
    name="terrain",
    description="mountains above a wooded valley: a height field for stress tests",
    source="shadowjax",
    build=build,
    default_triangles=DEFAULT,
    min_triangles=1600,
    max_triangles=4_000_000,
)
