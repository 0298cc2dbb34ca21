"""Sweeps: the same numbers as one at a time, finite at every limit, and spread over several devices."""

import os
import subprocess
import sys
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from shadowjax.optimize.analytic.sweep import sweep
from shadowjax.theory.aliasing.error import max_error_z, storage_factor
from shadowjax.theory.aliasing.light_frustum import LightFrustum
from shadowjax.theory.aliasing.near_distances import generalised
from shadowjax.theory.aliasing.optimal import minimax

GAMMAS = np.deg2rad([0, 1e-6, 20, 29.317033, 30, 45, 90])
ROOT = Path(__file__).resolve().parents[2]
ON_FOUR = """
import jax, numpy as np
jax.config.update("jax_enable_x64", True)
from shadowjax.optimize import sweep
found = sweep([0.2, 0.9, 1.3], [10.0, 1e3], [0.5], [1, 4])
assert len(jax.devices()) == 4
from shadowjax.optimize.analytic import sweep as module
inner = module._all(module.laid_out(np.tile([0.5, 9.0, 0.5, 1.0], (12, 1))), "axis")
assert len(inner.value.sharding.device_set) == 4, inner.value.sharding
assert {s.data.shape for s in inner.value.addressable_shards} == {(3,)}
print(" ".join(x.hex() for x in found.certificate.storage_minimax.reshape(-1).tolist()))
"""


def test_every_combination_is_what_it_is_alone_and_limits_are_finite():
    ratios, phis, ks = [1.01, 100.0, 1e6], [0.1, np.pi / 6], [1, 4]
    found = sweep(GAMMAS, ratios, phis, ks)
    assert all(x.shape == (7, 3, 2, 2) and np.isfinite(x).all() for x in jax.tree.leaves(found))
    gamma, ratio, phi, k = jnp.meshgrid(*(jnp.asarray(x, float) for x in (GAMMAS, ratios, phis, ks)), indexing="ij")
    part = LightFrustum(jnp.ones_like(ratio), ratio ** (1 / k), phi, phi, gamma)
    best = minimax(part)
    np.testing.assert_allclose(found.value, best, rtol=1e-12)
    np.testing.assert_allclose(
        found.certificate.storage_published, k * storage_factor(part, generalised(part)), rtol=1e-12
    )
    np.testing.assert_allclose(found.objective_value, max_error_z(part, best), rtol=1e-12)
    np.testing.assert_allclose(found.gain[3, 1, 1, 0], 1.199833484, rtol=1e-8)  # the published n' at its worst
    for least in (
        found.certificate.storage_minimax,
        found.certificate.storage_published,
        found.certificate.storage_uniform,
    ):
        assert (found.certificate.storage_least <= least * (1 + 1e-12)).all()
    for bad, message in (
        (([2.0], [10.0], [0.5], [1]), "gamma"), (([0.5], [1.0], [0.5], [1]), "far"),
        (([0.5], [2.0], [1.6], [1]), "phi"),
        (([0.5], [2.0], [0.5], [0.5]), "at least 1"), (([], [2.0], [0.5], [1]), "at least one"),
        (([0.5], [2.0], [0.5], [1], "edge"), "section"),
    ):  # fmt: skip
        with pytest.raises(ValueError, match=message):
            sweep(*bad)


def test_four_devices_share_the_work_and_agree_with_one():
    environment = {
        **os.environ, "XLA_FLAGS": "--xla_force_host_platform_device_count=4", "PYTHONPATH": str(ROOT),
        "JAX_PLATFORMS": "cpu",
    }  # fmt: skip
    ran = subprocess.run([sys.executable, "-c", ON_FOUR], capture_output=True, text=True, env=environment, check=False)
    assert ran.returncode == 0, ran.stderr
    alone = sweep([0.2, 0.9, 1.3], [10.0, 1e3], [0.5], [1, 4]).certificate.storage_minimax.reshape(-1)
    np.testing.assert_allclose([float.fromhex(x) for x in ran.stdout.split()], alone, rtol=1e-13)
