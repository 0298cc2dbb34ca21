"""Ledger beyond the warping chapter: what else a map may be best for, more rules for splits, and η of an n'."""

import functools
import math
from decimal import Decimal, localcontext
from fractions import Fraction
from itertools import pairwise
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from shadowjax._types import ScalarLike
from shadowjax.ledger import brute
from shadowjax.ledger.inputs import Inputs
from shadowjax.ledger.warping.tools import derived_errors, derived_max, equal_errors, equation, frustum, number, root
from shadowjax.theory.aliasing import near_distances, storage
from shadowjax.theory.aliasing.error import max_error_x, max_error_z, storage_factor
from shadowjax.theory.aliasing.light_frustum import LightFrustum, Section
from shadowjax.theory.aliasing.optimal import balanced, least_storage, minimax, storage_minimum, storage_strength
from shadowjax.theory.aliasing.split_rules import adaptive_splits, practical_splits
from shadowjax.warps.logarithmic import log_distance, log_error_z

VIEW = {"n": 0.7, "f": 53, "phi_y_deg": 33, "phi_x_deg": 41}
SECTIONS: tuple[Section, ...] = ("axis", "whole")
LIGHTS = tuple({**VIEW, "gamma_deg": g} for g in (80, 50, 33, 20, 6))
# thin slices under a light far from the view, where the storage still falls beyond the equalising n'
THIN = tuple(
    {"n": 1, "f": f, "phi_y_deg": p, "phi_x_deg": p, "gamma_deg": g} for f, p, g in ((1.11, 3.3, 47.8), (1.107, 66, 86))
)
OTHER = ({"n": 1, "f": 4, "phi_y_deg": 20, "phi_x_deg": 35, "gamma_deg": 12},)

# with image over map resolutions, across and along
_AT_RESOLUTIONS = (
    *zip(LIGHTS, (1, 9, 1, 0.2, 2), (20, 1, 4, 30, 1), strict=True),
    (OTHER[0], 1, 0.4),
    ({**VIEW, "gamma_deg": 33.2}, 1.5, 6),  # where the far plane's lowest edge lies just above the near one's
)


def plain(i: Inputs, gammas: Any = None) -> brute.View:
    """A row's view in NumPy, under its own light or others."""
    near = i.number("n", default=1.0)
    far = i.number("f") if "f" in i else near * i.number("f_over_n")
    gamma = i.angle("gamma_deg", default=90.0) if gammas is None else gammas
    tan_y = math.tan(i.angle("phi_y_deg", "phi_deg", default=30.0))
    tan_x = math.tan(i.angle("phi_x_deg", "phi_deg", "phi_y_deg", default=30.0))
    return brute.View(*(np.asarray(x, float) for x in (near, far, tan_y, tan_x, gamma)))


def _section(i: Inputs) -> Section:
    return next(name for name in SECTIONS if name == i.text("section"))


def _searched(error: Any):
    """The least value of an error of the NumPy view over all n', by golden section."""

    def value(i: Inputs) -> float:
        view = plain(i)
        ends = 1e-3 * float(view.near), 1e8 * float(view.far)
        return float(brute.least(lambda q: error(i, view, q), *ends))

    return value


def _least_storage(i: Inputs):
    view = frustum(i)
    return storage_factor(view, least_storage(view, _section(i)), _section(i))


def _stationary_storage(i: Inputs):
    """n' and 1/n' where the formula of S beyond the equalising n' is stationary."""
    view, section = frustum(i), _section(i)
    return jnp.stack([storage_minimum(view, section), storage_strength(view, section)])


def _stationary_storage_bisected(i: Inputs) -> list[float]:
    """The same from the slope of ln S of the near plane's error, at corners of the NumPy view."""
    view, top = plain(i), 1.0 if i.text("section") == "whole" else 0.0
    corners = view.corners()
    lowest = corners.min(axis=0)
    rise, far_rise = view.height(view.near, top * view.near * view.tan_y) - lowest, corners[2] - lowest
    extent = corners.max(axis=0) - lowest

    def slope(log_q: Any):
        q = np.exp(log_q)
        return 3 * q / (q + rise) - q / (q + far_rise) - 1 - q / (q + extent)

    found = float(np.exp(brute.bisected(slope, np.log(1e-6 * view.near), np.log(1e6 * view.far))))
    return [found, 1 / found]


