"""Casting on four virtual devices and in two processes gives what one device gives; gradients; refusals."""

import os
import socket
import subprocess
import sys
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from shapes import random_soup

from shadowjax import BruteForce, Mesh
from shadowjax.rays.light_space import PerspectiveSpace
from shadowjax.rays.plane_map import Box
from shadowjax.rays.ray_grid import RayGrid
from shadowjax.rays.sharded import closest_on_grids, closest_over_triangles, stack_grids

ROOT = Path(__file__).parents[2]
SCRIPT = ROOT / "tests" / "support" / "cast_on_devices.py"


def start(processes: int, index: int, port: int, devices: int) -> subprocess.Popen:
    settings = {
        "JAX_PLATFORMS": "cpu",
        "PYTHONPATH": os.pathsep.join([str(ROOT), str(SCRIPT.parent)]),
        "XLA_FLAGS": f"--xla_force_host_platform_device_count={devices}",
    }
    command = [sys.executable, str(SCRIPT), str(processes), str(index), str(port)]
    return subprocess.Popen(
        command, env={**os.environ, **settings}, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )


def assert_agreed(running: list[subprocess.Popen], num_devices: int):
    try:
        for process in running:
            out, errors = process.communicate(timeout=300)
            assert process.returncode == 0, errors
            assert f"{num_devices} devices agree with one" in out
    finally:
        for process in running:
            process.kill()


def test_four_virtual_devices_agree_with_one():
    assert_agreed([start(1, 0, 0, 4)], 4)


def test_two_processes_agree_with_one_device():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    assert_agreed([start(2, index, port, 1) for index in range(2)], 2)


def view(shift: float, cols: int = 12) -> RayGrid:
    box = Box(jnp.asarray([-1.0, -1.0]), jnp.asarray([1.0, 1.0]))
    space = PerspectiveSpace(jnp.asarray([shift, 0.1, -3.0]), jnp.eye(3))
    return RayGrid(space, box, jnp.asarray(9.0), 8, cols)


def test_gradients_pass_through_both_ways_of_dealing():
    mesh, grid = random_soup(20, 1), view(0.1)

    def total(vertices, cast):
        hit = cast(Mesh(vertices, mesh.faces, mesh.face_colors))
        return jnp.sum(jnp.where(hit.is_hit, hit.depth, 0))

    expected = jax.grad(total)(mesh.vertices, lambda moved: BruteForce().closest_on_grid(moved, grid))
    assert float(jnp.max(jnp.abs(expected))) > 0
    for cast in (
        lambda moved: closest_on_grids(BruteForce(), moved, stack_grids([grid])),
        lambda moved: closest_over_triangles(BruteForce(), moved, grid),
    ):
        np.testing.assert_allclose(jax.grad(total)(mesh.vertices, cast), expected, rtol=1e-12)


def test_a_batch_holds_grids_of_one_kind():
    with pytest.raises(ValueError, match="one kind of space, map and resolution; got 2"):
        stack_grids([view(0), view(0, cols=13)])
    with pytest.raises(ValueError, match="at least one grid"):
        stack_grids([])
    with pytest.raises(ValueError, match="at least one device"):
        closest_on_grids(BruteForce(), random_soup(20, 1), stack_grids([view(0)]), devices=[])
