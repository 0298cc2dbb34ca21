"""Ledger of the warping chapter, eq. 11–33: beams, and the errors of a perspective warp with the light overhead."""

import math
import re

import jax.numpy as jnp

from shadowjax.evaluate.measure import frustum_corners, light_axes, pixel_cut
from shadowjax.ledger.equation import Correction, Equation
from shadowjax.ledger.inputs import Inputs
from shadowjax.ledger.warping.tools import (  # fmt: skip
    cut,
    derived_errors,
    derived_max,
    derived_storage,
    equal_errors,
    equation,
    frustum,
    in_double,
    number,
    rates,
    ratio,
    root,
)
from shadowjax.theory.aliasing import near_distances, overhead, storage
from shadowjax.theory.aliasing.error import error_z

VIEW = {"n": 0.7, "f": 53, "phi_x_deg": 41, "phi_y_deg": 33}
NARROW = {"n": 2, "f": 2.5, "phi_x_deg": 20, "phi_y_deg": 25}
NEARS = (0.9, 7.5, 60)
MAPS = (
    *({**VIEW, "nprime": n, "z": z, "x": 0.3} for n in NEARS for z in (0.7, 6.0, 53)),
    {**NARROW, "nprime": 5, "z": 2.2, "x": -0.4, "res_ratio": 1.7},
)
# 6.4 and 7 lie on both sides of n + √(fn), and above √(fn)
MAXIMA = (*({**VIEW, "nprime": n} for n in (*NEARS, 6.4, 7.0)), {**NARROW, "nprime": 5, "res_ratio": 1.7})


def _surface(i: Inputs) -> dict[str, float]:
    """View angle, depth, surface angle and n' of a beam row; some rows give them in the label only."""
    label = dict(re.findall(r"(\w+)=(-?[\d.]+)", i.label))
    gamma = i.number("gamma_deg", default=float(label.get("g", 90)))
    view = frustum(i.merged({"n": 1, "f": 100}), gamma)
    return {
        "gamma": gamma,
        "alpha": i.angle("view_angle_deg", default=float(label.get("alpha", 0))),
        "depth": i.number("z0", default=float(label.get("z", 10))),
        "angle": i.angle("surface_angle_from_view_axis_deg", default=float(label.get("beta", 90))),
        "nprime": i.number("nprime", default=float(near_distances.generalised(view))),
        "res": i.number("res", default=512.0),
    }


def _beams(i: Inputs):
    s = _surface(i)
    view = frustum(i.merged({"n": 1, "f": 100}), s["gamma"])
    return view, s, cut(view, s["nprime"], s["depth"], math.tan(s["alpha"]), s["angle"], s["res"], s["res"])


def _m_exact(i: Inputs):
    return _beams(i)[2].aliasing


def _m_closed(i: Inputs):
    """Exact ratio of footprints in closed form: eq. 12 with the second order of both beams kept."""
    view, s, _ = _beams(i)
    h, slope = view.tan_y / s["res"], math.tan(s["alpha"])
    # Along z' of light space, for a point off the axis too.
    q, extent = s["nprime"], view.extent
    high = q + view.offset(jnp.asarray(s["depth"]), jnp.asarray(s["depth"] * slope))
    # z'(t) = n'f'/(f' − t·W): the exact difference over t ± ½/res is dz'/dt/res over 1 − (W·z'/(2·res·n'f'))².
    texel = extent * high**2 / (q * (q + extent)) / s["res"]
    texel = texel / (1 - (extent * high / (2 * s["res"] * q * (q + extent))) ** 2)
    light = jnp.abs(jnp.sin(view.gamma + s["angle"]))
    sine, cosine = math.sin(s["angle"]), math.cos(s["angle"])
    lean = sine - slope * cosine
    # Edges of slope ± h meet the line at ±h·z/(lean ∓ h·cos): both lengths added.
    pixel = 2 * h * s["depth"] * jnp.abs(sine - slope * cosine) / (lean**2 - (h * cosine) ** 2)
    return texel / light / pixel


def _m_approx(i: Inputs):
    view, s, _ = _beams(i)
    slope, depth = math.tan(s["alpha"]), jnp.asarray(s["depth"])
    pixel = overhead.pixel_width(depth, view.phi_y, s["res"])
    texel = error_z(view, jnp.asarray(s["nprime"]), depth, depth * slope) * pixel
    cosines = abs(math.sin(s["angle"] - s["alpha"])), abs(math.sin(float(view.gamma) + s["angle"]))
    across = pixel * math.cos(s["alpha"])  # thickness of the pixel's beam, across the view ray
    return overhead.aliasing(texel, across, jnp.asarray(cosines[0]), jnp.asarray(cosines[1]))


