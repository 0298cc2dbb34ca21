"""Descent of vertices: what a spread keeps, where it ends, and why."""

import numpy as np
import pytest

from shadowjax.optimize.solvers.descent import descend, diffuser

FACES = np.array([[0, 1, 2], [0, 2, 3], [0, 0, 0]])
START = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
GOAL = START + np.array([0.3, -0.2, 0.1])


def bowl(vertices):
    """Squared distance from the goal; what goes with it is the first vertex."""
    return float(((vertices - GOAL) ** 2).sum()), vertices[0], 2 * (vertices - GOAL)


def test_spreading_keeps_a_common_motion_and_smooths_others():
    spread = diffuser(FACES, 5, 2.0)
    np.testing.assert_allclose(spread @ np.ones(5), np.ones(5))
    np.testing.assert_allclose(spread, spread.T, atol=1e-15)
    # The fifth vertex has no neighbour, the triangle without area joins nothing.
    np.testing.assert_allclose(spread[4], [0, 0, 0, 0, 1])
    assert spread[0, 0] > spread[0, 1] > 0
    np.testing.assert_allclose(diffuser(FACES, 5, 0.0), np.eye(5))


def test_a_descent_comes_to_its_goal_and_says_so():
    found = descend(bowl, START, diffuser(FACES, 4, 1.0), 200, 0.05, target=1e-4)
    assert found.converged
    assert found.certificate.losses[-1] <= 1e-4
    assert "as small as asked" in found.certificate.reason
    assert len(found.certificate.losses) == len(found.certificate.vertices) == len(found.certificate.others)
    np.testing.assert_array_equal(found.certificate.others[-1], found.certificate.vertices[-1][0])
    np.testing.assert_array_equal(found.certificate.vertices[0], START)
    assert found.gain == found.certificate.losses[0] / found.certificate.losses[-1]


def test_steps_that_run_out_and_losses_that_are_flat_or_broken_are_told():
    few = descend(bowl, START, np.eye(4), 4, 0.01)
    assert not few.converged
    assert "raise num_steps" in few.certificate.reason
    flat = descend(lambda v: (1.0, None, np.zeros_like(v)), START, np.eye(4), 4, 0.01)
    assert not flat.converged
    assert "no slope" in flat.certificate.reason
    assert len(flat.certificate.losses) == 1
    broken = descend(lambda v: (1.0, None, np.full_like(v, np.nan)), START, np.eye(4), 4, 0.01)
    assert not broken.certificate.finite
    assert not broken.converged
    assert "not finite at step 0" in broken.certificate.reason
    at_rest = descend(bowl, GOAL, np.eye(4), 4, 0.01)
    assert at_rest.converged


@pytest.mark.parametrize(
    ("options", "told"),
    [
        ({"num_steps": 0}, "num_steps must be an integer of at least 1"),
        ({"rate": 0.0}, "rate must be positive"),
        ({"target": -1.0}, "target must not be negative"),
        ({"start": np.full((4, 3), np.nan)}, "must be finite"),
    ],
)
def test_bad_input_is_named(options, told):
    given = {"start": START, "spread": np.eye(4), "num_steps": 3, "rate": 0.1, **options}
    with pytest.raises(ValueError, match=told):
        descend(bowl, **given)
    with pytest.raises(ValueError, match="must not be negative"):
        diffuser(FACES, 4, -1.0)
