"""Moment maps: the bounds hold on random sets of depths, are attained by two depths, and match linear programming."""

import equinox as eqx
import jax
import jax.numpy as jnp
import moment_oracle as oracle
import numpy as np
import pytest

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


def sets_of_depths(count, seed=9):
    """Moments of six depths each, and receivers: a quarter where a partner runs to infinity, some next to the ends."""
    rng = np.random.default_rng(seed)
    depths, weights = rng.uniform(-1, 1, (count, 6)), rng.dirichlet(np.ones(6), count)
    receiver, part = rng.uniform(-1, 1, count), count // 4
    mean = np.sum(weights * depths, axis=-1)
    variance, third = (np.sum(weights * (depths - mean[:, None]) ** k, axis=-1) for k in (2, 3))
    far = mean + third / variance / 2 - np.sqrt((third / variance / 2) ** 2 + variance)
    receiver[:part] = (far + 10 ** rng.uniform(-9, -1, count))[:part]
    receiver[part : part + 40 : 2], receiver[part + 1 : part + 40 : 2] = 1 - 1e-5, 1e-5 - 1
    return moments_of(depths, weights), np.clip(receiver, -1, 1)


def off_by(num, dtype):
    """Largest difference of both bounds from 80-bit arithmetic, both on the rounded moments."""
    moments, receiver = sets_of_depths(num)
    moments, receiver = [m.astype(dtype) for m in moments], jnp.asarray(receiver, dtype)
    known = [np.asarray(part).astype(np.longdouble) for part in (*moments, receiver)]
    rivals = oracle.hamburger(known[:4], known[4])[0], oracle.hausdorff(known[:4], known[4])
    found = bounds(moments, receiver)
    assert found[0].dtype == dtype
    return [np.max(np.abs(np.asarray(a) - np.clip(b, 0, 1))) for a, b in zip(found, rivals, strict=True)]


@pytest.mark.parametrize("num", [2_000, pytest.param(100_000, marks=pytest.mark.long)])
def test_bounds_are_sharp_on_many_sets_of_moments(num, dtype):
    """Against kernels by Hankel matrices in 80 bits, which the next test holds to linear programmes."""
    assert max(off_by(num, dtype)) < {jnp.float32: 1e-4, jnp.float64: 1e-9}[dtype]


def test_bounds_are_the_optimum_of_linear_programmes():
    """Sharp: the largest lit share over all distributions with these moments, to 1e-9; the 80-bit bound too."""
    moments, receiver = sets_of_depths(800)
    chosen = np.random.default_rng(3).choice(800, 200, replace=False)
    found = np.asarray(bounds(moments, jnp.asarray(receiver))[1])[chosen]
    known = [np.asarray(m)[chosen] for m in moments]
    best = [oracle.programme([m[i] for m in known], receiver[chosen][i]) for i in range(200)]
    np.testing.assert_allclose(oracle.hausdorff(known, receiver[chosen]).astype(float), best, rtol=0, atol=1e-9)
    np.testing.assert_allclose(found, best, rtol=0, atol=1e-9)


def test_gradients_are_finite_where_points_meet_or_run_away(dtype):
    """At one depth, at two, at the ends of the interval and where a partner is infinitely far."""
    moments, receiver = sets_of_depths(400)
    few = moments_of(np.array([[0.3, 0.3], [-1.0, 1.0], [0.0, 0.5]]), np.full((3, 2), 0.5))
    moments = [jnp.concatenate([a, b]).astype(dtype) for a, b in zip(moments, few, strict=True)]
    receiver = jnp.concatenate([jnp.asarray(receiver), jnp.asarray([0.3, 1.0, -1.0])]).astype(dtype)
    slopes = jax.jit(jax.grad(lambda m, t: sum(jnp.sum(b) for b in bounds(m, t)), argnums=(0, 1)))(moments, receiver)
    assert all(np.isfinite(part).all() for part in jax.tree.leaves(slopes))


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
