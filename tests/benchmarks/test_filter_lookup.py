"""Time of one lookup of every smooth or wide filter next to a 3 × 3 PCF: 1024² receivers of a 1024² map, float32."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from shadowjax import TECHNIQUES, make_technique
from shadowjax.filters.base import Lookup

NAMES = (
    "pcf-3x3", "vsm", "esm", "esm-threshold", "esm-z-max", "evsm2", "evsm4", "msm-hamburger", "msm-hausdorff", "csm",
    "xcsm", "pcss", "brabec-seidel", "brabec-seidel-propagated", "hyper-z",
)  # fmt: skip
read = eqx.filter_jit(lambda filter_, planes, lookup: filter_.visibility(planes, lookup))


def setting(filter_, size):
    """A map of smooth hills, and receivers in the order of an image, most of them within a few texels of in-between."""
    rows, cols = np.mgrid[0:size, 0:size].astype(np.float32) * (1024 / size)
    depth = 5 + np.sin(rows / 40) * np.cos(cols / 60) + (np.hypot(rows - 500, cols - 400) < 200) * -1.5
    cells = np.ones((filter_.cast_factor,) * 2, np.float32)
    planes = jax.block_until_ready(filter_.prepare(jnp.asarray(np.kron(depth, cells), jnp.float32)))
    jitter = np.random.default_rng(0).uniform(size=(size, size, 2)).astype(np.float32)
    index = np.stack(np.mgrid[0:size, 0:size][::-1], -1).astype(np.float32)
    receiver = jnp.asarray(depth + 0.5, jnp.float32)
    zero, one = jnp.zeros((), jnp.float32), jnp.ones((), jnp.float32)
    gradient = jnp.zeros((size, size, 2), jnp.float32) if filter_.follows_plane else None
    return planes, Lookup(jnp.asarray(index + jitter), receiver, 0.01 * one, 0.01 * one + zero, gradient=gradient)


@pytest.mark.parametrize("name", NAMES)
def test_lookup(name, benchmark):
    assert name in TECHNIQUES
    filter_ = make_technique(name).filter
    planes, lookup = setting(filter_, 1024 if benchmark.enabled else 16)
    value = benchmark(lambda: jax.block_until_ready(read(filter_, planes, lookup)))
    assert 0 <= float(jnp.min(value)) <= float(jnp.max(value)) <= 1
