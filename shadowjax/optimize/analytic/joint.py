"""Planes and near distances together, with or without a limit on the jump of the error at the seams."""

import math
from collections.abc import Iterator
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from jax.core import Tracer
from scipy.optimize import minimize, nnls

from shadowjax._checked import Checked, checked
from shadowjax._checks import require, require_choice, require_int, require_value
from shadowjax._types import Array, ArrayLike, Bool, Float
from shadowjax.optimize.analytic._joint_conditions import (
    Problem,
    condition_and_slope,
    condition_of,
    distances_of,
    functions_and_slopes,
    log_jumps,
    log_storages,
    storages_and_jumps,
)
from shadowjax.optimize.analytic.slices import (
    SLICES_KIND,
    SPLIT_OBJECTIVES,
    WARPS,
    Slices,
    equal_ratios,
    similar,
    total,
)
from shadowjax.optimize.solution import Solution, ended
from shadowjax.theory.aliasing.error import storage_factor
from shadowjax.theory.aliasing.light_frustum import SECTIONS, LightFrustum, Section

JOINT_WARPS = ("free", *WARPS)
RANDOM_STARTS = 16
NEARLY = 1e-3  # slack of a constraint, in ln, below which it may turn out to be active
HELD = 1e-7  # largest excess of a constraint, in ln, that counts as kept
LEAST_BEND = 1e-12  # of a uniform map
STEPS = 12  # of Newton's method, which takes two or three


class JointCertificate(Checked):
    """Why the planes and near distances are optimal.

    Attributes:
        residual: What is left of the objective's slope after the active constraints' multipliers have taken their part
            (Karush–Kuhn–Tucker), relative to that slope; 0 at a stationary point.
        violation: Largest excess of a constraint, in ln of a storage or of a jump; at most rounding.
        seam_jump: Largest jump of m_x or m_z on the view axis at a cut.
        seam_limited: Whether the limit is what holds the optimum.
        published_jump: Largest jump of equal ratios with n' of eq. 42 and 44: they may break the limit.
        starts: How many starting points the search had.
    """

    residual: Float[Array, "*views"]
    violation: Float[Array, "*views"]
    seam_jump: Float[Array, "*views"]
    seam_limited: Bool[Array, "*views"]
    published_jump: Float[Array, "*views"]
    starts: int = eqx.field(static=True)


JointSlices = Solution[Slices, JointCertificate]


class _Point(NamedTuple):
    """A stationary point: its variables, its multipliers, and what holds it.

    Attributes:
        v: Log ratios, bends and ln S.
        forces: Multipliers of the constraints, and of the sum of log ratios.
        holds: Which constraints hold it.
        fixed: Which variables lie at a bound, or have no part.
        residual: Of the slope, relative.
        violation: Largest excess of a constraint.
    """

    v: Any
    forces: Any
    holds: Any
    fixed: Any
    residual: Any
    violation: Any


def _starts(span: float, k: int, limit: float, limited: bool, free: bool) -> Iterator[tuple[Any, Any]]:
    """Log ratios and bends to start from; bends None for those of the closed form.

    Equal ratios, one slice longer or shorter, all but the first at the limit; under a limit on free n', where optima
    are many, also strong warps and random ones from a fixed seed.
    """
    # Equal shares of ln(f/n), with the bends of the closed form.
    equal = np.full(k, span / k)
    yield equal, None
    for power in (0.5, 1.0, 2.0) if limited else ():
        rest = np.full(k, min(power * limit, 0.9 * span / k))
        rest[0] = span - rest[1:].sum()
        yield rest, None
    for factor in (0.4, 2.0) if k > 1 else ():
        for place in (0, k - 1):
            # One slice at either end shorter or longer than the others.
            shares = np.ones(k)
            shares[place] = factor
            yield span * shares / shares.sum(), None
    if limited and free:
        for bend in (0.2, 0.8, 0.97):
            yield equal, np.full(k, bend)
        rng = np.random.default_rng(0)
        for _ in range(RANDOM_STARTS):
            shares = rng.dirichlet(np.full(k, 3.0))
            yield span * (0.9 * shares + 0.1 / k), rng.uniform(0.02, 0.98, k)


