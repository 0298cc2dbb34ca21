"""Exponential maps: log space against the plain mean, the ceiling of each dtype, and both ways to find violations."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from shadowjax import Exponential, Prefilter
from shadowjax.filters.base import Lookup
from shadowjax.filters.exponential import blur_exponents
from shadowjax.filters.pcf import percentage_closer_of
from shadowjax.maps.blur import gaussian_weights

RNG = np.random.default_rng(6)
MAP = RNG.uniform(0, 1, (9, 11))
MAP[0, :2] = 0, 1
WHERE = Lookup(
    jnp.asarray(RNG.uniform([0, 0], [11, 9], (120, 2))),
    jnp.asarray(RNG.uniform(0, 1, 120)),
    jnp.zeros(()),
    jnp.ones(()),
)
BLUR = Prefilter(3)
answer = eqx.filter_jit(lambda filter_, depth, where: filter_.visibility(filter_._prepared(depth, None, "lit"), where))


def test_log_space_blur_is_the_blur_of_exponentials_without_their_range():
    weights = gaussian_weights(3)
    blurred = jax.jit(lambda x: blur_exponents(x, weights))
    windows = np.lib.stride_tricks.sliding_window_view(MAP, (3, 3))
    direct = np.log(np.einsum("rcij,i,j->rc", np.exp(50 * windows), weights, weights))
    np.testing.assert_allclose(blurred(jnp.asarray(50 * MAP)), direct, rtol=1e-12)
    # e^(1000 z) overflows; its logarithm is the same blur, shifted.
    shifted = blurred(jnp.asarray(50 * MAP + 950))
    np.testing.assert_allclose(shifted, direct + 950, rtol=1e-12)


def test_both_spaces_agree_where_both_exist():
    log, linear = (answer(Exponential(20.0, BLUR, space), jnp.asarray(MAP), WHERE) for space in ("log", "linear"))
    # They differ in what bilinear reads average: logarithms are raised first, so nothing.
    np.testing.assert_allclose(log, linear, rtol=1e-10)


def test_one_texel_tends_to_the_hard_test():
    """filtering, eq. 2.19: c = 10⁵ is exact but for receivers within 10⁻⁴ of the stored depth."""
    value = answer(Exponential(1e5, Prefilter(1, sampling="nearest")), jnp.asarray(MAP), WHERE)
    x, y = np.floor(np.asarray(WHERE.position)).astype(int).T
    np.testing.assert_allclose(value, np.asarray(WHERE.depth) <= MAP[y, x], atol=1e-4)


def test_violations_fall_back_to_bilinear_pcf():
    """z-max takes PCF wherever a depth of the kernel lies behind the receiver; the threshold where the mean says so."""
    pcf = np.asarray(percentage_closer_of(jnp.asarray(MAP)[None], WHERE, 1, "bilinear"))
    plain, threshold, z_max = (
        np.asarray(answer(Exponential(20.0, BLUR, fallback=kind), jnp.asarray(MAP), WHERE))
        for kind in ("none", "threshold", "z-max")
    )
    padded = np.pad(MAP, 2, constant_values=1)  # what lies outside is lit
    x, y = np.floor(np.asarray(WHERE.position)).astype(int).T
    largest = np.array([padded[r : r + 5, c : c + 5].max() for r, c in zip(y, x, strict=True)])
    behind = largest > np.asarray(WHERE.depth)
    assert behind.any()
    assert not behind.all()
    np.testing.assert_allclose(z_max, np.where(behind, pcf, plain), atol=1e-12)
    taken = np.abs(threshold - plain) > 1e-9
    assert taken.any()
    np.testing.assert_allclose(threshold[taken], pcf[taken], atol=1e-12)
    # The threshold misses some violations and finds no others.
    assert np.all(behind[taken])
    assert (plain[behind & ~taken] < 1).any()


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Exponential(30.0, space="linear").prepare(jnp.ones((8, 8), jnp.float16)), "overflows float16.*11.09"),
        (lambda: Exponential(89.0, space="linear").prepare(jnp.ones((8, 8), jnp.float32)), "overflows float32.*88.72"),
        (lambda: Exponential(0.0), "exponent must be a number, positive"),
        (lambda: Exponential(fallback="pcf"), "fallback must be one of"),
        (lambda: Exponential(threshold=-1.0), "threshold must not be negative"),
        (lambda: Exponential(prefilter=Prefilter(sampling="trilinear")), "use space='linear'"),
    ],
)
def test_bad_input(make, message):
    with pytest.raises(ValueError, match=message):
        make()
