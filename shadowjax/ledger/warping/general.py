"""Ledger of the warping chapter, eq. 35–44: any angle γ between light and view."""

import math

import jax
import jax.numpy as jnp
from scipy.integrate import quad

from shadowjax.evaluate.measure import frustum_corners, light_axes
from shadowjax.ledger.equation import Correction, Equation
from shadowjax.ledger.inputs import Inputs
from shadowjax.ledger.warping.tools import (  # fmt: skip
    cut,
    derived_errors,
    derived_max,
    equal_errors,
    equation,
    frustum,
    in_double,
    number,
    rates,
    ratio,
    root,
)
from shadowjax.theory.aliasing import near_distances, overhead
from shadowjax.theory.aliasing.error import error_x, error_z, max_error_x
from shadowjax.theory.aliasing.light_frustum import LightFrustum

KINDS: tuple[tuple[str, near_distances.Fade], ...] = (("43", "sine"), ("44", "squared"))
VIEW = {"n": 0.7, "f": 53, "phi_y_deg": 33}
GAMMAS = (80, 50, 33, 20, 2)
ANY = tuple({**VIEW, "gamma_deg": g, "nprime": 4, "z": z} for g, z in zip(GAMMAS, (0.7, 9, 53, 20, 5), strict=True))
ANY = (*ANY, {**VIEW, "phi_x_deg": 41, "gamma_deg": 62, "nprime": 3, "z": 8, "res_ratio": 1.7})
BELOW = tuple({**VIEW, "gamma_deg": g} for g in (33.5, 33, 20, 8, 0.5))


def _local(view: LightFrustum):
    """z' of the frustum's corners by their dot product with the light's axis."""
    return frustum_corners(view) @ light_axes(view.gamma)[2]


def _fprime(i: Inputs):
    high = _local(frustum(i))
    return i.number("nprime") + jnp.max(high) - jnp.min(high)


def _zprime(i: Inputs):
    view = frustum(i)
    point = jnp.asarray([0.0, 0.0, i.number("z")])
    return i.number("nprime") + point @ light_axes(view.gamma)[2] - jnp.min(_local(view))


def _steepest(i: Inputs) -> float:
    """Depth at which the derivative of m_z along depth vanishes, m_z being that of the matrix map."""
    view, q = frustum(i), _nprime(i)
    error = jax.jit(jax.grad(lambda z: jnp.log(error_from_map(view, q, z))))
    return root(lambda z: error(jnp.asarray(z)), 1e-6 * float(view.near), 1e6 * float(view.far))


def error_from_map(view: LightFrustum, near_distance, z):
    """m_z up to a constant, from z' of the real point."""
    point = jnp.stack([jnp.zeros_like(z), jnp.zeros_like(z), z])
    high = near_distance + point @ light_axes(view.gamma)[2] - jnp.min(_local(view))
    return high**2 / z


def _nprime(i: Inputs) -> float:
    """n' of a row; where it is not given, the equalising one."""
    return i.number("nprime", default=float(near_distances.equalising(frustum(i))))


def _first(i: Inputs):
    view = frustum(i)
    return (view.near + jnp.sqrt(view.near * view.far)) * view.sine - view.near * view.tilt


def _second(i: Inputs):
    view = frustum(i)
    return (view.far + jnp.sqrt(view.near * view.far)) * view.sine - view.far * view.tilt


def _zero_of_second(i: Inputs):
    view = frustum(i)
    return jnp.rad2deg(jnp.arctan(view.tan_y / (1 + jnp.sqrt(view.near / view.far))))


def _touching(i: Inputs) -> float:
    """γ at which the top of the near plane and the bottom of the far plane have one z', from the corners."""

    def gap(gamma: float) -> float:
        high = _local(frustum(i, gamma=gamma))
        return float(jnp.max(high[:4]) - jnp.min(high[4:]))

    return root(gap, 1e-9, math.pi / 2 - 1e-9)


def _fade(kind: str):
    def value(i: Inputs):
        view = frustum(i)
        return near_distances.FADES[kind](view.gamma, view.gamma_limit)

    return value


def _sine(angle: float) -> float:
    """sin of an angle up to π/2 without a sine: 2t/(1 + t²), the integral of 2/(1 + s²) from 0 to t being the angle."""
    if angle == 0:
        return 0.0
    # The half-angle's tangent t, found from the angle as an integral, gives the sine without one.
    t = root(lambda t: quad(lambda s: 2 / (1 + s * s), 0, t, epsabs=0, epsrel=1e-13)[0] - abs(angle), 0.0, 1.0 + 1e-9)
    return math.copysign(2 * t / (1 + t * t), angle)


def _printed_fade(kind: str):
    """r as printed, from the γ_lim of the corners and integrals in place of sines."""

    def value(i: Inputs):
        angle = i.angle("gamma_deg") / _touching(i) * math.pi / 2
        return _sine(angle) if kind == "sine" else (1 + _sine(angle - math.pi / 2)) ** 2

    return value


