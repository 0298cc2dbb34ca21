"""Casts on several devices, in a process of its own, and writes what came out: `PROCESSES INDEX PORT FILE`."""

import sys

import jax
import jax.numpy as jnp
import numpy as np
from jax.experimental.multihost_utils import process_allgather
from shapes import random_soup

from shadowjax import BruteForceCaster, Mesh
from shadowjax.geometry.light_space import PerspectiveSpace
from shadowjax.rays.bvh.caster import BvhCaster
from shadowjax.rays.grid.caster import GridCaster
from shadowjax.rays.plane_map import Box
from shadowjax.rays.ray_grid import RayGrid
from shadowjax.rays.sharded import (
    cast_over_bands,
    closest_on_grids,
    closest_over_triangles,
    depth_over_triangles,
    stack_grids,
    visible_over_points,
)


def view(shift: float, cols: int = 12) -> RayGrid:
    """A small view of the soup, from a little next to the last one."""
    box = Box(jnp.full(2, -0.4, jnp.float32), jnp.full(2, 0.4, jnp.float32))
    space = PerspectiveSpace(jnp.asarray([shift, 0.1, -3.0], jnp.float32), jnp.eye(3, dtype=jnp.float32))
    return RayGrid(space, box, jnp.asarray(9.0, jnp.float32), 8, cols)


def views() -> list[RayGrid]:
    """More than devices, and as many as no number of devices divides."""
    return [view(0.2 * k) for k in range(5)]


def soup() -> Mesh:
    """What is cast."""
    return random_soup(50, 1, jnp.float32)


def receivers(mesh: Mesh) -> tuple[jax.Array, jax.Array]:
    """Middles of triangles and their normals, as an image whose rows no even number of devices divides."""
    middles = jnp.mean(mesh.triangles(), axis=1)
    return middles[:49].reshape(7, 7, 3), mesh.face_normals()[:49].reshape(7, 7, 3)


def twice(mesh: Mesh) -> Mesh:
    """Every triangle two times, so that devices find equal depths: then the lowest index must win."""
    faces, colors = (jnp.concatenate([part] * 2) for part in (mesh.faces, mesh.face_colors))
    return Mesh(mesh.vertices, faces, colors)


def here(array: jax.Array) -> np.ndarray:
    """What this process has of an array that every device holds whole."""
    assert array.is_fully_replicated
    return np.asarray(array.addressable_data(0))


def main(processes: int, index: int, port: int, path: str) -> None:
    """In one process try every caster; in several, what they exchange: one program fewer to compile for each."""
    if processes > 1:
        jax.distributed.initialize(f"127.0.0.1:{port}", processes, index, initialization_timeout=120)
    mesh, grids = soup(), views()
    found = {"devices": np.asarray(len(jax.devices()))}
    if processes == 1:
        found["views"] = here(closest_on_grids(BvhCaster.build(mesh), mesh, stack_grids(grids)).face)
        found["depth"] = here(depth_over_triangles(GridCaster(), mesh, grids[1]))
        found["bands"] = np.asarray(cast_over_bands(GridCaster().depth_on_grid, mesh, grids[1]))
        # Three bands of three rows for eight.
        hit = cast_over_bands(BruteForceCaster().closest_on_grid, mesh, grids[1], jax.devices()[:3])
        found["uneven"] = here(hit.face)
        found["lit"] = here(visible_over_points(BruteForceCaster(), mesh, grids[1].space, *receivers(mesh)))
    else:
        # As many views as devices: each process holds its own, and nothing is exchanged before they are collected.
        dealt = closest_on_grids(BruteForceCaster(), mesh, stack_grids(grids[:processes])).face
        assert dealt.addressable_shards[0].data.shape[0] == 1
        found["views"] = np.asarray(process_allgather(dealt, tiled=True))
    hit = closest_over_triangles(BruteForceCaster(), twice(mesh), grids[1])
    found |= {"face": here(hit.face), "nearest": here(hit.depth)}
    np.savez(path, **found)


if __name__ == "__main__":
    main(*(int(argument) for argument in sys.argv[1:4]), sys.argv[4])
