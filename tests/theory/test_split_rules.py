"""Planes between slices: the source's own numbers, order for every valid input, and errors that name what is wrong."""

import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from shadowjax.partitions.cascades import (
    Cascades,
    adaptive_splits,
    iterate_adaptive,
    logarithmic_splits,
    practical_splits,
    uniform_splits,
)  # fmt: skip

RIGHT = np.pi / 2


def test_simple_rules(dtype, rounding):
    near, far = jnp.asarray(1, dtype), jnp.asarray(81, dtype)
    np.testing.assert_allclose(logarithmic_splits(near, far, 4), [1, 3, 9, 27, 81], rtol=10 * rounding)
    np.testing.assert_allclose(uniform_splits(near, far, 4), [1, 21, 41, 61, 81], rtol=10 * rounding)
    half = practical_splits(near, far, 4, jnp.asarray(0.5, dtype))
    np.testing.assert_allclose(half, [1, 12, 25, 44, 81], rtol=10 * rounding)
    assert half.dtype == dtype


def test_adaptive_is_logarithmic_overhead_and_keeps_ratios_when_parallel():
    np.testing.assert_allclose(adaptive_splits(1.0, 100.0, RIGHT, [2.0, 3.0, 4.0]), logarithmic_splits(1.0, 100.0, 4))
    parallel = adaptive_splits(1.0, 100.0, 0.0, [2.0, 3.0, 4.0])
    np.testing.assert_allclose(parallel[2:] / parallel[1:-1], [2, 3, 4], rtol=1e-13)


def test_the_printed_iteration_leaves_the_range_and_the_clamp_does_not():
    """Π α < f/n is not sufficient: f/n = 10, k = 9, λ = 0.1."""
    ratios = jnp.asarray([9.99] + [1.0000001] * 7)
    printed = iterate_adaptive(jnp.asarray(1.0), jnp.asarray(10.0), jnp.asarray(0.1), ratios)
    np.testing.assert_allclose(printed[1], 0.99076896443028, rtol=1e-13)
    clamped = adaptive_splits(1.0, 10.0, 0.1 * RIGHT, ratios)
    assert (jnp.diff(clamped) > 0).all()
    np.testing.assert_allclose(clamped[2:], printed[2:], rtol=1e-13)


@settings(max_examples=60, deadline=None)
@given(
    shares=st.lists(st.floats(0.01, 1), min_size=4, max_size=4), used=st.floats(0.05, 1.0),
    log_ratio=st.floats(0.02, 14), gamma=st.floats(0, RIGHT),
)  # fmt: skip
def test_clamped_planes_always_rise(shares, used, log_ratio, gamma):
    ratios = np.exp(np.asarray(shares) / np.sum(shares) * used * log_ratio * (1 - 1e-9))
    planes = adaptive_splits(1.0, float(np.exp(log_ratio)), gamma, ratios)
    assert (np.diff(planes) > 0).all()
    assert planes[0] == 1


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: logarithmic_splits(2.0, 1.0, 3), "far must be greater"),
        (lambda: logarithmic_splits(1.0, 2.0, 0), "at least 1"),
        (lambda: adaptive_splits(1.0, 10.0, 2.0, [2.0]), "gamma"),
        (lambda: adaptive_splits(1.0, 10.0, 0.5, [1.0, 3.0]), "must exceed 1"),
        (lambda: adaptive_splits(1.0, 10.0, 0.5, [3.0, 4.0]), "product"),
        (lambda: practical_splits(1.0, 10.0, 2, 1.5), "weight"),
        (lambda: Cascades(0), "at least 1"),
        (lambda: Cascades(2, "random"), "rule must"),
    ],
)
def test_bad_input(call, message):
    with pytest.raises(ValueError, match=message):
        call()
