"""Filtering source, section 2.5: exponential shadow maps and the range of their exponents."""

import math
from fractions import Fraction

import jax.numpy as jnp
import numpy as np

from shadowjax._types import default_dtype
from shadowjax.filters.exponential import exponential_test
from shadowjax.ledger.equation import Correction, Equation, Inputs
from shadowjax.ledger.filtering.moments import occluders


def _exponential(inputs: Inputs) -> float:
    return math.exp(-inputs.number("c") * (inputs.number("d") - inputs.number("z")))


def _exponential_factors(inputs: Inputs) -> float:
    """e^(−cd)·e^(cz): the receiver's factor and the stored one."""
    c = inputs.number("c")
    return math.exp(-c * inputs.number("d")) * math.exp(c * inputs.number("z"))


def _exponential_measured(inputs: Inputs) -> float:
    """The package's test."""
    stored, receiver = (jnp.asarray(inputs.number(name), default_dtype()) for name in ("z", "d"))
    return float(exponential_test(stored, receiver, inputs.number("c")))


def _filtered_exponential(inputs: Inputs) -> float:
    c, d = inputs.number("c"), inputs.number("d")
    return math.fsum(w * math.exp(-c * (d - z)) for w, z in zip(*occluders(inputs), strict=True))


def _filtered_exponential_factors(inputs: Inputs) -> float:
    c = inputs.number("c")
    stored = sum(w * math.exp(c * z) for w, z in zip(*occluders(inputs), strict=True))
    return math.exp(-c * inputs.number("d")) * stored


def _violated(inputs: Inputs) -> Inputs:
    """Half the kernel before the receiver and half beyond it, unless the row says otherwise."""
    label = inputs.label if "@" in inputs.label else "0.5@0.3,0.5@0.7"
    return Inputs({"d": 0.6, "c": 80, **inputs}, label)


def _blurred_exponential(inputs: Inputs) -> float:
    """The package's test, averaged over the kernel."""
    weights, depths = (jnp.asarray(part, default_dtype()) for part in occluders(inputs))
    receiver = jnp.asarray(inputs.number("d"), default_dtype())
    return float(jnp.sum(weights * exponential_test(depths, receiver, inputs.number("c"))))


def _ceiling(dtype: type[np.floating], subnormals: bool | None = None) -> float:
    """ln of the largest number; of its ratio to the smallest normal or subnormal number if asked."""
    info = np.finfo(dtype)
    smallest = {None: 1.0, False: float(info.smallest_normal), True: float(info.smallest_subnormal)}[subnormals]
    return math.log(float(info.max)) - math.log(smallest)


def _ceiling_searched(dtype: type[np.floating], below: float = 0.0) -> float:
    """Largest c whose e^(c−below) stays finite in the format, by bisection on the numbers of the format."""
    low, high = 0.0, 1000.0
    limit = float(np.finfo(dtype).max)
    while high - low > 1e-13 * high:
        middle = (low + high) / 2
        fits = math.exp(min(middle - below, 700.0)) <= limit
        low, high = (middle, high) if fits else (low, middle)
    return low


def _exponential_series(inputs: Inputs) -> float:
    """e³⁰ by its power series in whole fractions."""
    term = total = Fraction(1)
    for k in range(1, 130):
        # 30ᵏ/k! from the term before; 129 terms leave far less than float64 resolves.
        term = term * 30 / k
        total += term
    return float(total)