@functools.partial(jax.jit, static_argnames="section")
def _larger_error(view: LightFrustum, ratio_x: ScalarLike, ratio_z: ScalarLike, section: Section):
    """At the best n'. Compiled once for a section: plain calls compile their bisection each time."""
    q = balanced(view, ratio_x, ratio_z, section)
    return jnp.maximum(max_error_x(view, q, section, ratio_x), max_error_z(view, q, section, ratio_z))


def _least_of_two(i: Inputs):
    return _larger_error(frustum(i), i.number("ratio_x", default=1.0), i.number("ratio_z", default=1.0), _section(i))


def _two_errors(i: Inputs, view: brute.View, q: Any):
    ratios = i.number("ratio_x", default=1.0), i.number("ratio_z", default=1.0)
    return np.maximum(
        ratios[0] * brute.max_error_x(view, q, i.text("section")),
        ratios[1] * brute.max_error_z(view, q, i.text("section")),
    )


def _least_log(i: Inputs):
    """M_z of the best logarithmic warp: the largest at the two ends of the worst line."""
    view = frustum(i)
    depths = jnp.stack([view.near, view.far])
    heights = depths * view.tan_y if i.text("section") == "whole" else jnp.zeros_like(depths)
    return jnp.max(log_error_z(view, log_distance(view, _section(i)), depths, heights))


def _eta_from_maxima(i: Inputs) -> float:
    """How far M_z of the matrix map lies between LiSPSM's and PSM's, or the uniform map's."""
    view, near = frustum(i), i.number("n")
    here, best = derived_max(view, i.number("nprime"))[1], derived_max(view, equal_errors(view))[1]
    if i.number("nprime") <= equal_errors(view):
        return (here - best) / (derived_max(view, near)[1] - best)
    wide = 1e5 * float(view.far)
    # M_z tends to the uniform map's as M + c/n' + …; the combination of n' and 2n' removes the term c/n'.
    flattest = 2 * derived_max(view, 2 * wide)[1] - derived_max(view, wide)[1]
    return (best - here) / (flattest - best)


def _needed(i: Inputs):
    return storage.partitions_needed(number(i, "f_over_n"), number(i, "bound"))


def _counted(i: Inputs) -> int:
    """Slices added one by one until their storages, each ratio less 1, add up to no more than the bound."""
    ratio, bound = i.number("f_over_n"), i.number("bound")
    return next((k for k in range(1, 65) if sum([ratio ** (1 / k) - 1] * k) <= bound), 65)


def _split_storage(i: Inputs):
    view = frustum(i)
    rule = {
        "minimax": minimax,
        "wimmer": near_distances.wimmer,
        "psm": near_distances.psm,
        "uniform": near_distances.uniform,
    }[i.text("rule")]
    splits = practical_splits(view.near, view.far, i.integer("k"), 0.5)
    return storage.storage_of_splits(view, splits, rule, i.text("objective"))


def _split_storage_brute(i: Inputs) -> float:
    """The same slice by slice in NumPy."""
    whole, cuts = plain(i), [_mixed_cut(i.merged({"index": j, "weight": 0.5})) for j in range(i.integer("k") + 1)]
    each = []
    for near, far in pairwise(cuts):
        view = whole._replace(near=np.asarray(near), far=np.asarray(far))
        overhead = view.lights(np.asarray(np.pi / 2))
        distance = {
            "minimax": lambda v=view: brute.minimax(v), "wimmer": lambda v=overhead: brute.equalising(v),
            "psm": lambda v=view: v.near, "uniform": lambda v=view: 1e10 * v.far,
        }[i.text("rule")]()  # fmt: skip
        each.append(float(brute.storage(view, distance)))
    return max(each) if i.text("objective") == "max" else sum(each)


def _mixed_cut(i: Inputs) -> float:
    """λ·n(f/n)^(j/k) + (1 − λ)(n + (f − n)j/k), the power by exact roots of 40 digits."""
    with localcontext(prec=40):
        # Powers and roots of 40 digits, rounded to float64 once.
        near, far, weight = (Decimal(i.number(name)) for name in ("n", "f", "weight"))
        j, k = i.integer("index"), i.integer("k")
        logarithmic = near * (far / near) ** (Decimal(j) / k)
        return float(weight * logarithmic + (1 - weight) * (near + (far - near) * j / k))


