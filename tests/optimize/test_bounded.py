"""Searches within bounds: answers, several valleys, and why a search ended."""

import numpy as np
import pytest

from shadowjax.optimize.solvers.bounded import minimise_multistart


def valley(x):
    """Rosenbrock's, lowest at (1, 1)."""
    a, b = x
    return (1 - a) ** 2 + 10 * (b - a * a) ** 2, np.array([-2 * (1 - a) - 40 * a * (b - a * a), 20 * (b - a * a)])


def waves(x):
    """Many valleys; the lowest at 0."""
    return 0.1 * x[0] ** 2 - np.cos(3 * x[0]), np.array([0.2 * x[0] + 3 * np.sin(3 * x[0])])


def kink(x):
    """A roof upside down, lowest at (0.3, 0); the slope jumps across a line that is not along an axis."""
    u, v = x[0] + 2 * x[1] - 0.3, x[1]
    return abs(u) + 0.3 * v * v, np.array([np.sign(u), 2 * np.sign(u) + 0.6 * v])


def test_the_lowest_point_inside_and_on_a_bound():
    inside = minimise_multistart(valley, [[-1.0, 1.0]], [-2, -2], [2, 2])
    assert inside.converged
    np.testing.assert_allclose(inside.value, [1, 1], atol=1e-4)
    assert inside.certificate.slope < 1e-3
    assert not inside.certificate.at_bound.any()
    np.testing.assert_array_equal(inside.certificate.history[0], [-1, 1])
    np.testing.assert_array_equal(inside.certificate.history[-1], inside.value)
    # With a ≤ ½ the valley's floor b = a² is lowest at its end.
    bounded = minimise_multistart(valley, [[-1.0, 1.0]], [-2, -2], [0.5, 2])
    np.testing.assert_allclose(bounded.value, [0.5, 0.25], atol=1e-4)
    np.testing.assert_array_equal(bounded.certificate.at_bound, [True, False])
    assert bounded.certificate.slope < 1e-3
    fixed = minimise_multistart(valley, [[0.7, 1.0]], [0.5, -2], [0.5, 2])
    np.testing.assert_allclose(fixed.value, [0.5, 0.25], atol=1e-4)


def test_several_starts_tell_several_valleys():
    found = minimise_multistart(waves, [[4.0], [0.4], [-2.2], [-0.3]], [-5], [5])
    np.testing.assert_allclose(found.value, 0, atol=1e-5)
    assert found.certificate.reached(1e-6) == 2
    assert found.certificate.losses.shape == (4,)
    assert found.certificate.starts.shape == found.certificate.ends.shape == (4, 1)
    assert len(found.certificate.reasons) == 4


def test_it_says_why_it_did_not_converge():
    few = minimise_multistart(valley, [[-1.0, 1.0]], [-2, -2], [2, 2], max_steps=2)
    assert not few.converged
    assert "raise max_steps" in few.certificate.reason
    stuck = minimise_multistart(kink, [[1.7, 0.8]], [-3, -3], [3, 3])
    assert not stuck.converged
    assert "a kink" in stuck.certificate.reason


@pytest.mark.parametrize(
    ("options", "told"),
    [
        ({"starts": []}, "at least one"),
        ({"starts": [[0.0]]}, "must have the bounds' shape"),
        ({"starts": [[np.nan, 0.0]]}, "must be finite"),
        ({"lower": [3, 3]}, "must not exceed"),
        ({"lower": [0]}, "two vectors"),
        ({"max_steps": 0}, "max_steps must be an integer of at least 1"),
        ({"tolerance": 0.0}, "tolerance must be positive"),
    ],
)
def test_bad_input_is_named(options, told):
    with pytest.raises(ValueError, match=told):
        minimise_multistart(valley, **{"starts": [[0.0, 0.0]], "lower": [-2, -2], "upper": [2, 2], **options})
    with pytest.raises(ValueError, match="not finite at the start"):
        minimise_multistart(lambda x: (np.nan, x), [[0.0]], [-1], [1])