def _faded(kind: str):
    """n' of eq. 42, its n'(γ_lim) found as the root of equal errors of the matrix map at γ_lim."""

    def value(i: Inputs):
        limit = _touching(i)
        if i.angle("gamma_deg") >= limit:
            return equal_errors(frustum(i))
        return equal_errors(frustum(i, gamma=limit)) / _printed_fade(kind)(i)

    return value


def _at_limit(i: Inputs):
    view = frustum(i)
    return near_distances.generalised(LightFrustum(view.near, view.far, view.phi_y, view.phi_x, view.gamma_limit))


def _slope(side: int, fade: str):
    """One-sided slope of n'(γ) at γ_lim, by differentiating the branch."""

    def value(i: Inputs):
        view = frustum(i)

        def branch(gamma):
            at = LightFrustum(view.near, view.far, view.phi_y, view.phi_x, gamma)
            return near_distances.generalised(at, fade)  # pyright: ignore[reportArgumentType]

        return jax.grad(branch)(view.gamma_limit + side * 1e-12)

    return value


def _right_slope(i: Inputs):
    view = frustum(i)
    limit, root_ = view.gamma_limit, view.near + jnp.sqrt(view.near * view.far)
    return root_ * jnp.cos(limit) + view.near * view.tan_y * jnp.sin(limit)


def _left_slope(i: Inputs):
    if i.text("fade", "44") == "43":
        return 0.0
    view = frustum(i)
    at = LightFrustum(view.near, view.far, view.phi_y, view.phi_x, view.gamma_limit)
    return -math.pi * near_distances.generalised(at) / view.gamma_limit


def _literal(i: Inputs):
    return overhead.literal_error_z(frustum(i), number(i, "nprime"), number(i, "z"), ratio(i))


def _some(i: Inputs) -> float:
    """Any n' serves where the answer does not depend on it."""
    return i.number("nprime", default=3.0 * float(frustum(i).near))


