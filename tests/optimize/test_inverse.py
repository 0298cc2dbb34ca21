"""Damped least squares: answers, several starts, and why a search ended."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from shadowjax.optimize.solvers.least_squares import linearized, recover


class Valley(eqx.Module):
    """Rosenbrock's banana as residuals; the third parameter changes nothing."""

    steepness: float = eqx.field(static=True, default=10.0)

    def __call__(self, x):
        return jnp.stack([self.steepness * (x[1] - x[0] ** 2), 1 - x[0]])


class Waves(eqx.Module):
    """Zero at 2, with other minima on the way."""

    def __call__(self, x):
        return jnp.stack([jnp.sin(3 * (x[0] - 2)), 0.1 * (x[0] - 2)])


class Flat(eqx.Module):
    """Nothing matters."""

    def __call__(self, x):
        return 0 * x + 1


def test_it_walks_along_a_valley_and_leaves_alone_what_has_no_influence():
    found = recover(Valley(), [jnp.asarray([-1.2, 1.0, 7.0])], target=1e-20)
    assert found.certificate.solved
    assert found.converged
    np.testing.assert_allclose(found.value, [1.0, 1.0, 7.0], atol=1e-9)
    assert (np.diff(found.certificate.losses) < 0).all()
    np.testing.assert_array_equal(found.certificate.history[0], [-1.2, 1.0, 7.0])
    np.testing.assert_array_equal(found.certificate.history[-1], found.value)
    assert found.objective_value == found.certificate.losses[-1]


def test_slopes_are_the_derivative():
    rest, slopes = linearized(Valley(), jnp.asarray([0.5, 2.0, 0.0]))
    np.testing.assert_allclose(rest, [17.5, 0.5])
    np.testing.assert_allclose(slopes, [[-10.0, 10.0, 0.0], [-1.0, 0.0, 0.0]])


def test_a_local_minimum_is_told_and_another_start_helps():
    alone = recover(Waves(), [jnp.asarray([5.2])], target=1e-20)
    assert alone.converged
    assert not alone.certificate.solved
    assert "local" in alone.certificate.reason
    both = recover(Waves(), [jnp.asarray([5.2]), jnp.asarray([2.3])], target=1e-20)
    assert both.certificate.solved
    assert both.certificate.tried == 2
    np.testing.assert_allclose(both.value, 2.0, atol=1e-9)


def test_it_says_why_it_did_not_converge():
    few = recover(Valley(), [jnp.asarray([-1.2, 1.0, 0.0])], target=1e-20, max_steps=2)
    assert not few.converged
    assert "raise max_steps" in few.certificate.reason
    still = recover(Flat(), [jnp.zeros(2)])
    assert not still.converged
    assert "no parameter changes" in still.certificate.reason


@pytest.mark.parametrize(
    ("starts", "options", "told"),
    [
        ([], {}, "at least one"),
        ([jnp.zeros((2, 2))], {}, "must be a vector"),
        ([np.array([np.nan, 0.0, 0.0])], {}, "finite"),
        ([jnp.zeros(3)], {"max_steps": 0}, "max_steps must be an integer of at least 1"),
        ([jnp.zeros(3)], {"tolerance": 0.0}, "tolerance must be positive"),
        ([jnp.zeros(3)], {"target": -1.0}, "target must not be negative"),
    ],
)
def test_bad_input_is_named(starts, options, told):
    with jax.debug_nans(False), pytest.raises(ValueError, match=told):
        recover(Valley(), starts, **options)
