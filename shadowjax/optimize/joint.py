"""Planes and near distances together, with or without a limit on the jump of the error at the seams."""

import math
from collections.abc import Iterator
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from scipy.optimize import minimize, nnls

from shadowjax._checked import Checked, checked
from shadowjax._checks import require, require_choice, require_int
from shadowjax._types import Array, ArrayLike, Float
from shadowjax.optimize.splits import WARPS
from shadowjax.warps.light_frustum import SECTIONS, LightFrustum, Section
from shadowjax.warps.prediction import error_x, error_z, storage_factor

OBJECTIVES = ("max", "sum")
JOINT_WARPS = ("free", *WARPS)
RANDOM_STARTS = 16
ACTIVE = 1e-6  # slack of a constraint, in ln, below which it counts as active


class JointCertificate(Checked):
    """Why the planes and near distances are optimal.

    Attributes:
        residual: What is left of the objective's slope after the active constraints' multipliers have taken their part
            (Karush–Kuhn–Tucker), relative to that slope; 0 at a stationary point.
        violation: Largest excess of a constraint, in ln of a storage or of a jump; at most rounding.
        seam_jump: Largest jump of m_x or m_z on the view axis at a cut.
        seam_limited: Whether the limit is what holds the optimum.
        equal: Objective of equal ratios (warping, eq. 50) with the same warp, its n' the closed form if free.
        published: Objective of equal ratios with n' of eq. 42 and 44.
        published_jump: Their largest jump: they may break the limit.
        gain: `published` over the objective found; below 1 where only the limit makes it worse.
        starts: How many starting points the search had.
    """

    residual: float
    violation: float
    seam_jump: float
    seam_limited: bool
    equal: float
    published: float
    published_jump: float
    gain: float
    starts: int


class JointSplits(Checked):
    """The best planes and near distances of a view and a light.

    Attributes:
        splits: k + 1 planes, world units, n and f included.
        near_distances: n' of every slice, world units; huge for a uniform map.
        storage: Sum or maximum of the slices' storage factors.
        certificate: Evidence that it is optimal.
    """

    splits: Float[Array, "planes"]
    near_distances: Float[Array, "slices"]
    storage: Float[Array, ""]
    certificate: JointCertificate

    def to_json(self) -> dict[str, Any]:
        """Plain numbers, as `optimize splits` writes them."""
        return {
            "splits": self.splits.tolist(),
            "storage": self.storage.tolist(),
            "near_distances": self.near_distances.tolist(),
            "certificate": dict(vars(self.certificate)),
        }


def _slices(view: LightFrustum, log_ratios: Array) -> LightFrustum:
    """Similar slices of near distance 1."""
    one = jnp.ones_like(log_ratios)
    return LightFrustum(one, jnp.exp(log_ratios), one * view.phi_y, one * view.phi_x, one * view.gamma)


def _distances(parts: LightFrustum, bend: Array, warp: str, section: Section) -> Array:
    """n' of slices: by rule, or W(1 − b)/b of free bends b = W/(n' + W) in (0, 1), of which 0 is the uniform map."""
    if warp != "free":
        return WARPS[warp](parts, section)
    return parts.bounded(parts.extent * (1 - bend) / bend)


@checked
def log_storages(frustum: LightFrustum, near_distance: Array, section: Section) -> Float[Array, "slices 8"]:
    """ln of the eight smooth functions whose largest is a slice's S: near or far worst point for x and z, and width.

    Their maximum is smooth nowhere that matters, so the optimiser is given all eight as constraints.
    """
    strength = 1 / near_distance
    offset, slope = frustum.worst_line(section)
    stretches = 1 + offset * strength, 1 + (offset + slope * (frustum.far - frustum.near)) * strength
    depths = frustum.near, frustum.far
    widths = (
        frustum.near / (1 + strength * frustum.low_near),
        frustum.far / (1 + strength * frustum.low_far),
    )
    texel = frustum.extent / (1 + frustum.extent * strength) / (2 * frustum.tan_y)
    out = []
    for width in widths:
        for stretch_x, depth_x in zip(stretches, depths, strict=True):
            for stretch_z, depth_z in zip(stretches, depths, strict=True):
                out.append(jnp.log(width * stretch_x / depth_x * texel * stretch_z * stretch_z / depth_z))
    return jnp.stack(out, axis=-1)


@checked
def log_jumps(parts: LightFrustum, distance: Array) -> Float[Array, "cuts 2"]:
    """ln of the error after over the error before each cut, for m_x and m_z on the view axis, of similar slices."""

    def jump(error: Any) -> Array:
        # seen from the cut, both slices have it at depth 1: errors of similar slices do not depend on scale
        return jnp.log(error(parts, distance, parts.near)[1:] / error(parts, distance, parts.far)[:-1])

    return jnp.stack([jump(error_x), jump(error_z)], axis=-1)


