"""Convolution maps: coefficients by quadrature, the series of one texel, filtered bases, and why XCSM is not CSM."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import integrate

from shadowjax import Convolution, FourierStep, MeanDepthConvolution, Prefilter
from shadowjax.filters.base import Lookup
from shadowjax.filters.convolution import basis_bytes, fourier_bases, fourier_visibility
from shadowjax.ledger.filtering.bases import step_series

RNG = np.random.default_rng(5)
series = jax.jit(lambda stored, depth: fourier_visibility(list(fourier_bases(stored[None], 4)[:, 0]), depth))


def test_coefficients_are_those_of_the_step_by_quadrature():
    """Each term of the series over z − d, against the integral of a unit step of period 2; to 1e-12."""
    differences = (np.arange(16) + 0.5) / 16  # enough samples to separate four odd terms exactly
    values = np.asarray(series(jnp.asarray(differences), jnp.zeros(16))) - 0.5
    for k in range(1, 5):
        c = (2 * k - 1) * np.pi
        found = 2 * np.mean(values * np.sin(c * differences))
        quadrature = integrate.quad(lambda x: 1.0, 0, 1, weight="sin", wvar=c, epsabs=1e-14)[0]
        np.testing.assert_allclose(found, quadrature, atol=1e-12)


@pytest.mark.parametrize("terms", [1, 16])
def test_one_texel_is_the_series_itself(terms):
    """Without blur: scale·f(z − d), clamped; depths squeezed so that |z − d| stays below 1 − 1/(2M)."""
    stored = RNG.uniform(2, 6, (5, 5))
    position, depth = RNG.uniform(0, 5, (30, 2)), RNG.uniform(2, 6, 30)
    step = FourierStep(terms, 0.5)
    filter_ = Convolution(step, Prefilter(1, sampling="nearest"))
    where = Lookup(jnp.asarray(position), jnp.asarray(depth), jnp.zeros(()), jnp.ones(()))
    value = answer(filter_, jnp.asarray(stored), where)
    low, high = stored.min(), stored.max()
    z = (stored[np.floor(position[:, 1]).astype(int), np.floor(position[:, 0]).astype(int)] - low) / (high - low)
    d = np.clip((depth - low) / (high - low), 0, 1)
    expected = [np.clip(2 * step_series((1 - 1 / (2 * terms)) * t, terms, 0.5), 0, 1) for t in z - d]
    np.testing.assert_allclose(value, expected, atol=1e-12)


answer = eqx.filter_jit(lambda filter_, depth, where: filter_.visibility(filter_._prepared(depth, None, "lit"), where))


def test_bases_can_be_averaged_and_depths_cannot():
    """Half at 0.2, half at 0.8, receiver at 0.7, M = 16: CSM 0.519, XCSM 0.006, truth ½."""
    depths, receiver = jnp.asarray([0.2, 0.8]), jnp.asarray(0.7)
    bases = jnp.mean(fourier_bases(depths[None], 16)[:, 0], axis=-1)
    np.testing.assert_allclose(fourier_visibility(list(bases), receiver), 0.51862315861768148, rtol=1e-12)
    mean = fourier_bases(jnp.full((1, 1), 0.5), 16)[:, 0, 0]
    np.testing.assert_allclose(fourier_visibility(list(mean), receiver), 0.0058874675300166453, rtol=1e-11)


def test_memory():
    assert basis_bytes(16, 256, 256, 2) == 8 * 4 * 2 * 256 * 256  # eight textures of four halves
    assert (Convolution().num_planes, MeanDepthConvolution().num_planes) == (32, 1)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: FourierStep(0), "number of terms M must be an integer of at least 1; got 0"),
        (lambda: FourierStep(damping=-1.0), "damping must not be negative"),
        (lambda: FourierStep(offset=1.0), "offset is a part of the depth range"),
        (lambda: FourierStep(scale=0.0), "scale must be positive"),
    ],
)
def test_bad_input(make, message):
    with pytest.raises(ValueError, match=message):
        make()
