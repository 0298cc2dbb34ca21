"""warping, figure 26 turned round: how many depth slices bring storage to twice the least possible?

The logarithmic map needs ln(f/n)/(2 tan φ) texels per pixel and no map needs less. Allow twice that. With a warp in
every slice the sum of eq. 51 stays within it while (q − 1)/ln q ≤ 2, so while a slice's depth ratio q is at most 3.513:
k = ⌈ln(f/n)/1.256⌉ slices, half a decade each. Without warps q(q − 1)/ln q ≤ 2 allows only q ≤ 1.578, so
k = ⌈ln(f/n)/0.456⌉: 2.75 times as many. For parallel light no number of slices is enough: k(f/n)^(2/k) is least at
k = 2 ln(f/n), where it is 2e·ln(f/n), and grows beyond.

Measured: slices are counted up from one; for each the errors of every slice's own matrix are taken and M_x·M_z is
summed, until the sum is within the bound.

How to read it: steps are formulas, markers are counts on measured storages. On the right, storage over the least
possible falls with k, but for parallel light it rises again.
"""

from dataclasses import dataclass
from typing import Any

import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from scipy.optimize import brentq

from experiments.base import Claim
from experiments.claiming import agrees, all_true, equals
from experiments.sliced_views import measured_storage
from experiments.warped_views import check_count, check_view, in_double, log_range, views
from shadowjax._checks import require
from shadowjax.plotting import PALETTE, label, new_figure, styled
from shadowjax.theory.aliasing.storage import best_parallel_partitions, partitions_needed, storage_parallel


@dataclass(frozen=True)
class Config:
    """Settings.

    Attributes:
        phi_deg: Half the angle of view, degrees.
        ratios: f/n at which slices are counted, rising, > 1.
        num_ratios: Values of f/n of the steps, ≥ 10.
        factor: Storage allowed, over the least possible; > 1.
        most: Most slices tried, 2 to 64.
    """

    phi_deg: float = 30.0
    ratios: tuple[float, ...] = (3.0, 10.0, 30.0, 100.0, 300.0, 1000.0, 3000.0, 10000.0)
    num_ratios: int = 801
    factor: float = 2.0
    most: int = 32

    def __post_init__(self):
        require(len(self.ratios) > 1 and min(self.ratios) > 1, "ratios must hold at least two f/n, all above 1")
        require(tuple(sorted(set(self.ratios))) == self.ratios, "ratios must rise")
        check_view(1.0, max(self.ratios), self.phi_deg)
        check_count(self.num_ratios, "num_ratios", 10)
        require(self.factor > 1, f"factor must exceed 1: nothing beats the least possible; got {self.factor}")
        check_count(self.most, "most", 2)
        require(self.most <= 64, f"most must be at most 64; got {self.most}")


@dataclass(frozen=True)
class Result:
    """Slices needed.

    Attributes:
        config: The settings.
        largest: Largest depth ratio of a slice with and without a warp.
        along: f/n of the steps.
        steps: Slices by formula with and without a warp; 0 where more than the most.
        counted: Slices by count with and without a warp; 0 where more than the most.
        library: Slices with a warp by the package's function.
        storage: Measured storage over the least possible of the largest f/n, over k: with and without a warp.
        parallel: The same for parallel light, by eq. 54.
        best_parallel: The k at which eq. 54 is least.
    """

    config: Config
    largest: tuple[float, float]
    along: np.ndarray
    steps: tuple[np.ndarray, np.ndarray]
    counted: tuple[np.ndarray, np.ndarray]
    library: np.ndarray
    storage: tuple[np.ndarray, np.ndarray]
    parallel: np.ndarray
    best_parallel: float


def _widest(power: int, factor: float) -> float:
    """Largest ln q with q^power·(q − 1) ≤ factor·ln q."""
    return float(brentq(lambda x: np.exp(power * x) * np.expm1(x) / x - factor, 1e-9, 20.0, xtol=1e-15, rtol=1e-14))  # pyright: ignore[reportArgumentType]


@in_double
def run(config: Config) -> Result:
    """Thresholds, then counting on measured slices."""
    tangent = 2 * np.tan(np.radians(config.phi_deg))
    logs = np.log(config.ratios)
    k = np.arange(1, config.most + 1)
    # slices of one view are similar, so the first one's storage times k is the sum
    q = np.exp(logs[:, None] / k)
    sums = [
        k * measured_storage(np.ones_like(q), q, config.phi_deg, distance) * tangent
        for distance in (1 + np.sqrt(q), np.full_like(q, np.inf))
    ]
    within = [total <= config.factor * logs[:, None] for total in sums]
    counted = [np.where(ok.any(axis=1), ok.argmax(axis=1) + 1, 0) for ok in within]
    along = log_range(config.ratios[0], config.ratios[-1], config.num_ratios)
    widest = [_widest(power, config.factor) for power in (0, 1)]
    steps = [np.ceil(np.log(along) / w - 1e-12).astype(int) for w in widest]
    steps = [np.where(needed <= config.most, needed, 0) for needed in steps]
    library = partitions_needed(jnp.asarray(along), config.factor * jnp.log(jnp.asarray(along)))
    view = views(1.0, config.ratios[-1], config.phi_deg)
    parallel = np.asarray(storage_parallel(view, jnp.asarray(k, float))) / logs[-1]
    return Result(
        config, (float(np.exp(widest[0])), float(np.exp(widest[1]))), along, (steps[0], steps[1]),
        (counted[0], counted[1]), np.asarray(library), (sums[0][-1] / logs[-1], sums[1][-1] / logs[-1]), parallel,
        float(best_parallel_partitions(view)),
    )  # fmt: skip