@checked
def joint_splits(
    near: ArrayLike,
    far: ArrayLike,
    phi: ArrayLike,
    gamma: ArrayLike,
    num_partitions: int,
    objective: str = "sum",
    warp: str = "free",
    seam_limit: ArrayLike | None = None,
    section: str = "axis",
) -> JointSlices:
    """The planes of k depth slices, and the n' of each, of least storage, under a limit on the jump at seams.

    The four numbers of a view, and the limit, broadcast against each other; planes and n' stand along a last axis.
    Results carry their implicit derivative by all of them, from the conditions that hold at the optimum (Karush, Kuhn
    and Tucker), under `jit` and `vmap`, forward and reverse.

    The problem is smooth once every slice's storage is a variable above the eight smooth functions whose maximum it is.
    Sequential quadratic programming from several starts, with exact derivatives, finds the active constraints, and
    Newton's method on their conditions ends it; the certificate says how stationary the result is. That search is in
    64-bit floats, whatever the numbers given.

    Args:
        near: Depth n, world units, > 0.
        far: Depth f, world units, > near.
        phi: Half the vertical angle of view, radians, in (0, π/2).
        gamma: Angle between light and view, radians, in [0, π/2].
        num_partitions: k ≥ 1.
        objective: "sum", all texels, or "max", the largest slice's.
        warp: "free" to choose every n'; or a rule of `shadowjax.optimize.analytic.slices.WARPS`.
        seam_limit: Largest factor, > 1, by which m_x and m_z may change at a cut on the view axis; none if None.
        section: "axis" or "whole" vertical section, over which errors are taken.

    Raises:
        ValueError: If a number is out of range, a name unknown, or no planes keep the limit.
        RuntimeError: When differentiated (at run time) at a view whose optimum has not converged, or is not unique.

    Source: warping, eq. 50, 51 and 55, and the text on seams; the optimum is derived here.
    """
    require_choice(objective, "objective", SPLIT_OBJECTIVES)
    require_choice(warp, "warp", JOINT_WARPS)
    checked: Section = require_choice(section, "section", SECTIONS)
    view = LightFrustum.create(near, far, phi, gamma)
    k = require_int(num_partitions, "the number of partitions k", 1)
    # Without a limit the number has no part in any constraint; e only keeps its logarithm finite.
    factor = jnp.asarray(math.e if seam_limit is None else seam_limit, view.near.dtype)
    limit = jnp.log(require_value(factor, factor > 1, "seam_limit, a factor, must exceed 1"))
    kind = Problem(k, objective, warp, checked, seam_limit is not None and k > 1)
    shape = jnp.broadcast_shapes(limit.shape, *(x.shape for x in jax.tree.leaves(view)))
    flat = jax.tree.map(lambda x: jnp.broadcast_to(x, shape).reshape(-1), (view, limit))
    fixed = jax.tree.leaves(jax.lax.stop_gradient(flat))
    # The search runs on the host; under `jit` and `vmap` it is called back for, and only the conditions are traced.
    if any(isinstance(x, Tracer) for x in fixed):
        like = jax.eval_shape(lambda: _blank(kind, fixed[0].shape[0], view.near.dtype))
        point = jax.pure_callback(
            lambda *numbers: _find(kind, *numbers), like, *fixed, vmap_method="sequential"
        )  # fmt: skip
    else:
        point = _find(kind, *fixed)
    found = _all_reports(flat[0], flat[1], jax.tree.map(jnp.asarray, point), kind)
    return jax.tree.map(lambda x: x.reshape(*shape, *x.shape[1:]), found)


def _blank(kind: Problem, views: int, dtype: Any) -> _Point:
    """An array of the shape of each part of the points of several views."""
    num = 2 * kind.k + (kind.k if kind.objective == "sum" else 1)
    constraints = 8 * kind.k + (6 * (kind.k - 1) if kind.limited else 0)
    zero = lambda *shape: jnp.zeros((views, *shape), dtype)  # noqa: E731
    flags = lambda size: jnp.zeros((views, size), bool)  # noqa: E731
    return _Point(zero(num), zero(constraints + 1), flags(constraints), flags(num), zero(), zero())


