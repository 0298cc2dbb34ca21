"""Ledger of the warping chapter, eq. 45–55: the logarithmic map, slices in depth, seams and parallel light."""

import math
import re
from decimal import Decimal, localcontext
from itertools import pairwise
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from scipy.integrate import quad

from shadowjax.ledger import brute
from shadowjax.ledger.equation import Equation
from shadowjax.ledger.inputs import Inputs
from shadowjax.ledger.warping.tools import (  # fmt: skip
    derived_errors,
    derived_max,
    derived_storage,
    equal_errors,
    equation,
    frustum,
    number,
    ratio,
    root,
)
from shadowjax.partitions.cascades import iterate_adaptive, logarithmic_splits
from shadowjax.theory.aliasing import near_distances, storage
from shadowjax.theory.aliasing.error import storage_factor
from shadowjax.theory.aliasing.light_frustum import LightFrustum
from shadowjax.warps.logarithmic import LogarithmicWarp, log_error_z

VIEW = {"n": 0.7, "f": 53, "phi_y_deg": 33}
FAR_AWAY = 1e5  # n' over f that stands for ∞ in matrices, extrapolated


def _uniform(function: Any, view: LightFrustum) -> float:
    """A quantity of the matrix map in the limit n' → ∞, extrapolated from two large n'."""
    # The error falls like 1/n', so 2·F(2n') − F(n') cancels its first order (Richardson).
    wide = FAR_AWAY * float(view.far)
    return 2 * function(view, 2 * wide) - function(view, wide)


def _parts(i: Inputs, k: int, **values: float) -> list[LightFrustum]:
    view = frustum(i, **values)
    cuts = [float(view.near) * (float(view.far) / float(view.near)) ** (j / k) for j in range(k + 1)]
    deg = math.degrees(float(view.phi_y))
    gamma = math.degrees(float(view.gamma))
    return [frustum(Inputs({"n": a, "f": b, "phi_deg": deg, "gamma_deg": gamma})) for a, b in pairwise(cuts)]


def _sum_of_parts(i: Inputs) -> float:
    warped = i.text("kind").lower() == "lispsm"
    each = (
        derived_storage(part, equal_errors(part)) if warped else _uniform(derived_storage, part)
        for part in _parts(i, i.integer("k"))
    )
    return sum(each)


def _log_warp(i: Inputs) -> LogarithmicWarp:
    """The real logarithmic warp of the view axis with the light overhead, c = n."""
    near, far = i.number("n"), i.number("f")
    points = jnp.asarray([[-near, near], [near, near], [-far, far], [far, far]])
    return LogarithmicWarp.fit(points, 1 / near)


def _log_error(i: Inputs):
    place = jnp.asarray([0.0, i.number("z")])
    rate = _log_warp(i).inverse_spacing(place)[1, 1]
    return ratio(i) / (rate * 2 * i.number("z") * math.tan(i.angle("phi_y_deg", "phi_deg")))


def _log_storage(i: Inputs):
    """M_x·M_z of the real logarithmic warp by automatic differentiation."""
    near, far = i.number("n"), i.number("f")
    z = near * (far / near) ** jnp.linspace(0, 1, 9)
    rates = _log_warp(i).inverse_spacing(jnp.stack([0 * z, z], axis=-1))
    along = 1 / (rates[:, 1, 1] * 2 * z * math.tan(i.angle("phi_y_deg", "phi_deg")))
    across = 1 / (rates[:, 0, 0] * 2 * z)  # its sides are ±z, so that tan φ_x = 1
    return jnp.max(along) * jnp.max(across)


def _ratios(i: Inputs) -> tuple[float, list[float]]:
    """λ and α_2 … α_k of a row of eq. 55."""
    weight = i.number("lambda_") if "lambda_" in i else i.number("gamma_deg") / 90
    labelled = re.search(r"alpha=\(([\d.,]+)\)", i.label)
    if labelled:
        return weight, [float(x) for x in labelled[1].split(",")]

    def one(j: int) -> float:
        name = next((n for n in (f"alpha_{j}", "alpha_others", "alpha") if n in i), "alpha")
        return math.prod(float(part) for part in str(i[name]).split("*"))

    return weight, [one(j) for j in range(2, i.integer("k") + 1)]