@eqx.filter_jit
def _problem(
    v: Array, view: LightFrustum, limit: Array, k: int, objective: str, warp: str, section: Section, limited: bool
) -> tuple[Any, Any]:
    """Value and slope of the objective, and values and slopes of all constraints (≥ 0), at log ratios, bends, ln S."""

    def functions(v: Array) -> tuple[Array, Array]:
        log_ratios, bend, level = v[:k], v[k : 2 * k], v[2 * k :]
        parts = _slices(view, log_ratios)
        distance = _distances(parts, bend, warp, section)
        above = level[:, None] - log_storages(parts, distance, section)
        held = [above.reshape(-1)]
        if limited:
            jumps = log_jumps(parts, distance)
            held += [(limit - jumps).reshape(-1), (limit + jumps).reshape(-1)]
        worst = level[0] if objective == "max" else jax.nn.logsumexp(level)
        return worst, jnp.concatenate(held)

    return functions(v), jax.jacfwd(functions)(v)


def _starts(view: LightFrustum, k: int, limit: float, limited: bool, free: bool) -> Iterator[tuple[Any, Any]]:
    """Log ratios and bends to start from; bends None for those of the closed form.

    Equal ratios, one slice longer or shorter, all but the first at the limit; under a limit on free n', where optima
    are many, also strong warps and random ones from a fixed seed.
    """
    span = float(jnp.log(view.far / view.near))
    equal = np.full(k, span / k)
    yield equal, None
    for power in (0.5, 1.0, 2.0) if limited else ():
        rest = np.full(k, min(power * limit, 0.9 * span / k))
        rest[0] = span - rest[1:].sum()
        yield rest, None
    for factor in (0.4, 2.0) if k > 1 else ():
        for place in (0, k - 1):
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
    seam_limit: float | None = None,
    section: str = "axis",
) -> JointSplits:
    """The planes of k depth slices, and the n' of each, of least storage, under a limit on the jump at seams.

    The problem is smooth once every slice's storage is a variable above the eight smooth functions whose maximum it
    is. Sequential quadratic programming from several starts, with exact derivatives, solves it; the certificate says
    how stationary the result is. Run it with 64-bit floats: with 32 the residual is large.

    Args:
        near: Depth n, world units, > 0.
        far: Depth f, world units, > near.
        phi: Half the vertical angle of view, radians, in (0, π/2).
        gamma: Angle between light and view, radians, in [0, π/2].
        num_partitions: k ≥ 1.
        objective: "sum", all texels, or "max", the largest slice's.
        warp: "free" to choose every n'; or a rule of `shadowjax.optimize.splits.WARPS`.
        seam_limit: Largest factor, > 1, by which m_x and m_z may change at a cut on the view axis; none if None.
        section: "axis" or "whole" vertical section, over which errors are taken.

    Raises:
        ValueError: If a number is out of range, a name unknown, or no planes keep the limit.

    Source: warping, eq. 50, 51 and 55, and the text on seams; the optimum is derived here.
    """
    require_choice(objective, "objective", OBJECTIVES)
    require_choice(warp, "warp", JOINT_WARPS)
    require(seam_limit is None or seam_limit > 1, f"seam_limit, a factor, must exceed 1; got {seam_limit}")
    checked: Section = require_choice(section, "section", SECTIONS)
    view = LightFrustum.create(near, far, phi, gamma)
    require(view.near.ndim == 0, "joint_splits solves one view at a time; give single numbers")
    k = require_int(num_partitions, "the number of partitions k", 1)
    limited = seam_limit is not None and k > 1
    limit = math.log(seam_limit) if seam_limit is not None else 0.0
    args = (view, jnp.asarray(limit, view.near.dtype), k, objective, warp, checked, limited)
    best, num_starts = None, 0
    for log_ratios, bend in _starts(view, k, limit, limited, warp == "free"):
        num_starts += 1
        found = _solve(log_ratios, bend, *args)
        if found is not None and (best is None or found[1] < best[1] * (1 - 1e-12)):
            best = found
    require(
        best is not None,
        f"no {k} slices found whose error jumps by at most {seam_limit} at every cut; "
        "raise seam_limit or num_partitions",
    )
    assert best is not None
    return _report(best[0], num_starts, *args)


def _at(v: np.ndarray, args: tuple[Any, ...]) -> tuple[tuple[float, np.ndarray], tuple[np.ndarray, np.ndarray]]:
    """Value and constraints, and their slopes, as NumPy arrays."""
    dtype = args[0].near.dtype
    (value, held), (slope, slopes) = jax.tree.map(np.asarray, _problem(jnp.asarray(v, dtype), *args))
    as_double = lambda x: np.asarray(x, np.float64)  # noqa: E731
    return (float(value), as_double(held)), (as_double(slope), as_double(slopes))


