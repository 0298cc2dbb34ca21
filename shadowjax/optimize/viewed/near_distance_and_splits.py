"""Near distance and planes for one scene and view: the error averaged over the pixels that the camera really sees.

The error of every slice between two planes is a cubic of moments (`shadowjax.optimize.viewed.seen_pixels`), so the best
planes come from an exhaustive search.
"""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp

from shadowjax._checked import Checked, checked
from shadowjax._checks import require, require_choice, require_int, undifferentiable
from shadowjax._numerics import larger, safe_divide
from shadowjax._types import Array, Float, Scalar
from shadowjax.optimize.analytic.slices import Slices
from shadowjax.optimize.solution import Solution, SolutionKind, ended, with_slices
from shadowjax.optimize.viewed.seen_pixels import (
    Chart,
    SeenPixels,
    chart_between,
    mean_error,
    moments,
    seen_pixels,
    total_error,
    widest,
)
from shadowjax.techniques.shadow_mapping import ShadowMapping
from shadowjax.theory.aliasing.light_frustum import LightFrustum
from shadowjax.theory.aliasing.near_distances import generalised
from shadowjax.theory.aliasing.roots import implicit, least
from shadowjax.theory.aliasing.strength import least_worst_strength

BENDS = 129  # bends W/(n' + W) tried before the optimum is polished


class SeenCertificate(Checked):
    """Why a near distance is the best for a view.

    Attributes:
        slope_below: Derivative of ln(error) by the bend W/(n' + W) just below the optimum; not positive, unless the
            uniform map is best.
        slope_above: The same just above; not negative. Both are 0 at a smooth optimum, not at a kink, where another
            corner of the frustum begins to bound the map's width or, for "worst", another pixel is the worst.
        uniform: Whether the uniform map is best.
    """

    slope_below: Scalar
    slope_above: Scalar
    uniform: Array


def _technique(found: Any, resolution: int, options: dict[str, Any]) -> ShadowMapping:
    view = found.problem
    return with_slices(jnp.stack([view.near, view.far]), found.value[None], resolution, options)


NEAR_DISTANCE = SolutionKind(
    (
        ("near_distance", "value"), ("error", "objective_value"), ("baselines", "baselines"), ("gain", "gain"),
        ("certificate", "certificate"), ("result", "text"),
    ),
    technique=_technique,
)  # fmt: skip

# Bend → ln of the error.
LogError = Callable[[Array], Array]
# n' and what is seen → a positive number.
Rated = Callable[[Array, SeenPixels], Array]


def _mean(pixels: SeenPixels, chart: Chart) -> tuple[Array, LogError]:
    """Least mean of m_x·m_z by weight."""
    sums, count = jnp.sum(moments(pixels), axis=-1), jnp.sum(pixels.weight)

    # κ = 1/n' = b/((1 − b)·W); with the two bounding corners fixed the error is one smooth piece.
    def piece(bend: Array, sides: Any) -> Array:
        return _log(safe_divide(total_error(sums, chart, bend / (1 - bend) / chart.extent, sides), count))

    bend = _least(piece, lambda bend: widest(chart, bend / (1 - bend) / chart.extent), chart.extent.dtype)
    return bend, lambda bend: piece(bend, None)


def _worst(pixels: SeenPixels, chart: Chart) -> tuple[Array, LogError]:
    """Least of the largest weighted m_z of a pixel."""
    extent = chart.extent
    offset = jnp.clip(pixels.rise - chart.lowest, 0, extent)
    weight = pixels.weight / pixels.depth

    def log_error(bend: Array) -> Array:
        # m_z = W(1 + uκ)²/(1 + Wκ)/(2z·tan φ_y) with 1/(1 + Wκ) = 1 − b.
        stretch = 1 + offset * (bend / (1 - bend) / extent)
        return _log(jnp.max(weight * stretch * stretch) * extent * (1 - bend) / (2 * pixels.half_size[1]))

    strength = least_worst_strength(offset, weight, extent) * extent
    return strength / (1 + strength), log_error


# The bend of least error, and ln of the error at any; one line each. Or a function of n' and pixels, as users give it.
SEEN_OBJECTIVES: dict[str, Callable[[SeenPixels, Chart], tuple[Array, LogError]]] = {"mean": _mean, "worst": _worst}


def _given(objective: Rated, pixels: SeenPixels, chart: Chart) -> tuple[Array, LogError]:
    """Least of a function of n' and pixels."""

    def piece(bend: Array, _: Any) -> Array:
        return _log(jnp.asarray(objective(_distance(bend, chart.extent), pixels), bend.dtype))

    bend = _least(piece, lambda bend: jnp.zeros((), jnp.int32), chart.extent.dtype)
    return bend, lambda bend: piece(bend, None)


def _distance(bend: Array, extent: Array) -> Array:
    """n' of a bend; huge for the uniform map."""
    return extent * (1 - bend) / larger(bend, float(jnp.finfo(extent.dtype).eps) / 4)


