"""Limits of filters: each prediction next to its measurement, and next to the figures in use."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from shadowjax.filters.convolution import fourier_test
from shadowjax.theory import limits


@pytest.mark.parametrize(
    ("dtype", "moments", "expected"),
    [
        (jnp.float32, 1, 88.722839), (jnp.float32, 2, 44.361420), (jnp.float16, 1, 11.089866),
        (jnp.float16, 2, 5.5449332), (jnp.bfloat16, 2, 44.359462),
    ],
)  # fmt: skip
def test_largest_exponents_are_those_in_use_and_those_measured(dtype, moments, expected):
    predicted = limits.largest_exponent(dtype, moments)
    assert predicted == pytest.approx(expected, rel=1e-6)
    # rounding to the dtype may still bring a number just above its largest down to it
    slack = float(jnp.finfo(dtype).eps) / moments
    assert 0 <= limits.measured_exponent(dtype, moments) - predicted <= slack


def test_a_kernel_that_adds_first_costs_its_logarithm():
    for size in (3, 7):
        predicted = limits.largest_exponent(jnp.float32, 1, size, normalised=False)
        assert limits.largest_exponent(jnp.float32) - predicted == pytest.approx(2 * np.log(size))
        assert limits.measured_exponent(jnp.float32, 1, size, normalised=False) == pytest.approx(predicted, abs=1e-6)
        # weights first: nothing lost but roundings of the sum, 1/K² being rounded too
        weighted = limits.measured_exponent(jnp.float32, 1, size)
        assert weighted == pytest.approx(limits.largest_exponent(jnp.float32), abs=1e-5)
    assert limits.largest_exponent(jnp.float16, largest_depth=0.36966221628203387) == pytest.approx(30)


def test_the_receivers_factor_runs_out_earlier():
    for dtype in (jnp.float32, jnp.float16):
        c = limits.largest_receiver_exponent(dtype)
        kind = np.dtype(jnp.dtype(dtype))
        tiny = np.finfo(kind).tiny
        assert np.exp(-c * (1 - 1e-4)).astype(kind) >= tiny > np.exp(-c * (1 + 1e-2)).astype(kind)
        assert c < limits.largest_exponent(dtype)


def test_gibbs_peaks_are_the_checked_values_and_the_measured_ones():
    known = {4: 1.0921125666890242, 8: 1.0901420644613528, 16: 1.0896527044476514}
    for num_terms, value in known.items():
        assert limits.gibbs_peak(num_terms) == pytest.approx(value, rel=1e-14)
        t = jnp.linspace(-1, 1, 20001)
        assert float(jnp.max(fourier_test(t, num_terms))) == pytest.approx(value, abs=2e-5)
    assert limits.gibbs_peak(None) == pytest.approx(1.0894898722360836, rel=1e-14)
    damped = {4: 0.99259366187659511, 8: 1.0043881075379411, 16: 1.0130117342427576}
    for num_terms, value in damped.items():
        assert limits.gibbs_peak(num_terms, 1.0) == pytest.approx(value, abs=1e-9)
    assert limits.gibbs_peak(16, 0.5) == pytest.approx(1.0428277245315749, abs=1e-9)


def test_damping_makes_the_step_less_steep():
    known = {4: 5.3117522235744920, 8: 11.301729278702566, 16: 23.258586538394532}
    for num_terms, value in known.items():
        assert limits.step_slope(num_terms) == 2 * num_terms
        assert limits.step_slope(num_terms, 1.0) == pytest.approx(value, rel=1e-13)
        slope = jax.grad(lambda t, m=num_terms: fourier_test(t, m, 1.0))(0.0)
        assert float(slope) == pytest.approx(value, rel=1e-13)


def two_occluders(warp, near, far, receiver, share):
    """Chebyshev's bound of two depths, from their moments."""
    z, w, d = warp(np.array([near, far])), np.array([1 - share, share]), warp(receiver)
    mean, second = (w * z).sum(), (w * z**2).sum()
    variance = second - mean**2
    return variance / (variance + (d - mean) ** 2)


def test_bleeding_of_two_occluders():
    known = limits.variance_bleed((0.5 - 0.1) / (0.9 - 0.5), 0.7)
    assert float(known) == pytest.approx(0.11052631578947368, rel=1e-13)
    for c in (0.0, 5.0, 20.0):
        warp = (lambda z: z) if c == 0 else (lambda z, c=c: np.exp(c * z))
        expected = two_occluders(warp, 0.2, 0.6, 0.7, 0.6)
        assert float(limits.exponential_variance_bleed(0.2, 0.6, 0.7, 0.6, c)) == pytest.approx(expected, rel=1e-9)
    direct = 0.6 * np.exp(-30 * 0.1) + 0.4 * np.exp(-30 * 0.5)
    assert float(limits.exponential_bleed(0.2, 0.6, 0.7, 0.6, 30.0)) == pytest.approx(direct, rel=1e-12)


def test_the_worst_share_bleeds_the_square_of_r_over_r_plus_two():
    share = np.linspace(0, 1, 200001)
    for r in (0.3, 2.0, 40.0):
        values = np.asarray(limits.variance_bleed(r, share))
        assert limits.least_bleed_clamp(r) == pytest.approx((r / (r + 2)) ** 2, rel=1e-13)
        assert values.max() == pytest.approx((r / (r + 2)) ** 2, rel=1e-8)
        assert np.all(values <= share + 1e-12)  # never more than the far occluder's share
    slope = jax.grad(limits.variance_bleed)(2.0, 0.5)
    step = (limits.variance_bleed(2.0 + 1e-6, 0.5) - limits.variance_bleed(2.0 - 1e-6, 0.5)) / 2e-6
    np.testing.assert_allclose(slope, step, rtol=1e-7)


@pytest.mark.parametrize("mean", [0.5, 10.0, 200.0])
def test_the_smallest_deviation_is_the_measured_one(mean):
    for dtype in (jnp.float32, jnp.float16) if mean < 100 else (jnp.float32,):
        ratio = limits.measured_deviation(mean, dtype) / limits.smallest_deviation(mean, dtype)
        assert 0.3 < ratio < 1.0, (dtype, ratio)
    assert limits.smallest_deviation(10.0, jnp.float32) ** 2 > 1e-6  # so a variance of 1e-6 at 10 is lost


def test_bad_numbers_are_named():
    with pytest.raises(ValueError, match="num_terms must be an integer of at least 1; got 0"):
        fourier_test(0.1, 0)
    with pytest.raises(ValueError, match="kernel_size must be"):
        limits.largest_exponent(jnp.float32, 1, 0)
    with pytest.raises(ValueError, match="without damping only"):
        limits.gibbs_peak(None, 1.0)
    with pytest.raises(ValueError, match="largest depth must be positive"):
        limits.largest_exponent(jnp.float32, largest_depth=0.0)