def _find(kind: Problem, *numbers: Array) -> _Point:
    """The best point of every view, one after the other, on the host; in float64, without which residuals are large."""
    dtype = numbers[0].dtype
    points = []
    with jax.enable_x64(True):
        for row in zip(*(np.asarray(x).tolist() for x in numbers), strict=True):
            *fields, limit = (jnp.asarray(x, jnp.float64) for x in row)
            points.append(_search(LightFrustum(*fields), limit, kind))
    return _Point(*(np.stack(parts).astype(like.dtype) for parts, like in zip(
        zip(*points, strict=True), _blank(kind, 1, dtype), strict=True)))  # fmt: skip


def _search(view: LightFrustum, limit: Array, kind: Problem) -> _Point:
    best = None
    for log_ratios, bend in _starts(
        math.log(float(view.far / view.near)), kind.k, float(limit), kind.limited, kind.warp == "free"
    ):
        found = _solve(log_ratios, bend, view, limit, kind)
        if found is not None and (best is None or found[1] < best[1] * (1 - 1e-12)):
            best = found
    require(
        best is not None,
        f"no {kind.k} slices found whose error jumps by at most {math.exp(float(limit)):.6g} at every cut; "
        "raise seam_limit or num_partitions",
    )
    assert best is not None
    return _settled(best[0], view, limit, kind)


