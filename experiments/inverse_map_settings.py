"""Inverse problem: near distance n', bias and filter width of a shadow map, all at once, for the least error in view.

A filter that counts depth tests has no gradient in its bias, and moving n' moves every texel, so the error of a map is
rough in all three. `optimize.viewed.expected` averages it over the place of each receiver inside its texel and softens
the tests; the result is smooth, and its slope sees the edges of shadows. L-BFGS-B within bounds lowers it from several
starts. The reference is the mean over the sun's disc, so that a wider kernel may be right.

Measured: the slope against central differences; the softened error against that of the map itself, which is cast,
tested and filtered as always, at every end; whether the map's own error falls against the default (n' of eqs 42 and
44, 3 × 3 bilinear taps a texel apart, least bias that frees a plane of acne); whether settings chosen one at a time, n'
first, then bias, then width, do as well; how many starts reach the best; and whether a grid of settings holds a better
one. Suns are random, over several scenes.

How to read it: above, the picture of visibility for the first sun: the truth, and what the map has too dark (blue) or
too light (orange). Below: the map's own errors; softened against measured errors, with the line where they are equal;
and where every start ends.
"""

import math
from dataclasses import dataclass
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure

from experiments.base import Claim
from experiments.claiming import all_true, at_most
from shadowjax import DirectionalLight, scenes
from shadowjax._checks import require, require_int
from shadowjax.optimize.solution import Solution
from shadowjax.optimize.solvers.bounded import SearchCertificate, minimise_multistart
from shadowjax.optimize.viewed.expected import ExpectedError, MapSettings, error_and_slope
from shadowjax.plotting import PALETTE, label, new_figure, show_image, styled

LOWER, UPPER = np.array([0.0, 0.0, 0.05]), np.array([0.97, 6.0, 3.0])  # of bend, bias and width
MOST_STEPS = 20  # of a search
NEARLY = 0.02  # relative excess of an error that counts as the best
DEFAULT, APART, JOINT = "default", "one at a time", "all at once"


@dataclass(frozen=True)
class Config:
    """Settings.

    Attributes:
        scenes: Built-in scenes with a directional light.
        num_suns: Random suns for each, ≥ 1.
        num_starts: Starts of each search, the default and random ones, ≥ 2.
        width: Pixels across, ≥ 16.
        resolution: Texels along each side of the map, ≥ 16.
        sun_radius_deg: Of the sun's disc, degrees, in [0, 20].
        num_tried: Settings along each axis of the grid that is tried, ≥ 2.
    """

    scenes: tuple[str, ...] = ("colonnade", "cubes")
    num_suns: int = 3
    num_starts: int = 3
    width: int = 80
    resolution: int = 128
    sun_radius_deg: float = 1.5
    num_tried: int = 3

    def __post_init__(self):
        for name in self.scenes:
            scenes.family(name)
        require_int(self.num_suns, "num_suns", 1)
        require_int(self.num_starts, "num_starts", 2)
        require_int(self.width, "width", 16)
        require_int(self.resolution, "resolution", 16)
        require_int(self.num_tried, "num_tried", 2)
        require(0 <= self.sun_radius_deg <= 20, f"sun_radius_deg must lie in [0, 20]; got {self.sun_radius_deg}")


@dataclass(frozen=True)
class Found:
    """One sun over one scene.

    Attributes:
        scene: Its name.
        search: All at once; losses are ln of softened errors.
        settings: Way of choosing → bend, bias, width.
        softened: Way → softened error.
        measured: Way → error of the map itself.
        tried: Least softened error on the grid.
        slopes: Slope at the default, by program and by central differences.
    """

    scene: str
    search: Solution[np.ndarray, SearchCertificate]
    settings: dict[str, np.ndarray]
    softened: dict[str, float]
    measured: dict[str, float]
    tried: float
    slopes: tuple[np.ndarray, np.ndarray]


@dataclass(frozen=True)
class Result:
    """All suns.

    Attributes:
        found: One for each.
        exact: True picture of the first.
        seen: The map's pictures on the way of the first search, from the default if that start was best.
        default: The map's picture with default settings.
        errors: The map's own error for each picture in `seen`.
    """

    found: tuple[Found, ...]
    exact: np.ndarray
    seen: np.ndarray
    default: np.ndarray
    errors: np.ndarray


def run(config: Config) -> Result:
    """All searches, in double precision."""
    with jax.enable_x64(True):
        return _run(config)