def _ground(i: Inputs):
    """Beams on the plane y = −1 at the whole degrees below the horizon inside the view."""
    view = frustum(i.merged({"n": 1, "f": 100, "phi_deg": 30, "gamma_deg": 60}))
    distance = near_distances.generalised(view)
    angles = [math.radians(d) for d in range(1, math.ceil(math.degrees(float(view.phi_y))))]
    res = i.number("res", default=512.0)
    cuts = [cut(view, distance, 1 / math.tan(a), -math.tan(a), 0.0, res, res) for a in angles]
    exact = jnp.stack([c.aliasing for c in cuts])
    height, depth = -jnp.ones(len(angles)), jnp.asarray([1 / math.tan(a) for a in angles])
    widths = error_z(view, distance, depth, height) / jnp.cos(jnp.asarray(angles))
    measured = jnp.stack([c.texel_width / c.pixel_width for c in cuts])
    return overhead.l_infinity(exact), overhead.l_infinity(widths), overhead.l_infinity(measured)


def _pixel_ratio(i: Inputs, angle: float, phi: str = "phi_deg"):
    """Footprint of a pixel on the line at an angle through a point, over eq. 17."""
    slope, z, res = math.tan(i.angle("view_angle_deg", default=0)), i.number("z", "z0"), i.number("res", "res_cy")
    half = i.angle(phi, "phi_y_deg", "phi_x_deg")
    found = pixel_cut(jnp.asarray(slope), jnp.asarray(math.tan(half) / res), jnp.asarray(z), jnp.asarray(angle))
    return found / overhead.pixel_width(jnp.asarray(z), jnp.asarray(half), res)


def _opening_ratio(i: Inputs):
    view, q = frustum(i), number(i, "nprime")
    return view.half_width(1 / q) * (q + view.extent) / (q * view.far * view.tan_x)


def _opening_corners(i: Inputs):
    view, q = frustum(i), number(i, "nprime")
    local = frustum_corners(view) @ light_axes(view.gamma).T
    high = local[:, 2] - jnp.min(local[:, 2]) + q
    return jnp.max(jnp.abs(local[:, 0]) / high) * jnp.max(high) / (view.far * view.tan_x)


def _offaxis(i: Inputs):
    """Thickness across the beam over eq. 17: cos α/(1 − (h·sin α·cos α)²) with h half a pixel at distance 1."""
    alpha = i.angle("view_angle_deg")
    half = math.tan(i.angle("phi_deg", "phi_y_deg")) / i.number("res")
    # Across the ray the edges tan α ± h lie at ±h·z/(1/cos α ± h·sin α): both lengths added, over 2h·z.
    return math.cos(alpha) / (1 - (half * math.sin(alpha) * math.cos(alpha)) ** 2)


def _beam_eq19(i: Inputs):
    view, q, res = frustum(i.merged({"phi_deg": 30})), number(i, "nprime"), i.number("res_lt")
    # h = n' + u = n'(n' + W)/A with A = n' + W − W·t. Half a texel moves A by δ = W/(2·res), so a texel's width is its
    # derivative's times 1/(1 − (δ/A)²).
    high = q + view.offset(number(i, "z"))
    return 1 / (1 - (view.extent * high / (2 * res * q * (q + view.extent))) ** 2)


def _cut_eq19(i: Inputs):
    view, res = frustum(i.merged({"phi_deg": 30})), i.number("res_lt")
    q, z = i.number("nprime"), i.number("z")
    return cut(view, q, z, map_rows=res).texel_width * rates(view, q, z)[2][0] * res


BEAM_SAMPLES = tuple(
    {"n": 1, "f": 60, "phi_deg": 28, "gamma_deg": g, "nprime": 6.5, "res": 400, "view_angle_deg": a, "z0": z,
     "surface_angle_from_view_axis_deg": b}
    for g, a, z, b in ((90, 0, 10, 60), (50, 17, 5, 75), (75, -20, 30, 40), (35, 25, 8, 90))
)  # fmt: skip