def _clamped(i: Inputs):
    ratios = i.numbers("alphas")
    share = i.number("least_share")
    return adaptive_splits(i.number("n"), i.number("f"), i.angle("gamma_deg"), ratios, share)


def _clamped_by_logs(i: Inputs) -> list[float]:
    """The same in logarithms: no cut lies below the given part of its equal share of what is left."""
    near, end = i.number("n"), i.number("f")
    weight, share = Fraction(str(i.number("gamma_deg"))) / 90, i.number("least_share")
    planes = [end]
    for j, alpha in reversed(list(enumerate(i.numbers("alphas"), start=2))):
        # What is left of ln(f/n) in front of this cut.
        left = math.log(end) - math.log(near)
        wanted = float(weight) * math.exp(math.log(near) + left * (j - 1) / j) + float(1 - weight) * end / alpha
        end = max(wanted, math.exp(math.log(near) + share * left * (j - 1) / j))
        planes.append(end)
    return [near, *reversed(planes)]


def _equal_power(i: Inputs):
    """n' that makes m_x^α·m_z^β equal at both planes: (F − E·r)/(r − 1) with r = (f/n)^((α + β)/(α + 2β))."""
    view, alpha, beta = frustum(i), i.number("alpha"), i.number("beta")
    # m_x ∝ (q + u)/z and m_z ∝ (q + u)²/z: equality at both planes is (q + F)/(q + E) = r.
    at_near, at_far = view.offset(view.near), view.offset(view.far)
    power = (view.far / view.near) ** ((alpha + beta) / (alpha + 2 * beta))
    return (at_far - at_near * power) / (power - 1)


def _equal_power_root(i: Inputs) -> float:
    """The same as a root of errors of the matrix map."""
    view = frustum(i)

    def difference(log_distance: float) -> float:
        m_x, m_z = derived_errors(view, math.exp(log_distance), jnp.stack([view.near, view.far]))
        powers = i.number("alpha") * jnp.log(m_x) + i.number("beta") * jnp.log(m_z)
        return float(powers[0] - powers[1])

    return math.exp(root(difference, math.log(1e-6 * float(view.near)), math.log(1e3 * float(view.far))))


def _area_gain(i: Inputs) -> float:
    """Largest m_x·m_z at LiSPSM's n' over the largest at the n' that makes it equal at both planes, light overhead."""
    view = plain(i)
    depths = view.near * (view.far / view.near) ** np.linspace(0, 1, 41)

    def worst(q: float) -> float:
        beyond, length = q + depths - view.near, view.far - view.near
        m_x = view.far / (q + length) * beyond / depths  # P is as wide as the far plane's corners at its far end
        m_z = beyond**2 * length / (q * (q + length)) / (2 * depths * view.tan_y)
        return float(np.max(m_x * m_z))

    return worst(float(view.near + np.sqrt(view.near * view.far))) / worst(float(_equal_power(i.merged(_AREA))))


_AREA = {"alpha": 1, "beta": 1}
_SHAPES = {"section": "axis"}, {"section": "whole"}

