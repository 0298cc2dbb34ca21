"""warping, equations 42 to 44, beyond: the published n'(γ) against the n' of least error.

Down to γ_lim the source's n' is optimal on the view axis. Below, it fades to the uniform map with a function that "was
decided arbitrarily". The optimum has a closed form: with E the offset of the worst line at the near plane and W the
extent, n' = max(n' of equal error, E·W/(W − 2E)). It needs no fade, and tends to ∞ like 1/γ by itself. Over the whole
vertical section of the view, not its axis alone, errors are largest on the top edge; the same formula with that edge's
offsets is the optimum, and there the published n' is too strong a warp for every γ.

Measured: the closed forms are held to a search that tries thousands of n' for every angle with no formula for the
optimum, and the errors it compares are those that beams give (figure 23). How much is lost is found where it is
largest, by refinement.

How to read it: n' on the left; next to it the largest error over the least possible one, on the axis and over the
whole section. 1 is the optimum.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure

from experiments.base import Claim
from experiments.claiming import agrees, all_true, at_most, equals
from experiments.layout import mark_x
from experiments.warped_views import check_count, check_view, in_double, refined_largest, views
from shadowjax._types import Array
from shadowjax.plotting import PALETTE, label, new_figure, styled
from shadowjax.theory.aliasing.error import max_error_z
from shadowjax.theory.aliasing.light_frustum import SECTIONS, LightFrustum
from shadowjax.theory.aliasing.near_distances import generalised, wimmer_over_sine
from shadowjax.theory.aliasing.optimal import minimax

RULES = {"eqs 42 and 44": PALETTE[0], "eqs 42 and 43": PALETTE[2], "Wimmer: (n + √(fn))/sin γ": PALETTE[4]}
SQUARED, SINE, WIMMER = RULES


@dataclass(frozen=True)
class Config:
    """Settings.

    Attributes:
        near: n, world units.
        far: f, world units.
        phi_deg: Half the angle of view, degrees.
        num_gammas: Angles from 0.5 to 90 degrees, ≥ 50.
        num_searched: Angles at which n' is searched, ≥ 3.
        num_near_distances: Values of n' tried for each, ≥ 100.
    """

    near: float = 1.0
    far: float = 100.0
    phi_deg: float = 30.0
    num_gammas: int = 1433
    num_searched: int = 24
    num_near_distances: int = 4001

    def __post_init__(self):
        check_view(self.near, self.far, self.phi_deg)
        check_count(self.num_gammas, "num_gammas", 50)
        check_count(self.num_searched, "num_searched", 3)
        check_count(self.num_near_distances, "num_near_distances", 100)


@dataclass(frozen=True)
class Result:
    """n' and losses over γ in degrees; losses are largest errors over the least possible.

    Attributes:
        config: The settings.
        gammas: Angles.
        limit: γ_lim.
        rules: Rule → n'.
        best: Section → n' of least error.
        losses: Section → rule → loss.
        worst: Section → rule → γ of the largest loss up to γ_lim, and the loss.
        at_limit: Loss of eqs 42 and 44 over the whole section at γ_lim.
        searched: Section → least error of all n' tried over that of the closed form.
        step: ln of the ratio of neighbouring n' tried.
        trend: γ·n' of least error on the axis at two small angles, radians times world units.
    """

    config: Config
    gammas: np.ndarray
    limit: float
    rules: Mapping[str, np.ndarray]
    best: Mapping[str, np.ndarray]
    losses: Mapping[str, Mapping[str, np.ndarray]]
    worst: Mapping[str, Mapping[str, tuple[float, float]]]
    at_limit: float
    searched: Mapping[str, np.ndarray]
    step: float
    trend: tuple[float, float]


@jax.jit
def _rules(view: LightFrustum) -> tuple[Array, ...]:
    return generalised(view), generalised(view, "sine"), wimmer_over_sine(view)


@jax.jit
def _best(view: LightFrustum) -> tuple[Array, Array]:
    return minimax(view), minimax(view, "whole")


@jax.jit
def _errors(view: LightFrustum, near_distance: Array) -> tuple[Array, Array]:
    return max_error_z(view, near_distance), max_error_z(view, near_distance, "whole")


@jax.jit
def _losses(view: LightFrustum) -> tuple[tuple[Array, ...], ...]:
    """For each section, the loss of each rule."""
    least = [_errors(view, distance)[i] for i, distance in enumerate(_best(view))]
    return tuple(tuple(_errors(view, distance)[i] / least[i] for distance in _rules(view)) for i in range(2))


@in_double
def run(config: Config) -> Result:
    """Closed forms over γ, the search, and the largest losses."""

    def view(gammas: Any) -> LightFrustum:
        return views(config.near, config.far, config.phi_deg, gammas)

    gammas = np.linspace(0.5, 90, config.num_gammas)
    limit = float(np.degrees(np.asarray(view(90.0).gamma_limit)))
    rules = dict(zip(RULES, (np.asarray(x) for x in _rules(view(gammas))), strict=True))
    best = {str(name): np.asarray(x) for name, x in zip(SECTIONS, _best(view(gammas)), strict=True)}
    losses = [[np.asarray(x) for x in section] for section in _losses(view(gammas))]
    some = np.linspace(2, 90, config.num_searched)[:, None]
    tried = config.near * np.exp(np.linspace(-4, 4 + np.log(1e4 * config.far / config.near), config.num_near_distances))
    all_errors = [np.asarray(x).min(axis=1) for x in _errors(view(some), jnp.asarray(tried))]
    at_best = [np.asarray(_errors(view(some), distance)[i])[:, 0] for i, distance in enumerate(_best(view(some)))]
    small = np.array([0.02, 0.01])
    trend = np.radians(small) * np.asarray(_best(view(small))[0])
    return Result(
        config, gammas, limit, rules, best,
        losses={name: dict(zip(RULES, row, strict=True)) for name, row in zip(SECTIONS, losses, strict=True)},
        worst={
            name: {
                rule: refined_largest(lambda g, i=i, j=j: np.asarray(_losses(view(g))[i][j]), 1.0, limit)
                for j, rule in enumerate(RULES)
            }
            for i, name in enumerate(SECTIONS)
        },
        at_limit=float(_losses(view(limit))[1][0]),
        searched={name: all_errors[i] / at_best[i] for i, name in enumerate(SECTIONS)},
        step=float(np.log(tried[1] / tried[0])), trend=(float(trend[0]), float(trend[1])),
    )  # fmt: skip


def penalty_at_limit(ratio: float) -> float:
    """Loss of the published n' over the whole section at γ_lim, from f/n alone: it tends to 2."""
    root = np.sqrt(ratio)
    axis, whole = (ratio - root + 2) / (root - 1), 2 * (ratio - root + 1) / (root - 1)
    extent = 2 * (ratio + 1)
    return float((axis + extent) / axis / ((whole + extent) / whole))