def _adaptive(i: Inputs):
    weight, alphas = _ratios(i)
    ends = (jnp.asarray(i.number("n")), jnp.asarray(i.number("f")))
    return iterate_adaptive(*ends, jnp.asarray(weight), jnp.asarray(alphas))[i.integer("index") - 1]


def _root_of(value: Decimal, degree: int) -> Decimal:
    """A root of whole degree by Newton's method, digit for digit of the decimal context."""
    found = Decimal(float(value) ** (1 / degree))
    for _ in range(8):
        # Quadratic convergence: eight steps from 16 digits exceed any precision asked for here.
        found -= (found**degree - value) / (degree * found ** (degree - 1))
    return found


def _adaptive_decimal(i: Inputs) -> float:
    """The same with 40 decimal digits: the cut of equal ratios from an i-th root, mixed with f_i/α_i."""
    weight, alphas = _ratios(i)
    with localcontext(prec=40):
        near, end, share = Decimal(i.number("n")), Decimal(i.number("f")), Decimal(weight)
        for j in range(i.integer("k"), i.integer("index") - 1, -1):
            equal = end / _root_of(end / near, j)
            end = share * equal + (1 - share) * end / Decimal(alphas[j - 2])
        return float(end)


def _min_lambda_decimal(i: Inputs) -> float:
    """The least λ by trying all, with 30 decimal digits."""
    k, alpha, far = i.integer("k"), Decimal(i.number("alpha")), Decimal(i.number("f_over_n"))

    def valid(step: int) -> bool:
        end, weight = far, Decimal(step) / 200
        for j in range(k, 1, -1):
            cut = weight * end / _root_of(end, j) + (1 - weight) * end / alpha
            if not 0 < cut < end:
                return False
            end = cut
        return end >= 1

    with localcontext(prec=30):
        return next(step for step in range(201) if valid(step)) / 200


def _min_lambda(i: Inputs) -> float:
    k = i.integer("k")
    weights = jnp.arange(201.0) / 200
    alphas = jnp.full((201, k - 1), i.number("alpha"))
    planes = iterate_adaptive(jnp.ones(201), jnp.full(201, i.number("f_over_n")), weights, alphas)
    # the first slice may be empty, the others may not
    good = (planes[:, 1] >= 1) & jnp.all(jnp.diff(planes[:, 1:], axis=-1) > 0, axis=-1)
    return float(weights[jnp.argmax(good)])


def _seam_closed(i: Inputs) -> float:
    step = (i.number("f") / i.number("n")) ** (1 / i.integer("k"))
    return step if i.text("kind") == "uniform" else (math.sqrt(step) if i.text("axis") == "x" else 1.0)


def _seam_package(i: Inputs):
    view = frustum(i.merged({"phi_deg": 30}))
    rule = near_distances.uniform if i.text("kind") == "uniform" else near_distances.wimmer
    cuts = logarithmic_splits(view.near, view.far, i.integer("k"))
    return storage.seam_jumps(view, cuts, rule)[i.text("axis") == "z"][0]


def _seam_matrix(i: Inputs) -> float:
    before, after = _parts(i.merged({"phi_deg": 30}), i.integer("k"))[:2]
    which = i.text("axis") == "z"

    def error(part: LightFrustum, depth: Any) -> float:
        if i.text("kind") == "uniform":
            return _uniform(lambda v, q: float(derived_errors(v, q, depth)[which][0]), part)
        return float(derived_errors(part, equal_errors(part), depth)[which][0])

    jump = error(after, after.near) / error(before, before.far)
    return max(jump, 1 / jump)


def _parallel_sum(i: Inputs) -> float:
    parts = _parts(i.merged({"phi_deg": 30, "gamma_deg": 0}), i.integer("k", default=1))
    return sum(_uniform(derived_storage, part) for part in parts)