class _Functions:
    """Value and constraints, and their slopes, as NumPy arrays; a step of a search asks for each of the four alone."""

    def __init__(self, view: LightFrustum, limit: Array, kind: Problem) -> None:
        self.given = np.asarray([float(x) for x in (*jax.tree.leaves(view), limit)]), kind
        self._last: Any = b"", None

    def __call__(self, v: np.ndarray) -> tuple[tuple[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]:
        if v.tobytes() != self._last[0]:
            self._last = v.tobytes(), jax.tree.map(np.asarray, functions_and_slopes(v, *self.given))
        return self._last[1]


def _num_starts(kind: Problem) -> int:
    """How many starting points a search has."""
    return sum(1 for _ in _starts(4.0, kind.k, 1.0, kind.limited, kind.warp == "free"))


def _solve(start: np.ndarray, bend: np.ndarray | None, *args: Any) -> tuple[np.ndarray, float] | None:
    """Variables and exact objective from one start; None where the result breaks the limit."""
    view, _, kind = args
    k, dtype = kind.k, view.near.dtype
    parts = similar(view, jnp.asarray(start, dtype))
    if bend is None:
        distance = WARPS["least_storage" if kind.warp == "free" else kind.warp](parts, kind.section)
        bend = np.asarray(parts.extent / (parts.extent + distance), np.float64)
    else:
        distance = distances_of(parts, jnp.asarray(bend, dtype), kind.warp, kind.section)
    # The starting levels lie exactly on the maximum of their pieces: a feasible start for the storages.
    level = np.max(np.asarray(log_storages(parts, distance, kind.section), np.float64), axis=-1)
    level = level if kind.objective == "sum" else np.asarray([level.max()])
    # The order of `functions_of`: log ratios, bends, levels.
    v = np.concatenate([start, np.clip(bend, 1e-9, 1 - 1e-9), level])
    span = float(np.log(float(view.far / view.near)))
    sums = np.concatenate([np.ones(k), np.zeros(len(v) - k)])
    # Log ratios stay positive, bends within (0, 1), levels where exp neither overflows nor vanishes.
    bounds = [(1e-3 * span / k, span)] * k + [(LEAST_BEND, 1 - 1e-9)] * k + [(-60.0, 60.0)] * len(level)
    at = _Functions(*args)
    found: Any = minimize(
        lambda x: (float(at(x)[0][0]), at(x)[1][0]), v, jac=True, method="SLSQP", bounds=bounds,
        constraints=[
            {"type": "eq", "fun": lambda x: sums @ x - span, "jac": lambda x: sums},
            {"type": "ineq", "fun": lambda x: at(x)[0][1], "jac": lambda x: at(x)[1][1]},
        ],
        options={"maxiter": 300, "ftol": 1e-15},
    )  # fmt: skip
    v = np.asarray(found.x)
    # What is left of the equality is scaled away, then the levels and the jump are worked out exactly.
    v[:k] *= span / v[:k].sum()
    v, value, broken = _exact(v, args)
    return None if broken > HELD else (v, value)


def _exact(v: np.ndarray, args: tuple[Any, ...]) -> tuple[np.ndarray, float, float]:
    """Variables with the levels that the others give; the objective; and by how much a jump exceeds its limit."""
    _, limit, kind = args
    levels, jumps = jax.tree.map(np.asarray, storages_and_jumps(v, *_Functions(*args).given))
    level, value = (levels, np.exp(levels).sum()) if kind.objective == "sum" else ([levels.max()], np.exp(levels.max()))
    over = float(np.abs(jumps).max()) - float(limit) if kind.limited else 0.0
    return np.concatenate([v[: 2 * kind.k], level]), float(value), over


def _settled(v: np.ndarray, *args: Any) -> _Point:
    """The stationary point next to the end of a search: Newton's method on the conditions of its active constraints.

    A constraint nearly met counts as active if it is needed to balance the objective's slope. Where the point that
    this leads to breaks a constraint or needs a negative multiplier, the search's own end stands.
    """
    kind, dtype = args[-1], args[0].near.dtype
    num, k = len(v), kind.k
    fixed = np.zeros(num, bool)
    bends = slice(k, 2 * k)
    # A uniform map is at the bound itself, not somewhere within the search's rounding of it.
    v[bends] = np.where(v[bends] < 1e-6, LEAST_BEND, v[bends])
    fixed[bends] = (v[bends] < 1e-6) | (v[bends] > 1 - 1e-8) | (kind.warp != "free")
    trial = _balanced(v, fixed, NEARLY, args)
    z = np.concatenate([trial.v, trial.forces])
    for _ in range(STEPS):
        rest, slopes = condition_and_slope(
            jnp.asarray(z, dtype), *args[:2], jnp.asarray(v, dtype), jnp.asarray(trial.holds), jnp.asarray(fixed), kind
        )
        if not (np.isfinite(rest).all() and np.isfinite(slopes).all()):
            # Newton has left for where the storage overflows: the search's own end stands.
            z = np.full_like(z, np.nan)
            break
        # Least squares instead of a solve: with redundant active constraints the multipliers are not unique.
        z = z - np.linalg.lstsq(np.asarray(slopes, np.float64), np.asarray(rest, np.float64))[0]
    new, value, _ = _exact(z[:num], args) if np.isfinite(z).all() else (v, math.inf, 0.0)
    forces = z[num:-1][trial.holds]
    better = _balanced(new, fixed, HELD, args)
    # Newton may have left for another stationary point: it must keep the constraints, the signs and the objective.
    kept = better.violation <= HELD and value <= _exact(v, args)[1] * (1 + 1e-6) and (forces >= -1e-9).all()
    if kept and better.residual <= _balanced(v, fixed, HELD, args).residual:
        return better._replace(v=new, forces=z[num:], holds=trial.holds)
    return _balanced(v, fixed, HELD, args)


def _balanced(v: np.ndarray, fixed: np.ndarray, slack: float, args: tuple[Any, ...]) -> _Point:
    """Multipliers ≥ 0 of the constraints with at most some slack that best balance the objective's slope.

    The slack is relative to what the levels, logarithms themselves, can move: to 1.
    """
    k = args[-1].k
    (_, held), (slope, slopes) = _Functions(*args)(v)
    sums = np.concatenate([np.ones(k), np.zeros(len(v) - k)])
    near = np.flatnonzero(held < slack)
    # Stationarity as nonnegative least squares: inequality multipliers ≥ 0; the equality's is free, so it enters with
    # both signs; a fixed variable balances its own component.
    columns = [*slopes[near], sums, -sums, *np.eye(len(v))[fixed]]
    forces, rest = nnls(np.stack(columns, axis=-1), slope)
    held_by = np.zeros(len(held) + 1)
    held_by[near], held_by[-1] = forces[: len(near)], forces[len(near)] - forces[len(near) + 1]
    # Strictly active only: a constraint that is met but pulls nothing would make the derivative's system singular.
    holds = held_by[:-1] > 1e-9 * np.linalg.norm(slope)
    if fixed.any() and holds.any():
        # Between uniform maps both errors jump alike: constraints that differ in what is fixed alone are one. Holding
        # both would leave their multipliers without an answer. A solution of nnls has independent columns.
        kept = np.flatnonzero(holds)
        columns = np.stack([*slopes[kept], sums, -sums], axis=-1)[~fixed]
        shares, _ = nnls(columns, slope[~fixed])
        held_by[:-1][kept], held_by[-1] = shares[: len(kept)], shares[len(kept)] - shares[len(kept) + 1]
        holds = held_by[:-1] > 1e-9 * np.linalg.norm(slope)
    residual = np.asarray(rest / np.linalg.norm(slope))
    return _Point(v, held_by, holds, fixed, residual, np.asarray(max(0.0, -float(held.min()))))


@eqx.filter_jit
def _all_reports(views: LightFrustum, limits: Array, points: _Point, kind: Problem) -> JointSlices:
    return jax.vmap(lambda view, limit, point: _report(view, limit, point, kind))(views, limits, points)


_REFUSED = (
    "planes and near distances have no derivative here: the search has not converged, or equally good ones lie "
    "next to them; see the certificate, move the view a little, or differentiate another objective"
)


def _variables(view: LightFrustum, limit: Array, point: Any, kind: Problem, settled: Array) -> Array:
    """The variables, with the derivative of the stationary point that they are."""
    start, holds, fixed = point.v, point.holds, point.fixed

    def condition(z: Array) -> Array:
        return condition_of(z, view, limit, start, holds, fixed, kind)

    def tangent(linear: Any, change: Array) -> Array:
        # The linearised conditions as a matrix: a few dozen unknowns, solved densely.
        matrix = jax.jacfwd(linear)(jnp.zeros_like(change))
        # A singular system has no derivative to give: equally good optima lie along its null space.
        spread = jnp.linalg.svd(matrix, compute_uv=False)
        singular = spread[-1] <= 100 * float(jnp.finfo(change.dtype).eps) * spread[0]
        matrix = eqx.error_if(matrix, singular | ~settled, _REFUSED)
        return jnp.linalg.solve(matrix, change)

    z = jax.lax.custom_root(condition, jnp.concatenate([start, point.forces]), lambda _, z: z, tangent)
    return z[: start.shape[0]]


def _report(view: LightFrustum, limit: Array, point: Any, kind: Problem) -> JointSlices:
    """Planes, near distances and certificate of the best variables of one view."""
    k, section = kind.k, kind.section
    single = view.near.dtype == jnp.float32
    converged = (point.residual < (1e-3 if single else 1e-6)) & (point.violation <= (1e-4 if single else HELD))
    v = _variables(view, limit, point, kind, converged)
    log_ratios = v[:k]
    parts = similar(view, log_ratios)
    distance = distances_of(parts, v[k : 2 * k], kind.warp, section)

    def jump(parts: LightFrustum, distance: Array) -> Array:
        return jnp.exp(jnp.max(jnp.abs(log_jumps(parts, distance)), initial=0.0))

    storage = total(storage_factor(parts, distance, section), kind.objective)
    # The published choice on the same view: equal ratios, n' of eq. 42 with 44.
    alike = similar(view, jnp.full_like(log_ratios, 1 / k) * jnp.sum(log_ratios))
    rule = "least_storage" if kind.warp == "free" else kind.warp
    certificate = JointCertificate(
        residual=point.residual,
        violation=point.violation,
        seam_jump=jump(parts, distance),
        seam_limited=jnp.any(point.holds[8 * k :]),
        published_jump=jump(alike, WARPS["lispsm"](alike, section)),
        starts=_num_starts(kind),
    )
    baselines = equal_ratios(view, k, kind.objective, rule, section)
    value = Slices.between(view, log_ratios, distance)
    # What no step lowers any more and is not stationary to the precision of the numbers.
    result = ended(converged, optx.RESULTS.stagnation)
    return Solution(value, storage, baselines, certificate, result, view, SLICES_KIND)


__all__ = ["JOINT_WARPS", "JointCertificate", "JointSlices", "joint_splits"]
