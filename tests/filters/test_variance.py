"""Variance maps: moments, planar term, Chebyshev's bound, light bleeding; exponential variance maps next to them."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from shadowjax import ExponentialVariance, Prefilter, Variance
from shadowjax.filters.base import Lookup
from shadowjax.filters.exponential_variance import warp_depth
from shadowjax.filters.variance import (
    chebyshev_visibility,
    depth_moments,
    linear_step,
    surface_slopes,
    variance_of,
)

POINT = Prefilter(1, sampling="nearest")
RNG = np.random.default_rng(3)
MAP = RNG.uniform(2, 5, (12, 9))
RECEIVERS = RNG.uniform([0, 0], [9, 12], (200, 2))
DEPTH = RNG.uniform(1, 6, 200)


def lookup(dtype=jnp.float64, bias=0.0):
    return Lookup(
        jnp.asarray(RECEIVERS, dtype), jnp.asarray(DEPTH, dtype), jnp.asarray(bias, dtype), jnp.ones((), dtype)
    )


answer = eqx.filter_jit(lambda filter_, depth, where: filter_.visibility(filter_._prepared(depth, None, "lit"), where))


def stored_at_receivers():
    return MAP[np.floor(RECEIVERS[:, 1]).astype(int), np.floor(RECEIVERS[:, 0]).astype(int)]


@pytest.mark.parametrize(
    "make", [Variance, ExponentialVariance, lambda **more: ExponentialVariance(negative=None, **more)]
)
def test_one_texel_without_footprint_and_floor_is_the_hard_test(make):
    """A single depth has no variance, so the bound is 0 behind it and 1 before."""
    filter_ = make(prefilter=POINT, min_variance=0.0, footprint=0.0)
    value = filter_.visibility(filter_.prepare(jnp.asarray(MAP)), lookup())
    np.testing.assert_allclose(value, stored_at_receivers() >= DEPTH, atol=1e-9)


def test_bound_and_floor_by_hand():
    """filtering, eqs 2.3–2.8 with two depths: σ² = p(1−p)(z₂−z₁)², and the bound is p for a receiver at z₂."""
    for share in (0.25, 0.5, 0.9):
        mean = jnp.asarray(share * 0.7 + (1 - share) * 0.2)
        square = jnp.asarray(share * 0.49 + (1 - share) * 0.04)
        variance = variance_of(mean, square)
        np.testing.assert_allclose(variance, share * (1 - share) * 0.25, rtol=1e-12)
        np.testing.assert_allclose(chebyshev_visibility(mean, variance, jnp.asarray(0.7)), share, rtol=1e-12)
    assert float(variance_of(jnp.asarray(0.5), jnp.asarray(0.2499), 1e-6)) == 1e-6
    assert float(chebyshev_visibility(jnp.asarray(0.5), jnp.asarray(0.0), jnp.asarray(0.5))) == 1


def test_planar_term_is_the_second_moment_of_a_sloped_texel():
    """filtering, eq. 2.9 with any footprint: the mean square of a plane over a box is μ² + w²/12·(z_x² + z_y²)."""
    rows, cols = jnp.meshgrid(jnp.arange(7.0), jnp.arange(6.0), indexing="ij")
    plane = 1 + 0.03 * cols - 0.05 * rows
    _, square = jax.jit(depth_moments, static_argnums=1)(plane, 1 / 12)
    steps = (np.arange(1000) + 0.5) / 1000 - 0.5
    samples = np.asarray(plane)[..., None, None] + 0.03 * steps[:, None] - 0.05 * steps
    np.testing.assert_allclose(square, np.mean(samples**2, axis=(-2, -1)), rtol=1e-9)
    np.testing.assert_allclose(depth_moments(jnp.full((1, 1), 0.4), 0.25)[1], 0.16)


def test_slopes_stop_at_silhouettes():
    """A plane's slope is exact next to a jump, and the jump itself does not count."""
    line = jnp.asarray([[0.0, 0.1, 0.2, 5.0, 5.2, 5.4, 5.1]])
    np.testing.assert_allclose(surface_slopes(line)[0], [[0.1, 0.1, 0.1, 0.2, 0.2, 0.0, -0.3]], atol=1e-12)
    assert float(jnp.max(jnp.abs(surface_slopes(line, 0.15)[0]))) == 0.15


def test_bounds_hold_and_warps_tighten_them():
    """No bound lies below the lit share of a kernel; of two occluders in shadow, the warp bleeds less."""
    depths = jnp.asarray(RNG.uniform(0, 1, (4000, 5)))
    receiver = jnp.asarray(RNG.uniform(0, 1, 4000))
    lit = np.mean(np.asarray(depths) >= np.asarray(receiver)[:, None], axis=1)

    @eqx.filter_jit
    def decoded(filter_, depths=depths, receiver=receiver):
        return filter_.decode([jnp.mean(p, axis=-1) for p in filter_.encode(depths)], receiver)

    common = {"min_variance": 0.0, "footprint": 0.0}
    two, four = (ExponentialVariance(negative=n, positive=10.0, **common) for n in (None, 5.0))
    assert np.min(decoded(Variance(**common)) - lit) > -1e-12
    assert np.min(decoded(two) - lit) > -1e-12
    assert np.min(decoded(four) - lit) > -1e-12
    assert np.all(decoded(four) <= decoded(two) + 1e-12)
    # The reference case: 0.3 of the region at 0.1, 0.7 at 0.5, the receiver at 0.9. All of the light is bleeding.
    occluders, behind = jnp.asarray([[0.1] * 3 + [0.5] * 7]), jnp.asarray([0.9])
    plain, warped = (float(decoded(f, occluders, behind)[0]) for f in (Variance(**common), two))
    np.testing.assert_allclose(plain, 0.11052631578947368, rtol=1e-12)
    assert warped < plain / 100


def test_warps_rise_and_linear_step_is_algorithm_2():
    z = jnp.linspace(0.0, 1.0, 50)
    for exponent in (5.0, -5.0):
        assert np.all(np.diff(np.asarray(warp_depth(z, exponent))) > 0)
    np.testing.assert_allclose(linear_step(jnp.asarray([0.1, 0.3, 0.6, 1.0]), 0.2, 1.0), [0, 0.125, 0.5, 1])


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Variance(min_variance=-1e-3), "min_variance must not be negative"),
        (lambda: Variance(bleed_low=1.0), "0 ≤ bleed_low < bleed_high ≤ 1"),
        (lambda: Variance(footprint=-0.1), "footprint"),
        (lambda: ExponentialVariance(positive=0.0), "positive, the magnitude"),
        (lambda: ExponentialVariance(positive=45.0).prepare(jnp.ones((4, 4), jnp.float32)), "overflows float32"),
        (lambda: chebyshev_visibility(jnp.asarray(0.5), jnp.asarray(-0.1), jnp.asarray(0.6)), "variance must not be"),
        (lambda: Prefilter(4), "odd size"),
        (lambda: Prefilter(3, sigma=0.0), "sigma"),
    ],
)
def test_bad_input(make, message):
    with pytest.raises(ValueError, match=message):
        make()


def test_maps_with_nan_are_refused():
    with jax.debug_nans(False), pytest.raises(ValueError, match=r"must be finite; 1 of 16"):
        Variance().prepare(jnp.ones((4, 4)).at[1, 2].set(jnp.nan))


def test_an_empty_range_is_lit():
    """A map that saw nothing: everything lies on or before its depth."""
    filter_ = Variance(Prefilter(3))
    where = lookup()
    assert float(jnp.min(answer(filter_, jnp.full((12, 9), 7.0), where))) == 1