def _least_parallel(i: Inputs):
    view = frustum(i.merged({"phi_deg": 30}))
    return storage.storage_parallel(view, storage.best_parallel_partitions(view))


def _least_parallel_searched(i: Inputs) -> float:
    """Least sum of k squares of the slices' ratios, by golden section over real k."""
    log_ratio = math.log(i.number("f") / i.number("n", default=1.0))
    return float(brute.least(lambda k: k * np.exp(log_ratio / k) ** 2, 0.1, 100.0))


def _literal_parallel(i: Inputs):
    view = frustum(i.merged({"phi_deg": 30}))
    return storage_factor(view, number(i, "nprime")) / view.sine


def _literal_matrix(i: Inputs) -> float:
    view = frustum(i.merged({"phi_deg": 30}))
    return _uniform(lambda v, q: derived_max(v, q)[0] * derived_max(v, q)[1], view) / math.sin(i.angle("gamma_deg"))


def _zp(i: Inputs):
    return storage.storage_z_partitions(frustum(i), i.number("k"), i.text("kind").lower() == "lispsm")


ADAPTIVE = (
    {"n": 0.5, "f": 60, "k": 4, "gamma_deg": 40, "alpha_2": 2, "alpha_3": 2.5, "alpha_4": 4, "index": 2},
    {"n": 1, "f": 60, "k": 3, "lambda_": 0.0, "alpha": 3, "index": 2},
    {"n": 1, "f": 60, "k": 3, "lambda_": 1.0, "alpha": 3, "index": 3},
)

