"""One gradient step through a shadow picture: all vertices of 20 k triangles at 256², next to the picture alone.

`python -m tests.benchmarks.cases.shadow_gradient`. It stands apart from the session of all cases: it compiles for
longer than all of them, and no other program in the session does the same.
"""

import time

import jax
import jax.numpy as jnp
import numpy as np

from shadowjax import DirectionalLight, Mesh, MeshEdges, RayGrid, camera_grid, make_scene, mesh_edges, shadow_picture
from shadowjax._types import Array
from shadowjax.rays.grid.caster import GridCaster

TRIANGLES, RESOLUTION, ROUNDS = 20_000, 256, 9


def loss(vertices: Array, mesh: Mesh, edges: MeshEdges, light: DirectionalLight, view: RayGrid) -> Array:
    """Mean squared difference from grey."""
    moved = Mesh(vertices, mesh.faces, mesh.face_colors)
    return jnp.mean((shadow_picture(moved, edges, light, view, GridCaster()) - 0.5) ** 2)


def main() -> None:
    """Print milliseconds and megabytes of both programs, and their ratio."""
    scene = make_scene("geodesic-sphere", num_triangles=TRIANGLES)
    mesh, view = scene.mesh, camera_grid(scene.camera, RESOLUTION, RESOLUTION)
    arguments = (mesh.vertices, mesh, mesh_edges(mesh), scene.lights[0], view)
    least = []
    for name, function in (("picture", loss), ("picture and gradient", jax.value_and_grad(loss))):
        program = jax.jit(function).lower(*arguments).compile()
        plan = program.memory_analysis()
        times = []
        for _ in range(ROUNDS):
            start = time.perf_counter()
            jax.block_until_ready(program(*arguments))
            times.append(1e3 * (time.perf_counter() - start))
        least.append(min(times))
        megabytes = 0.0 if plan is None else plan.temp_size_in_bytes / 1e6
        print(f"{name}: least {min(times):.0f} ms, median {np.median(times):.0f} ms, temporaries {megabytes:.0f} MB")
    print(f"{mesh.num_faces} triangles, {RESOLUTION}²: gradient step ÷ picture = {least[1] / least[0]:.2f}")


if __name__ == "__main__":
    main()
