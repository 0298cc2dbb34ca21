"""Filtering source: the package's filters run on small maps, against plain Python."""

import itertools
import math
from typing import Any

import jax.numpy as jnp
import numpy as np

from shadowjax.filters import convolution, exponential, variance
from shadowjax.filters.base import Lookup
from shadowjax.filters.prefilter import Prefilter
from shadowjax.ledger.equation import Equation, Inputs
from shadowjax.ledger.warping.tools import in_double

_FORMATS = {"float16": (jnp.float16, np.float16), "float32": (jnp.float32, np.float32)}
# Depths of a small map: a plane, creases (one with steps of 1 to 2.01), a jump, a spike, and the farthest in a corner.
_MAP = (
    (1.0, 1.2, 1.4, 1.7, 3.3), (1.1, 1.3, 1.5, 1.8, 2.1), (1.2, 1.4, 3.0, 1.9, 2.2), (1.6, 1.8, 2.0, 1.0, 1.3),
    (2.0, 2.2, 2.602, 1.1, 1.4),
)  # fmt: skip


def _step(i: Inputs) -> convolution.FourierStep:
    options = (i.number(name, default=value) for name, value in (("alpha", 1.0), ("offset", 0.0), ("scale", 2.0)))
    return convolution.FourierStep(i.integer("M"), *options)


def _decoded(i: Inputs, kind: Any):
    """What a filter makes of two averaged depths."""
    filter_ = kind(_step(i))
    codes = filter_.encode(jnp.asarray([i.numbers("z")]))[:, 0]
    return filter_.decode(list(codes @ jnp.asarray(i.numbers("w"))), jnp.asarray(i.number("d")))


def _series(i: Inputs, depths: list[float], weights: list[float]) -> float:
    """Scaled and clamped series of depths that are squeezed below the half period."""
    terms, offset = i.integer("M"), i.number("offset", default=0.0)
    squeeze = (2 * terms - 1) / (2 * terms * (1 + offset))
    receiver = min(max(i.number("d"), 0.0), 1.0) - offset
    total = 0.5
    for z, w in zip(depths, weights, strict=True):
        for k in range(1, terms + 1):
            c = math.pi * (2 * k - 1)
            damped = math.exp(-i.number("alpha", default=1.0) * k * k / terms**2)
            total += 2 * w * damped * math.sin(c * squeeze * (z - receiver)) / c
    return min(max(i.number("scale", default=2.0) * total, 0.0), 1.0)


def _mean(i: Inputs) -> float:
    return math.fsum(w * z for w, z in zip(i.numbers("w"), i.numbers("z"), strict=True))


def _chebyshev(i: Inputs) -> float:
    """Bound of the second moments of two depths, its low end cut."""
    square = math.fsum(w * z * z for w, z in zip(i.numbers("w"), i.numbers("z"), strict=True))
    spread = max(square - _mean(i) ** 2, i.number("least"))
    behind = max(i.number("d") - _mean(i), 0.0)
    bound = spread / (spread + behind**2)
    low, high = i.number("low"), i.number("high")
    return min(max((bound - low) / (high - low), 0.0), 1.0)


def _variance(i: Inputs):
    filter_ = variance.Variance(
        min_variance=i.number("least"), bleed_low=i.number("low"), bleed_high=i.number("high"), footprint=0.0
    )
    codes = filter_.encode(jnp.asarray([i.numbers("z")]))[:, 0]
    return filter_.decode(list(codes @ jnp.asarray(i.numbers("w"))), jnp.asarray(i.number("d")))


def _slopes(i: Inputs):
    """Along columns and along rows."""
    return jnp.stack(variance.surface_slopes(jnp.asarray(_MAP), i.number("limit") if "limit" in i else None))


def _slopes_plain(i: Inputs) -> list[Any]:
    """The same texel by texel."""

    def one(before: float, after: float) -> float:
        small, large = sorted((before, after), key=abs)
        slope = 0.0 if small * large <= 0 else (small + large) / 2 if abs(large) <= 2 * abs(small) else small
        limit = i.number("limit", default=1e9)
        return min(max(slope, -limit), limit)

    def along(rows: list[Any]) -> list[Any]:
        steps = [[b - a for a, b in itertools.pairwise(row)] for row in rows]
        return [[one(s[max(k - 1, 0)], s[min(k, len(s) - 1)]) for k in range(len(s) + 1)] for s in steps]

    down = along([list(column) for column in zip(*_MAP, strict=True)])
    return [along(list(_MAP)), [list(row) for row in zip(*down, strict=True)]]