def _critical(i: Inputs, axis: str):
    res = i.number("res_c")
    return storage.critical_resolution(frustum(i), number(i, "nprime"), res, res)[axis == "t"]


def _invert_eta(i: Inputs) -> float:
    """n' at which η, made from maxima of the matrix map, has the wanted value."""
    view, eta = frustum(i), i.number("eta")
    near = float(view.near)
    best = derived_max(view, equal_errors(view))[1]
    steepest, wide = derived_max(view, near)[1], 1e5 * float(view.far)
    flattest = 2 * derived_max(view, 2 * wide)[1] - derived_max(view, wide)[1]  # limit of n' → ∞

    def excess(log_distance: float) -> float:
        worst = derived_max(view, math.exp(log_distance))[1]
        share = (worst - best) / (steepest - best) if eta >= 0 else (best - worst) / (flattest - best)
        return share - eta

    middle = math.log(equal_errors(view))
    if eta == 0:
        return math.exp(middle)
    ends = (math.log(near) - 1e-9, middle) if eta > 0 else (middle, math.log(wide))
    return math.exp(root(excess, *ends))


EQUATIONS: tuple[Equation, ...] = (
    equation(
        "Eq12.m_exact", "eq. 11", "m is the ratio of the lengths that texel and pixel beam cut from a surface.",
        _m_closed, BEAM_SAMPLES, measured=_m_exact,
    ),
    equation(
        "Eq12.m_approx", "eq. 12", "m ≈ w_l cos θ_c/(w_c cos θ_l).", _m_approx, BEAM_SAMPLES, measured=_m_exact,
        measured_tolerance=1e-4, verdict="conditional",
        condition="To second order in the sizes of pixel and texel; both thicknesses across their own beam.",
    ),
    equation(
        "Eq13.max_wl_over_wc", "eq. 13", "L∞ is max |w_l/w_c|; it is not max |m|.", lambda i: _ground(i)[1],
        ({"f": 100, "phi_deg": 30, "gamma_deg": 60}, {"f": 40, "phi_deg": 25, "gamma_deg": 70}),
        measured=lambda i: _ground(i)[2], measured_tolerance=1e-4, verdict="erratum",
        correction=Correction("max |m| = max |w_l/w_c|", "L∞ := max |w_l/w_c|; m also has cos θ_c/cos θ_l.",
                              in_double(lambda i: _ground(i)[0]), {"phi_deg": 30, "gamma_deg": 60}),
    ),
    equation(
        "Eq13.max_abs_m_exact", "eq. 13", "max |m| on a ground plane, from cut beams.", lambda i: _ground(i)[0],
        ({"f": 100, "phi_deg": 30, "gamma_deg": 60},),
        pattern=r"warping\.Eq13\.(max_m|max_abs_m|max_m_exact|max_abs_m_exact)",
        independent=lambda i: max(
            _m_closed(Inputs({"n": 1, "f": 100, "phi_deg": 30, "gamma_deg": 60, "view_angle_deg": -d,
                              "z0": 1 / math.tan(math.radians(d)), "surface_angle_from_view_axis_deg": 0}))
            for d in range(1, 30)),
    ),
    equation(
        "Eq13.l_infinity", "eq. 13", "L∞ is the largest absolute error where something is drawn, 0 where nothing is.",
        lambda i: overhead.l_infinity(jnp.asarray(i.numbers("errors")), jnp.asarray(i["drawn"])),
        ({"errors": [1.5, -3, 0.2], "drawn": [True, True, False]}, {"errors": [2, 0.004, -0.001],
                                                                    "drawn": [False, True, True]},
         {"errors": [2], "drawn": [False]}),
        independent=lambda i: max(
            (abs(error) for error, drawn in zip(i.numbers("errors"), i["drawn"], strict=True) if drawn), default=0.0),
    ),
    equation(
        "Eq12.wc_prime_ratio", "eq. 12 and 17", "Footprint over (w_c/cos θ_c): 1/(1 − h² tan² θ_c), h = tan φ/res.",
        lambda i: 1 / (1 - (math.tan(i.angle("phi_deg")) / i.number("res_cy", "res")
                            * math.tan(i.angle("theta_c_deg"))) ** 2),
        tuple({"phi_deg": 35, "theta_c_deg": t, "res_cy": r, "z0": 7} for t, r in ((0, 64), (45, 64), (80, 512), (88,
        300))),
        measured=lambda i: _pixel_ratio(i, math.pi / 2 - i.angle("theta_c_deg")) * math.cos(i.angle("theta_c_deg")),
    ),
    *(equation(
        f"Eq{e}.wc{axis}", f"eq. {e}", "Width of a pixel's beam on a plane parallel to the image plane: 2z tan φ/res.",
        lambda i, p=f"phi_{axis}_deg": overhead.pixel_width(number(i, "z"), jnp.asarray(i.angle(p, "phi_deg")),
        i.number("res")),
        ({f"phi_{axis}_deg": 37, "res": 300, "z": 4.5},),
        measured=lambda i, p=f"phi_{axis}_deg": pixel_cut(
            jnp.asarray(0.2), jnp.asarray(math.tan(i.angle(p, "phi_deg")) / i.number("res")), number(i, "z"),
            jnp.asarray(math.pi / 2)),
    ) for e, axis in ((16, "x"), (17, "y"))),
    equation(
        "Eq17.offaxis_ratio", "eq. 17", "Across the beam at the view angle α a pixel is thinner than eq. 17 by cos α.",
        _offaxis, tuple({"phi_deg": 45, "res": r, "z": 3, "view_angle_deg": a} for a, r in ((0, 64), (25, 64), (44,
        512))),
        measured=lambda i: _pixel_ratio(i, i.angle("view_angle_deg") + math.pi / 2),
        verdict="conditional", condition="Eq. 17 is a thickness on the view axis only.",
    ),
    equation(
        "Eq17.parallel_plane_ratio", "eq. 17",
        "On a plane parallel to the image plane eq. 17 is exact at any view angle.",
        lambda i: 1.0, tuple({"phi_deg": 45, "res": 64, "z": 3, "view_angle_deg": a} for a in (0, 25, 44)),
        measured=lambda i: _pixel_ratio(i, math.pi / 2),
    ),
    equation(
        "Eq19.wl_prime_ratio", "eq. 19", "Texel beam over (1/res) dz'/dt: 1/(1 − (W z'/(2 res f' n'))²).", _beam_eq19,
        tuple({**VIEW, "gamma_deg": g, "nprime": q, "z": z, "res_lt": r}
              for g, q, z, r in ((90, 0.9, 53, 128), (90, 7, 5, 64), (55, 4, 20, 64))),
        measured=_cut_eq19, verdict="conditional",
        condition="To second order in the texel; for γ < π/2 with dz', not dz.",
    ),
    equation(
        "Eq20.s", "eq. 20 and 22", "s of a point with the light overhead.",
        lambda i: overhead.overhead_s(frustum(i), number(i, "nprime"), number(i, "x"), number(i, "z")), MAPS,
        independent=lambda i: 0.5 + i.number("x") * rates(frustum(i), i.number("nprime"), i.number("z"), True)[1][0],
        verdict="conditional", condition="tan φ'_x = f tan φ_x/f' encloses the frustum for γ = π/2 and n' ≥ n only.",
    ),
    equation(
        "Eq20.tgphix_true_over_sub", "eq. 20 and 22", "True opening of P over f tan φ_x/f'.", _opening_ratio,
        tuple({**VIEW, "gamma_deg": g, "nprime": q} for g, q in ((90, 7), (90, 0.3), (60, 6), (40, 3), (20, 15))),
        independent=_opening_corners,
    ),
    equation(
        "Eq21.t", "eq. 21–22", "t of a depth with the light overhead.",
        lambda i: overhead.overhead_t(frustum(i.merged({"phi_deg": 30})), number(i, "nprime"), number(i, "z")), MAPS,
        independent=lambda i: rates(frustum(i.merged({"phi_deg": 30})), i.number("nprime"), i.number("z"))[0][0, 1],
    ),
    equation(
        "Eq23.dsdx", "eq. 23", "ds/dx with the light overhead.",
        lambda i: overhead.overhead_ds_dx(frustum(i), number(i, "nprime"), number(i, "z")), MAPS,
        independent=lambda i: rates(frustum(i), i.number("nprime"), i.number("z"), True)[1][0],
    ),
    equation(
        "Eq24.dtdz", "eq. 24", "dt/dz with the light overhead.",
        lambda i: overhead.overhead_dt_dz(frustum(i.merged({"phi_deg": 30})), number(i, "nprime"), number(i, "z")),
        MAPS,
        independent=lambda i: rates(frustum(i.merged({"phi_deg": 30})), i.number("nprime"), i.number("z"))[3][0],
    ),
    equation(
        "Eq25.mx", "eq. 25", "m_x on the view axis with the light overhead.",
        lambda i: overhead.overhead_error_x(frustum(i), number(i, "nprime"), number(i, "z"), ratio(i, "res_cx",
        "res_ls")),
        MAPS, independent=lambda i: ratio(i, "res_cx", "res_ls") * derived_errors(
            frustum(i), i.number("nprime"), i.number("z"), True)[0][0],
    ),
    equation(
        "Eq26.mz", "eq. 26", "m_z on the view axis with the light overhead.",
        lambda i: overhead.overhead_error_z(frustum(i), number(i, "nprime"), number(i, "z"), ratio(i)), MAPS,
        independent=lambda i: derived_errors(frustum(i), i.number("nprime"), i.number("z"))[1][0] * ratio(i),
        measured=lambda i: cut(frustum(i), i.number("nprime"), i.number("z")).perspective * ratio(i),
        measured_tolerance=1e-6,
    ),
    equation(
        "Eq27.nprime", "eq. 27", "n' = n + √(fn) makes m_z equal at both planes, and least.",
        lambda i: near_distances.wimmer(frustum(i)), ({"n": 1, "f": 30}, {"n": 0.2, "f": 900}, {"n": 3, "f": 3.3}),
        independent=lambda i: equal_errors(frustum(i)),
    ),
    equation(
        "Eq28.Mx", "eq. 28", "M_x, at the near plane.",
        lambda i: overhead.overhead_max_x(frustum(i), number(i, "nprime"), ratio(i)), MAXIMA,
        independent=lambda i: ratio(i) * derived_max(frustum(i), i.number("nprime"))[0],
        verdict="conditional", condition="n' ≥ n",
    ),
    equation(
        "Eq29.Mz", "eq. 29", "M_z, at the far plane up to n'_LiSPSM, at the near plane beyond.",
        lambda i: overhead.overhead_max_z(frustum(i), number(i, "nprime"), ratio(i)), MAXIMA,
        independent=lambda i: ratio(i) * derived_max(frustum(i), i.number("nprime"))[1],
    ),
    equation(
        "Eq30.S", "eq. 30", "S is texels at critical resolution per pixel, so M_x·M_z.",
        lambda i: _critical(i, "s") * _critical(i, "t") / i.number("res_c") ** 2,
        tuple({**s, "res_c": 300} for s in MAXIMA),
        independent=lambda i: derived_storage(frustum(i), i.number("nprime")),
    ),
    *(equation(
        f"Eq30.crit_res_{axis}", "text before eq. 30", "Resolution at which the largest error is 1.",
        lambda i, a=axis: _critical(i, a), tuple({**s, "res_c": 300} for s in MAXIMA),
        independent=lambda i, k=k: root(
            lambda r: derived_max(frustum(i), i.number("nprime"))[k] * i.number("res_c") / r - 1, 1e-3, 1e12),
    ) for k, axis in enumerate("st")),
    equation(
        "Eq31.S", "eq. 31", "S is flat for n ≤ n' ≤ n'_LiSPSM and rises beyond.",
        lambda i: storage.overhead_storage(frustum(i), number(i, "nprime")), MAXIMA,
        independent=lambda i: derived_storage(frustum(i), i.number("nprime")),
        verdict="conditional", condition="n' ≥ n",
    ),
    equation(
        "Eq33.nprime", "eq. 32–33", "n' of a position η between uniform (−1), LiSPSM (0) and PSM (1).",
        lambda i: near_distances.near_distance_from_eta(frustum(i), i.number("eta")),
        tuple({"n": n, "f": f, "eta": e} for n, f in ((2, 70), (0.3, 9)) for e in (-0.8, -0.3, 0, 0.005, 0.4, 1)),
        independent=_invert_eta, tolerance=1e-7, verdict="erratum",
        correction=Correction(
            "n' = (n + √(fn))/(n + η√(fn)) for η ≥ 0",
            "n' = n(n + √(fn))/(n + η√(fn)): the printed form lacks a length.",
            lambda i: (i.number("n") + math.sqrt(i.number("f") * i.number("n")))
            / (i.number("n") + i.number("eta") * math.sqrt(i.number("f") * i.number("n"))), {"n": 2, "f": 200,
            "eta": 0.5},
        ),
    ),
)  # fmt: skip
