"""What every filter that averages codes owes its users: borders, ranges, gradients; one compiled program for each."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from shadowjax import (
    Convolution,
    Exponential,
    ExponentialVariance,
    FourierStep,
    MeanDepthConvolution,
    Moments,
    Prefilter,
    Variance,
)
from shadowjax.filters.base import Lookup

RNG = np.random.default_rng(21)
BLUR = Prefilter(3)
FILTERS = {
    "variance": Variance(BLUR),
    "exponential": Exponential(20.0, BLUR),
    "exponential, linear": Exponential(20.0, BLUR, "linear"),
    "exponential variance": ExponentialVariance(10.0, 5.0, BLUR),
    "convolution": Convolution(FourierStep(4), BLUR),
    "mean depth convolution": MeanDepthConvolution(FourierStep(4), BLUR),
    "hamburger": Moments("hamburger", prefilter=BLUR),
    "hausdorff": Moments("hausdorff", prefilter=BLUR),
}
MAP = RNG.uniform(2, 5, (6, 7))
MAP[:3] = 3.0  # a flat part: no variance
WHERE = Lookup(
    jnp.asarray(RNG.uniform([-1, -1], [8, 7], (40, 2))),
    jnp.asarray(RNG.uniform(1.5, 6, 40)),
    jnp.zeros(()),
    jnp.ones(()),
)


@eqx.filter_jit
def program(filter_, depth, where):
    """Visibilities, and the gradient of their sum in the map and in the receivers."""

    def total(depth, where):
        value = filter_.visibility(filter_._prepared(depth, None, where.border), where)
        return jnp.sum(value), value

    (_, value), gradient = jax.value_and_grad(total, argnums=(0, 1), has_aux=True)(depth, where)
    return value, gradient


@pytest.mark.parametrize("name", FILTERS)
def test_values_and_gradients(name):
    """Visibilities are such, the outside is lit, and gradients are finite and agree with central differences."""
    filter_, depth = FILTERS[name], jnp.asarray(MAP)
    value, gradient = program(filter_, depth, WHERE)
    assert 0 <= float(jnp.min(value)) < 0.3
    assert float(jnp.max(value)) == 1
    x, y = np.asarray(WHERE.position).T
    outside = (x < 0) | (x > 7) | (y < 0) | (y > 6)
    assert outside.any()
    np.testing.assert_array_equal(value[outside], 1)
    assert all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(gradient))
    step = jnp.asarray(1e-6 * RNG.normal(size=MAP.shape))
    # The nearest depth ends the range; its ties would make a corner.
    step = jnp.where(depth == jnp.min(depth), 0.0, step)
    above, below = (jnp.sum(program(filter_, depth + way * step, WHERE)[0]) for way in (1, -1))
    central = (above - below) / 2
    np.testing.assert_allclose(jnp.sum(gradient[0] * step), central, rtol=1e-3, atol=1e-10)
    assert abs(float(central)) > 1e-8
    moved = [eqx.tree_at(lambda w: w.depth, WHERE, WHERE.depth + way * 1e-6) for way in (1, -1)]
    slopes = np.asarray(program(filter_, depth, moved[0])[0] - program(filter_, depth, moved[1])[0]) / 2e-6
    differs = np.abs(slopes - np.asarray(gradient[1].depth)) > 1e-4 * (1 + np.abs(slopes))
    # A receiver within a millionth of a kink may differ.
    assert differs.sum() <= 1


@pytest.mark.parametrize("name", ["exponential variance", "hamburger"])
def test_float32_is_near_float64_and_finite(name):
    filter_ = {"exponential variance": ExponentialVariance(40.0, 5.0, BLUR)}.get(name, FILTERS[name])
    single = jax.tree.map(lambda x: x.astype(jnp.float32), WHERE)
    value, gradient = program(filter_, jnp.asarray(MAP, jnp.float32), single)
    assert value.dtype == jnp.float32
    assert all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(gradient))
    np.testing.assert_allclose(value, program(filter_, jnp.asarray(MAP), WHERE)[0], atol=2e-2)
