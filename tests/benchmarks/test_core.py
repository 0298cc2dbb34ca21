"""Speed and memory of the core, as `make bench` reports them. Skipped as timings in the suite, still run once there."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from shadowjax import BruteForceCaster, Mesh, MultiDepth, Neighbourhood, Rays
from shadowjax.filters.base import Lookup

NUM_FACES, NUM_RAYS = 1024, 1 << 18


@pytest.fixture(scope="module")
def soup():
    rng = np.random.default_rng(0)
    corners = rng.normal(size=(3 * NUM_FACES, 3))
    mesh = Mesh.create(corners, np.arange(3 * NUM_FACES).reshape(-1, 3), dtype=jnp.float32)
    origins = jnp.asarray(3 * rng.normal(size=(NUM_RAYS, 3)), jnp.float32)
    return mesh, Rays.create(origins, rng.normal(size=(NUM_RAYS, 3)))


def test_brute_force_tests_per_second(soup, benchmark):
    mesh, rays = soup
    cast = eqx.filter_jit(lambda mesh, rays: BruteForceCaster().closest(mesh, rays).depth)
    depth = benchmark(lambda: jax.block_until_ready(cast(mesh, rays)))
    assert np.isfinite(depth).all()
    if benchmark.stats:
        benchmark.extra_info["tests_per_second"] = NUM_FACES * NUM_RAYS / benchmark.stats["median"]


@pytest.mark.parametrize("num_faces", [1 << 10, 1 << 16])
def test_brute_force_extra_memory_stays_under_300_mb(num_faces):
    """As XLA plans it: temporaries next to arguments and result, for a million rays and any number of triangles."""
    corners, faces = jnp.zeros((3 * num_faces, 3), jnp.float32), jnp.zeros((num_faces, 3), jnp.int32)
    mesh = Mesh(corners, faces, jnp.zeros((num_faces, 3), jnp.float32))
    directions, ones = jnp.ones((1 << 20, 3), jnp.float32), jnp.ones(1 << 20, jnp.float32)
    rays = Rays(directions, directions, ones, ones)
    plan = (
        jax.jit(lambda mesh, rays: BruteForceCaster().closest(mesh, rays)).lower(mesh, rays).compile().memory_analysis()
    )
    assert plan.temp_size_in_bytes < 300e6


def test_multi_depth_build_and_pcf(benchmark):
    """n-SM build and PCF(9, 2) of a 1024² map for a 1024² image."""
    rng = np.random.default_rng(1)
    filter_ = MultiDepth(Neighbourhood("max"), 3)
    depth = jnp.asarray(rng.uniform(size=(1024, 1024)), jnp.float32)
    rows, cols = np.mgrid[0:1024, 0:1024]
    position = jnp.asarray(np.stack([cols, rows], -1) + rng.uniform(size=(1024, 1024, 2)), jnp.float32)
    receiver = jnp.asarray(rng.uniform(size=(1024, 1024)), jnp.float32)

    @jax.jit
    def shadow(depth, position, receiver):
        planes = filter_.prepare(depth)
        zero = jnp.zeros((), depth.dtype)
        return filter_.visibility(planes, Lookup(position, receiver, zero, zero + 1))

    value = benchmark(lambda: jax.block_until_ready(shadow(depth, position, receiver)))
    assert 0 <= float(jnp.min(value)) < float(jnp.max(value)) <= 1
