"""Filtering source, section 2.4: convolution shadow maps, a step as a series of Fourier bases."""

import math

import jax
import jax.numpy as jnp
import numpy as np
from scipy import integrate, optimize

from shadowjax._types import Array, Float, default_dtype
from shadowjax.filters.convolution import damping_weights, fourier_bases, fourier_visibility, frequencies
from shadowjax.ledger.equation import Correction, Equation, Inputs
from shadowjax.ledger.filtering.moments import occluders
from shadowjax.theory import limits, memory


def step_series(difference: float, num_terms: int, damping: float = 0.0) -> float:
    """½ + 2 Σ exp(−α(k/M)²) sin(c_k (z−d)) / c_k: a step in z − d; 1 is lit. Source: filtering, eq. 2.17."""
    c = frequencies(num_terms)
    return 0.5 + 2 * math.fsum(damping_weights(num_terms, damping) * np.sin(c * difference) / c)


def _slope(difference: float, num_terms: int, damping: float = 0.0) -> float:
    return 2 * math.fsum(damping_weights(num_terms, damping) * np.cos(frequencies(num_terms) * difference))


def _size(inputs: Inputs) -> tuple[int, float]:
    return inputs.integer("M"), inputs.number("alpha", default=0.0)


def _series(inputs: Inputs) -> float:
    return step_series(inputs.number("z") - inputs.number("d"), *_size(inputs))


def _split_bases(inputs: Inputs) -> float:
    """Σ a_i(d) B_i(z): cosines and sines of the stored depth times those of the receiver, as a filter stores them."""
    (terms, damping), d, z = _size(inputs), inputs.number("d"), inputs.number("z")
    # sin c(z − d) = sin cz·cos cd − cos cz·sin cd, summed apart: each sum holds one basis of the stored depth.
    c = frequencies(terms)
    weight = 2 * damping_weights(terms, damping) / c
    return 0.5 + math.fsum(weight * np.cos(c * d) * np.sin(c * z)) - math.fsum(weight * np.sin(c * d) * np.cos(c * z))


def _series_measured(inputs: Inputs) -> float:
    """The package's filter: bases of one stored depth, and the sum with the receiver's coefficients."""
    (terms, damping), dtype = _size(inputs), default_dtype()
    bases = fourier_bases(jnp.full((1, 1), inputs.number("z"), dtype), terms)[:, 0, 0]
    return float(fourier_visibility(list(bases), jnp.asarray(inputs.number("d"), dtype), damping))


def _dirichlet(inputs: Inputs) -> float:
    """½ + ∫₀^{z−d} sin(2Mπx)/sin(πx) dx: the integral of the closed-form derivative of the undamped series."""
    terms, end = inputs.integer("M"), inputs.number("z_minus_d")

    # Σ 2·cos c_k x is a geometric sum, the Dirichlet kernel sin(2Mπx)/sin(πx).
    def derivative(x: float) -> float:
        return 2 * terms if x == 0 else math.sin(2 * terms * math.pi * x) / math.sin(math.pi * x)

    return 0.5 + integrate.quad(derivative, 0, end, limit=400, epsabs=1e-13, epsrel=1e-13)[0]


def _square_wave_coefficient(inputs: Inputs) -> float:
    """Half the sine coefficient of a square wave of period 2, by quadrature."""
    c = (2 * inputs.integer("k") - 1) * math.pi
    return 0.5 * 2 * integrate.quad(lambda x: 1.0, 0, 1, weight="sin", wvar=c, epsabs=1e-13)[0]


def _first_maximum(inputs: Inputs) -> float:
    terms = inputs.integer("M")
    low, high = 0.25 / terms, 0.75 / terms
    return float(optimize.brentq(lambda x: _slope(x, terms), low, high, xtol=1e-15))  # pyright: ignore[reportArgumentType]


def _overshoot_integrated(inputs: Inputs) -> float:
    """The undamped series at 1/(2M) as an integral of its slope; the largest value if damped."""
    terms, damping = _size(inputs)
    return _largest(inputs) if damping else _dirichlet(Inputs({"M": terms, "z_minus_d": 1 / (2 * terms)}))