EQUATIONS: tuple[Equation, ...] = (
    Equation(
        id="filtering.Eq2.19.limit",
        source="filtering, eq. 2.19",
        statement="The limit of e^(−c(d−z)) for large c is 0 where d > z and 1 where d = z.",
        verdict="conditional",
        condition="d ≥ z; the text assumes d > z, where the limit is always 0.",
        closed_form=lambda i: int(i.fraction("d") == i.fraction("z")),
        independent=lambda i: math.exp(-1e12 * float(i.fraction("d") - i.fraction("z"))),
        samples=({"d": 0.5, "z": 0.45}, {"d": 0.5, "z": 0.5}),
    ),
    Equation(
        id="filtering.Eq2.20",
        source="filtering, eq. 2.20",
        statement="e^(−c(d−z)) splits into a factor of the receiver and one of the stored depth.",
        verdict="conditional",
        condition="z ≤ d; otherwise it exceeds 1.",
        closed_form=_exponential,
        independent=_exponential_factors,
        measured=_exponential_measured,
        measured_tolerance=1e-5,
        samples=tuple({"d": 0.5, "z": z, "c": 80} for z in (0.45, 0.49)),
    ),
    Equation(
        id="filtering.Eq2.21",
        source="filtering, eq. 2.21",
        statement="Filtering e^(cz) first and multiplying by e^(−cd) is the filtered exponential test.",
        verdict="conditional",
        condition="z ≤ d over the whole kernel.",
        closed_form=_filtered_exponential,
        independent=_filtered_exponential_factors,
        samples=(({"d": 0.6, "c": 80}, "0.5@0.3,0.5@0.6"), ({"d": 0.6, "c": 80}, "0.5@0.3,0.5@0.7")),
    ),
    Equation(
        id="filtering.Eq2.21.violation",
        source="filtering, eq. 2.21",
        statement="Where a stored depth lies beyond the receiver the filtered exponential exceeds 1, without bound.",
        verdict="holds",
        closed_form=lambda i: _filtered_exponential(_violated(i)),
        independent=lambda i: _filtered_exponential_factors(_violated(i)),
        measured=lambda i: _blurred_exponential(_violated(i)),
        measured_tolerance=1e-4,  # float32 of an exponent near 80
        samples=({}, ({"d": 0.5, "c": 30}, "0.25@0.4,0.75@0.6")),
    ),
    *(
        Equation(
            id=f"filtering.ESM.{name}",
            source="filtering, section 2.5",
            statement=statement,
            verdict="holds",
            closed_form=closed_form,
            independent=independent,
            samples=({},),
        )
        for name, statement, closed_form, independent in (
            (
                "cmax_fp32",
                "Largest c with e^c finite in float32.",
                lambda i: _ceiling(np.float32),
                lambda i: _ceiling_searched(np.float32),
            ),
            (
                "cmax_fp16",
                "Largest c with e^c finite in float16.",
                lambda i: _ceiling(np.float16),
                lambda i: _ceiling_searched(np.float16),
            ),
            (
                "cmax_fp16_fullrange",
                "Largest range of c·z between float16's smallest normal and its largest number.",
                lambda i: _ceiling(np.float16, subnormals=False),
                lambda i: _ceiling_searched(np.float16, below=14 * math.log(2)),
            ),
            (
                "cmax_fp16_fullrange_subnormals",
                "The same from the smallest subnormal number.",
                lambda i: _ceiling(np.float16, subnormals=True),
                lambda i: _ceiling_searched(np.float16, below=24 * math.log(2)),
            ),
            ("e30", "e³⁰, beyond float16.", lambda i: math.exp(30), _exponential_series),
        )
    ),
    Equation(
        id="filtering.ESM.zmax_for_c30_fp16",
        pattern=r"filtering\.ESM\.zmax_for_c(?P<c>[\d.]+)_fp16",
        source="filtering, section 2.5",
        statement="Largest depth that e^(cz) can store in float16: ln(65504)/c.",
        verdict="erratum",
        closed_form=lambda i: _ceiling(np.float16) / i.number("c"),
        independent=lambda i: _ceiling_searched(np.float16) / i.number("c"),
        correction=Correction(
            printed="c = 30 suits 16-bit textures (depths up to 1)",
            corrected="it overflows beyond z = 0.3697; c ≤ 11 for depths up to 1",
            printed_form=lambda i: 1.0,
            counterexample={"c": 30},
        ),
        samples=({"c": 30}, {"c": 11}),
    ),
)