def _moments(i: Inputs):
    """Both moments of a plane, in the middle of a map."""
    y, x = np.mgrid[-1:2, -1:2]
    plane = i.number("z") + i.number("zx") * x + i.number("zy") * y
    return variance.depth_moments(jnp.asarray(plane), i.number("footprint"))[:, 1, 1]


def _moments_integrated(i: Inputs) -> list[float]:
    """The same over a Gaussian footprint, by Gauss's rule."""
    nodes, weights = np.polynomial.hermite_e.hermegauss(4)
    spread, total = math.sqrt(i.number("footprint")), 2 * math.pi
    points = [
        (u * v / total, i.number("z") + spread * (i.number("zx") * a + i.number("zy") * b))
        for (u, a), (v, b) in itertools.product(zip(weights, nodes, strict=True), repeat=2)
    ]
    return [math.fsum(w * z**power for w, z in points) for power in (1, 2)]


def _blurred(i: Inputs):
    """ln of the mean of e^(cz) at the middle of the map."""
    weights = Prefilter(size=5).weights
    return exponential.blur_exponents(i.number("c") * jnp.asarray(_MAP), weights)[0, 0]


def _blurred_plain(i: Inputs) -> float:
    """The same less the largest exponent, term by term; the weights are those of a Gaussian of a fifth of the size."""
    taps = [math.exp(-(k * k) / 2) for k in (-2, -1, 0, 1, 2)]
    top = i.number("c") * max(map(max, _MAP))
    terms = [a * b * math.exp(i.number("c") * z - top) for a, row in zip(taps, _MAP, strict=True)
             for b, z in zip(taps, row, strict=True)]  # fmt: skip
    return top + math.log(math.fsum(terms) / sum(taps) ** 2)


def _exponential(i: Inputs):
    """Visibility of a receiver at the middle of the map, through all of the filter."""
    filter_ = exponential.Exponential(
        i.number("c"), Prefilter(3, "box", sampling="nearest"), i.text("space"), i.text("fallback"),
        i.number("threshold", default=0.02),
    )  # fmt: skip
    planes = filter_.prepare(jnp.asarray(_MAP), jnp.asarray(4.0))
    zero = jnp.zeros(1)
    lookup = Lookup(jnp.full((1, 2), 2.5), zero + i.number("d"), zero + i.number("bias"), zero + 1)
    return filter_.visibility(planes, lookup)[0]


def _exponential_plain(i: Inputs) -> float:
    """The mean test over 3 × 3 texels, at most 1; the texel's own test where the fallback sees a violation."""
    unit = [[(z - 1.0) / 3.0 for z in row] for row in _MAP]
    depth = max((i.number("d") - i.number("bias") - 1.0) / 3.0, 0.0)
    near = [z for row in unit[1:4] for z in row[1:4]]
    mean = math.fsum(math.exp(i.number("c") * (z - depth)) for z in near) / 9
    wide = max(map(max, unit))
    fails = {"none": False, "threshold": mean > 1 + i.number("threshold", default=0.02), "z-max": wide > depth}
    lit = float(i.number("d") - i.number("bias") <= _MAP[2][2])
    return lit if fails[i.text("fallback")] else min(mean, 1.0)


def _largest_accepted(i: Inputs) -> float:
    """Largest exponent that the filter's check lets pass, by bisection."""
    low, high = 0.0, 200.0
    for _ in range(60):
        middle = (low + high) / 2
        try:
            exponential.check_exponent(middle, _FORMATS[i.text("format")][0], i.integer("power"), i.number("growth"))
            low = middle
        except ValueError:
            high = middle
    return low


def _room(i: Inputs) -> float:
    """c with growth·e^(power·c) = the largest number."""
    largest = float(np.finfo(_FORMATS[i.text("format")][1]).max)
    return math.log(largest / i.number("growth")) / i.integer("power")


