"""Ledger beyond the warping chapter: optimal n' in closed form, what the published n' lose, and best slices."""

import math
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from scipy.optimize import minimize, minimize_scalar

from shadowjax.evaluate.measure import frustum_corners, light_axes, warp_matrix, warp_point
from shadowjax.ledger import brute
from shadowjax.ledger.equation import Equation
from shadowjax.ledger.inputs import Inputs, Unavailable
from shadowjax.ledger.warping.choices import plain
from shadowjax.ledger.warping.tools import derived_storage, equal_errors, equation, frustum, root
from shadowjax.theory.aliasing import near_distances
from shadowjax.theory.aliasing.error import max_error_z, storage_factor
from shadowjax.theory.aliasing.light_frustum import LightFrustum, Section
from shadowjax.theory.aliasing.optimal import minimax
from shadowjax.theory.aliasing.split_search import best_shares

VIEW = {"n": 0.7, "f": 53, "phi_y_deg": 33}
SWEEP = tuple({**VIEW, "gamma_deg": g} for g in (85, 50, 33, 31, 20, 6))
SECTIONS: dict[str, Section] = {"onaxis": "axis", "full": "whole"}


@jax.jit
def _map_errors(view: LightFrustum, distance: jax.Array, heights: jax.Array) -> jax.Array:
    """m_z on the lines y = height·z at the near and the far plane, from derivatives of the matrix map."""
    matrix, axes = warp_matrix(view, distance), light_axes(view.gamma)

    def one(z: jax.Array, slope: jax.Array) -> jax.Array:
        point = jnp.stack([jnp.zeros_like(z), slope * z, z])
        # dt/dz' of the matrix map at the point; m_z is its inverse over the pixel's width.
        rate = jax.jvp(lambda u: warp_point(matrix, point + u * axes[2]), (jnp.zeros_like(z),), (jnp.ones_like(z),))[1]
        return 1 / (rate[1] * 2 * z * view.tan_y)

    return jnp.max(jax.vmap(lambda z: jax.vmap(lambda s: one(z, s))(heights))(jnp.stack([view.near, view.far])))


def _map_worst(view: LightFrustum, distance: float, section: Section) -> float:
    """M_z by looking at the matrix map: the axis, or 9 heights of the whole section."""
    heights = view.tan_y * (jnp.linspace(-1, 1, 9) if section == "whole" else jnp.zeros(9))
    return float(_map_errors(view, jnp.asarray(distance), heights))


def _golden(i: Inputs, section: Section) -> tuple[float, float]:
    """n' and M_z of the numeric minimax of the matrix map; at a kink the search is good to 1e-8 and no more."""
    view = frustum(i)
    # In ln n', from 10⁻⁴·n to 10⁴·f.
    found: Any = minimize_scalar(
        lambda x: _map_worst(view, math.exp(x), section),
        bounds=(math.log(1e-4 * float(view.near)), math.log(1e4 * float(view.far))), method="bounded",
        options={"xatol": 1e-11, "maxiter": 300},
    )  # fmt: skip
    return math.exp(float(found.x)), float(found.fun)


def _best(i: Inputs):
    return minimax(frustum(i), SECTIONS[i.text("section", "onaxis")])


def _least(i: Inputs):
    section = SECTIONS[i.text("section", "onaxis")]
    return max_error_z(frustum(i), minimax(frustum(i), section), section)


def _published(view: LightFrustum, rule: str):
    if rule == "Wimmer":
        return near_distances.wimmer_over_sine(view)
    return near_distances.generalised(view, "sine" if rule.endswith("43") else "squared")


def _loss(view: LightFrustum, rule: str, section: Section):
    return max_error_z(view, _published(view, rule), section) / max_error_z(view, minimax(view, section), section)


def _ratio(i: Inputs):
    return _loss(frustum(i), i.text("rule"), SECTIONS[i.text("section")])