def _expected(config: Config, name: str, seed: int) -> ExpectedError:
    """A scene under a random sun that stands 30 to 60 degrees high and not before the camera's own direction."""
    scene = scenes.make_scene(name, dtype=jnp.float64)
    rng = np.random.default_rng([seed, len(name)])
    height, turn = np.radians(rng.uniform(30, 60)), rng.uniform(-np.pi, np.pi)
    direction = [np.cos(height) * np.cos(turn), -np.sin(height), np.cos(height) * np.sin(turn)]
    sun = DirectionalLight.create(direction, dtype=jnp.float64)
    scene = eqx.tree_at(lambda s: s.lights, scene, (sun,))
    return ExpectedError.create(
        scene, config.width, config.width * 3 // 4, config.resolution, sun_radius=math.radians(config.sun_radius_deg)
    )


def _apart(expected: ExpectedError) -> np.ndarray:
    """n', then bias, then width, each alone."""
    at = np.asarray(expected.published)
    for index in range(3):
        lower, upper = at.copy(), at.copy()
        lower[index], upper[index] = LOWER[index], UPPER[index]
        starts = [np.where(np.arange(3) == index, LOWER + share * (UPPER - LOWER), at) for share in (0.2, 0.8)]
        at = minimise_multistart(lambda x: error_and_slope(expected, x), [at, *starts], lower, upper, MOST_STEPS).value
    return at


def _search(config: Config, name: str, seed: int) -> tuple[Found, ExpectedError]:
    expected = _expected(config, name, seed)

    def both(x: Any) -> tuple[Any, Any]:
        return error_and_slope(expected, jnp.asarray(x))

    default = np.asarray(expected.published)
    random = np.random.default_rng(seed).uniform(LOWER, UPPER, (config.num_starts - 1, 3))
    search = minimise_multistart(both, [default, *random], LOWER, UPPER, MOST_STEPS)
    settings = {DEFAULT: default, APART: _apart(expected), JOINT: search.value}
    softened = {way: float(np.exp(both(x)[0])) for way, x in settings.items()}
    measured = {way: expected.measured(MapSettings.of(jnp.asarray(x))) for way, x in settings.items()}
    axes = [np.linspace(low, high, config.num_tried) for low, high in zip(LOWER, UPPER, strict=True)]
    tried = min(float(both(np.array([a, b, c]))[0]) for a in axes[0] for b in axes[1] for c in axes[2])
    step = 1e-6
    central = [(both(default + step * unit)[0] - both(default - step * unit)[0]) / (2 * step) for unit in np.eye(3)]
    slopes = np.asarray(both(default)[1]), np.array([float(x) for x in central])
    return Found(name, search, settings, softened, measured, float(np.exp(tried)), slopes), expected


