"""warping, figure 22: the near distance n' for every angle between light and view, before and after its correction.

Before (a): n'₁ for γ ≥ φ and n'₂ below make the error along z' equal at both planes. The source says that n'₂ turns
negative for γ ≤ φ. It does not: at γ = φ it is √(fn)·sin φ, and it vanishes at tan γ = tan φ/(1 + √(n/f)).

After (b): below γ_lim, where the depth ranges of near and far plane overlap seen from the light, the source replaces n'
by n'(γ_lim)/r(γ) with r of eq. 43 or 44, so that the warp fades to the uniform map. That is continuous and not smooth.
The dashed line is what needs no such choice: the n' of least M_z in closed form, which equals the source's for γ ≥
γ_lim.

Measured: n' of equal error is found a second time by bisection on the beams of the warp's matrix, and γ_lim from the
frustum's corners.

How to read it: lines are formulas, markers are measured. The vertical axis of (b) is logarithmic.
"""

import math
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure

from experiments.base import Claim
from experiments.claiming import agrees, equals
from experiments.layout import mark_x
from experiments.warped_views import check_count, check_view, in_double, measured_errors, views
from shadowjax._types import Array
from shadowjax.evaluate.measure import frustum_corners, light_axes
from shadowjax.plotting import PALETTE, label, new_figure, styled
from shadowjax.theory.aliasing.light_frustum import LightFrustum
from shadowjax.theory.aliasing.near_distances import equalising, generalised
from shadowjax.theory.aliasing.optimal import minimax

STEPS = 60  # halvings of a bracket of n'


@dataclass(frozen=True)
class Config:
    """Settings.

    Attributes:
        near: n, world units.
        far: f, world units.
        phi_deg: Half the angle of view, degrees.
        num_gammas: Angles from 0 to 90 degrees, ≥ 19.
        num_measured: Angles at which n' is found by bisection, ≥ 4.
    """

    near: float = 1.0
    far: float = 100.0
    phi_deg: float = 30.0
    num_gammas: int = 721
    num_measured: int = 16

    def __post_init__(self):
        check_view(self.near, self.far, self.phi_deg)
        check_count(self.num_gammas, "num_gammas", 19)
        check_count(self.num_measured, "num_measured", 4)


@dataclass(frozen=True)
class Result:
    """n' over γ; γ in degrees.

    Attributes:
        config: The settings.
        gammas: Angles.
        before: n'₁ and n'₂ of eq. 39.
        squared: Eq. 42 with eq. 44.
        sine: Eq. 42 with eq. 43.
        best: n' of least M_z on the view axis.
        measured_gammas: Angles at which was measured.
        measured: n' of equal error, by bisection on beams.
        formula: n' of eq. 39 there.
        special: Name → number: n' and slopes (a radian) at special angles, and γ_lim from corners.
    """

    config: Config
    gammas: np.ndarray
    before: np.ndarray
    squared: np.ndarray
    sine: np.ndarray
    best: np.ndarray
    measured_gammas: np.ndarray
    measured: np.ndarray
    formula: np.ndarray
    special: dict[str, float]

    @property
    def limit(self) -> float:
        """γ_lim of eq. 40, degrees."""
        config = self.config
        span = (config.far + config.near) / (config.far - config.near)
        return math.degrees(math.atan(math.tan(math.radians(config.phi_deg)) * span))


@jax.jit
def _near_distances(view: LightFrustum) -> tuple[Array, ...]:
    return equalising(view), generalised(view), generalised(view, "sine"), minimax(view)


@jax.jit
def _overlap(view: LightFrustum) -> Array:
    """How far the near plane's z' range reaches into the far plane's, from the corners; view along a last axis."""

    def one(view: LightFrustum) -> Array:
        level = frustum_corners(view) @ light_axes(view.gamma)[2]
        return jnp.max(level[:4]) - jnp.min(level[4:])

    return jax.vmap(one)(view)


