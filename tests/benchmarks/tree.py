"""Prints processor time of the tree caster next to brute force: `python tests/benchmarks/tree.py`."""

import time
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import trimesh

from shadowjax import BruteForceCaster, Mesh, Rays
from shadowjax.rays.bvh.caster import BvhCaster

NUM_RAYS = 1 << 16
# Brute force is given fewer rays, so that a run ends.
MAX_PAIRS = 4e7


def displaced_sphere(subdivisions: int) -> Mesh:
    """A wavy sphere over two large triangles."""
    sphere = trimesh.creation.icosphere(subdivisions)
    x, y, _ = sphere.vertices.T
    waves = 1 + 0.05 * np.sin(9 * x) * np.cos(7 * y)
    floor = np.array([[-4, -1.2, -4], [4, -1.2, -4], [4, -1.2, 4], [-4, -1.2, 4]])
    count = len(sphere.vertices)
    faces = np.concatenate([sphere.faces, count + np.array([[0, 2, 1], [0, 3, 2]])])
    return Mesh.create(np.concatenate([sphere.vertices * waves[:, None], floor]), faces, dtype=jnp.float32)


def bundles() -> dict[str, Rays]:
    """Rays of any direction, and those of a camera row by row."""
    rng = np.random.default_rng(0)
    side = int(NUM_RAYS**0.5)
    line = (np.arange(side) + 0.5) / side * 2 - 1
    x, y = (a.reshape(-1) for a in np.meshgrid(line, line))
    origins = jnp.asarray(rng.uniform(-2, 2, (NUM_RAYS, 3)), jnp.float32)
    towards = np.stack([0.5 * x, 0.5 * y - 0.3, -np.ones_like(x)], axis=1)
    return {
        "any": Rays.create(origins, rng.normal(size=(NUM_RAYS, 3))),
        "camera": Rays.create(jnp.asarray([0, 1.2, 4], jnp.float32), towards),
    }


def best(function: Callable[[], Any], repeats: int = 3) -> float:
    """Least seconds of all cores together, of a few runs after a first one: other programs hardly stretch these."""
    jax.block_until_ready(function())
    times = []
    for _ in range(repeats):
        start = time.process_time()
        jax.block_until_ready(function())
        times.append(time.process_time() - start)
    return min(times)


def main() -> None:
    """Print one line for each size."""
    closest = jax.jit(lambda caster, mesh, rays: caster.closest(mesh, rays).face)
    refit = jax.jit(lambda caster, mesh: caster.refit(mesh))
    for subdivisions in range(1, 9):
        mesh = displaced_sphere(subdivisions)
        build = best(lambda mesh=mesh: BvhCaster.build(mesh), 1)
        caster = BvhCaster.build(mesh)
        line = f"{mesh.num_faces:8d} triangles  build {build:6.3f} s"
        line += f"  refit {1e3 * best(lambda: refit(caster, mesh)):6.2f} ms"  # noqa: B023
        for name, rays in bundles().items():
            spent = best(lambda rays=rays: closest(caster, mesh, rays))  # noqa: B023
            line += f"  {name} {1e6 * spent / NUM_RAYS:5.2f} µs"
        few = int(min(NUM_RAYS, MAX_PAIRS / mesh.num_faces))
        if few >= 1024:
            some = jax.tree.map(lambda x: x[:few], bundles()["any"].flattened())  # noqa: B023
            line += f"  brute {1e6 * best(lambda: closest(BruteForceCaster(), mesh, some), 1) / few:6.2f} µs"  # noqa: B023
        print(line, flush=True)


if __name__ == "__main__":
    main()