def _worst_ratio(i: Inputs):
    """The loss at the γ of a row, if γ's last digit decides nothing; the largest loss if the row names no γ."""
    if "gamma_deg" not in i:
        return _peak(i)
    section, rule, gamma = SECTIONS[i.text("section")], i.text("rule"), i.angle("gamma_deg")
    # Half a unit of the last digit to either side shows whether it decides anything.
    rounding = math.radians(0.5e-6)  # such rows spell γ with six decimals of a degree
    loss = np.asarray(_loss(_fan(i, gamma + rounding * np.asarray([-1.0, 0.0, 1.0])), rule, section))
    spread = float(np.max(np.abs(loss / loss[1] - 1)))
    if "." in i.text("gamma_deg") and spread > 1e-9:
        raise Unavailable(f"γ is rounded, which alone moves the ratio by {spread:.0e}")
    return loss[1]


def _ratio_matrix(i: Inputs) -> float:
    section = SECTIONS[i.text("section")]
    distance = float(brute.published(plain(i), i.text("rule")))
    return _map_worst(frustum(i), distance, section) / _golden(i, section)[1]


def _fan(i: Inputs, gammas: np.ndarray) -> LightFrustum:
    """The row's view under many lights."""
    view = frustum(i, 90.0)
    gamma = jnp.minimum(jnp.asarray(gammas), jnp.asarray(math.pi / 2))
    near, far, phi_y, phi_x = (jnp.broadcast_to(x, gamma.shape) for x in (view.near, view.far, view.phi_y, view.phi_x))
    return LightFrustum(near, far, phi_y, phi_x, gamma)


def _scan(i: Inputs, count: int = 4000) -> float:
    """Largest loss over `count` evenly spaced γ from 0.002 rad to γ_lim, both included."""
    limit = float(frustum(i, 90.0).gamma_limit)
    loss = _loss(_fan(i, np.linspace(0.002, limit, count)), i.text("rule"), SECTIONS[i.text("section")])
    return float(jnp.max(loss))


def _scan_brute(i: Inputs, count: int = 4000) -> float:
    """The same in NumPy: least errors by golden section, published n' as printed."""
    section, rule = SECTIONS[i.text("section")], i.text("rule")
    limit = float(brute.touching(plain(i, np.zeros(()))))
    view = plain(i, np.linspace(0.002, limit, count))
    best = brute.least(
        lambda q: brute.max_error_z(view, q, section, depths=2), 1e-3 * float(view.near), 1e9 * float(view.far),
        view.gamma.shape,
    )  # fmt: skip
    return float(np.max(brute.max_error_z(view, brute.published(view, rule), section) / best))


def _peak(i: Inputs) -> float:
    """The same, refined around the best of 400 steps."""
    limit = float(frustum(i, 90.0).gamma_limit)
    rule, section = i.text("rule"), SECTIONS[i.text("section")]
    steps = limit * np.arange(1, 401) / 400
    values = np.asarray(_loss(_fan(i, steps), rule, section))
    # Between the neighbours of the best step, 2001 finer ones.
    near = steps[max(int(np.argmax(values)) - 1, 0)], min(steps[int(np.argmax(values))] + limit / 400, limit)
    fine = np.linspace(*near, 2001)
    return float(jnp.max(_loss(_fan(i, fine), rule, section)))


def _penalty(i: Inputs) -> float:
    """Loss over the whole section of n'₁ at γ_lim, as a function of r = f/n alone."""
    # Lengths in units of n·tan φ·cos γ_lim. There the far plane's top decides over the whole section, where M_z ∝ 1 +
    # W/n'; `full` is the n' that equalises both tops.
    r = i.number("f_over_n")
    q = math.sqrt(r) - 1
    first, full, extent = (r - math.sqrt(r) + 2) / q, 2 * (r - math.sqrt(r) + 1) / q, 2 * (r + 1)
    return (1 + extent / first) / (1 + extent / full)


