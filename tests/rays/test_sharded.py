"""Casting on four virtual devices and in two processes gives what one device gives; gradients; refusals."""

import os
import socket
import subprocess
import sys
import time
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from cast_on_devices import receivers, soup, view, views

from shadowjax import BruteForceCaster, Mesh
from shadowjax.rays.sharded import (
    cast_over_bands,
    closest_on_grids,
    closest_over_triangles,
    depth_over_triangles,
    stack_grids,
    visible_over_points,
)

ROOT = Path(__file__).parents[2]
SCRIPT = ROOT / "tests" / "support" / "cast_on_devices.py"
# Seconds for all processes of a test together; they need about ten on an idle machine.
LIMIT = 240


def cast_elsewhere(folder: Path, processes: int, devices: int) -> list[dict[str, np.ndarray]]:
    """What each of several processes found, each with some virtual devices; fails with their words, never hangs."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    environment = {
        **os.environ,
        "JAX_PLATFORMS": "cpu",
        "PYTHONPATH": os.pathsep.join([str(ROOT), str(SCRIPT.parent)]),
        # Code that runs once need not be fast. Devices wait for each other longer than a busy machine delays them.
        "XLA_FLAGS": f"--xla_force_host_platform_device_count={devices} --xla_backend_optimization_level=0 "
        f"--xla_cpu_collective_call_terminate_timeout_seconds={LIMIT}",
    }
    running, said = [], [folder / f"said_{index}.txt" for index in range(processes)]
    try:
        for index in range(processes):
            arguments = [str(SCRIPT), str(processes), str(index), str(port), str(folder / f"{index}.npz")]
            with said[index].open("w") as words:
                running.append(
                    subprocess.Popen([sys.executable, *arguments], env=environment, stdout=words, stderr=words)
                )
        end = time.monotonic() + LIMIT
        # A process that fails leaves the others waiting for it: watch all of them.
        while any(process.poll() is None for process in running) and not any(process.poll() for process in running):
            if time.monotonic() > end:
                break
            time.sleep(0.05)
        codes = [process.poll() for process in running]
    finally:
        for process in running:
            process.kill()
            process.wait()
    words = "\n".join(f"process {index}:\n{path.read_text()}" for index, path in enumerate(said))
    assert codes == [0] * processes, f"exit codes {codes} (None: still running after {LIMIT} s)\n{words}"
    return [dict(np.load(folder / f"{index}.npz")) for index in range(processes)]


@pytest.fixture(scope="module")
def one_device():
    """First hits of all views, cast here one by one."""
    cast = jax.jit(lambda grid: BruteForceCaster().closest_on_grid(soup(), grid))
    hits = [cast(grid) for grid in views()]
    assert all(0.3 < np.mean(hit.is_hit) < 0.7 for hit in hits)
    return hits


def assert_same(found: dict[str, np.ndarray], expected: list, num_devices: int):
    assert found["devices"] == num_devices
    np.testing.assert_array_equal(found["views"], [hit.face for hit in expected[: len(found["views"])]])
    np.testing.assert_array_equal(found["face"], expected[1].face)
    np.testing.assert_allclose(found["nearest"], expected[1].depth, rtol=1e-6)


def test_four_virtual_devices_agree_with_one(tmp_path, one_device):
    (found,) = cast_elsewhere(tmp_path, processes=1, devices=4)
    assert len(found["views"]) == 5
    assert_same(found, one_device, 4)
    np.testing.assert_allclose(found["depth"], one_device[1].depth, rtol=2e-6)
    np.testing.assert_allclose(found["bands"], one_device[1].depth, rtol=2e-6)
    np.testing.assert_array_equal(found["uneven"], one_device[1].face)
    lit = jax.jit(BruteForceCaster().visible)(soup(), view(0.2).space, *receivers(soup()))
    assert 5 < np.sum(lit) < 44
    np.testing.assert_array_equal(found["lit"], lit)


def test_two_processes_agree_with_one_device(tmp_path, one_device):
    for found in cast_elsewhere(tmp_path, processes=2, devices=1):
        assert_same(found, one_device, 2)


def test_gradients_pass_through_dealt_triangles_and_bands():
    mesh, grid = soup(), view(0.1)

    def total(vertices, cast):
        depth = cast(Mesh(vertices, mesh.faces, mesh.face_colors))
        return jnp.sum(jnp.where(depth < grid.far, depth, 0))

    ways = (
        lambda moved: BruteForceCaster().depth_on_grid(moved, grid),
        lambda moved: closest_over_triangles(BruteForceCaster(), moved, grid).depth,
        lambda moved: depth_over_triangles(BruteForceCaster(), moved, grid),
        lambda moved: cast_over_bands(BruteForceCaster().depth_on_grid, moved, grid),
    )
    # One program: compiling takes longest.
    expected, *found = jax.jit(lambda vertices: [jax.grad(total)(vertices, cast) for cast in ways])(mesh.vertices)
    assert float(jnp.max(jnp.abs(expected))) > 0
    for gradient in found:
        np.testing.assert_allclose(gradient, expected, rtol=1e-5, atol=1e-5)


def test_a_batch_holds_grids_of_one_kind():
    with pytest.raises(ValueError, match="one kind of space, map and resolution; got 2"):
        stack_grids([view(0), view(0, cols=13)])
    with pytest.raises(ValueError, match="at least one grid"):
        stack_grids([])
    with pytest.raises(ValueError, match="at least one device"):
        closest_on_grids(BruteForceCaster(), soup(), stack_grids([view(0)]), devices=[])


def test_what_cannot_be_dealt_is_refused():
    mesh, grid = soup(), view(0)
    with pytest.raises(ValueError, match="8 rows cannot be cut into bands for 9 devices"):
        cast_over_bands(BruteForceCaster().depth_on_grid, mesh, grid, jax.devices() * 9)
    with pytest.raises(ValueError, match="a list or an image of them; got a single point"):
        visible_over_points(BruteForceCaster(), mesh, grid.space, jnp.zeros(3))
