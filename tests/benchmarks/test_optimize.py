"""Speed of the search for n': one problem, and many at once. Skipped as timings in the suite, still run once there."""

import equinox as eqx
import jax
import numpy as np
from views import random_frusta

from shadowjax.optimize.analytic.near_distance import search
from shadowjax.theory.aliasing.optimal import minimax

COUNT = 10_000


def test_one_near_distance(benchmark):
    """By bisection alone, compiled; the closed form is what it is held to."""
    frustum = jax.tree.map(lambda x: x[7], random_frusta(20, seed=5))
    one = eqx.filter_jit(search)
    found = benchmark(lambda: jax.block_until_ready(one(frustum)))
    np.testing.assert_allclose(found, minimax(frustum), rtol=1e-8)
    if benchmark.stats:
        assert benchmark.stats["median"] < 0.010


def test_near_distances_per_second(benchmark):
    frusta = random_frusta(COUNT, seed=5)
    many = jax.jit(jax.vmap(search))
    found = benchmark(lambda: jax.block_until_ready(many(frusta)))
    # below γ = 1e-5 rounding hides the optimum from a search, not from the closed form
    clear = np.asarray(frusta.gamma > 1e-5)
    closed = np.asarray(minimax(frusta))
    flat = closed > 1e-3 * np.asarray(frusta.uniform_near_distance)
    assert np.max(np.abs(np.asarray(found) / closed - 1)[clear & ~flat]) < 1e-8
    if benchmark.stats:
        rate = COUNT / benchmark.stats["median"]
        benchmark.extra_info["problems_per_second"] = rate
        assert rate > 1e4
