"""Run in processes of its own: casts on several devices and compares with one; `PROCESSES INDEX PORT`."""

# ruff: noqa: E402 — processes must meet before anything makes an array.
import sys

import jax

processes, index, port = (int(argument) for argument in sys.argv[1:])
if processes > 1:
    jax.distributed.initialize(f"127.0.0.1:{port}", processes, index)

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax.experimental.multihost_utils import process_allgather
from shapes import random_soup

from shadowjax import BruteForce
from shadowjax.rays.bvh import BoundingVolumeHierarchy
from shadowjax.rays.grid import Grid
from shadowjax.rays.light_space import PerspectiveSpace
from shadowjax.rays.plane_map import Box
from shadowjax.rays.ray_grid import RayGrid
from shadowjax.rays.sharded import closest_on_grids, closest_over_triangles, stack_grids

mesh = random_soup(50, 1, jnp.float32)
box = Box(jnp.asarray([-1.0, -1.0]), jnp.asarray([1.0, 1.0]))
grids = [
    RayGrid(PerspectiveSpace(jnp.asarray([0.2 * k, 0.1, -3.0]), jnp.eye(3)), box, jnp.asarray(9.0), 8, 12)
    for k in range(5)
]
batch = stack_grids(grids)
cast_one = eqx.filter_jit(lambda caster, grid: caster.closest_on_grid(mesh, grid))


def collected(tree):
    return process_allgather(tree, tiled=True) if processes > 1 else tree


def same(found, expected):
    assert np.mean(expected.face >= 0) > 0.1
    np.testing.assert_array_equal(found.face, expected.face)
    np.testing.assert_allclose(found.depth, expected.depth, rtol=1e-6)


for caster in (Grid(), BoundingVolumeHierarchy.build(mesh)):
    expected = jax.tree.map(lambda *leaves: np.stack(leaves), *[cast_one(caster, grid) for grid in grids])
    same(collected(closest_on_grids(caster, mesh, batch)), expected)
# The shares of a mesh that is doubled hold every triangle twice: ties go to the lowest index across devices.
twice = type(mesh)(mesh.vertices, jnp.concatenate([mesh.faces] * 2), jnp.concatenate([mesh.face_colors] * 2))
found = closest_over_triangles(BruteForce(), twice, grids[1])
same(jax.tree.map(lambda x: x.addressable_data(0), found), cast_one(BruteForce(), grids[1]))
print(f"{len(jax.devices())} devices agree with one", flush=True)