EQUATIONS: tuple[Equation, ...] = (
    equation(
        "Eq35.zprime", "eq. 35",
        "z' of a point on the view axis, measured so that the frustum's lowest point has z' = n'.",
        lambda i: number(i, "nprime") + frustum(i).offset(number(i, "z")), ANY, independent=_zprime,
    ),
    equation(
        "Eq36.fprime", "eq. 36", "f' − n' is the frustum's extent along z'.",
        lambda i: number(i, "nprime") + frustum(i).extent, ANY, independent=_fprime,
    ),
    equation(
        "Eq37true.mz_beam", "eq. 37", "m_z for any γ, with the texel's thickness across the light.",
        lambda i: error_z(frustum(i), number(i, "nprime"), number(i, "z"), resolution_ratio=ratio(i)), ANY,
        independent=lambda i: ratio(i) * derived_errors(frustum(i), i.number("nprime"), i.number("z"))[1][0],
        measured=lambda i: ratio(i) * cut(frustum(i), i.number("nprime"), i.number("z")).perspective,
        measured_tolerance=1e-6, verdict="erratum",
        correction=Correction(
            "the same divided by sin γ",
            "no sin γ: the beam's thickness is dz' = sin γ dz; only so does eq. 53 follow.",
            in_double(_literal), {**VIEW, "gamma_deg": 31, "nprime": 5, "z": 10},
        ),
    ),
    equation(
        "beyond.mx_any", "beyond eq. 25", "m_x on the view axis for any γ, with the smallest P.",
        lambda i: error_x(frustum(i), number(i, "nprime"), number(i, "z"), resolution_ratio=ratio(i)), ANY,
        independent=lambda i: ratio(i) * derived_errors(frustum(i), i.number("nprime"), i.number("z"))[0][0],
    ),
    equation(
        "beyond.Mx_any", "beyond eq. 28", "M_x on the view axis for any γ, at the far plane for small n'.",
        lambda i: max_error_x(frustum(i), number(i, "nprime"), resolution_ratio=ratio(i)),
        (*ANY, {**VIEW, "gamma_deg": 75, "nprime": 0.2}, {**VIEW, "gamma_deg": 30, "nprime": 0.05, "res_ratio": 3}),
        independent=lambda i: ratio(i) * derived_max(frustum(i), i.number("nprime"))[0],
    ),
    equation(
        "Eq37.mz_dz", "eq. 37", "m_z as printed: dz/dt along the view axis over the pixel's width.", _literal, ANY,
        independent=lambda i: ratio(i) / (rates(frustum(i), i.number("nprime"), i.number("z"))[3][0]
                                      * 2 * i.number("z") * frustum(i).tan_y),
        verdict="conditional",
        condition="Texel length taken along the view axis, which is no beam thickness for γ < π/2.",
    ),
    equation(
        "Eq37.ratio_dz_over_true", "eq. 37", "Printed over true m_z is 1/sin γ.",
        lambda i: _literal(i) / error_z(frustum(i), number(i, "nprime"), number(i, "z"), 0.0, ratio(i)), ANY,
        recomputed=lambda i: 1 / math.sin(i.angle("gamma_deg")),
        independent=lambda i: (lambda r: r[2][0] / r[3][0])(rates(frustum(i), _some(i), frustum(i).far / 2)),
    ),
    equation(
        "Eq38.zmin", "eq. 38", "m_z has one stationary depth on the axis, a minimum.",
        lambda i: overhead.least_error_depth(frustum(i), jnp.asarray(_nprime(i))),
        tuple({**VIEW, "gamma_deg": g, "nprime": q} for g, q in ((70, 9), (50, 4), (34, 4), (30, 7), (20, 40))),
        independent=_steepest, verdict="conditional",
        condition="Inside [n, f] only for n ≤ A/sin γ ≤ f, A the printed numerator.",
    ),
    equation(
        "Eq39.n1", "eq. 39", "n' of equal m_z at both planes, γ ≥ φ.", _first,
        tuple({**VIEW, "gamma_deg": g} for g in (90, 70, 45, 34)), independent=lambda i: equal_errors(frustum(i)),
        verdict="erratum", correction=Correction(
            "m_x(n) = m_x(f)", "m_z(n) = m_z(f); m_x would give n sin γ − a cos γ.",
            in_double(lambda i: frustum(i).near * (frustum(i).sine - frustum(i).tilt)), {**VIEW, "gamma_deg": 60}),
    ),
    equation(
        "Eq39.n2", "eq. 39", "n' of equal m_z at both planes, γ < φ, where positive.", _second,
        tuple({**VIEW, "gamma_deg": g} for g in (33, 32, 31)), independent=lambda i: equal_errors(frustum(i)),
        verdict="conditional", condition="tan γ > tan φ/(1 + √(n/f)); otherwise no n' > 0 equalises.",
    ),
    equation(
        "text.n2_zero_gamma_deg", "text after eq. 39", "n'₂ vanishes at tan γ = tan φ/(1 + √(n/f)), in degrees.",
        _zero_of_second, ({**VIEW}, {"n": 1, "f": 4, "phi_y_deg": 45}),
        independent=lambda i: math.degrees(
            root(lambda g: _second(Inputs({**i, "gamma_deg": math.degrees(g)})), 1e-6, 1.5)),
        verdict="erratum", correction=Correction(
            "n'₂ is negative for all γ ≤ φ", "only for tan γ < tan φ/(1 + √(n/f))",
            lambda i: i.number("phi_y_deg", "phi_deg"), VIEW),
    ),
    equation(
        "Eq40.gamma_lim_rad", "eq. 40", "γ_lim, where near and far plane touch seen from the light, in radians.",
        lambda i: frustum(i).gamma_limit, ({**VIEW}, {"n": 1, "f": 2, "phi_y_deg": 50}), independent=_touching,
    ),
    equation(
        "Eq40.gamma_lim_deg", "eq. 40", "γ_lim in degrees.", lambda i: jnp.rad2deg(frustum(i).gamma_limit),
        ({**VIEW}, {"n": 1, "f": 2, "phi_y_deg": 50}), independent=lambda i: math.degrees(_touching(i)),
    ),
    *(e for name, kind in KINDS for e in (
        equation(
            f"Eq{name}.r", f"eq. {name}", "Fade r(γ) from 0 at γ = 0 to 1 at γ_lim.", _fade(kind), BELOW,
            independent=_printed_fade(kind), tolerance=1e-8,
        ),
        equation(
            f"Eq42.nprime_r{name}", f"eq. 41–42 and {name}", "n'(γ): equalising down to γ_lim, then n'(γ_lim)/r(γ).",
            lambda i, k=kind: near_distances.generalised(frustum(i), k),
            ({**VIEW, "gamma_deg": 60}, *BELOW), independent=_faded(kind), tolerance=1e-8, verdict="conditional",
            condition="Continuous; least M_z on the axis for γ ≥ γ_lim only.",
        ),
    )),
    equation(
        "Eq42.nprime_at_gamma_lim", "eq. 40–42", "n' at γ_lim, where both branches meet.",
        _at_limit, ({**VIEW}, {"n": 1, "f": 9, "phi_y_deg": 20}),
        independent=lambda i: equal_errors(frustum(i, gamma=_touching(i))), tolerance=1e-8,
    ),
    equation(
        "Eq42.left_slope_r44_at_lim", "eq. 42 and 44", "Slope of n'(γ) just below γ_lim, per radian.", _left_slope,
        ({**VIEW}, {"n": 1, "f": 9, "phi_y_deg": 20}), independent=_slope(-1, "squared"), tolerance=1e-8,
    ),
    equation(
        "Eq42.left_slope_r43_at_lim", "eq. 42 and 43", "Slope of n'(γ) just below γ_lim with r of eq. 43 is 0.",
        lambda i: 0.0, ({**VIEW},), independent=_slope(-1, "sine"), tolerance=1e-8,
    ),
    equation(
        "Eq42.right_slope_at_lim", "eq. 42", "Slope of n'(γ) just above γ_lim: n' is not differentiable there.",
        _right_slope, ({**VIEW}, {"n": 1, "f": 9, "phi_y_deg": 20}), independent=_slope(1, "squared"), tolerance=1e-8,
    ),
)  # fmt: skip