def _penalty_matrix(i: Inputs) -> float:
    row = i.merged({"phi_y_deg": 25})
    at = row.merged({"gamma_deg": math.degrees(float(frustum(row, 90.0).gamma_limit))})
    view = frustum(at)
    return _map_worst(view, equal_errors(view), "whole") / _golden(at, "whole")[1]


def _switch(i: Inputs) -> float:
    """γ below which the near plane alone decides the minimax, in degrees, from a quadratic in tan γ."""
    view = frustum(i, 90.0)
    n, f, tan = (float(x) for x in (view.near, view.far, view.tan_y))
    a, b, length, mean = n * tan, f * tan, f - n, math.sqrt(n * f)
    if i.text("section") == "onaxis":
        return math.degrees(math.atan(tan / math.sqrt((1 - n / f) * (1 + math.sqrt(n / f)))))
    # E·W = q·(W − 2E) with E = a + b − L·u, W = 2b, q = (√(fn) + f)u + (√(fn) − f)·tan φ, u = tan γ
    first, second = mean + f, (mean - f) * tan
    p, q, r = length * first, length * (second + b) - a * first, -a * second - (a + b) * b
    return math.degrees(math.atan((-q + math.sqrt(q * q - 4 * p * r)) / (2 * p)))


def _switch_root(i: Inputs) -> float:
    section = SECTIONS[i.text("section")]

    def difference(gamma: float) -> float:
        view = frustum(i, gamma=gamma)
        offset, _ = view.worst_line(section)
        return float(near_distances.equalising(view, section) * view.slack(section) - offset * view.extent)

    return math.degrees(root(difference, 1e-6, float(frustum(i, 90.0).phi_y)))


def _uniform_limit(i: Inputs) -> float:
    view = frustum(i, 90.0)
    return math.degrees(math.atan(float(view.near * view.tan_y / (view.far - view.near))))


def _uniform_limit_corners(i: Inputs) -> float:
    """γ at which the top of the near plane reaches the middle of the extent, from the corners."""

    def gap(gamma: float) -> float:
        high = np.asarray(frustum_corners(frustum(i, gamma=gamma)) @ light_axes(jnp.asarray(gamma))[2])
        return 2 * (float(high[:4].max()) - float(high.min())) - float(high.max() - high.min())

    return math.degrees(root(gap, 1e-9, 1.5))


def _storage(i: Inputs):
    view, rule = frustum(i), i.text("rule", "42_44")
    if rule == "uniform":
        return storage_factor(view, near_distances.uniform(view))
    return storage_factor(view, minimax(view) if rule == "minimax" else _published(view, rule))


def _storage_matrix(i: Inputs) -> float:
    view, rule = frustum(i), i.text("rule", "42_44")
    if rule == "uniform":
        wide = 1e5 * float(view.far)
        return 2 * derived_storage(view, 2 * wide) - derived_storage(view, wide)
    alone = plain(i)
    return derived_storage(view, float(brute.minimax(alone) if rule == "minimax" else brute.published(alone, rule)))


def _excess(i: Inputs, gammas: np.ndarray):
    """Storage of 42 + 44 over that of the uniform map."""
    view = _fan(i, gammas)
    return np.asarray(
        storage_factor(view, near_distances.generalised(view)) / storage_factor(view, near_distances.uniform(view))
    )


def _crossover(i: Inputs) -> float:
    limit = float(frustum(i, 90.0).gamma_limit)
    steps = np.linspace(1e-3, 1, 500) * limit
    last = int(np.flatnonzero(_excess(i, steps) > 1)[-1])
    ends = float(steps[last]), float(steps[last + 1])
    return math.degrees(root(lambda g: _excess(i, np.asarray([g]))[0] - 1, *ends))


def _crossover_matrix(i: Inputs) -> float:
    near = math.radians(_crossover(i))

    def difference(gamma: float) -> float:
        view = frustum(i, gamma=gamma)
        wide = 1e5 * float(view.far)
        uniform = 2 * derived_storage(view, 2 * wide) - derived_storage(view, wide)
        return derived_storage(view, float(brute.published(plain(i, gamma), "44"))) / uniform - 1

    return math.degrees(root(difference, near * 0.98, near * 1.02))