EQUATIONS: tuple[Equation, ...] = (
    equation(
        "Eq48.t", "eq. 46–48", "Texels in proportion to depth: t = ln(z/n)/ln(f/n).",
        lambda i: math.log(i.number("z") / i.number("n")) / math.log(i.number("f") / i.number("n")),
        tuple({**VIEW, "z": z} for z in (0.7, 4, 53)),
        independent=lambda i: quad(lambda z: 1 / z, i.number("n"), i.number("z"), epsabs=0)[0]
        / quad(lambda z: 1 / z, i.number("n"), i.number("f"), epsabs=0)[0],
        measured=lambda i: _log_warp(i).forward(jnp.asarray([0.0, i.number("z")]))[1],
    ),
    equation(
        "Eq49.mz_log", "eq. 45 and 49", "m_z of the logarithmic map is ln(f/n)/(2 tan φ) at every depth.",
        lambda i: log_error_z(frustum(i), number(i, "n"), number(i, "z"), resolution_ratio=ratio(i)),
        tuple({**VIEW, "z": z} for z in (0.7, 4, 53)), independent=_log_error,
    ),
    equation(
        "Eq50.n", "eq. 50", "Planes of equal ratio, n_i = n (f/n)^((i−1)/k).",
        lambda i: logarithmic_splits(number(i, "n"), number(i, "f"), i.integer("k"))[i.integer("i", "index") - 1],
        tuple({**VIEW, "k": 5, "i": j} for j in (1, 3, 5)), pattern=r"warping\.Eq50\.n(_(?P<index>\d+))?",
        independent=lambda i: i.number("n") * root(
            lambda q: i.number("n") * q ** i.integer("k") - i.number("f"), 1.0, i.number("f") / i.number("n")
        ) ** (i.integer("i", "index") - 1),
    ),
    *(equation(
        f"Eq51.S_ZP2_{kind}", "eq. 51", "S of k similar slices with the light overhead.", _zp,
        tuple({**VIEW, "k": k} for k in (1, 2, 5)), independent=_sum_of_parts, tolerance=1e-8,
        pattern=rf"warping\.Eq51\.S_ZP(?P<k>\d+)_(?P<kind>{kind})",
    ) for kind in ("uniform", "LiSPSM")),
    equation(
        "Eq52.S_LogSM", "eq. 52", "S of the logarithmic map, the limit of many slices: ln(f/n)/(2 tan φ).",
        lambda i: storage.storage_logarithmic(frustum(i)), (VIEW, {"n": 1, "f": 1000, "phi_y_deg": 20}),
        independent=_log_storage,
    ),
    equation(
        "Eq53.S_parallel", "eq. 53", "S for parallel light is (f/n)².",
        lambda i: storage.storage_parallel(frustum(i.merged({"phi_deg": 30}))), (VIEW, {"n": 1, "f": 4}),
        independent=_parallel_sum, tolerance=1e-8,
    ),
    equation(
        "Eq53.S_parallel_literal37", "eq. 37 and 53",
        "With the printed eq. 37, S diverges like 1/sin γ, against eq. 53.",
        _literal_parallel, ({**VIEW, "gamma_deg": "1e-5", "nprime": "1e20"},), independent=_literal_matrix,
        tolerance=1e-7,
        verdict="conditional", condition="Texel length along the view axis; shows that eq. 37 cannot be meant so.",
    ),
    equation(
        "Eq54.S_par", "eq. 54", "S of k similar slices for parallel light, k (f/n)^(2/k); not monotone in k.",
        lambda i: storage.storage_parallel(frustum(i.merged({"phi_deg": 30})), i.number("k")),
        tuple({**VIEW, "k": k} for k in (1, 3, 9)), independent=_parallel_sum, tolerance=1e-8,
    ),
    equation(
        "Eq54.k_opt_real", "eq. 54", "Least at k = 2 ln(f/n).",
        lambda i: storage.best_parallel_partitions(frustum(i.merged({"phi_deg": 30}))), (VIEW, {"n": 1, "f": 1000}),
        independent=lambda i: root(
            lambda k: jax.grad(lambda x: jnp.log(storage.storage_parallel(frustum(i.merged({"phi_deg": 30})), x)))(
                jnp.asarray(k)), 0.1, 100),
    ),
    equation(
        "Eq54.S_at_k_opt", "eq. 54", "S at the best real k is 2e·ln(f/n).", _least_parallel,
        (VIEW, {"n": 1, "f": 1000}),
        recomputed=lambda i: 2 * math.e * math.log(i.number("f") / i.number("n", default=1.0)),
        independent=_least_parallel_searched,
    ),
    equation(
        "Eq55.n", "eq. 55", "Planes of the adaptive iteration, as printed.", _adaptive, ADAPTIVE,
        independent=_adaptive_decimal,
        pattern=r"warping\.Eq55\.n(_(?P<index>\d+))?", verdict="conditional",
        condition="Stays in [n, f] if all α_i ≤ (f/n)^(1/k), or they do not fall with i and Πα_i < f/n.",
    ),
    equation(
        "Eq55.min_lambda", "eq. 55", "Least λ on a grid of 1/200 from which the printed planes are in order.",
        _min_lambda,
        ({"k": 4, "alpha": 4, "f_over_n": 10}, {"k": 8, "alpha": 2, "f_over_n": 100}), independent=_min_lambda_decimal,
    ),
    equation(
        "Eq55.counterexample", "eq. 55", "Πα < f/n alone does not keep n_2 ≥ n.",
        lambda i: _adaptive(i.merged({"index": 2})),
        ({"n": 1, "f": 10, "k": 9, "lambda_": 0.1, "alpha_2": "0.999*10", "alpha_others": "1.0000001"},),
        independent=lambda i: _adaptive_decimal(i.merged({"index": 2})),
    ),
    *(equation(
        f"seam.m{axis}_jump_{kind}", "text after eq. 52", "How much m jumps at the cuts between similar slices.",
        _seam_package, tuple({"n": 0.5, "f": 80, "k": k} for k in (2, 5)), recomputed=_seam_closed,
        independent=_seam_matrix, tolerance=1e-8, pattern=rf"warping\.seam\.m(?P<axis>{axis})_jump_(?P<kind>{kind})",
    ) for axis in "xz" for kind in ("uniform", "LiSPSM")),
)  # fmt: skip
