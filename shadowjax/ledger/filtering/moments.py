"""Filtering source, sections 2.1 to 2.3: the test, bilinear taps, variance shadow maps."""

import math
import re
from fractions import Fraction
from typing import Any

import jax.numpy as jnp
import numpy as np
from scipy import integrate, optimize

from shadowjax._types import default_dtype
from shadowjax.filters.hard import is_lit
from shadowjax.filters.pcf import percentage_closer
from shadowjax.filters.variance import chebyshev_visibility, linear_step
from shadowjax.ledger.equation import Correction, Equation, Inputs, Unavailable
from shadowjax.ledger.inputs import exact


def occluders(inputs: Inputs) -> tuple[list[float], list[float]]:
    """Weights and depths of a filter region: two depths and a share p, lists `p` and `z`, or `w@z` in the label."""
    if "z_occ" in inputs:
        p = inputs.number("p")
        return [p, 1 - p], [inputs.number("z_rec"), inputs.number("z_occ")]
    if "p" in inputs and "z" in inputs:
        return inputs.numbers("p"), inputs.numbers("z")
    pairs = re.findall(r"([\d.]+)@([\d.]+)", inputs.label)
    if not pairs:
        raise Unavailable(f"no occluders in the inputs or in the label {inputs.label!r}")
    return [float(w) for w, _ in pairs], [float(z) for _, z in pairs]


def _moments(inputs: Inputs) -> tuple[float, float]:
    """Mean and variance of depth, from the first two moments."""
    weights, depths = occluders(inputs)
    mean = sum(w * z for w, z in zip(weights, depths, strict=True))
    square = sum(w * z * z for w, z in zip(weights, depths, strict=True))
    return mean, square - mean * mean


def _central_moments(inputs: Inputs) -> tuple[float, float]:
    """The same with the variance taken about the mean."""
    weights, depths = occluders(inputs)
    mean = math.fsum(w * z for w, z in zip(weights, depths, strict=True))
    return mean, math.fsum(w * (z - mean) ** 2 for w, z in zip(weights, depths, strict=True))


def _chebyshev(inputs: Inputs) -> float:
    mean, variance = _moments(inputs)
    return variance / (variance + (inputs.number("d") - mean) ** 2)


def _markov(inputs: Inputs) -> float:
    """Best of Markov's bounds on (z − μ + u)²: min over u of (σ² + u²)/(δ + u)², where δ = d − μ > 0."""
    mean, variance = _central_moments(inputs)
    delta = inputs.number("d") - mean
    # The bound has one minimum over u ≥ 0; u = tan(v) brings it onto a finite interval.
    found: Any = optimize.minimize_scalar(
        lambda v: (variance + math.tan(v) ** 2) / (delta + math.tan(v)) ** 2,
        bounds=(0, math.pi / 2 - 1e-6), method="bounded", options={"xatol": 1e-10},
    )  # fmt: skip
    return float(found.fun)


def _visibility(inputs: Inputs) -> float:
    return 1.0 if inputs.number("d") <= _moments(inputs)[0] else _chebyshev(inputs)


def _visibility_measured(inputs: Inputs) -> float:
    """The package's filter on the filtered moments."""
    dtype = default_dtype()
    mean, variance = _central_moments(inputs)
    numbers = (jnp.asarray(value, dtype) for value in (mean, variance, inputs.number("d")))
    return float(chebyshev_visibility(*numbers))


def _linear_step_measured(inputs: Inputs) -> float:
    return float(linear_step(jnp.asarray(inputs.number("v"), default_dtype()), inputs.number("L"), inputs.number("H")))


def _visibility_from_bound(inputs: Inputs) -> float:
    return 1.0 if inputs.number("d") <= _central_moments(inputs)[0] else _markov(inputs)


def _lit_share(inputs: Inputs) -> float:
    """What is left of the whole without the occluders before the receiver."""
    weights, depths = occluders(inputs)
    return 1 - sum(w for w, z in zip(weights, depths, strict=True) if inputs.number("d") > z)


