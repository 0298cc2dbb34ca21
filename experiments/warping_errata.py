"""warping, errata: what is printed, what is true, and a picture of where the two part.

(a) Eq. 13 sets the largest m equal to the largest w_l/w_c. It drops the angles of incidence of eq. 12: on a floor the
two differ. (b) The second branch of eq. 33 lacks a factor n, so η = 0 does not give LiSPSM. (c) Eq. 37 measures a texel
along the view axis; then storage diverges as light and view align, against eq. 53, (f/n)². (d) Eq. 39 asks for equal
m_x at both planes; m_z is meant, and equal m_x is another n'. (e) The iteration of eq. 55 can leave [n, f], where the
product of the α is too large for f/n and λ is small. (f) The text calls the jump of m_x between two slices small. With
LiSPSM in each it is the factor √(f_i/n_i), so 3.16 for two slices of f/n = 100.

Measured: (a), (c) and (d) by beams cut out of real surfaces with the matrix of the warp, (b) by solving eq. 32 for n'
numerically, (e) by running the iteration, (f) from the matrices of neighbouring slices.

How to read it: orange is as printed, blue is true, markers are measured.
"""

from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure

from experiments.base import Claim
from experiments.claiming import agrees, all_true, equals
from experiments.sliced_views import equal_planes
from experiments.warped_views import check_count, in_double, log_range, measured_errors, views
from shadowjax._checks import require
from shadowjax._types import Array
from shadowjax.evaluate.measure import beams
from shadowjax.partitions.cascades import iterate_adaptive
from shadowjax.plotting import PALETTE, label, new_figure, styled
from shadowjax.theory.aliasing.error import error_z, max_error_x, max_error_z
from shadowjax.theory.aliasing.light_frustum import LightFrustum
from shadowjax.theory.aliasing.near_distances import equalising, near_distance_from_eta
from shadowjax.theory.aliasing.overhead import literal_error_z, overhead_max_z

PRINTED, TRUE = PALETTE[1], PALETTE[0]
NEAR, FAR, PHI = 1.0, 100.0, 30.0
FLOOR, FLOOR_GAMMA, FLOOR_ROWS = -1.0, 60.0, 512  # (a): height of the floor below the eye, degrees, rows
ETA_NEAR, ETA_FAR = 2.0, 200.0  # (b): n is not 1, or the slip does not show
EQUAL_GAMMA = 60.0  # (d), degrees
SLICES, RATIO, ALPHA = 4, 10.0, 4.0  # (e): k, f/n and every α
LARGEST = 1e4  # n' over f of a matrix that stands for the uniform map
ROWS = 2**14


@dataclass(frozen=True)
class Config:
    """Settings; the counterexamples are fixed.

    Attributes:
        samples: Points of every curve, ≥ 20.
        most_slices: Largest number of slices of (f), ≥ 2.
    """

    samples: int = 201
    most_slices: int = 8

    def __post_init__(self):
        check_count(self.samples, "samples", 20)
        check_count(self.most_slices, "most_slices", 2)
        require(self.most_slices <= 64, f"most_slices must be at most 64; got {self.most_slices}")


@dataclass(frozen=True)
class Result:
    """Curves of each panel: name → array; see `run`."""

    floor: dict[str, np.ndarray]
    eta: dict[str, np.ndarray]
    parallel: dict[str, np.ndarray]
    equal: dict[str, np.ndarray]
    planes: dict[str, np.ndarray]
    jumps: dict[str, np.ndarray]


@jax.jit
def _floor(view: LightFrustum, depth: Array) -> tuple[Array, Array]:
    """m and w_l/w_c where beams meet the floor."""
    distance, rows = equalising(view), jnp.asarray(float(FLOOR_ROWS))

    def one(z: Array) -> tuple[Array, Array]:
        cut = beams(view, distance, z, FLOOR / z, jnp.zeros_like(z), rows, rows)
        return cut.aliasing, cut.perspective

    return jax.vmap(one)(depth)


@jax.jit
def _etas(view: LightFrustum, eta: Array, tried: Array) -> tuple[Array, Array]:
    return near_distance_from_eta(view, eta), overhead_max_z(view, tried)