EQUATIONS = (
    equation(
        "beyond.least_storage", "beyond eq. 31", "Least S over all n', for any γ.", _least_storage,
        tuple({**light, **shape} for light in LIGHTS + OTHER + THIN for shape in _SHAPES),
        independent=_searched(lambda i, view, q: brute.storage(view, q, i.text("section"))), tolerance=1e-8,
    ),
    equation(
        "beyond.stationary_storage", "beyond eq. 31", "n' and 1/n' of 3/(n' + E) = 1/(n' + o) + 1/n' + 1/(n' + W).",
        _stationary_storage, tuple({**light, **shape} for light in (*LIGHTS[:2], LIGHTS[3]) for shape in _SHAPES),
        independent=_stationary_storage_bisected, verdict="conditional", condition="o + W > 3E.",
    ),
    equation(
        "beyond.least_of_both", "beyond eq. 42", "Least max(M_x, M_z) over all n', at given resolutions.",
        _least_of_two,
        tuple({**light, **shape, "ratio_x": x, "ratio_z": z}
              for light, x, z in _AT_RESOLUTIONS
              for shape in _SHAPES),
        independent=_searched(_two_errors), tolerance=1e-7,
    ),
    equation(
        "beyond.log_least", "beyond eq. 49", "Least M_z of a logarithmic warp over all c, for any γ.", _least_log,
        tuple({**light, **shape} for light in LIGHTS + OTHER for shape in _SHAPES),
        independent=_searched(lambda i, view, c: brute.max_error_log(view, c, i.text("section"))), tolerance=1e-8,
    ),
    equation(
        "beyond.nprime_power", "beyond eq. 27", "n' of equal m_x^α·m_z^β at both planes; α = β is the area of a texel.",
        _equal_power,
        tuple({**VIEW, "gamma_deg": g, "alpha": a, "beta": b}
              for g in (90, 50) for a, b in ((1, 1), (0, 1), (1, 0), (2, 1))),
        independent=_equal_power_root, verdict="conditional", condition="γ ≥ γ_lim.",
    ),
    equation(
        "beyond.area_gain", "beyond eq. 27",
        "With the light overhead the largest area error falls by (f/n)^(1/3) from LiSPSM to α = β, at equal storage.",
        lambda i: (i.number("f") / i.number("n")) ** (1 / 3), ({"n": 1, "f": 10}, {"n": 0.5, "f": 250}),
        independent=_area_gain,
    ),
    equation(
        "Eq32.eta", "eq. 32", "η of a near distance: −1 is the uniform map, 0 LiSPSM, 1 PSM.",
        lambda i: near_distances.eta_from_near_distance(frustum(i), number(i, "nprime")),
        tuple({"n": n, "f": f, "nprime": q}
              for n, f, q in ((2, 70, 2), (2, 70, 6), (2, 70, 13), (2, 70, 13.825), (2, 70, 40), (0.3, 9, 1.1))),
        independent=_eta_from_maxima, tolerance=1e-8,
    ),
    equation(
        "beyond.partitions_needed", "beyond eq. 51",
        "Fewest warped slices whose S is at most a bound, with the light overhead.", _needed,
        tuple({"f_over_n": r, "bound": b}
              for r, b in ((100, 5.0), (100, 99.5), (100, 7.3), (100, 10.92), (30, 3.39), (30, 3.0))),
        independent=_counted,
    ),
    equation(
        "beyond.storage_of_splits", "beyond eq. 51", "S of slices, each with its own n'.", _split_storage,
        tuple({**VIEW, "gamma_deg": g, "k": 3, "rule": r, "objective": o}
              for g, r, o in ((60, "minimax", "sum"), (25, "wimmer", "max"), (75, "psm", "sum"),
                              (50, "uniform", "sum"))),
        independent=_split_storage_brute, tolerance=1e-8,
    ),
    equation(
        "beyond.practical_splits", "beyond eq. 50", "Cuts between those of equal depth and those of equal ratio.",
        lambda i: practical_splits(
            i.number("n"), i.number("f"), i.integer("k"), i.number("weight"))[i.integer("index")],
        tuple({"n": 0.7, "f": 53, "k": 4, "weight": w, "index": j} for w, j in ((0.3, 1), (0.8, 3), (0, 2), (0.5, 0),
                                                                               (0.5, 4))),
        independent=_mixed_cut,
    ),
    equation(
        "Eq55.clamped", "eq. 55", "Planes of the adaptive iteration with the clamp that keeps them in order.", _clamped,
        ({"n": 1, "f": 100, "gamma_deg": 27, "alphas": [2, 3, 4], "least_share": 0.25},
         {"n": 0.5, "f": 10, "gamma_deg": 9, "alphas": [2.2, 2.2, 3.9], "least_share": 0.6},
         {"n": 1, "f": 10, "gamma_deg": 9, "alphas": [1.2, 1.2, 6.9], "least_share": 0.6},
         {"n": 1, "f": 30, "gamma_deg": 63, "alphas": [1.5, 1.5], "least_share": 0.0}),
        independent=_clamped_by_logs,
    ),
)  # fmt: skip