def _largest(inputs: Inputs) -> float:
    """Largest value on (0, ½]: the series at every root of its derivative, and at ½."""
    terms, damping = _size(inputs)
    grid = np.linspace(0, 0.5, 64 * terms + 1)
    slopes = np.array([_slope(x, terms, damping) for x in grid])
    # Maxima: where the slope changes from positive to negative on a grid finer than any lobe.
    falls = np.flatnonzero((slopes[:-1] > 0) & (slopes[1:] <= 0))
    slope = lambda x: _slope(x, terms, damping)  # noqa: E731
    peaks = [float(optimize.brentq(slope, grid[i], grid[i + 1], xtol=1e-15)) for i in falls]  # pyright: ignore[reportArgumentType]
    return max(step_series(x, terms, damping) for x in (*peaks, 0.5))


def _slope_by_autodiff(inputs: Inputs) -> float:
    """Automatic derivative of the series at z = d."""
    terms, damping = _size(inputs)
    dtype = default_dtype()
    parts = (0.0, frequencies(terms), damping_weights(terms, damping))
    return float(_series_slope(*(jnp.asarray(part, dtype) for part in parts)))


@jax.jit
@jax.grad
def _series_slope(x: Float[Array, ""], c: Float[Array, "terms"], weight: Float[Array, "terms"]) -> Float[Array, ""]:
    return 0.5 + 2 * jnp.sum(jnp.sin(c * x) * weight / c)


def _mean_series(inputs: Inputs) -> float:
    """Filtered bases: the mean of the series over the region."""
    (terms, damping), d = _size(inputs), inputs.number("d")
    return math.fsum(w * step_series(z - d, terms, damping) for w, z in zip(*occluders(inputs), strict=True))


def _filtered_bases(inputs: Inputs) -> float:
    """The mean of each basis first, then the sum with the receiver's coefficients (2.15)."""
    (terms, damping), d = _size(inputs), inputs.number("d")
    c = frequencies(terms)
    weight = 2 * damping_weights(terms, damping) / c
    pairs = list(zip(*occluders(inputs), strict=True))
    sines, cosines = (sum(w * wave(c * z) for w, z in pairs) for wave in (np.sin, np.cos))
    # sin c(z − d) = sin cz cos cd − cos cz sin cd parts what is filtered from what the receiver brings.
    return 0.5 + math.fsum(weight * (np.cos(c * d) * sines - np.sin(c * d) * cosines))


def _series_of_mean(inputs: Inputs) -> float:
    weights, depths = occluders(inputs)
    mean = sum(w * z for w, z in zip(weights, depths, strict=True))
    return step_series(mean - inputs.number("d"), *_size(inputs))


def _series_of_mean_split(inputs: Inputs) -> float:
    weights, depths = occluders(inputs)
    return _split_bases(Inputs({**inputs, "z": sum(w * z for w, z in zip(weights, depths, strict=True))}))


def _textures_filled(inputs: Inputs) -> int:
    """Basis images of the package's filter put into textures of four channels, one after another."""
    bases = fourier_bases(jnp.zeros((1, 1), default_dtype()), inputs.integer("M"))
    textures: list[list[int]] = [[]]
    for plane in range(bases.shape[0]):
        if len(textures[-1]) == 4:
            textures.append([])
        textures[-1].append(plane)
    return len(textures)


def _quantised_error(inputs: Inputs) -> float:
    """Largest difference of the series with and without rounding of its bases to 255 steps, on a grid of depths."""
    terms = inputs.integer("M", default=16)
    depth = np.linspace(0, 1, 401)
    angle = np.outer(depth, np.pi * np.arange(1, 2 * terms, 2))
    bases = np.concatenate([np.sin(angle), np.cos(angle)], axis=1)
    # [−1, 1] in 255 steps of 2/255: what rounding to the nearest takes away from every basis.
    lost = np.round((bases + 1) * 127.5) / 127.5 - 1 - bases
    receiver = np.concatenate([np.cos(angle), -np.sin(angle)], axis=1) * np.tile(
        2 / np.pi / np.arange(1, 2 * terms, 2), 2
    )
    return float(np.abs(lost @ receiver.T).max())