def claims(result: Result) -> tuple[Claim, ...]:
    """Where the published n' is optimal, and what it loses where it is not."""
    config = result.config
    ratio = config.far / config.near
    above = result.gammas >= result.limit
    searched = np.concatenate(list(result.searched.values()))
    # ln M_z changes by at most twice as much as ln n' does
    room = np.exp(2 * result.step / 2)
    least = min(loss.min() for section in result.losses.values() for loss in section.values())
    axis, whole = (result.worst[name] for name in SECTIONS)
    published, gentle = axis[SQUARED], axis[SINE]
    found: list[Claim] = [
        Claim("no n' tried beats the closed forms", bool(searched.min() >= 1 - 1e-12), f"{searched.min():.15g}",
              "at least 1"),
        at_most("and the best one tried comes as near as neighbours are apart", searched, room),
        Claim("no rule beats them at any angle", bool(least >= 1 - 1e-12), f"{least:.15g}", "at least 1"),
        agrees("on the axis eq. 42 is the optimum for every γ ≥ γ_lim", result.losses["axis"][SQUARED][above], 1.0,
               1e-12),
        equals("γ·n' of least error tends to a constant as γ → 0", result.trend[1], result.trend[0], 1e-2),
        all_true("over the whole section the best warp is weaker than on the axis at every γ < 90°",
                 (result.best["whole"] > result.best["axis"])[result.gammas < 90], "angles"),
        equals("the loss over the whole section at γ_lim follows from f/n alone", result.at_limit,
               penalty_at_limit(ratio), 1e-9),
    ]  # fmt: skip
    if (config.near, config.far, config.phi_deg) == (1.0, 100.0, 30.0):
        found += [
            equals("eqs 42 and 44 lose most on the axis", published[1], 1.199833484, 1e-8),
            Claim("at γ = 29.317°", abs(published[0] - 29.317) < 1e-3, f"{published[0]:.4f}°", "29.317°"),
            equals("and over the whole section", whole[SQUARED][1], 1.8892391304, 1e-9),
            equals("eqs 42 and 43 lose most on the axis", gentle[1], 2.159286488, 1e-8),
            Claim("at γ = 11.165°", abs(gentle[0] - 11.165) < 1e-3, f"{gentle[0]:.4f}°", "11.165°"),
        ]
    return tuple(found)


def numbers(result: Result) -> dict[str, Any]:
    """n' and losses over γ."""
    return {
        "gamma_deg": result.gammas, "gamma_limit_deg": result.limit, "near_distance": result.rules,
        "least_error_near_distance": result.best, "loss": result.losses, "largest_loss": result.worst,
    }  # fmt: skip


@styled
def draw(result: Result) -> Figure:
    """n' on the left, losses on the axis and over the section next to it."""
    figure, axes = new_figure(12.4, 4.5, 1, 3)
    left, middle, right = axes[0]
    for name, color in reversed(RULES.items()):
        width = 2.0 if name == SQUARED else 1.4
        left.plot(result.gammas, result.rules[name], color=color, linewidth=width, label=name)
        for spot, section in ((middle, "axis"), (right, "whole")):
            spot.plot(result.gammas, result.losses[section][name], color=color, linewidth=width)
    left.plot(result.gammas, result.best["axis"], color=PALETTE[1], linewidth=2, label="least error on the axis")
    left.plot(result.gammas, result.best["whole"], color=PALETTE[1], linewidth=1.4, linestyle=(0, (4, 2)),
              label="least error over the section")  # fmt: skip
    left.set_yscale("log")
    left.set_ylim(1, 1e4 * result.config.near)
    label(left, "γ, angle of light and view (degrees)", "n' (world units)", "Near distance")
    for spot, section, title in ((middle, "axis", "Loss on the axis"), (right, "whole", "Loss over the whole section")):
        at, worst = result.worst[section][SQUARED]
        spot.annotate(
            f"×{worst:.3f} at {at:.2f}°", (at, worst), (70, 90), textcoords="offset points", fontsize=8,
            arrowprops={"arrowstyle": "-", "color": PALETTE[0], "linewidth": 0.8},
        )  # fmt: skip
        spot.set_ylim(0.95, 3.6)
        label(spot, "γ, angle of light and view (degrees)", "M_z over the least possible", title)
    for spot in axes[0]:
        mark_x(spot, result.limit, f"γ_lim = {result.limit:.2f}°", "left")
    handles, names = left.get_legend_handles_labels()
    figure.legend(handles, names, loc="outside lower center", ncols=5)
    return figure
