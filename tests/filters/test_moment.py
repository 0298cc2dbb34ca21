"""Moment maps: the bounds hold on random sets of depths, are attained by two depths, and match linear programming."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import linprog

from shadowjax import Moments, Prefilter
from shadowjax.filters.base import Lookup
from shadowjax.filters.moment import bias_moments, hamburger_visibility, hausdorff_visibility

RNG = np.random.default_rng(8)
bounds = jax.jit(lambda moments, depth: (hamburger_visibility(moments, depth), hausdorff_visibility(moments, depth)))


answer = eqx.filter_jit(lambda filter_, depth, where: filter_.visibility(filter_.prepare(depth), where))


def moments_of(depths, weights):
    return [jnp.asarray(np.sum(weights * depths**k, axis=-1)) for k in range(1, 5)]


def test_bounds_hold_on_a_hundred_thousand_sets_of_depths():
    """Never below the lit share; the bound that knows the interval is never above the one that does not."""
    depths = RNG.uniform(-1, 1, (100_000, 6))
    depths[::3] = np.round(depths[::3], 1)  # sets with repeated depths
    weights = RNG.dirichlet(np.ones(6), 100_000)
    receiver = RNG.uniform(-1, 1, 100_000)
    lit = np.sum(weights * (depths >= receiver[:, None]), axis=-1)
    hamburger, hausdorff = bounds(moments_of(depths, weights), jnp.asarray(receiver))
    # The moments carry 1e-16; the bound of nearly singular moments amplifies it.
    assert np.min(np.asarray(hamburger) - lit) > -1e-6
    assert np.min(np.asarray(hausdorff) - lit) > -1e-6
    assert np.max(np.asarray(hausdorff - hamburger)) < 1e-6
    assert np.mean(np.asarray(hamburger) - np.asarray(hausdorff)) > 1e-3
    for value in (hamburger, hausdorff):
        assert 0 <= float(jnp.min(value)) <= float(jnp.max(value)) <= 1


def test_two_depths_are_told_exactly():
    """Between two depths the share of the farther, beyond both 0: no light bleeds, which two moments cannot do."""
    share = RNG.uniform(0.1, 0.9, 300)
    depths = np.stack([RNG.uniform(-0.9, -0.1, 300), RNG.uniform(0.1, 0.9, 300)], axis=-1)
    moments = moments_of(depths, np.stack([1 - share, share], axis=-1))
    # One in two of the receivers lies between, the others behind both.
    between = 0.5 * (depths[:, 0] + depths[:, 1])
    for receiver, expected in ((between, share), (depths[:, 1] + 0.05, 0.0), (depths[:, 0] - 0.05, 1.0)):
        for value in bounds(moments, jnp.asarray(receiver)):
            np.testing.assert_allclose(value, expected, atol=1e-6)


def test_bounds_are_the_optimum_of_a_linear_programme():
    """Sharpest possible: the largest lit share over all distributions on a grid with these moments."""
    grid = np.linspace(-1, 1, 401)
    depths = RNG.uniform(-0.95, 0.95, (8, 5))
    weights = RNG.dirichlet(np.ones(5), 8)
    receiver = RNG.choice(grid[100:300], 8)
    moments = moments_of(depths, weights)
    _, hausdorff = bounds(moments, jnp.asarray(receiver))
    for i in range(8):
        fit = linprog(
            -(grid >= receiver[i] - 1e-12).astype(float), method="highs",
            A_eq=np.stack([grid**k for k in range(5)]), b_eq=[1, *(float(m[i]) for m in moments)],
        )  # fmt: skip
        # The grid may miss the best points by half a step.
        assert fit.status == 0
        assert -fit.fun <= float(hausdorff[i]) + 1e-6
        np.testing.assert_allclose(-fit.fun, hausdorff[i], atol=5e-3)


def test_one_texel_is_the_hard_test_and_bias_leaks_little():
    stored = RNG.uniform(2, 5, (8, 8))
    position = RNG.uniform(0, 8, (300, 2))
    depth = RNG.uniform(2, 5, 300)
    truth = depth <= stored[np.floor(position[:, 1]).astype(int), np.floor(position[:, 0]).astype(int)]
    where = Lookup(jnp.asarray(position), jnp.asarray(depth), jnp.zeros(()), jnp.ones(()))
    clear = np.abs(depth - stored[np.floor(position[:, 1]).astype(int), np.floor(position[:, 0]).astype(int)]) > 0.3
    for problem in ("hamburger", "hausdorff"):
        exact = Moments(problem, 0.0, Prefilter(1, sampling="nearest"))
        value = answer(exact, jnp.asarray(stored), where)
        np.testing.assert_allclose(value[clear], truth[clear], atol=1e-12)
        biased = Moments(problem, prefilter=Prefilter(1, sampling="nearest"))
        leak = np.asarray(answer(biased, jnp.asarray(stored), where)) - truth
        assert 0 <= np.max(leak[clear]) < 1e-3


def test_bias_is_a_mixture_with_the_ends():
    moments = moments_of(np.array([[0.3, -0.2]]), np.array([[0.5, 0.5]]))
    mixed = moments_of(np.array([[0.3, -0.2, -1, 1]]), np.array([[0.45, 0.45, 0.05, 0.05]]))
    np.testing.assert_allclose(np.stack(bias_moments(moments, 0.1)), np.stack(mixed), rtol=1e-12)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Moments("stieltjes"), "problem must be one of 'hamburger', 'hausdorff'"),
        (lambda: Moments(moment_bias=1.0), "moment_bias is a share"),
        (lambda: Moments(bleed_high=0.0), "0 ≤ bleed_low < bleed_high ≤ 1"),
    ],
)
def test_bad_input(make, message):
    with pytest.raises(ValueError, match=message):
        make()