@checked
@eqx.filter_jit
def near_distance_for_view(pixels: SeenPixels, objective: str | Rated = "mean") -> Solution[Scalar, SeenCertificate]:
    """The n' of one map that is best for the pixels a camera sees.

    n' and its error carry their implicit derivative by the pixels, at kinks too.

    Args:
        pixels: From `seen_pixels`.
        objective: "mean", the mean of m_x·m_z by weight; "worst", the largest weighted m_z of a pixel
            (`shadowjax.theory.aliasing.strength`); or a smooth function of n' and the pixels that gives a positive
            number.

    Returns:
        `value` n', world units, huge for the uniform map; `objective_value` the error; `baselines` "published", eq. 42
        with 44 over the same range of depths, and "uniform". Its technique is one map around what is seen.

    Raises:
        ValueError: If the objective is unknown.
    """
    frustum = pixels.frustum
    chart = chart_between(pixels, frustum.near, frustum.far)
    if isinstance(objective, str):
        bend, log_error = SEEN_OBJECTIVES[require_choice(objective, "objective", SEEN_OBJECTIVES)](pixels, chart)
    else:
        bend, log_error = _given(objective, pixels, chart)
    before = chart.extent / (chart.extent + generalised(frustum))
    below, above = (_slope(log_error, bend, side) for side in (-1, 1))
    error = jnp.exp(log_error(bend))
    baselines = {"published": jnp.exp(log_error(before)), "uniform": jnp.exp(log_error(jnp.zeros_like(bend)))}
    return Solution(
        _distance(bend, chart.extent), error, baselines, SeenCertificate(below, above, bend <= 1e-9),
        ended(jnp.isfinite(error)), frustum, NEAR_DISTANCE,
    )  # fmt: skip


def _log(value: Array) -> Array:
    """Logarithm; that of a tiny number where nothing is seen, so no error either."""
    return jnp.log(jnp.maximum(value, float(jnp.finfo(value.dtype).tiny) ** 0.5))


def _slope(function: Any, place: Array, side: int) -> Array:
    """Derivative just next to a place."""
    beside = jnp.clip(place + side * float(jnp.finfo(place.dtype).eps) ** 0.5, 0.0, 1 - 1e-6)
    return jax.jvp(function, (beside,), (jnp.ones_like(beside),))[1]


def _least(piece: Any, active: Any, dtype: Any) -> Array:
    """Bend of least value in [0, 1): the best of a grid, polished between its neighbours."""
    grid = jnp.linspace(0, 1 - 1 / BENDS, BENDS, dtype=dtype)
    # The error may have several valleys in the bend: the grid finds the deepest.
    index = jnp.argmin(jax.lax.stop_gradient(jax.vmap(lambda bend: piece(bend, None))(grid)))
    start, width = grid[index], grid[1] - grid[0]
    ends = jnp.maximum(start - width, 0.0), jnp.minimum(start + width, 1 - 0.01 / BENDS)
    rounding = 100 * float(jnp.finfo(dtype).eps)
    found = least(piece, active, *ends, lambda bend, sides: rounding + 0 * bend)
    # Between neighbours there may be two valleys; then the grid's point stands, and has no derivative to give.
    better = piece(found, None) <= piece(start, None) + rounding
    return jnp.where(better, found, implicit(lambda bend: 0 * bend, start))


class GridCertificate(Checked):
    """What the planes chosen from a grid may still cost.

    Attributes:
        coarser: Error of the best planes on half as many candidates over the error found, less 1.
    """

    coarser: Scalar


SPLITS = SolutionKind(
    (
        ("splits", "value.cuts"), ("near_distances", "value.near_distances"), ("error", "objective_value"),
        ("baselines", "baselines"), ("gain", "gain"), ("certificate", "certificate"), ("result", "text"),
    ),
    technique=lambda found, resolution, options: with_slices(
        found.value.cuts, found.value.near_distances, resolution, options
    ),
)  # fmt: skip