def _row(name: str, where: str, statement: str, closed_form: Any, independent: Any, samples: Any, **options: Any):
    return Equation(
        id=f"filtering.{name}", source=f"filtering, {where}", statement=statement, verdict="holds",
        closed_form=in_double(closed_form), independent=independent, samples=samples, **options,
    )  # fmt: skip


_TWO = {"z": [0.3, 0.8], "w": [0.25, 0.75]}
_STEPS = (
    {**_TWO, "M": 4, "d": 0.5}, {**_TWO, "M": 8, "d": 0.75, "alpha": 0.5, "offset": 0.1, "scale": 1.5},
    {**_TWO, "M": 8, "d": 0.81, "alpha": 0.2, "scale": 1.1}, {**_TWO, "M": 3, "d": 1.4, "scale": 1.7},
)  # fmt: skip
_BOUND = {**_TWO, "least": 1e-6, "low": 0.1, "high": 0.9}
_SMALL = {"space": "log", "fallback": "none", "c": 4.0, "d": 2.4, "bias": 0.1}

EQUATIONS: tuple[Equation, ...] = (
    _row("CSM.decoded", "eq. 2.15 and section 2.4", "The filter's answer to two averaged depths, series and clamp.",
         lambda i: _decoded(i, convolution.Convolution), lambda i: _series(i, i.numbers("z"), i.numbers("w")), _STEPS),
    _row("XCSM.decoded", "section 2.4.3", "The series of the mean depth, scaled and clamped.",
         lambda i: _decoded(i, convolution.MeanDepthConvolution), lambda i: _series(i, [_mean(i)], [1.0]), _STEPS),
    _row("CSM.bytes", "section 2.4.1", "Bytes of the basis images.",
         lambda i: convolution.basis_bytes(i.integer("M"), i.integer("rows"), i.integer("cols")),
         lambda i: convolution.fourier_bases(
             jnp.zeros((i.integer("rows"), i.integer("cols")), jnp.float32), i.integer("M")).nbytes,
         ({"M": 3, "rows": 2, "cols": 5},)),
    _row("VSM.decoded", "eqs 2.3 to 2.8 and Algorithm 2", "The filter's answer to two averaged depths.",
         _variance, _chebyshev,
         (*({**_BOUND, "d": d} for d in (0.6, 0.7, 0.8, 0.95)), {**_BOUND, "d": 0.9, "least": 0.2})),
    _row("VSM.slopes", "eq. 2.9", "Slopes of a map's surfaces: mean differences on planes, the smaller beside jumps.",
         _slopes, _slopes_plain, ({}, {"limit": 0.25})),
    _row("Eq2.9.moments", "eqs 2.3, 2.4 and 2.9", "Moments of a plane under a Gaussian footprint.",
         _moments, _moments_integrated,
         ({"z": 0.4, "zx": 0.03, "zy": -0.05, "footprint": 0.25}, {"z": 2, "zx": 0.5, "zy": 1, "footprint": 1})),
    _row("ESM.blurred", "eq. 2.21", "ln of the blurred e^(cz), whose largest exponents overflow alone.",
         _blurred, _blurred_plain, ({"c": 3.0}, {"c": 500.0})),
    _row("ESM.decoded", "eqs 2.20 and 2.21", "The filter's answer in the middle of a small map, with its fallbacks.",
         _exponential, _exponential_plain,
         ({**_SMALL}, {**_SMALL, "space": "linear", "d": 2.8}, {**_SMALL, "d": 0.9}, {**_SMALL, "d": 3.4},
          {**_SMALL, "fallback": "threshold", "d": 1.5}, {**_SMALL, "fallback": "threshold", "d": 3.15},
          {**_SMALL, "fallback": "z-max", "d": 2.9}, {**_SMALL, "fallback": "z-max", "d": 3.25},
          {**_SMALL, "fallback": "z-max", "d": 3.6},
          {**_SMALL, "fallback": "threshold", "d": 2.2, "threshold": 0.4})),
    _row("ESM.cmax_checked", "section 2.5.1", "Largest exponent that the filter's check accepts.",
         _largest_accepted, _room,
         ({"format": "float32", "power": 1, "growth": 1}, {"format": "float16", "power": 2, "growth": 9}),
         tolerance=1e-12),
)  # fmt: skip
