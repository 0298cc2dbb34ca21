"""Exhaustive search for the best shares of a separable cost: the reference that optimisers of splits are held to."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.optimize import minimize_scalar

from shadowjax._checked import checked
from shadowjax._checks import require_untraced

Cost = Callable[[np.ndarray], np.ndarray]


@checked
def best_shares(cost: Cost, log_ratio: float, num_partitions: int, objective: str = "sum") -> tuple[np.ndarray, float]:
    """Shares of ln(f/n) for k slices that minimise the sum or the maximum of their costs.

    Slices of one view are similar, so the cost of a slice depends on ln(f_i/n_i) alone and order does not matter. The
    maximum of a rising cost is least for equal shares. A sum is stationary where all slopes are equal; every solution
    with at most two different shares is tried: m slices of one share and k − m of another, on a grid refined by
    golden section.

    Args:
        cost: Cost of slices of given ln(f_i/n_i), elementwise on arrays.
        log_ratio: ln(f/n).
        num_partitions: k.
        objective: "sum" or "max".

    Returns:
        Shares in rising order, summing to 1, and the objective's value.
    """
    require_untraced("best_shares", log_ratio)
    k = num_partitions
    equal = np.full(k, 1 / k)
    each = cost(equal * log_ratio)
    if objective == "max" or k == 1:
        return equal, float(np.max(each) if objective == "max" else each[0])
    best, value = equal, float(np.sum(each))

    # What m slices leave is shared equally by the other k − m; m and k − m change places, so m ≤ k/2 covers all.
    def total(first: np.ndarray, m: int) -> np.ndarray:
        second = (1 - m * first) / (k - m)
        return m * cost(first * log_ratio) + (k - m) * cost(second * log_ratio)

    for m in range(1, k // 2 + 1):
        grid = np.linspace(1e-4 / m, (1 - 1e-4) / m, 2001)
        # The sum may have several valleys along the share: a fine grid picks the deepest, golden section polishes it.
        i = int(np.argmin(total(grid, m)))
        low, high = grid[max(i - 1, 0)], grid[min(i + 1, len(grid) - 1)]
        found: Any = minimize_scalar(
            lambda x, m=m: float(total(np.asarray([x]), m)[0]),
            bounds=(low, high),
            method="bounded",
            options={"xatol": 1e-12},
        )
        first = float(found.x)
        if float(found.fun) < value * (1 - 1e-12):
            value = float(found.fun)
            best = np.sort(np.asarray([first] * m + [(1 - m * first) / (k - m)] * (k - m)))
    return best, value


@checked
def planes_of(shares: np.ndarray, near: float, far: float) -> np.ndarray:
    """Depths of the planes between slices of given shares of ln(f/n)."""
    inner = near * np.exp(np.cumsum(shares)[:-1] * math.log(far / near))
    return np.concatenate([[near], inner, [far]])


__all__ = ["Cost", "best_shares", "planes_of"]
