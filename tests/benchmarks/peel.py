"""Prints times of one step of depth peeling, drawn and traced by the tree: `python -m tests.benchmarks.peel`."""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp

from shadowjax import Mesh
from shadowjax.rays.bvh.caster import BvhCaster
from shadowjax.rays.grid.caster import GridCaster
from shadowjax.rays.layers import second_layer
from tests.benchmarks.scenes import PROJECTIONS, sphere_over_plane, view
from tests.benchmarks.timing import interleave

SIZE, RESOLUTION, ROUNDS = "80 k", 1024, 7


def main() -> None:
    """Print one line for each projection."""
    geometry = sphere_over_plane(SIZE)
    mesh = Mesh.create(geometry.vertices, geometry.faces, dtype=jnp.float32)
    first = eqx.filter_jit(lambda mesh, grid: GridCaster().closest_on_grid(mesh, grid))
    second = eqx.filter_jit(second_layer)
    # Brute force would never end; the tree is built before.
    tree = BvhCaster.build(mesh)
    for projection in PROJECTIONS:
        grid = view(geometry, projection, RESOLUTION).grid
        hit = first(mesh, grid)
        calls: dict[str, Callable[[int], Any]] = {
            "first": lambda _, grid=grid: jax.block_until_ready(first(mesh, grid)),
            "drawn": lambda _, grid=grid, hit=hit: jax.block_until_ready(second(GridCaster(), mesh, grid, hit)),
            "traced": lambda _, grid=grid, hit=hit: jax.block_until_ready(second(tree, mesh, grid, hit)),
        }
        drawn, traced = calls["drawn"](0), calls["traced"](0)
        other = int(jnp.sum(jnp.abs(drawn.depth - traced.depth) > 1e-5 * grid.far))
        took = {name: row["median_ms"] for name, row in interleave(calls, ROUNDS).items()}
        line = f"{mesh.num_faces} triangles  {RESOLUTION}²  {projection:12s}"
        line += "".join(f"  {name} {took[name]:7.1f} ms" for name in calls)
        line += f"  ratio {took['traced'] / took['drawn']:5.1f}  hits {int(jnp.sum(drawn.is_hit))}"
        print(f"{line}  other depth {other}", flush=True)


if __name__ == "__main__":
    main()