def claims(result: Result) -> tuple[Claim, ...]:
    """Counts are what the thresholds say."""
    config, ratios = result.config, np.asarray(result.config.ratios)
    expected = [np.ceil(np.log(ratios) / np.log(q) - 1e-12) for q in result.largest]
    expected = [np.where(needed <= config.most, needed, 0) for needed in expected]
    found = ", ".join(f"{k} at {ratio:g}" for k, ratio in zip(result.counted[0], ratios, strict=True))
    told = ", ".join(f"{k:g} at {ratio:g}" for k, ratio in zip(expected[0], ratios, strict=True))
    k = np.arange(1, config.most + 1)
    limits = config.ratios[-1] ** (1 / k)
    falls, best = np.diff(result.parallel) < 0, result.best_parallel
    known = result.steps[0] > 0
    return (
        Claim("with a warp: ⌈ln(f/n)/ln q⌉ slices, counted on measured storages",
              bool((result.counted[0] == expected[0]).all()), found, told),
        all_true("without: the same with its own q", result.counted[1] == expected[1], "values of f/n"),
        equals("with a warp the widest slice has (q − 1)/ln q = the factor",
               (result.largest[0] - 1) / np.log(result.largest[0]), config.factor, 1e-12),
        equals("without a warp it has q(q − 1)/ln q = the factor",
               result.largest[1] * (result.largest[1] - 1) / np.log(result.largest[1]), config.factor, 1e-12),
        all_true("the package's `partitions_needed` counts the same", (result.library == result.steps[0])[known],
                 "values of f/n"),
        agrees("measured storage with a warp is k(q − 1)", result.storage[0] * np.log(ratios[-1]), k * (limits - 1),
               1e-7),
        all_true("parallel light: more slices help up to k = 2 ln(f/n), and cost beyond",
                 np.where(k[1:] <= best, falls, ~falls)[(k[1:] <= best) | (k[:-1] >= best)], "steps of k"),
        Claim("and never bring it within the factor", bool(result.parallel.min() >= 2 * np.e - 1e-9 > config.factor),
              f"{result.parallel.min():.4g} times ln(f/n) at k = {int(result.parallel.argmin()) + 1}",
              f"at least 2e = {2 * np.e:.4g}"),
    )  # fmt: skip


def numbers(result: Result) -> dict[str, Any]:
    """Counts and thresholds."""
    return {
        "largest_slice_ratio_warped_uniform": result.largest, "f_over_n": result.config.ratios,
        "counted_warped": result.counted[0], "counted_uniform": result.counted[1],
        "storage_over_log_warped": result.storage[0], "storage_over_log_uniform": result.storage[1],
        "storage_over_log_parallel": result.parallel, "best_parallel_partitions": result.best_parallel,
    }  # fmt: skip


NAMES = ("LiSPSM in every slice", "a uniform map in every slice")


@styled
def draw(result: Result) -> Figure:
    """Slices needed on the left, storage over slices on the right."""
    figure, axes = new_figure(9.6, 4.3, 1, 2)
    left, right = axes[0]
    for index, (name, marker) in enumerate(zip(NAMES, "os", strict=True)):
        color, q = PALETTE[index], result.largest[index]
        steps, counted = (np.where(x > 0, x, np.nan) for x in (result.steps[index], result.counted[index]))
        left.plot(result.along, steps, color=color, linewidth=1.4, label=f"{name}: q ≤ {q:.4g}")
        left.plot(result.config.ratios, counted, marker, color=color, markersize=5)
        k = np.arange(1, result.config.most + 1)
        right.plot(
            k, result.storage[index], marker, color=color, markersize=4, linestyle="-", linewidth=1.2, label=name
        )
    left.set_xscale("log")
    left.yaxis.set_major_locator(MaxNLocator(integer=True))
    label(left, "f/n", "slices k", f"Slices for {result.config.factor:g} times the least storage")
    left.legend(loc="upper left")
    right.plot(np.arange(1, result.config.most + 1), result.parallel, "^-", color=PALETTE[2], markersize=4,
               linewidth=1.2, label="parallel light, eq. 54")  # fmt: skip
    right.axhline(result.config.factor, color="#4d4d4d", linestyle="--", linewidth=1.2, label="allowed")
    right.set_yscale("log")
    right.set_ylim(0.8, 1e3)
    label(right, "slices k", "storage over the least possible", f"f/n = {result.config.ratios[-1]:g}")
    right.legend(loc="upper right")
    return figure
