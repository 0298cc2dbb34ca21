"""Smooth losses lowered within bounds from several starts, with a report of what happened."""

from collections.abc import Callable, Iterable

import numpy as np
from scipy.optimize import minimize

from shadowjax._checked import Checked, checked
from shadowjax._checks import require, require_int, require_untraced
from shadowjax._types import ArrayLike

ValueAndSlope = Callable[[np.ndarray], tuple[ArrayLike, ArrayLike]]


class BoundedMinimum(Checked):
    """The best of several searches, and how each of them ended.

    Attributes:
        parameters: The best found.
        loss: The loss there.
        slope: Largest slope there, among parameters that are free to move along it.
        at_bound: Which parameters lie on a bound.
        history: Parameters after every step from the best start, the start first.
        converged: Whether the best search came to a point without a way down.
        reason: Why it ended.
        starts: All starts.
        ends: Parameters found from each.
        losses: Losses found from each.
        reasons: Why each ended.
    """

    parameters: np.ndarray
    loss: float
    slope: float
    at_bound: np.ndarray
    history: np.ndarray
    converged: bool
    reason: str
    starts: np.ndarray
    ends: np.ndarray
    losses: np.ndarray
    reasons: tuple[str, ...]

    def reached(self, within: float) -> int:
        """How many starts found a loss of at most the best plus `within`."""
        return int((self.losses <= self.loss + within).sum())


@checked
def minimise_multistart(
    value_and_slope: ValueAndSlope,
    starts: Iterable[ArrayLike],
    lower: ArrayLike,
    upper: ArrayLike,
    max_steps: int = 60,
    tolerance: float = 1e-6,
) -> BoundedMinimum:
    """Limited-memory BFGS within bounds, from every start.

    All starts are used: multimodality shows in how many of them reach the best loss.

    Args:
        value_and_slope: Parameters → loss and its slope.
        starts: Vectors to begin with; brought between the bounds.
        lower: Least value of each parameter. Equal bounds fix a parameter.
        upper: Largest value of each.
        max_steps: Most steps from each start, ≥ 1.
        tolerance: Largest slope that counts as none, > 0. A search whose loss falls by less than a thousandth of it,
            relatively, ends too; it has converged if its slope is less than the root of it then.

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
    losses = np.array([search[1] for search in searches])
    best = int(np.argmin(losses))
    parameters, loss, slope, history, reason, converged = searches[best]
    return BoundedMinimum(
        parameters, loss, slope, (parameters <= low) | (parameters >= high), history, converged, reason,
        np.stack(begun), np.stack([search[0] for search in searches]), losses, tuple(search[4] for search in searches),
    )  # fmt: skip


def _search(
    function: ValueAndSlope, start: np.ndarray, low: np.ndarray, high: np.ndarray, max_steps: int, tolerance: float
) -> tuple[np.ndarray, float, float, np.ndarray, str, bool]:
    """Where it ends, loss and largest free slope there, the way, why it ended, and whether it has converged."""
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
    blocked = ((end <= low) & (gradient > 0)) | ((end >= high) & (gradient < 0)) | (low == high)
    left = float(np.abs(np.where(blocked, 0, gradient)).max(initial=0))
    converged = left <= tolerance**0.5
    if converged:
        reason = "nothing is lower nearby: a minimum, perhaps a local one"
    elif found.status == 1:
        reason = f"no end after {max_steps} steps; raise max_steps"
    else:
        # Slopes that jump mislead a line search: it ends on the kink.
        reason = f"a slope of {left:.2g} is left but no step is much lower: a kink, perhaps a minimum"
    return end, float(found.fun), left, np.stack(history), reason, converged


__all__ = ["BoundedMinimum", "ValueAndSlope", "minimise_multistart"]