def _bisect(function: Any, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Roots of a function that rises, elementwise; positive ends."""
    for _ in range(STEPS):
        middle = np.sqrt(low * high)
        above = function(middle) > 0
        low, high = np.where(above, low, middle), np.where(above, middle, high)
    return np.sqrt(low * high)


@in_double
def run(config: Config) -> Result:
    """Formulas over γ, bisection on beams, and slopes at γ_lim."""
    near, far, phi_deg = config.near, config.far, config.phi_deg
    gammas = np.linspace(0, 90, config.num_gammas)
    view = views(near, far, phi_deg, gammas)
    before, squared, sine, best = (np.asarray(x) for x in _near_distances(view))
    zero_deg = math.degrees(math.atan(math.tan(math.radians(phi_deg)) / (1 + math.sqrt(near / far))))
    measured_gammas = np.linspace(zero_deg + 0.05 * (90 - zero_deg), 90, config.num_measured)
    some = views(near, far, phi_deg, measured_gammas)
    formula = np.asarray(_near_distances(some)[0])
    planes = np.array([near, far])
    columns = views(near, far, phi_deg, measured_gammas[:, None])

    def difference(near_distance: np.ndarray) -> np.ndarray:
        # the near plane's error over the far plane's grows with n'
        error = measured_errors(columns, near_distance[:, None], planes, 2**20)[1]
        return error[:, 0] - error[:, 1]

    one = np.ones_like(measured_gammas)
    measured = _bisect(difference, 1e-3 * near * one, 10 * far * one)
    touching = _bisect(lambda g: -np.asarray(_overlap(views(near, far, phi_deg, g))), np.full(2, 1.0), np.full(2, 90.0))
    limit = float(touching[0])
    step = 1e-4  # degrees
    around = views(near, far, phi_deg, np.array([limit - step, limit, limit + step, phi_deg, zero_deg]))
    eq39, published, gentle, _ = (np.asarray(x) for x in _near_distances(around))
    slope = {"right": published[2] - published[1], "left": published[1] - published[0], "sine": gentle[1] - gentle[0]}
    return Result(
        config, gammas, before, squared, sine, best, measured_gammas, measured, formula,
        {"limit_deg": limit, "at_limit": float(published[1]), "before_at_limit": float(eq39[1]), "zero_deg": zero_deg,
         "at_phi": float(eq39[3]), "at_zero": float(eq39[4])}
        | {name: float(value) / math.radians(step) for name, value in slope.items()},
    )  # fmt: skip


def claims(result: Result) -> tuple[Claim, ...]:
    """What the figure shows, and the sign of n'₂."""
    config, special = result.config, result.special
    root, phi, limit = math.sqrt(config.far * config.near), math.radians(config.phi_deg), math.radians(result.limit)
    at_limit = (config.near + root) * math.sin(limit) - config.near * math.tan(phi) * math.cos(limit)
    rising = (config.near + root) * math.cos(limit) + config.near * math.tan(phi) * math.sin(limit)
    falling = -math.pi / limit * at_limit  # r' = π/γ_lim for eq. 44
    above = result.gammas >= result.limit
    between = (result.gammas > special["zero_deg"]) & (result.gammas <= config.phi_deg)
    step = math.radians(1e-4)
    jump = special["right"] - special["left"]
    return (
        agrees("n' of equal error, found on beams, is eq. 39", result.measured, result.formula, 1e-8),
        equals("n'₁ at γ = 90° is n + √(fn)", result.before[-1], config.near + root, 1e-12),
        equals("corrected: n'₂ at γ = φ is √(fn)·sin φ, not negative", special["at_phi"], root * math.sin(phi), 1e-9),
        Claim("corrected: n'₂ vanishes at tan γ = tan φ/(1 + √(n/f))",
              abs(special["at_zero"]) < 1e-9 * root and bool((result.before[between] > 0).all()),
              f"{special['zero_deg']:.6f}°, positive from there to φ", f"below φ = {config.phi_deg:g}°"),
        equals("γ_lim of eq. 40 is where near and far plane touch seen from the light", special["limit_deg"],
               result.limit, 1e-9),
        Claim("γ_lim exceeds φ", result.limit > config.phi_deg, f"{result.limit:.6f}°", f"above {config.phi_deg:g}°"),
        equals("eq. 42 is continuous at γ_lim", special["at_limit"], special["before_at_limit"], 1e-9),
        Claim("but not smooth with eq. 44", abs(jump - (rising - falling)) < 100 * step * (rising - falling),
              f"slopes {special['left']:.3f} and {special['right']:.3f} a radian", f"{falling:.3f} and {rising:.3f}"),
        Claim("nor with eq. 43", abs(special["sine"]) < 100 * step * rising and rising > 0,
              f"slopes {special['sine']:.3f} and {special['right']:.3f} a radian", f"0 and {rising:.3f}"),
        agrees("above γ_lim the n' of least M_z is the source's", result.best[above], result.squared[above], 1e-12),
    )  # fmt: skip


def numbers(result: Result) -> dict[str, Any]:
    """n' over γ and at special angles."""
    return {
        "gamma_deg": result.gammas, "eq39": result.before, "eq42_44": result.squared, "eq42_43": result.sine,
        "least_error": result.best, "gamma_measured_deg": result.measured_gammas, "measured": result.measured,
        "special": result.special,
    }  # fmt: skip


@styled
def draw(result: Result) -> Figure:
    """(a) on the left, (b) on the right."""
    figure, axes = new_figure(9.6, 4.3, 1, 2)
    left, right = axes[0]
    phi, zero, limit = result.config.phi_deg, result.special["zero_deg"], result.limit
    top = 1.1 * result.before.max()
    left.axhline(0, color="#4d4d4d", linewidth=0.8)
    left.axvspan(0, zero, color="#f0d9cc", linewidth=0)
    left.plot(result.gammas, result.before, color=PALETTE[0], label="eq. 39")
    left.plot(result.measured_gammas, result.measured, "o", color=PALETTE[0], markersize=4.5, label="by bisection")
    left.set_ylim(-0.6 * top, top)
    left.text(0.7 * zero, -0.45 * top, "n' negative:\nno warp", ha="right", fontsize=8)
    mark_x(left, zero, f"{zero:.2f}°")
    mark_x(left, phi, f"φ = {phi:g}°", "right")
    label(left, "γ, angle of light and view (degrees)", "n' (world units)", "(a) Equal error at both planes")
    left.legend(loc="lower right")
    below = result.gammas <= limit
    right.plot(result.gammas[below], result.sine[below], color=PALETTE[2], linewidth=1.4, label="eqs 42 and 43")
    right.plot(result.gammas, result.squared, color=PALETTE[0], label="eqs 42 and 44")
    right.plot(result.gammas, result.best, color=PALETTE[1], linestyle=(0, (4, 2)), linewidth=1.5, label="least M_z")
    right.set_yscale("log")
    right.set_ylim(0.5 * result.best.min(), 3 * result.config.far)
    mark_x(right, limit, f"γ_lim = {limit:.2f}°", "right")
    label(right, "γ, angle of light and view (degrees)", "n' (world units)", "(b) Fading to the uniform map")
    right.legend(loc="upper right")
    return figure