def _quantised_measured(inputs: Inputs) -> float | None:
    """The same at depth 0 through the package's filter of 16 terms."""
    if inputs.integer("M", default=16) != 16:
        return None
    bases = fourier_bases(jnp.zeros((1, 1), default_dtype()), inputs.integer("M", default=16))[:, 0, 0]
    coarse = jnp.round((bases + 1) * 127.5) / 127.5 - 1
    zero = jnp.zeros((), default_dtype())
    return float(jnp.abs(fourier_visibility(list(coarse), zero) - fourier_visibility(list(bases), zero)))


_TERMS = tuple({"M": terms} for terms in (1, 2, 4, 8, 16, 32))
_DAMPED = tuple({"M": terms, "alpha": alpha} for terms in (4, 8, 16) for alpha in (0, 0.5, 1, 2, 4))
_REGION = ({"d": 0.7, "M": 16}, "0.5@0.2,0.5@0.8,d=0.7,M=16")
_STEPS = tuple({"d": d, "z": z, "M": terms} for d, z in ((0.3, 0.6), (0.6, 0.3), (0.5, 0.52)) for terms in (4, 16))

EQUATIONS: tuple[Equation, ...] = (
    Equation(
        id="filtering.Eq2.16.coef_S",
        source="filtering, eq. 2.16",
        statement="The sine coefficient of the step's series is 2/c_k.",
        verdict="holds",
        closed_form=lambda i: 2 / ((2 * i.integer("k") - 1) * math.pi),
        independent=_square_wave_coefficient,
        samples=tuple({"k": k} for k in (1, 2, 3, 8)),
    ),
    Equation(
        id="filtering.Eq2.16",
        source="filtering, eq. 2.16 and the text before it",
        statement="The step is H(z − d), so its series holds sin c_k(z − d).",
        verdict="erratum",
        closed_form=_series,
        independent=_split_bases,
        correction=Correction(
            printed="f = H(d − z) with sin c_k(d − z)",
            corrected="f = H(z − d) with sin c_k(z − d), as (2.1) and (2.17) need; the printed series is 1 − (2.17)",
            printed_form=lambda i: step_series(i.number("d") - i.number("z"), *_size(i)),
            counterexample={"d": 0.3, "z": 0.6, "M": 16},
        ),
        samples=_STEPS,
    ),
    Equation(
        id="filtering.Eq2.17",
        source="filtering, eqs 2.11–2.17",
        statement="The step's series splits into bases of the stored depth times coefficients of the receiver.",
        verdict="conditional",
        condition="|z − d| < 1; the series has period 2.",
        closed_form=_series,
        independent=_split_bases,
        measured=_series_measured,
        measured_tolerance=1e-5,
        samples=(*_STEPS, {"d": 0.2, "z": 0.9, "M": 8, "alpha": 1}),
    ),
    *(
        Equation(
            id=f"filtering.Eq2.17.at_z-d={difference}",
            pattern=r"filtering\.Eq2\.17\.at_z-d=(?P<z_minus_d>-?[\d.]+)",
            source="filtering, eq. 2.17",
            statement="The series is ½ at z − d = 0 and falls back to ½ at ±1.",
            verdict="holds",
            closed_form=lambda i: step_series(i.number("z_minus_d"), *_size(i)),
            independent=_dirichlet,
            samples=({"M": 16}, {"M": 4}),
        )
        for difference in ("0.0", "0.999", "1.0")
    ),
    Equation(
        id="filtering.Gibbs.t_first_max",
        source="filtering, section 2.4",
        statement="The undamped series has its first maximum at z − d = 1/(2M).",
        verdict="holds",
        closed_form=lambda i: 1 / (2 * i.integer("M")),
        independent=_first_maximum,
        samples=_TERMS,
    ),
    Equation(
        id="filtering.Gibbs.fmax",
        source="filtering, section 2.4",
        statement="Overshoot of the truncated series at its first maximum.",
        verdict="holds",
        closed_form=lambda i: limits.gibbs_peak(*_size(i)),
        independent=_overshoot_integrated,
        samples=_TERMS,
    ),
    Equation(
        id="filtering.Gibbs.limit",
        source="filtering, section 2.4",
        statement="The overshoot tends to ½ + Si(π)/π.",
        verdict="holds",
        closed_form=lambda i: limits.gibbs_peak(None),
        independent=lambda i: (
            0.5 + integrate.quad(lambda x: np.sinc(x / math.pi), 0, math.pi, epsabs=1e-13)[0] / math.pi
        ),
        samples=({},),
    ),
    Equation(
        id="filtering.damped.slope0",
        source="filtering, section 2.4",
        statement="Slope of the damped series at z = d: 2 Σ exp(−α(k/M)²), 2M undamped.",
        verdict="holds",
        closed_form=lambda i: limits.step_slope(*_size(i)),
        independent=_slope_by_autodiff,
        tolerance=1e-6,  # automatic derivatives may run in float32
        samples=_DAMPED,
    ),
    Equation(
        id="filtering.damped.fmax",
        source="filtering, section 2.4",
        statement="Largest value of the damped series on (0, ½].",
        verdict="holds",
        closed_form=_largest,
        independent=lambda i: limits.gibbs_peak(*_size(i)),
        tolerance=1e-8,  # sampled, within a 64 000th of a period
        samples=_DAMPED,
    ),
    Equation(
        id="filtering.text.damping",
        source="filtering, section 2.4",
        statement="Damping changes the slope of the step from 2M to 2 Σ exp(−α(k/M)²), which is less.",
        verdict="erratum",
        closed_form=lambda i: bool(limits.step_slope(*_size(i)) > 2 * i.integer("M")),
        independent=lambda i: bool(_slope_by_autodiff(i) > 2 * i.integer("M")),
        correction=Correction(
            printed="the damped step is steeper",
            corrected="it is less steep: slope 23.26 instead of 32 for M = 16, α = 1",
            printed_form=lambda i: True,
            counterexample={"M": 16, "alpha": 1},
        ),
        samples=({"M": 16, "alpha": 1}, {"M": 4, "alpha": 0.5}),
    ),
    Equation(
        id="filtering.CSM.textures",
        source="filtering, section 2.4",
        statement="M terms need 2M basis values, four to a texture.",
        verdict="holds",
        closed_form=lambda i: memory.convolution_textures(i.integer("M")),
        independent=lambda i: sum(one.count for one in memory.planes_in_formats(2 * i.integer("M"), bits=8)),
        measured=_textures_filled,
        samples=({"M": 16}, {"M": 4}, {"M": 5}),
    ),
    Equation(
        id="filtering.CSM.8bit_max_error",
        source="filtering, section 2.4",
        statement="Error that bases of 8 bits bring to the series: (2/255)·Σ 1/c_k, at z = d = 0.",
        verdict="conditional",
        condition="The largest on a grid of depths for M ≥ 16; with fewer terms other depths are worse, by √2 at most.",
        closed_form=lambda i: 2 / 255 * math.fsum(1 / frequencies(i.integer("M", default=16))),
        independent=_quantised_error,
        measured=_quantised_measured,
        measured_tolerance=1e-3,  # bases of float32
        samples=({"M": 16}, {"M": 32}),
    ),
    Equation(
        id="filtering.CSM.filtered",
        source="filtering, eq. 2.15",
        statement="Filtering the bases is filtering the series itself.",
        verdict="holds",
        closed_form=_mean_series,
        independent=_filtered_bases,
        samples=(_REGION, ({"d": 0.4, "M": 4}, "0.25@0.2,0.75@0.8")),
    ),
    Equation(
        id="filtering.XCSM.filtered",
        source="filtering, section 2.4.3",
        statement="Bases of the filtered depth give the series of the mean depth, not the mean of the series.",
        verdict="erratum",
        closed_form=_series_of_mean,
        independent=_series_of_mean_split,
        correction=Correction(
            printed="bases made from a filtered depth give very similar results",
            corrected="B(w∗z) ≠ w∗B(z): half lit half shadowed gives 0.006 instead of 0.519",
            printed_form=_mean_series,
            counterexample=_REGION[0],
            label=_REGION[1],
        ),
        samples=(_REGION,),
    ),
)