def _largest_excess(i: Inputs) -> float:
    return float(np.max(_excess(i, np.radians(np.arange(0.25, 90.01, 0.25)))))


def _largest_excess_matrix(i: Inputs) -> float:
    gammas = np.arange(0.25, 90.01, 0.25)
    worst = float(gammas[int(np.argmax(_excess(i, np.radians(gammas))))])
    row = {k: v for k, v in i.items() if k != "gamma_deg"} | {"gamma_deg": worst}
    pair = [_storage_matrix(Inputs({**row, "rule": rule})) for rule in ("42_44", "uniform")]
    return pair[0] / pair[1]


RULES = {
    "lispsm": near_distances.generalised,
    # as in the reference values, n' = 1e10·n stands for ∞ here: 2e-9 below the limit
    "uniform": lambda part: 1e10 * part.near,
    "minimax": minimax,
}


def _slice_cost(i: Inputs):
    """Storage of a slice of the row's view as a function of ln(f_i/n_i)."""
    view, rule = frustum(i), RULES[i.text("mode")]

    def cost(log_ratio: np.ndarray) -> np.ndarray:
        one = jnp.ones(np.shape(log_ratio))
        part = LightFrustum(one, jnp.exp(jnp.asarray(log_ratio)), one * view.phi_y, one * view.phi_x, one * view.gamma)
        return np.asarray(storage_factor(part, rule(part)))

    return cost


def _partition(i: Inputs) -> float:
    view = frustum(i)
    log_ratio = float(jnp.log(view.far / view.near))
    return best_shares(_slice_cost(i), log_ratio, i.integer("k"), i.text("objective"))[1]


def _partition_searched(i: Inputs) -> float:
    """Storages in NumPy, with shares found by a simplex search."""
    k, mode = i.integer("k"), i.text("mode")
    whole = plain(i)
    log_ratio = math.log(float(whole.far / whole.near))
    rules = {
        "lispsm": lambda v: brute.published(v, "44"),
        "minimax": brute.minimax,
        "uniform": lambda v: 1e10 * v.near,
    }

    def total(logits: np.ndarray) -> float:
        shares = np.exp(np.append(logits, 0.0))
        part = whole._replace(
            near=np.ones(k), far=np.exp(shares / shares.sum() * log_ratio), gamma=whole.gamma + np.zeros(k)
        )
        each = brute.storage(part, rules[mode](part))
        return float(each.max() if i.text("objective") == "max" else each.sum())

    # order does not matter: from equal shares, and from one share that is smaller than the others
    starts = np.zeros((2, k - 1))
    starts[1, 0] = -0.7
    options = {"xatol": 1e-9, "fatol": 1e-13, "maxiter": 400}
    found: list[Any] = [minimize(total, start, method="Nelder-Mead", options=options) for start in starts]
    return min(float(one.fun) for one in found)


_WHERE = "beyond eq. 42"