def _lit_share_measured(inputs: Inputs) -> float:
    """The package's test of every occluder."""
    weights, depths = (jnp.asarray(part, default_dtype()) for part in occluders(inputs))
    return float(jnp.sum(jnp.where(is_lit(depths, jnp.asarray(inputs.number("d"), default_dtype())), weights, 0)))


def _bilinear(inputs: Inputs) -> float:
    """Weights by the distances to the opposite texels, of the four test results."""
    x, y, d = inputs.number("theta"), inputs.number("phi"), inputs.number("d")
    lit = {name: float(d <= inputs.number(name)) for name in ("z00", "z10", "z01", "z11")}
    low = (1 - x) * lit["z00"] + x * lit["z10"]
    return (1 - y) * low + y * ((1 - x) * lit["z01"] + x * lit["z11"])


def _box_overlap(inputs: Inputs) -> float:
    """Area of each texel's unit square under a unit box around the receiver, where the test passes."""
    total = Fraction(0)
    for name in ("z00", "z10", "z01", "z11"):
        col, row = int(name[1]), int(name[2])
        # Overlap of two unit intervals whose middles lie this far apart, along each axis.
        across = 1 - abs(inputs.fraction("theta") - col)
        down = 1 - abs(inputs.fraction("phi") - row)
        total += across * down * (inputs.fraction("d") <= inputs.fraction(name))
    return float(total)


def _bilinear_measured(inputs: Inputs) -> float:
    """The package's bilinear filter with one tap on a 2 × 2 map; texel centres lie at +½."""
    dtype = default_dtype()
    stored = jnp.asarray([[[inputs.number("z00"), inputs.number("z10")], [inputs.number("z01"), inputs.number("z11")]]])
    position = jnp.asarray([[0.5 + inputs.number("theta"), 0.5 + inputs.number("phi")]], dtype=dtype)
    depth = jnp.asarray([inputs.number("d")], dtype=dtype)
    return float(percentage_closer(stored.astype(dtype), position, depth, 1, taps="bilinear")[0])


def _taps_counted(inputs: Inputs) -> int:
    """Weight that one lit texel has in the package's filter, inverted: the number of taps."""
    width = inputs.integer("K")
    dtype = default_dtype()
    # One lit texel in a dark map: its weight in the mean is one over the number of taps.
    stored = jnp.zeros((1, 9, 9), dtype=dtype).at[0, 4, 4].set(2)
    middle = jnp.full((1, 2), 4.5 if width % 2 else 5.0, dtype=dtype)
    one = jnp.ones((1,), dtype=dtype)
    return round(1 / float(percentage_closer(stored, middle, one, width)[0]))


def _footprint(text: str) -> tuple[str, float]:
    """Kind and size of a footprint such as `box width sqrt(3)` or `Gaussian sigma=1/2`."""
    kind = next((kind for kind in ("gaussian", "disc", "disk", "tent", "box", "points") if kind in text.lower()), "")
    number = re.search(r"sqrt\(\s*([\d./]+)\s*\)|(\d[\d./]*)", text)
    if not kind or number is None:
        raise Unavailable(f"no footprint in {text!r}; known: Gaussian, disc, tent, box, points, with a size")
    size = math.sqrt(exact(number.group(1))) if number.group(1) else float(exact(number.group(2)))
    return kind.replace("disk", "disc"), size


def _coefficient(inputs: Inputs) -> float:
    """E[x²] of the footprint: σ², r²/4, h²/6 (half-width h), w²/12 (width w), or a² for points at ±a."""
    kind, size = _footprint(inputs.text("footprint"))
    return size**2 / {"gaussian": 1, "disc": 4, "tent": 6, "box": 12, "points": 1}[kind]