def _run(config: Config) -> Result:
    found, shown = [], None
    for name in config.scenes:
        for seed in range(config.num_suns):
            one, expected = _search(config, name, seed)
            found.append(one)
            if shown is None:
                default = one.settings[DEFAULT]
                history = np.concatenate([default[None], one.search.certificate.history])
                steps = [
                    MapSettings.of(jnp.asarray(x)) for x in history[np.linspace(0, len(history) - 1, 10).astype(int)]
                ]
                shape = (config.width * 3 // 4, config.width)
                seen = [np.asarray(expected.seen(x)).reshape(shape) for x in steps]
                errors = np.array([expected.measured(x) for x in steps])
                # Where the light does not count, the picture is lit.
                counts = np.asarray(expected.weight).reshape(shape) > 0
                pictures = np.where(counts, np.stack(seen), 1.0)
                exact = np.where(counts, np.asarray(expected.exact).reshape(shape), 1.0)
                shown = exact, pictures, pictures[0], errors
    assert shown is not None
    return Result(tuple(found), *shown)


def claims(result: Result) -> tuple[Claim, ...]:
    """The softened error stands for the map's own, and lowering it lowers that."""
    found = result.found
    gain = np.array([one.measured[DEFAULT] / one.measured[JOINT] for one in found])
    apart = np.array([one.softened[APART] / one.softened[JOINT] for one in found])
    off = [abs(one.softened[way] / one.measured[way] - 1) for one in found for way in one.settings]
    away = [np.abs(a - b).max() / np.abs(b).max() for a, b in (one.slopes for one in found)]
    starts = sum(len(one.search.certificate.losses) for one in found)
    reached = sum(one.search.certificate.reached(NEARLY) for one in found)
    ended = sum(bool(one.search.converged) for one in found)
    return (
        at_most("slope against central differences, relative", away, 1e-2),
        at_most("softened against measured errors, relative", off, 0.12),
        Claim(
            "the map's own error falls against the default, under every sun", bool((gain > 1).all()),
            f"{int((gain > 1).sum())} of {len(gain)}, by ×{gain.min():.3f} to ×{gain.max():.2f}, mean "
            f"×{gain.mean():.3f}", "all",
        ),
        Claim(
            "chosen one at a time they are worse by 1 % under some sun, and nowhere better by 1 %",
            bool((apart > 1.01).any() and (apart > 0.99).all()),
            f"×{apart.min():.4f} to ×{apart.max():.3f}, mean ×{apart.mean():.3f}; worse by 1 % under "
            f"{int((apart > 1.01).sum())} of {len(apart)} suns", "×0.99 at least, above ×1.01 somewhere",
        ),
        Claim(
            f"refuted: any start comes within {NEARLY:.0%} of the best", reached < starts,
            f"{reached} of {starts} starts do", "fewer than all",
        ),
        all_true("no setting on a grid is better", [one.tried >= 0.999 * one.softened[JOINT] for one in found], "suns"),
        Claim(
            "every search says why it ended", all(reason for one in found for reason in one.search.certificate.reasons),
            f"{ended} of {len(found)} have converged, the others end on a kink",
            "a reason each",
        ),
    )  # fmt: skip


def numbers(result: Result) -> dict[str, Any]:
    """Settings and errors."""
    return {
        "suns": [
            {
                "scene": one.scene, "bend_bias_width": one.settings, "softened": one.softened,
                "measured": one.measured, "least_on_grid": one.tried, "starts": np.exp(one.search.certificate.losses),
                "reasons": one.search.certificate.reasons, "slope": one.search.certificate.slope,
            }
            for one in result.found
        ]
    }  # fmt: skip


def _difference(seen: np.ndarray, exact: np.ndarray) -> np.ndarray:
    """Blue where too dark, orange where too light, over a faint truth."""
    base = 0.75 + 0.25 * exact
    less, more = np.clip(exact - seen, 0, 1), np.clip(seen - exact, 0, 1)
    parts = base * (1 - less) * (1 - 0.1 * more), base * (1 - 0.55 * less) * (1 - 0.45 * more), base * (1 - more)
    return np.clip(np.stack(parts, axis=-1), 0, 1)


@styled
def draw(result: Result) -> Figure:
    """Pictures above, errors below."""
    figure, axes = new_figure(11.4, 6.4, 2, 3)
    show_image(axes[0, 0], result.exact, f"{result.found[0].scene}: visibility, exact")
    for spot, seen, name in ((axes[0, 1], result.default, DEFAULT), (axes[0, 2], result.seen[-1], JOINT)):
        error = result.found[0].measured[name]
        show_image(spot, _difference(seen, result.exact), f"{name}: error {error:.3f}")
    bars, scatter, ends = axes[1]
    place = np.arange(len(result.found))
    for index, way in enumerate((DEFAULT, APART, JOINT)):
        measured = np.array([one.measured[way] for one in result.found])
        bars.plot(place, measured, "os^"[index], color=PALETTE[index], label=way, ms=6)
        scatter.plot([one.softened[way] for one in result.found], measured, "os^"[index], color=PALETTE[index], ms=5)
    limits = scatter.get_xlim()
    scatter.plot(limits, limits, color="k", lw=0.8)
    for x, one in zip(place, result.found, strict=True):
        over = np.maximum(np.exp(one.search.certificate.losses - one.search.objective_value) - 1, 1e-7)
        ends.semilogy(np.full(len(over), x), over, "o", color=PALETTE[2], alpha=0.7)
    ends.axhline(NEARLY, color="k", lw=0.8)
    for spot in (bars, ends):
        spot.set_xticks(place)
    bars.set_ylim(0, 1.35 * max(one.measured[DEFAULT] for one in result.found))
    bars.legend(fontsize=8, ncols=3)
    label(bars, "sun", "RMS error of visibility", "The map's own error")
    label(scatter, "softened", "measured", "Softened and measured errors")
    label(ends, "sun", "excess over the best", "Ends of all starts")
    return figure


@styled
def animate(result: Result) -> list[Figure]:
    """The map's errors in the picture, as the first search goes on."""
    frames = []
    for step, (seen, error) in enumerate(zip(result.seen, result.errors, strict=True)):
        figure, axes = new_figure(6.4, 2.6, 1, 2)
        show_image(axes[0, 0], _difference(seen, result.exact), f"error {error:.3f}")
        axes[0, 1].plot(result.errors[: step + 1], "o-", color=PALETTE[1])
        axes[0, 1].set_xlim(-0.5, len(result.errors) - 0.5)
        axes[0, 1].set_ylim(0.9 * result.errors.min(), 1.05 * result.errors.max())
        label(axes[0, 1], "picture along the search", "RMS error", "of the map itself")
        frames.append(figure)
    return frames


__all__ = ["Config", "Result", "animate", "claims", "draw", "numbers", "run"]