EQUATIONS: tuple[Equation, ...] = (
    *(equation(
        f"beyond.nprime_minimax_{name}", _WHERE, "n' of least M_z for any γ: max(equalising n', E·W/(W − 2E)).", _best,
        (*SWEEP, {**VIEW, "gamma_deg": 33.2}),
        independent=lambda i: _golden(i, SECTIONS[i.text("section")])[0], tolerance=1e-5,
        pattern=rf"warping\.beyond\.nprime_minimax_(?P<section>{name})",
    ) for name in SECTIONS),
    *(equation(
        f"beyond.M_minimax_{name}", _WHERE, "Least M_z over all n'.", _least, SWEEP,
        independent=lambda i: _golden(i, SECTIONS[i.text("section")])[1], tolerance=1e-7,
        pattern=rf"warping\.beyond\.M_minimax_(?P<section>{name})",
    ) for name in SECTIONS),
    *(equation(
        f"beyond.ratio_{rule}_over_opt_{name}", _WHERE, "Largest z error of a published n' over the least.", _ratio,
        SWEEP[:5], independent=_ratio_matrix, tolerance=1e-7,
        pattern=rf"warping\.beyond\.ratio_(42_)?(?P<rule>{rule})_over_opt_(?P<section>{name})",
    ) for rule in ("43", "44", "Wimmer") for name in SECTIONS),
    *(equation(
        f"beyond.{name}_switch_gamma_deg", _WHERE, "γ below which the near plane alone decides the minimax, degrees.",
        _switch, (VIEW, {"n": 1, "f": 20, "phi_y_deg": 45}), independent=_switch_root,
        pattern=rf"warping\.beyond\.(?P<section>{name})_switch_gamma_deg",
    ) for name in SECTIONS),
    equation(
        "beyond.full_uniform_gamma_deg", _WHERE,
        "γ below which the uniform map is best over the whole section, degrees.",
        _uniform_limit, (VIEW, {"n": 1, "f": 3, "phi_y_deg": 45}), independent=_uniform_limit_corners,
    ),
    *(equation(
        f"beyond.worst_{name}_{rule}", _WHERE,
        "Largest loss of the published n' over 4000 evenly spaced γ up to γ_lim.", _scan,
        ({"n": 1, "f_over_n": 30, "phi_y_deg": 25},), independent=_scan_brute,
        pattern=rf"warping\.beyond\.worst_(?P<section>{name})_(?P<rule>{rule})",
    ) for rule in ("43", "44") for name in SECTIONS),
    *(equation(
        f"beyond.worst_ratio_{rule}_{name}", _WHERE, "Loss of the published n' at the γ where it is largest.",
        _worst_ratio, ({"n": 1, "f": 30, "phi_y_deg": 25, "gamma_deg": 19},),
        independent=_ratio_matrix, tolerance=1e-7,
        pattern=rf"warping\.beyond\.worst_ratio_(?P<rule>{rule})_(?P<section>{name})",
    ) for rule in ("43", "44") for name in SECTIONS),
    equation(
        "beyond.full_penalty_at_lim", _WHERE,
        "Loss of n'₁ over the whole section at γ_lim; it tends to 2 as f/n grows.",
        _penalty, ({"f_over_n": 3}, {"f_over_n": 300}), independent=_penalty_matrix, tolerance=1e-7,
    ),
    *(equation(
        f"beyond.S_{rule}", "beyond eq. 31", "S on the view axis for any γ.", _storage, SWEEP,
        independent=_storage_matrix, tolerance=1e-8, pattern=rf"warping\.beyond\.S_(?P<rule>{rule})",
    ) for rule in ("uniform", "42_44", "42_43", "minimax")),
    equation(
        "beyond.S_crossover_gamma_deg", "beyond eq. 31",
        "γ below which 42 + 44 needs more storage than the uniform map.",
        _crossover, ({"n": 1, "f": 40, "phi_deg": 30},), independent=_crossover_matrix, tolerance=1e-7,
    ),
    equation(
        "beyond.S_max_excess_over_uniform", "beyond eq. 31", "Largest storage of 42 + 44 over the uniform map's.",
        _largest_excess, ({"n": 1, "f": 40, "phi_deg": 30},), independent=_largest_excess_matrix, tolerance=1e-8,
    ),
    equation(
        "beyond.partition", "beyond eq. 50", "Least sum or maximum of S over all slices in depth.", _partition,
        tuple({"n": 1, "f": 60, "phi_deg": 28, "gamma_deg": g, "k": k, "mode": m, "objective": o} for g, k, m, o in (
            (45, 4, "lispsm", "sum"), (20, 2, "minimax", "sum"), (70, 3, "uniform", "max"))),
        independent=_partition_searched, tolerance=1e-7,
    ),
)  # fmt: skip