def _coefficient_quadrature(inputs: Inputs) -> float:
    """∫x²w / ∫w of the footprint's profile along one axis."""
    kind, size = _footprint(inputs.text("footprint"))
    if kind == "points":
        return (size**2 + (-size) ** 2) / 2
    profile, reach = {
        "gaussian": (lambda x: math.exp(-0.5 * (x / size) ** 2), 12 * size),
        "disc": (lambda x: math.sqrt(max(size**2 - x**2, 0.0)), size),
        "tent": (lambda x: max(1 - abs(x) / size, 0.0), size),
        "box": (lambda x: 1.0, size / 2),
    }[kind]

    # Profiles are even: half the axis is enough, and the factor 2 cancels in the quotient.
    def integral(power: int) -> float:
        return integrate.quad(lambda x: x**power * profile(x), 0, reach, epsabs=0, epsrel=1e-12, limit=200)[0]

    return integral(2) / integral(0)


def _second_moment(inputs: Inputs, coefficient: float) -> float:
    slopes = inputs.number("dzdx") ** 2 + inputs.number("dzdy") ** 2
    return inputs.number("mu") ** 2 + coefficient * slopes


def _second_moment_integrated(inputs: Inputs) -> float | None:
    """E[(μ + z_x·x + z_y·y)²] by quadrature over the footprint's two axes, a Gaussian or a box."""
    kind, size = _footprint(inputs.text("footprint"))
    if kind == "gaussian":
        # Four Gauss nodes an axis integrate the square of a linear function exactly.
        nodes, weights = np.polynomial.hermite_e.hermegauss(4)
        nodes = nodes * size
    elif kind == "box":
        nodes, weights = np.polynomial.legendre.leggauss(4)
        nodes = nodes * size / 2
    else:
        return None
    x, y = nodes[:, None], nodes
    depth = inputs.number("mu") + inputs.number("dzdx") * x + inputs.number("dzdy") * y
    return float(weights @ depth**2 @ weights / np.sum(weights) ** 2)


def _linear_step(inputs: Inputs) -> float:
    low, high = inputs.number("L"), inputs.number("H")
    return min(max((inputs.number("v") - low) / (high - low), 0.0), 1.0)


def _unit_roundoff(inputs: Inputs) -> float:
    """Half the spacing at 1 of the format that the label names; the input prints six digits of it only."""
    for name, dtype in (("fp16", np.float16), ("fp32", np.float32), ("fp64", np.float64)):
        if name in inputs.label:
            return float(np.finfo(dtype).eps) / 2
    return inputs.number("unit_roundoff")


def _depth_precision(inputs: Inputs) -> float:
    """The spacing at μ² found in the format itself, half of it, rooted: what one rounding of M₂ can add to σ."""
    dtype = np.float16 if "fp16" in inputs.label else np.float32
    square = np.asarray(inputs.number("mu") ** 2, dtype)
    return math.sqrt(float(np.spacing(square)) / 2)


_TWO = {"z_occ": 0.2, "z_rec": 0.7}
_QUAD = {"z00": 0.3, "z10": 0.6, "z01": 0.5, "z11": 0.2}

