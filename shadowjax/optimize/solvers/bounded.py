"""Bounded minimisation of smooth losses by L-BFGS-B from several starting points, with a certificate."""

from collections.abc import Callable, Iterable
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from scipy.optimize import minimize

from shadowjax._checked import Checked, checked
from shadowjax._checks import require, require_int, require_untraced
from shadowjax._types import ArrayLike
from shadowjax.optimize.solution import Solution, SolutionKind

ValueAndSlope = Callable[[np.ndarray], tuple[ArrayLike, ArrayLike]]


class SearchCertificate(Checked):
    """How the best of several searches ended, and the others.

    Attributes:
        slope: Largest slope at the end, among parameters that are free to move along it.
        at_bound: Which parameters lie on a bound.
        history: Parameters after every step from the best start, the start first.
        reason: Why it ended.
        starts: All starts.
        ends: Parameters found from each.
        losses: Losses found from each.
        reasons: Why each ended.
    """

    slope: float
    at_bound: np.ndarray
    history: np.ndarray
    reason: str = eqx.field(static=True)
    starts: np.ndarray
    ends: np.ndarray
    losses: np.ndarray
    reasons: tuple[str, ...] = eqx.field(static=True)

    def reached(self, within: float) -> int:
        """How many starts found a loss of at most the best plus `within`."""
        return int((self.losses <= self.losses.min() + within).sum())


_KIND = SolutionKind(
    (
        ("parameters", "value"), ("loss", "objective_value"), ("baselines", "baselines"),
        ("certificate", "certificate"), ("result", "text"),
    ),
    rival="start",
)  # fmt: skip


@checked
def minimise_multistart(
    value_and_slope: ValueAndSlope,
    starts: Iterable[ArrayLike],
    lower: ArrayLike,
    upper: ArrayLike,
    max_steps: int = 60,
    tolerance: float = 1e-6,
) -> Solution[np.ndarray, SearchCertificate]:
    """The parameters of least loss: limited-memory BFGS within bounds, from every start.

    All starts are used: multimodality shows in how many of them reach the best loss.

    Args:
        value_and_slope: Parameters → loss and its slope.
        starts: Vectors to begin with; brought between the bounds.
        lower: Least value of each parameter. Equal bounds fix a parameter.
        upper: Largest value of each.
        max_steps: Most steps from each start, ≥ 1.
        tolerance: Largest slope that counts as none, > 0. A search whose loss falls by less than a thousandth of it,
            relatively, ends too; it has converged if its slope is less than the root of it then.

    Returns:
        `value` the parameters; `objective_value` the loss; `baselines` "start", the least loss of a start. Not
        converged means that steps ran out, or that the search ended on a kink; `certificate.reason` says which.

    Raises:
        ValueError: If there is no start, shapes differ, bounds are crossed, or a number is not finite.
    """
    require_untraced("minimise_multistart", starts, lower, upper)
    low, high = np.asarray(lower, np.float64), np.asarray(upper, np.float64)
    require_int(max_steps, "max_steps", 1)
    require(tolerance > 0, f"tolerance must be positive; got {tolerance}")
    require(low.ndim == 1 and low.shape == high.shape, f"bounds must be two vectors; got {low.shape} and {high.shape}")
    require(bool((low <= high).all()), f"lower bounds must not exceed upper ones; got {low} and {high}")
    begun = [np.asarray(start, np.float64) for start in starts]
    require(len(begun) > 0, "starts must hold at least one vector")
    searches = []
    for start in begun:
        require(start.shape == low.shape, f"a start must have the bounds' shape {low.shape}; got {start.shape}")
        require(bool(np.isfinite(start).all()), f"a start must hold finite numbers; got {start}")
        searches.append(_search(value_and_slope, np.clip(start, low, high), low, high, max_steps, tolerance))
    # Every start is reported, so that multimodality shows; the best one is the answer.
    losses = np.array([one.loss for one in searches])
    best = int(np.argmin(losses))
    found = searches[best]
    reasons, ends = tuple(one.reason for one in searches), np.stack([one.end for one in searches])
    at_bound = (found.end <= low) | (found.end >= high)
    certificate = SearchCertificate(
        found.slope, at_bound, found.history, found.reason, np.stack(begun), ends, losses, reasons
    )
    before = {"start": jnp.asarray(min(one.first for one in searches))}
    return Solution(found.end, jnp.asarray(found.loss), before, certificate, found.result, None, _KIND)


class _Search(NamedTuple):
    """Where a search ended, loss and largest free slope there, the way, why it ended, and the loss at its start."""

    end: np.ndarray
    loss: float
    slope: float
    history: np.ndarray
    reason: str
    result: Any
    first: float


def _search(
    function: ValueAndSlope, start: np.ndarray, low: np.ndarray, high: np.ndarray, max_steps: int, tolerance: float
) -> _Search:
    history = [start]

    def both(x: np.ndarray) -> tuple[float, np.ndarray]:
        loss, slope = function(x)
        return float(np.asarray(loss)), np.asarray(slope, np.float64)

    first, slope = both(start)
    require(bool(np.isfinite(first) and np.isfinite(slope).all()), f"loss or slope is not finite at the start {start}")
    found = minimize(
        both, start, jac=True, method="L-BFGS-B", bounds=np.stack([low, high], axis=-1).tolist(),
        callback=lambda x: history.append(np.array(x)),
        options={"maxiter": max_steps, "gtol": tolerance, "ftol": tolerance * 1e-3},
    )  # fmt: skip
    end, gradient = np.asarray(found.x), np.asarray(found.jac)
    # A slope that only a bound keeps from being followed is no sign of an unfinished search.
    blocked = ((end <= low) & (gradient > 0)) | ((end >= high) & (gradient < 0)) | (low == high)
    left = float(np.abs(np.where(blocked, 0, gradient)).max(initial=0))
    result = optx.RESULTS.successful
    reason = "nothing is lower nearby: a minimum, perhaps a local one"
    if left > tolerance**0.5 and found.status == 1:
        result = optx.RESULTS.nonlinear_max_steps_reached
        reason = f"no end after {max_steps} steps; raise max_steps"
    elif left > tolerance**0.5:
        # Slopes that jump mislead a line search: it ends on the kink.
        result = optx.RESULTS.stagnation
        reason = f"a slope of {left:.2g} is left but no step is much lower: a kink, perhaps a minimum"
    return _Search(end, float(found.fun), left, np.stack(history), reason, result, first)


__all__ = ["SearchCertificate", "ValueAndSlope", "minimise_multistart"]
