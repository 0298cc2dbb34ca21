"""A formation of cubes over a floor: the last scene of the stencil source."""

import itertools

import numpy as np

from shadowjax._checked import checked
from shadowjax.geometry.camera import Camera
from shadowjax.geometry.light import Light
from shadowjax.geometry.mesh import Mesh
from shadowjax.scenes import palette
from shadowjax.scenes.base import SceneFamily, framed, sun, to_mesh
from shadowjax.scenes.parts import scatter
from shadowjax.scenes.primitives import box, floor

SIDE = 2.4  # of the whole formation, metres
FILL = 0.47  # edge of a cube over the pitch of the lattice


@checked
def build(num_triangles: int) -> tuple[Mesh, Camera, tuple[Light, ...]]:
    """n³ cubes in a lattice that floats over a floor."""
    per_side = max(1, round(((num_triangles - 12) / 12) ** (1 / 3)))
    pitch = SIDE / per_side
    half = 0.5 * FILL * pitch
    cell = np.array(list(itertools.product(range(per_side), repeat=3)))
    centres = (cell + 0.5) * pitch - np.array([SIDE / 2, -0.25, SIDE / 2])
    height = (cell[:, 1:2] + 0.5) / per_side
    tint = (1.0 - height) * palette.NAVY + height * palette.OCHRE
    tint = palette.varied(np.random.default_rng(12), tint, 0.12)
    cube = box((-half, -half, -half), (half, half, half))
    parts = [
        scatter(cube, np.broadcast_to(np.eye(3), (len(cell), 3, 3)), centres, tint).turned((0, 1, 0), np.radians(33.0)),
        floor(3.3, 2.3).moved(x=-1.55, z=-0.45).painted(palette.PLASTER),
    ]
    mesh = to_mesh(parts)
    return mesh, framed(mesh, 0.0, 34.0), sun(74.0, 37.0)


FAMILY = SceneFamily(
    name="cubes",
    description="a floating lattice of 5 × 5 × 5 cubes: many small shadows that overlap",
    source="stencil, figure 12 and table 1",
    build=build,
    default_triangles=1512,
    min_triangles=108,
    max_triangles=3_000_000,
)