EQUATIONS: tuple[Equation, ...] = (
    Equation(
        id="filtering.Eq2.1",
        source="filtering, eq. 2.1",
        statement="Lit (1) iff the receiver is not behind the stored depth: d ≤ z.",
        verdict="holds",
        closed_form=lambda i: int(i.fraction("d") <= i.fraction("z")),
        measured=lambda i: int(is_lit(jnp.asarray(i.number("z")), jnp.asarray(i.number("d")))),
        samples=({"d": 0.4, "z": 0.5}, {"d": 0.5, "z": 0.5}, {"d": 0.6, "z": 0.5}),
    ),
    Equation(
        id="filtering.Alg1.taps",
        source="filtering, Algorithm 1",
        statement="A kernel of width K has K² taps, for even K too.",
        verdict="holds",
        closed_form=lambda i: i.integer("K") ** 2,
        measured=_taps_counted,
        samples=tuple({"K": width} for width in (2, 3)),
    ),
    Equation(
        id="filtering.Eq2.2",
        source="filtering, eq. 2.2",
        statement="Bilinear filtering of test results: the weights are areas of overlap with a texel-sized box.",
        verdict="conditional",
        condition="θ and φ count from the first texel's centre.",
        closed_form=_bilinear,
        independent=_box_overlap,
        measured=_bilinear_measured,
        measured_tolerance=1e-6,
        samples=tuple({**_QUAD, "d": d, "theta": x, "phi": y} for d, x, y in ((0.4, 0.3, 0.7), (0.25, 0.1, 0.9))),
    ),
    Equation(
        id="filtering.Eq2.6.var",
        source="filtering, eqs 2.3–2.6",
        statement="Variance is E[z²] − E[z]²: p(1−p)(z₂−z₁)² for two depths.",
        verdict="holds",
        closed_form=lambda i: _moments(i)[1],
        independent=lambda i: _central_moments(i)[1],
        samples=tuple({**_TWO, "p": p} for p in (0.25, 0.5, 0.9)),
    ),
    Equation(
        id="filtering.Eq2.7.pmax_planar",
        source="filtering, eq. 2.7",
        statement="The one-sided Chebyshev bound is the lit share itself for two planes and a receiver on the farther.",
        verdict="holds",
        closed_form=_chebyshev,
        independent=lambda i: i.number("p") if i.number("d") == i.number("z_rec") else _markov(i),
        samples=tuple({**_TWO, "p": p, "d": 0.7} for p in (0.25, 0.5, 0.9)),
    ),
    Equation(
        id="filtering.Eq2.7.pmax",
        source="filtering, eq. 2.7",
        statement="σ²/(σ² + (d−μ)²) bounds the share of depths at or beyond d.",
        verdict="conditional",
        condition="d > μ.",
        closed_form=_chebyshev,
        independent=_markov,
        samples=({**_TWO, "p": 0.5, "d": 0.6}, {**_TWO, "p": 0.25, "d": 0.6}),
    ),
    Equation(
        id="filtering.Eq2.7.lightbleed",
        source="filtering, eq. 2.7",
        statement="A region of two occluders in front of the receiver gets light although none of it is lit.",
        verdict="holds",
        closed_form=_chebyshev,
        independent=_markov,
        samples=({"p": [0.3, 0.7], "z": [0.1, 0.5], "d": 0.9},),
    ),
    Equation(
        id="filtering.Eq2.7.meaning",
        source="filtering, text of eq. 2.7",
        statement="P(z ≥ d) is the lit share of the region.",
        verdict="erratum",
        closed_form=_lit_share,
        independent=lambda i: i.number("p") if i.number("d") > i.number("z_occ") else 1.0,
        measured=_lit_share_measured,
        measured_tolerance=1e-6,
        correction=Correction(
            printed="P(z ≥ d) is the share whose test is negative",
            corrected="it is the share whose test (2.1) is positive",
            printed_form=lambda i: 1 - _lit_share(i),
            counterexample={**_TWO, "p": 0.25, "d": 0.6},
        ),
        samples=tuple({**_TWO, "p": p, "d": d} for p, d in ((0.25, 0.6), (0.9, 0.7), (0.5, 0.1))),
    ),
    Equation(
        id="filtering.Eq2.8.I",
        source="filtering, eq. 2.8",
        statement="Variance shadow maps: 1 where d ≤ μ, else the bound (2.7).",
        verdict="holds",
        closed_form=_visibility,
        independent=_visibility_from_bound,
        measured=_visibility_measured,
        measured_tolerance=1e-5,
        samples=tuple({**_TWO, "p": p, "d": 0.6} for p in (0.25, 0.5, 0.9)),
    ),
    Equation(
        id="filtering.fig2.5.delta_over_sigma",
        source="filtering, figure 2.5",
        statement="(d−μ)/σ at which the bound takes a value: √(1/p − 1).",
        verdict="holds",
        closed_form=lambda i: math.sqrt(1 / i.number("pmax") - 1),
        independent=lambda i: optimize.brentq(lambda r: 1 / (1 + r * r) - i.number("pmax"), 0.0, 1e4, xtol=1e-14),  # pyright: ignore[reportArgumentType]
        samples=({"pmax": 0.8}, {"pmax": 0.5}, {"pmax": 0.1}),
    ),
    Equation(
        id="filtering.Eq2.9.coefficient",
        source="filtering, eq. 2.9",
        statement="The factor of the squared slopes is E[x²] of the footprint; ¼ is that of a Gaussian with σ = ½.",
        verdict="conditional",
        condition="¼ belongs to σ = ½, a box of width √3 or a disc of radius 1; a texel's own box has 1/12.",
        closed_form=_coefficient,
        independent=_coefficient_quadrature,
        samples=tuple(
            {"footprint": text}
            for text in (
                "Gaussian sigma=1/2",
                "disc radius 1",
                "disc radius 1/2",
                "tent half-width 1 (bilinear)",
                "box width sqrt(3)",
                "box width 1",
                "points +-1/2",
            )
        ),
    ),
    Equation(
        id="filtering.Eq2.9.M2",
        source="filtering, eq. 2.9",
        statement="Second moment of a planar footprint: μ² + E[x²]·(z_x² + z_y²).",
        verdict="conditional",
        condition="The footprint is centred and isotropic, the surface planar.",
        closed_form=lambda i: _second_moment(i, _coefficient(i)),
        independent=_second_moment_integrated,
        samples=tuple(
            {"mu": 0.4, "dzdx": 0.3, "dzdy": 0.5, "footprint": text} for text in ("Gaussian sigma=1/2", "box width 1")
        ),
    ),
    Equation(
        id="filtering.Alg2",
        source="filtering, Algorithm 2",
        statement="Linear step against light bleeding: (v−L)/(H−L), clamped to [0, 1].",
        verdict="holds",
        closed_form=_linear_step,
        independent=lambda i: float(np.interp(i.number("v"), [i.number("L"), i.number("H")], [0.0, 1.0])),
        measured=_linear_step_measured,
        measured_tolerance=1e-6,
        samples=(
            {"L": 0.2, "H": 1, "v": 0.6},
            {"L": 0.1, "H": 1, "v": 0.999},
            {"L": 0.3, "H": 1, "v": 0.25},
            {"L": 0.2, "H": 0.8, "v": 0.95},
        ),
    ),
    Equation(
        id="filtering.VSM.cancellation_std",
        source="filtering, section 2.3",
        statement="Standard deviation that one rounding of the second moment can make up: μ√u.",
        verdict="holds",
        closed_form=lambda i: i.number("mu") * math.sqrt(_unit_roundoff(i)),
        independent=_depth_precision,
        samples=(({"mu": 0.5}, "fp32,mu=0.5"), ({"mu": 0.25}, "fp16,mu=0.25")),
    ),
    Equation(
        id="filtering.text.SAT_precision",
        source="filtering, text of eq. 2.10",
        statement="Bits that a summed-area table of N × N values needs beyond those of a value: 2·log₂N.",
        verdict="erratum",
        closed_form=lambda i: 2 * math.log2(i.integer("N")),
        independent=lambda i: math.log2(float(np.cumsum(np.cumsum(np.ones((i.integer("N"),) * 2), 0), 1)[-1, -1])),
        correction=Correction(
            printed="a summed-area table reduces numerical instability",
            corrected="its sums need more bits than the values; differences of large sums cancel",
            printed_form=lambda i: 0.0,
            counterexample={"N": 1024},
        ),
        samples=({"N": 64}, {"N": 256}),
    ),
)