@checked
@eqx.filter_jit
def splits_for_view(pixels: SeenPixels, num_partitions: int, num_bins: int = 64) -> Solution[Slices, GridCertificate]:
    """The planes and n' of k slices that are best for the pixels a camera sees, by exhaustive search over a grid.

    Every pair of candidate planes, equal in ln z, is a slice with its best n'; the best chain of k slices is found by
    dynamic programming, so nothing on the grid is better. A slice counts by its pixels: empty depths cost nothing.

    Args:
        pixels: From `seen_pixels`.
        num_partitions: k ≥ 1.
        num_bins: Intervals between candidate planes, even and at least 2k.

    Planes are points of a grid, chosen by exhaustion: a choice has no derivative, so none is given.

    Returns:
        `value.cuts`, k + 1 planes from the nearest to the farthest depth that is seen, and `value.near_distances`,
        world units; `objective_value` the pixels that a texel covers, averaged over all seen pixels, with k maps of one
        resolution; `baselines` of equal ratios (eq. 50): "published" with n' of eq. 42 and 44, and "uniform". Its
        technique has one map a slice.

    Raises:
        ValueError: If a number is out of range, or the result is differentiated.
    """
    pixels = undifferentiable(
        pixels,
        "splits_for_view chooses planes among candidates, which has no derivative; differentiate the error of given "
        "planes instead: seen_pixels.total_error",
    )
    k = require_int(num_partitions, "the number of partitions k", 1)
    bins = require_int(num_bins, "num_bins", 2 * k)
    require(bins % 2 == 0, f"num_bins must be even; got {bins}")
    view = pixels.frustum
    dtype = view.near.dtype
    span = jnp.log(view.far / view.near)
    # Candidate planes n·(f/n)^(i/bins); the last is set, since a rounded power would miss f.
    edges = view.near * jnp.exp(span * jnp.arange(bins + 1, dtype=dtype) / bins)
    edges = edges.at[-1].set(view.far)
    index = jnp.clip((jnp.log(pixels.depth / view.near) / span * bins).astype(jnp.int32), 0, bins - 1)
    # Moments of every bin and their running sums: those of any slice are a difference of two columns.
    each = jnp.zeros((4, bins), dtype).at[:, index].add(moments(pixels))
    running = jnp.concatenate([jnp.zeros((4, 1), dtype), jnp.cumsum(each, axis=-1)], axis=-1)
    first, last = jnp.triu_indices(bins + 1, 1)
    costs, bends = _slice_costs(running[:, last] - running[:, first], chart_between(pixels, edges[first], edges[last]))
    # table[i, j]: cost of a slice from plane i to plane j; infinite unless i < j.
    table = jnp.full((bins + 1, bins + 1), jnp.inf, dtype).at[first, last].set(costs)
    count = jnp.sum(pixels.weight)
    chain, total = _best_chain(table, k)
    # The same with every second plane: how much that loses says what a finer grid could still gain.
    _, coarse = _best_chain(table[::2, ::2], k)
    planes = edges[chain]
    extent = chart_between(pixels, planes[:-1], planes[1:]).extent
    bend = jnp.zeros((bins + 1, bins + 1), dtype).at[first, last].set(bends)[chain[:-1], chain[1:]]
    distances = _distance(bend, extent)
    # The rivals: slices of equal ratios (eq. 50), in each the n' of eq. 42 and 44, or none.
    equal = view.near * jnp.exp(span * jnp.arange(k + 1, dtype=dtype) / k)
    equal = equal.at[-1].set(view.far)
    one = jnp.ones(k, dtype)
    usual = LightFrustum(equal[:-1], equal[1:], one * view.phi_y, one * view.phi_x, one * view.gamma)
    place = jnp.clip((jnp.log(pixels.depth / view.near) / span * k).astype(jnp.int32), 0, k - 1)
    sums = jnp.zeros((4, k), dtype).at[:, place].add(moments(pixels))
    charts = chart_between(pixels, equal[:-1], equal[1:])
    strengths = {"published": 1 / generalised(usual), "uniform": jnp.zeros_like(one)}
    baselines = {
        name: safe_divide(jnp.sum(total_error(sums, charts, strength)), count) for name, strength in strengths.items()
    }
    error = safe_divide(total, count)
    certificate = GridCertificate(safe_divide(coarse, total) - 1)
    value = Slices(planes, distances)
    return Solution(value, error, baselines, certificate, ended(jnp.isfinite(error)), view, SPLITS)


def _slice_costs(sums: Float[Array, "4 slices"], charts: Chart) -> tuple[Array, Array]:
    """Least Σ w·m of every slice over the bends, and the bend: a grid, refined twice around its best."""

    def cost(bend: Array) -> Array:
        return total_error(sums, charts, bend / (1 - bend) / charts.extent)

    low, width = jnp.zeros_like(charts.extent), 1.0
    best = low
    for num in (33, 17, 17, 17):
        step = width * (1 - 1e-6) / (num - 1)
        trials = low + step * jnp.arange(num, dtype=low.dtype)[:, None]
        best = jnp.take_along_axis(trials, jnp.argmin(jax.lax.map(cost, trials), axis=0)[None], axis=0)[0]
        # One step to either side of the best, within [0, 1).
        low, width = jnp.clip(best - step, 0.0, 1 - 2 * step), 2 * step
    return cost(best), best


def _best_chain(table: Float[Array, "planes planes"], k: int) -> tuple[Array, Scalar]:
    """Indices of the k + 1 planes from first to last of least summed cost, and that sum."""
    reached, parents = table[0], []
    for _ in range(k - 1):
        # Bellman: the least cost to reach plane j with one more slice, over its last start i.
        through = reached[:, None] + table
        parents.append(jnp.argmin(through, axis=0))
        reached = jnp.min(through, axis=0)
    chain = [jnp.asarray(table.shape[0] - 1)]
    for parent in reversed(parents):
        chain.append(parent[chain[-1]])
    chain.append(jnp.zeros_like(chain[0]))
    return jnp.stack(chain[::-1]), reached[-1]


__all__ = [
    "SEEN_OBJECTIVES", "GridCertificate", "SeenCertificate", "SeenPixels", "mean_error", "near_distance_for_view",
    "seen_pixels", "splits_for_view",
]  # fmt: skip