def _solve(start: np.ndarray, bend: np.ndarray | None, *args: Any) -> tuple[np.ndarray, float] | None:
    """Variables and exact objective from one start; None where the result breaks the limit."""
    view, limit, k, objective, warp, section, limited = args
    dtype = view.near.dtype
    parts = _slices(view, jnp.asarray(start, dtype))
    if bend is None:
        distance = WARPS["least_storage" if warp == "free" else warp](parts, section)
        bend = np.asarray(parts.extent / (parts.extent + distance), np.float64)
    else:
        distance = _distances(parts, jnp.asarray(bend, dtype), warp, section)
    level = np.max(np.asarray(log_storages(parts, distance, section), np.float64), axis=-1)
    level = level if objective == "sum" else np.asarray([level.max()])
    v = np.concatenate([start, np.clip(bend, 1e-9, 1 - 1e-9), level])
    span = float(np.log(float(view.far / view.near)))
    sums = np.concatenate([np.ones(k), np.zeros(len(v) - k)])
    bounds = [(1e-3 * span / k, span)] * k + [(1e-12, 1 - 1e-9)] * k + [(-60.0, 60.0)] * len(level)
    found: Any = minimize(
        lambda x: (_at(x, args)[0][0], _at(x, args)[1][0]), v, jac=True, method="SLSQP", bounds=bounds,
        constraints=[
            {"type": "eq", "fun": lambda x: sums @ x - span, "jac": lambda x: sums},
            {"type": "ineq", "fun": lambda x: _at(x, args)[0][1], "jac": lambda x: _at(x, args)[1][1]},
        ],
        options={"maxiter": 300, "ftol": 1e-15},
    )  # fmt: skip
    v = np.asarray(found.x)
    v[:k] *= span / v[:k].sum()
    parts = _slices(view, jnp.asarray(v[:k], dtype))
    distance = _distances(parts, jnp.asarray(v[k : 2 * k], dtype), warp, section)
    each = np.asarray(storage_factor(parts, distance, section))
    if limited and float(jnp.max(jnp.abs(log_jumps(parts, distance)))) > float(limit) + 1e-7:
        return None
    return v, float(np.sum(each) if objective == "sum" else np.max(each))


def _report(v: np.ndarray, num_starts: int, *args: Any) -> JointSplits:
    """Planes, near distances and certificate of the best variables."""
    view, limit, k, objective, warp, section, limited = args
    dtype = view.near.dtype
    log_ratios = jnp.asarray(v[:k], dtype)
    parts = _slices(view, log_ratios)
    distance = _distances(parts, jnp.asarray(v[k : 2 * k], dtype), warp, section)

    def total(each: Array) -> Array:
        return jnp.sum(each) if objective == "sum" else jnp.max(each)

    def jump(parts: LightFrustum, distance: Array) -> float:
        return math.exp(float(jnp.max(jnp.abs(log_jumps(parts, distance)), initial=0.0)))

    storage = total(storage_factor(parts, distance, section))
    levels = jnp.max(log_storages(parts, distance, section), axis=-1)
    v = np.concatenate([v[: 2 * k], np.asarray(levels if objective == "sum" else levels.max()[None], np.float64)])
    (_, held), (slope, slopes) = _at(v, args)
    similar = _slices(view, jnp.full_like(log_ratios, float(jnp.mean(log_ratios))))
    rule = "least_storage" if warp == "free" else warp
    equal = total(storage_factor(similar, WARPS[rule](similar, section), section))
    old = WARPS["lispsm"](similar, section)
    published = total(storage_factor(similar, old, section))
    biggest = jump(parts, distance)
    certificate = JointCertificate(
        residual=_stationarity(v, k, held, slope, slopes),
        violation=max(0.0, -float(held.min())),
        seam_jump=biggest,
        seam_limited=bool(limited and math.log(biggest) > float(limit) - ACTIVE),
        equal=float(equal),
        published=float(published),
        published_jump=jump(similar, old),
        gain=float(published / storage),
        starts=num_starts,
    )
    inner = view.near * jnp.exp(jnp.cumsum(log_ratios))
    planes = jnp.concatenate([view.near[None], inner]).at[-1].set(view.far)
    return JointSplits(planes, distance * planes[:-1], storage, certificate)


def _stationarity(v: np.ndarray, k: int, held: np.ndarray, slope: np.ndarray, slopes: np.ndarray) -> float:
    """Least norm of slope − Σ multipliers · active slopes with multipliers ≥ 0, relative to the slope."""
    unit = np.eye(len(v))
    sums = np.concatenate([np.ones(k), np.zeros(len(v) - k)])
    columns = [*slopes[held < ACTIVE], sums, -sums]
    columns += [unit[i] for i in range(k, 2 * k) if v[i] < 1e-6]  # bends at 0: uniform maps
    _, rest = nnls(np.stack(columns, axis=-1), slope)
    return float(rest / np.linalg.norm(slope))


__all__ = ["JOINT_WARPS", "OBJECTIVES", "JointCertificate", "JointSplits", "joint_splits", "log_jumps", "log_storages"]
