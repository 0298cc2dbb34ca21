"""Prints what stands behind the choice between a tree and brute force: `python -m tests.benchmarks.thresholds`.

Milliseconds of processor time of one call; the two take turns, and the least of each counts, which other programs
hardly stretch.
"""

import time
from collections.abc import Callable, Mapping
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from shadowjax import BruteForceCaster, Mesh, Rays
from shadowjax.rays.bvh.caster import BvhCaster
from shadowjax.rays.grid.caster import tree_is_faster
from tests.benchmarks.scenes import sphere_over_plane

ROUNDS = 5
NUM_RAYS, NUM_FACES = (256, 1024, 4096, 16384, 65536), (20, 40, 80, 160, 320, 1282, 5122)
# Brute force is not asked for more pairs of ray and triangle, so that a run ends.
MAX_PAIRS = 5e7


def least(calls: Mapping[Any, Callable[[], Any]]) -> dict[Any, float]:
    """Least milliseconds of all cores together of each call, after a first one."""
    for call in calls.values():
        jax.block_until_ready(call())
    taken = dict.fromkeys(calls, float("inf"))
    for _ in range(ROUNDS):
        for name, call in calls.items():
            start = time.process_time()
            jax.block_until_ready(call())
            taken[name] = min(taken[name], 1e3 * (time.process_time() - start))
    return taken


def some_faces(num_faces: int) -> Mesh:
    """A displaced sphere over two triangles, or every so many of its triangles."""
    geometry = sphere_over_plane("1 k" if num_faces <= 1282 else "20 k")
    faces = geometry.faces[np.linspace(0, geometry.num_faces - 1, num_faces).astype(int)]
    return Mesh.create(geometry.vertices, faces, dtype=jnp.float32)


def main() -> None:
    """Print one line for each number of rays and of triangles."""
    rng = np.random.default_rng(0)
    closest = jax.jit(lambda caster, mesh, rays: caster.closest(mesh, rays).face)
    for num_rays in NUM_RAYS:
        origins = jnp.asarray(rng.uniform(-2, 2, (num_rays, 3)), jnp.float32)
        rays = Rays.create(origins, rng.normal(size=(num_rays, 3)))
        for num_faces in NUM_FACES:
            if num_rays * num_faces > MAX_PAIRS:
                continue
            mesh = some_faces(num_faces)
            # Traced, the mesh gets a new tree in every call.
            took = least({
                "brute": lambda mesh=mesh, rays=rays: closest(BruteForceCaster(), mesh, rays),
                "tree": lambda mesh=mesh, rays=rays: closest(BvhCaster(), mesh, rays),
            })  # fmt: skip
            chosen = "tree" if tree_is_faster(num_faces, num_rays) else "brute"
            line = f"{num_rays:6d} rays {num_faces:5d} triangles" + "".join(f"  {k} {took[k]:7.2f} ms" for k in took)
            print(f"{line}  chosen {chosen}, {took[chosen] / min(took.values()):.2f} of the least", flush=True)


if __name__ == "__main__":
    main()
