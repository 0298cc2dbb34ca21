"""Warping source, eq. 45 to 49: the package's logarithmic warp, point by point, and its best c by long numbers."""

import math
from decimal import Decimal, localcontext

import jax
import jax.numpy as jnp
import numpy as np

from shadowjax.ledger.equation import Equation
from shadowjax.ledger.inputs import Inputs
from shadowjax.ledger.warping.tools import equation, frustum
from shadowjax.theory.aliasing.light_frustum import Section
from shadowjax.warps.logarithmic import LogarithmicWarp, log_distance, log_error_z

# Corners of a trapezium: half widths 1 and 4 at heights 0.5 and 6.
_CORNERS = ((-1.0, 0.5), (1.0, 0.5), (-4.0, 6.0), (4.0, 6.0))
_PLACES = ((0.3, 0.5), (-1.5, 3.0), (2.0, 6.0))
_BEYOND = (0.4, 2.01e-6, 1.5e-6, -5e-3, -1.8)  # the centre of projection, of the lowest corner's distance from it
_SECTIONS: dict[str, Section] = {"axis": "axis", "whole": "whole"}


def _warp(i: Inputs) -> LogarithmicWarp:
    return LogarithmicWarp.fit(jnp.asarray(_CORNERS), i.number("strength"))


def _square(i: Inputs) -> list[tuple[float, float]]:
    """(s, t) of the places by plain logarithms of 40 digits, in the limit for strength 0."""
    found = []
    with localcontext(prec=40):
        k, length = Decimal(i.number("strength")), Decimal("5.5")
        half = max(Decimal(1), Decimal(4) / (1 + k * length))
        for x, z in _PLACES:
            up = Decimal(z) - Decimal("0.5")
            t = (1 + k * up).ln() / (1 + k * length).ln() if k else up / length
            found.append((float((Decimal(x) / (1 + k * up) / half + 1) / 2), float(t)))
    return found


def _rates(i: Inputs):
    """Lengths of the inverse's derivatives by s and by t."""
    rates = jax.vmap(jax.jacfwd(_warp(i).inverse))(jnp.asarray(_square(i)))
    return jnp.stack([rates[:, 0, 0], rates[:, 1, 1]], axis=-1)


def _places_about_centre(i: Inputs) -> list[tuple[float, float]]:
    """Places before, next to and behind the centre of projection, 1/strength below the lowest corner."""
    return [*_PLACES, *((0.0, 0.5 + (beyond - 1) / i.number("strength")) for beyond in _BEYOND)]


def _is_regular(i: Inputs) -> list[bool]:
    """Whether a place lies in front of the centre of projection by more than rounding."""
    return [True] * len(_PLACES) + [beyond > 2e-6 for beyond in _BEYOND]


def _best(i: Inputs):
    return log_distance(frustum(i), _SECTIONS[i.text("section")])


def _best_in_decimals(i: Inputs) -> float:
    """W/x with x the root of (1 + x)·ln(1 + x)/x = 1 + x·E/W, by halving an interval of ln x."""
    view = frustum(i)
    with localcontext(prec=50):
        share = (1 - Decimal(float(view.slack(_SECTIONS[i.text("section")]) / view.extent))) / 2
        low, high = Decimal(-12), Decimal(20)
        for _ in range(110):
            middle = (low + high) / 2
            x = middle.exp()
            low, high = (middle, high) if (1 + x) * (1 + x).ln() / x > 1 + x * share else (low, middle)
        return float(view.extent) / float(low.exp())


def _decided(i: Inputs) -> float:
    """The larger of that and the c of constant errors."""
    return max(_best_in_decimals(i), float(frustum(i).near * frustum(i).low_slope))


def _error_from_warp(i: Inputs) -> float:
    """m_z of a point from the derivative of a logarithm, the frustum's corners looked up one by one."""
    n, f, phi = i.number("n"), i.number("f"), i.angle("phi_y_deg")
    gamma, c, z, y = i.angle("gamma_deg"), i.number("c"), i.number("z"), i.number("y")
    heights = [s * d * math.tan(phi) * math.cos(gamma) + d * math.sin(gamma) for d in (n, f) for s in (-1, 1)]
    rise = y * math.cos(gamma) + z * math.sin(gamma) - min(heights)
    length = max(heights) - min(heights)
    return i.number("ratio") * (c + rise) * math.log1p(length / c) / (2 * z * math.tan(phi))


_STRENGTHS = tuple({"strength": k} for k in (2.0, 0.3, 1.7e-4, 1e-5, 0))
# The last views lie just above the γ from which the uniform map is best, where W/c is small.
_VIEW = {"n": 1, "f": 40, "phi_y_deg": 30}
_EDGE = math.degrees(math.atan(math.tan(math.radians(30)) / 39))
_VIEWS = (
    *({**_VIEW, "section": section, "gamma_deg": g} for section in ("axis", "whole") for g in (75, 31, 12)),
    *({**_VIEW, "section": "whole", "gamma_deg": _EDGE * (1 + step)} for step in (3e-2, 1e-3)),
)

EQUATIONS: tuple[Equation, ...] = (
    equation(
        "Eq48.st", "eq. 48", "(s, t) of the logarithmic map, and its limit of strength 0.",
        lambda i: _warp(i).forward(jnp.asarray(_PLACES)), _STRENGTHS, independent=_square, tolerance=2e-14,
    ),
    equation(
        "Eq48.inverse", "eq. 48", "Places of (s, t) of the logarithmic map.",
        lambda i: _warp(i).inverse(jnp.asarray(_square(i))), _STRENGTHS,
        independent=lambda i: np.asarray(_PLACES), tolerance=2e-14,
    ),
    equation(
        "Eq45.widths", "eq. 45", "Lengths of the steps of s and t on the plane grow as u + c.",
        lambda i: _warp(i).widths(jnp.asarray(_square(i))), _STRENGTHS, independent=_rates, tolerance=1e-11,
    ),
    equation(
        "Eq48.regular", "eq. 48", "Places in front of the centre of projection.",
        lambda i: _warp(i).regular(jnp.asarray(_places_about_centre(i))), ({"strength": 0.3}, {"strength": 0.6}),
        independent=_is_regular,
    ),
    equation(
        "beyond.log_c", "beyond eq. 49", "The c of least M_z for a logarithmic warp, for any γ.", _best, _VIEWS,
        independent=_decided, tolerance=1e-9,
    ),
    equation(
        "Eq49.mz_any", "eq. 45 and 49", "m_z of the logarithmic map at any point, for any γ.",
        lambda i: log_error_z(frustum(i), *(jnp.asarray(i.number(name)) for name in ("c", "z", "y", "ratio"))),
        tuple({**_VIEW, "gamma_deg": g, "c": c, "z": z, "y": y, "ratio": 1.5}
              for g, c, z, y in ((75, 0.7, 2, 0.4), (20, 3, 30, -5))), independent=_error_from_warp,
    ),
)  # fmt: skip
