"""Ten million triangles, or a map of 16 384², timed: `python tests/benchmarks/scale.py scene|map`."""

import resource
import sys
import time

import jax
import jax.numpy as jnp
import numpy as np

from shadowjax import Camera, Mesh, Rays, camera_grid, make_scene
from shadowjax.rays.bands import depth_bands
from shadowjax.rays.bvh.caster import BvhCaster
from shadowjax.rays.grid.caster import GridCaster


class Stopwatch:
    """Says how long each step took and how much memory was in use at most so far."""

    def __init__(self) -> None:
        self.start = time.perf_counter()

    def __call__(self, step: str) -> None:
        """Print one line and start anew."""
        now = time.perf_counter()
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
        print(f"{step}: {now - self.start:.2f} s, peak {peak:.2f} GiB", flush=True)
        self.start = time.perf_counter()


def waves(num_triangles: int) -> Mesh:
    """A square of hills, two triangles a cell."""
    side = int((num_triangles / 2) ** 0.5)
    line = np.linspace(-10, 10, side + 1, dtype=np.float32)
    x, z = np.meshgrid(line, line)
    y = np.sin(2 * x) * np.cos(3 * z) + np.float32(0.3) * np.sin(17 * x + 5 * z)
    corner = np.arange(side * (side + 1), dtype=np.int32).reshape(side, side + 1)[:, :-1].reshape(-1)
    across, down = corner + 1, corner + side + 1
    faces = np.concatenate([np.stack([corner, down, across], 1), np.stack([across, down, down + 1], 1)])
    return Mesh.create(np.stack([x, y, z], axis=-1).reshape(-1, 3), faces, dtype=jnp.float32)


def scene() -> None:
    """Depth by the grid caster and a quarter of a million rays by the tree, over ten million triangles."""
    say = Stopwatch()
    mesh = waves(10_000_000)
    say(f"{mesh.num_faces} triangles made")
    camera = Camera.look_at((0.0, 8.0, 14.0), (0.0, 0.0, 0.0), phi_y=0.4, near=1.0, far=40.0, dtype=jnp.float32)
    grid, depth = camera_grid(camera, 1024, 1024), jax.jit(GridCaster().depth_on_grid)
    for when in ("first", "again"):
        depth(mesh, grid).block_until_ready()
        say(f"depth of 1024² by the grid caster, {when}")
    caster = BvhCaster.build(mesh)
    jax.block_until_ready(caster)
    say("tree built")
    rng, count = np.random.default_rng(0), 1 << 18
    origins = jnp.asarray(rng.uniform([-9, 1.5, -9], [9, 3, 9], (count, 3)), jnp.float32)
    rays = Rays.create(origins, rng.normal(size=(count, 3)))
    closest = jax.jit(lambda caster, mesh, rays: caster.closest(mesh, rays).face)
    for when in ("first", "again"):
        closest(caster, mesh, rays).block_until_ready()
        say(f"{count} rays of any direction by the tree, {when}")


def large_map() -> None:
    """A depth map of 16 384² by bands."""
    say = Stopwatch()
    made = make_scene("terrain", 80_000, jnp.float32)
    say(f"{made.mesh.num_faces} triangles made")
    hits = 0
    grid = camera_grid(made.camera, 16384, 16384)
    for start, band in depth_bands(GridCaster(), made.mesh, grid):
        hits += int(np.count_nonzero(band < np.float32(grid.far)))
        if start == 0:
            say("first band")
    say(f"all bands, {hits / 16384**2:.2f} of the rays hit")


if __name__ == "__main__":
    {"scene": scene, "map": large_map}[sys.argv[1]]()