@jax.jit
def _parallel(view: LightFrustum, distance: Array) -> tuple[Array, Array]:
    """Storage of a nearly uniform map, true and with the error of eq. 37 as printed."""
    across = max_error_x(view, distance)
    return across * max_error_z(view, distance), across * literal_error_z(view, distance, view.near)


@jax.jit
def _equal(view: LightFrustum, depth: Array) -> tuple[Array, ...]:
    true = equalising(view)
    printed = view.near * (view.sine - view.tilt)  # equal m_x: (n' + offset)/z constant
    return true, printed, error_z(view, true, depth), error_z(view, printed, depth)


def near_distance_of(eta: np.ndarray, view: LightFrustum, near: float, far: float) -> np.ndarray:
    """n' ∈ [n, n + √(fn)] of η ≥ 0 by interpolation in the definition of η, eq. 32."""
    tried = log_range(near, near + np.sqrt(near * far), 20001)
    largest = np.asarray(_etas(view, jnp.zeros(1), jnp.asarray(tried))[1])
    found = (largest - largest[-1]) / (largest[0] - largest[-1])
    return np.interp(eta, found[::-1], tried[::-1])


@in_double
def run(config: Config) -> Result:
    """Every panel's curves."""
    samples = config.samples
    depth = log_range(1.001 * -FLOOR / np.tan(np.radians(PHI)), FAR, samples)
    m, perspective = (np.asarray(x) for x in _floor(views(NEAR, FAR, PHI, FLOOR_GAMMA), jnp.asarray(depth)))

    some = np.linspace(0, 1, 9)
    eta = np.linspace(-0.5, 1, samples)
    eta_view = views(ETA_NEAR, ETA_FAR, PHI)
    root = np.sqrt(ETA_NEAR * ETA_FAR)
    both = np.asarray(_etas(eta_view, jnp.asarray(np.append(eta, some)), jnp.ones(1))[0])
    corrected, expected = both[:samples], both[samples:]
    printed = np.where(eta >= 0, (ETA_NEAR + root) / (ETA_NEAR + eta * root), corrected)

    gamma = log_range(0.05, 90.0, samples)
    some_gamma = np.array([0.05, 0.2, 1.0, 5.0, 20.0, 60.0])
    view = views(NEAR, FAR, PHI, np.append(gamma, some_gamma))
    storage, literal = (np.asarray(x) for x in _parallel(view, jnp.asarray(LARGEST * FAR)))
    across, along = measured_errors(views(NEAR, FAR, PHI, some_gamma[:, None]), LARGEST * FAR,
                                    log_range(NEAR, FAR, 17), ROWS)  # fmt: skip

    z = log_range(NEAR, FAR, samples)
    equal_view = views(NEAR, FAR, PHI, EQUAL_GAMMA)
    true_n, printed_n, true_z, printed_z = (np.asarray(x) for x in _equal(equal_view, jnp.asarray(z)))
    beam_x, beam_z = measured_errors(equal_view, np.array([true_n, printed_n])[:, None], z[:: samples // 10], ROWS)

    weight = np.linspace(0, 1, samples)
    ratios = jnp.full((samples, SLICES - 1), ALPHA)
    ends = jnp.ones(samples), jnp.full(samples, RATIO)
    loose, kept = (np.asarray(iterate_adaptive(*ends, jnp.asarray(weight), ratios, share)) for share in (0.0, 0.25))

    counts = np.arange(2, config.most_slices + 1)
    q = (FAR / NEAR) ** (1 / counts)
    # the first cut: the far plane of slice 1 and the near plane of slice 2
    planes = [equal_planes(NEAR, FAR, int(k)) for k in counts]
    slices = [np.stack([cuts[[0, 1]], cuts[[1, 2]]]) for cuts in planes]
    near, far = np.stack(slices)[..., 0], np.stack(slices)[..., 1]
    measured = {}
    for name, distance in (("lispsm", near + np.sqrt(near * far)), ("uniform", LARGEST * far)):
        errors = measured_errors(views(near, far, PHI), distance, near[:, 1:], ROWS)
        for axis, error in zip("xz", errors, strict=True):
            measured[f"{name}_{axis}"] = error[:, 1] / error[:, 0]
    return Result(
        floor={"depth": depth, "m": m, "perspective": perspective},
        eta={"eta": eta, "printed": printed, "true": corrected, "some": some, "expected": expected,
             "measured": near_distance_of(some, eta_view, ETA_NEAR, ETA_FAR)},
        parallel={"gamma": gamma, "printed": literal[:samples], "true": storage[:samples], "some": some_gamma,
                  "expected": storage[samples:],
                  "measured": across.max(axis=1) * along.max(axis=1)},
        equal={"depth": z, "true_n": true_n, "printed_n": printed_n, "true": true_z, "printed": printed_z,
               "some": z[:: samples // 10], "measured": beam_z, "measured_x": beam_x},
        planes={"weight": weight, "printed": loose, "true": kept},
        jumps={"k": counts, "ratio": q, **measured},
    )  # fmt: skip


def claims(result: Result) -> tuple[Claim, ...]:
    """Each erratum with its counterexample."""
    floor, eta, parallel, equal, planes, jumps = (
        result.floor, result.eta, result.parallel, result.equal, result.planes, result.jumps
    )  # fmt: skip
    warped = eta["eta"] >= 0
    inside = (planes["printed"] >= 1 - 1e-12).all(axis=1)
    bound = float(planes["weight"][inside].min())
    step = float(planes["weight"][1])
    floor_max = {name: floor[name].max() for name in ("m", "perspective")}
    return (
        Claim("(a) eq. 13: on a floor the largest m is not the largest w_l/w_c",
              floor_max["perspective"] > 1.5 * floor_max["m"],
              f"m ≤ {floor_max['m']:.4f}, w_l/w_c ≤ {floor_max['perspective']:.4f}", "a factor of 1.5 at least"),
        agrees("(b) eq. 33, corrected, is what solving eq. 32 for n' gives", eta["measured"], eta["expected"], 1e-6),
        agrees("(b) as printed it is n times too small", eta["printed"][warped] * ETA_NEAR, eta["true"][warped], 1e-12),
        agrees("(c) measured storage is that of the error across the light", parallel["measured"],
               parallel["expected"], 1e-6),
        equals("(c) it tends to (f/n)², eq. 53", parallel["measured"][0], (FAR / NEAR) ** 2, 2e-4),
        agrees("(c) with eq. 37 as printed it diverges like 1/sin γ", parallel["printed"] *
               np.sin(np.radians(parallel["gamma"])), parallel["true"], 1e-9),
        agrees("(d) the n' of eq. 39 makes m_z equal at both planes, on beams", equal["measured"][0, -1],
               equal["measured"][0, 0], 1e-6),
        agrees("(d) equal m_x, as printed, is n' = n sin γ − a cos γ", equal["measured_x"][1, -1],
               equal["measured_x"][1, 0], 1e-6),
        Claim("(d) which makes M_z larger", equal["printed"].max() > 2 * equal["true"].max(),
              f"{equal['printed'].max():.3f} at n' = {equal['printed_n']:.3f}",
              f"more than twice {equal['true'].max():.3f} at n' = {equal['true_n']:.3f}"),
        Claim("(e) eq. 55 with α = 4, f/n = 10 leaves [n, f] below λ = 0.565", abs(bound - 0.565) <= step,
              f"below {bound:.3f}", f"0.565 ± {step:.3f}"),
        all_true("(e) clamped, the planes rise from n to f for every λ", np.diff(planes["true"], axis=1) > 0,
                 "slices"),
        agrees("(f) LiSPSM: m_x jumps by √(f_i/n_i) at a cut, measured", jumps["lispsm_x"], np.sqrt(jumps["ratio"]),
               1e-6),
        agrees("(f) and m_z does not", jumps["lispsm_z"], 1.0, 1e-4),
        agrees("(f) uniform: both jump by f_i/n_i", np.stack([jumps["uniform_x"], jumps["uniform_z"]]),
               jumps["ratio"], 1e-3),
    )  # fmt: skip


def numbers(result: Result) -> dict[str, Any]:
    """All curves."""
    return dict(vars(result))


@styled
def draw(result: Result) -> Figure:
    """Six panels."""
    figure, axes = new_figure(11.6, 6.6, 2, 3)
    (a, b, c), (d, e, f) = axes
    floor = result.floor
    a.plot(floor["depth"], floor["perspective"], color=PRINTED, label="w_l/w_c")
    a.plot(floor["depth"], floor["m"], color=TRUE, label="m")
    a.set_xscale("log")
    label(a, "depth of the floor (world units)", "pixels per texel", "(a) eq. 13: two maxima")
    _pair(b, "eta", "true", "printed", "some", result.eta)
    b.set_yscale("log")
    label(b, "η", "n' (world units)", "(b) eq. 33: a factor n")
    _pair(c, "gamma", "true", "printed", "some", result.parallel)
    c.set_xscale("log")
    c.set_yscale("log")
    c.axhline((FAR / NEAR) ** 2, color="#4d4d4d", linestyle=":", linewidth=1.2)
    c.text(0.06, 1.15 * (FAR / NEAR) ** 2, "(f/n)²", fontsize=8)
    label(c, "γ (degrees)", "S of the uniform map", "(c) eq. 37: a factor 1/sin γ")
    equal = result.equal
    for row, (name, color) in enumerate((("true", TRUE), ("printed", PRINTED))):
        told = "equal m_z" if name == "true" else "equal m_x"
        d.plot(equal["depth"], equal[name], color=color, label=f"{told}, n' = {equal[f'{name}_n']:.2f}")
        d.plot(equal["some"], equal["measured"][row], "o", color=color, markersize=4.5)
    d.set_xscale("log")
    d.set_yscale("log")
    label(d, "depth z (world units)", "m_z, pixels per texel", f"(d) eq. 39 at γ = {EQUAL_GAMMA:g}°")
    for cut in range(1, SLICES):
        e.plot(
            result.planes["weight"],
            result.planes["printed"][:, cut],
            color=PRINTED,
            label="printed" if cut == 1 else None,
        )
        e.plot(result.planes["weight"], result.planes["true"][:, cut], color=TRUE, linestyle=(0, (4, 2)),
               label="clamped" if cut == 1 else None)  # fmt: skip
    e.axhspan(0.1, 1, color="#f0d9cc", linewidth=0)
    e.text(0.97, 0.72, "in front of the near plane", fontsize=8, ha="right")
    e.set_yscale("log")
    e.set_ylim(0.4, RATIO)
    label(e, "λ = γ/90°", "cuts (n = 1, f = 10)", "(e) eq. 55: cuts outside")
    jumps = result.jumps
    f.plot(jumps["k"], np.sqrt(jumps["ratio"]), color=TRUE)
    f.plot(jumps["k"], jumps["lispsm_x"], "o", color=TRUE, markersize=4.5, label="LiSPSM, m_x: √(f_i/n_i)")
    f.plot(jumps["k"], jumps["lispsm_z"], "D", color=PALETTE[2], markersize=4.5, label="LiSPSM, m_z: none")
    f.plot(jumps["k"], jumps["ratio"], color=PALETTE[6])
    f.plot(jumps["k"], jumps["uniform_x"], "s", color=PALETTE[6], markersize=4.5, label="uniform: f_i/n_i")
    f.axhline(1, color=PRINTED, linewidth=1.4, label="“small”")
    f.set_yscale("log")
    f.set_ylim(0.9, 12)
    label(f, "slices k of f/n = 100", "jump at a cut (factor)", "(f) m_x at the seams")
    for spot in axes.flat:
        spot.legend(loc="best", fontsize=7.5)
    return figure


def _pair(spot: Any, x: str, true: str, printed: str, some: str, curves: dict[str, np.ndarray]) -> None:
    """A printed and a true curve with markers on what was measured."""
    spot.plot(curves[x], curves[printed], color=PRINTED, label="printed")
    spot.plot(curves[x], curves[true], color=TRUE, label="true")
    spot.plot(curves[some], curves["measured"], "o", color=TRUE, markersize=4.5, label="measured")
