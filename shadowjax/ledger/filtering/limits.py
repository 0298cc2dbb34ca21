"""Beyond the filtering source: the package's closed forms of where filters break, against brute force."""

import math
from typing import Any

import jax.numpy as jnp
import numpy as np
from scipy import integrate, optimize

from shadowjax.filters.convolution import fourier_test
from shadowjax.ledger.equation import Equation, Inputs
from shadowjax.ledger.warping.tools import in_double
from shadowjax.theory import limits

# Two occluders before a receiver: depths, and the share q of the kernel that sees the far one.
_DEPTHS = {"near": 0.2, "far": 0.5, "receiver": 0.8}
_TWO = tuple({**_DEPTHS, "share": q} for q in (0.1, 0.5, 0.9))
_THREE = ({**_TWO[0], "c": 4.0}, {**_TWO[1], "c": 1.5}, {**_TWO[2], "c": 9.0})
_FLAT = ({**_TWO[1], "c": 0.0, "receiver": 0.9},)
_SPREADS = ({"spread": 0.5}, {"spread": 3.0})
_FORMATS = {"float16": np.float16, "float32": np.float32, "float64": np.float64}


def _depths(inputs: Inputs) -> tuple[float, float, float, float]:
    near, far, receiver, share = (inputs.number(name) for name in ("near", "far", "receiver", "share"))
    return near, far, receiver, share


def _spread(inputs: Inputs) -> float:
    near, far, receiver, _ = _depths(inputs)
    return (far - near) / (receiver - far)


def _markov(depths: tuple[float, float], share: float, receiver: float) -> float:
    """Least of Markov's bounds on (z − μ + u)² for two depths, by looking for the best u."""
    mean = share * depths[1] + (1 - share) * depths[0]
    variance = share * (depths[1] - mean) ** 2 + (1 - share) * (depths[0] - mean) ** 2
    unit = receiver - mean  # the search is made for a receiver at distance 1
    found: Any = optimize.minimize_scalar(
        lambda v: (variance / unit**2 + math.tan(v) ** 2) / (1 + math.tan(v)) ** 2,
        bounds=(0, math.pi / 2 - 1e-6), method="bounded", options={"xatol": 1e-11},
    )  # fmt: skip
    return float(found.fun)


def _bleed_markov(inputs: Inputs) -> float:
    near, far, receiver, share = _depths(inputs)
    return _markov((near, far), share, receiver)


def _warped_bleed(inputs: Inputs) -> float:
    near, far, receiver, share = _depths(inputs)
    c = inputs.number("c")  # depths themselves are the limit of c → 0, as straight lines bend no ratio
    # The same bound on warped depths; at c = 0 on depths themselves.
    warped = [math.exp(c * depth) if c else depth for depth in (near, far, receiver)]
    return _markov((warped[0], warped[1]), share, warped[2])


def _exponential_mean(inputs: Inputs) -> float:
    """The mean of e^(cz) over the kernel, divided by e^(cd)."""
    near, far, receiver, share = _depths(inputs)
    c = inputs.number("c")
    return (share * math.exp(c * far) + (1 - share) * math.exp(c * near)) / math.exp(c * receiver)


def _bleed_over_shares(inputs: Inputs) -> float:
    """Largest share of light over all q, by search on Chebyshev's bound of two depths at 0 and r before 1 + r."""
    r = inputs.number("spread")

    def light(q: float) -> float:
        # Depths 0 with weight 1 − q and r with weight q, before a receiver at 1 + r.
        mean = q * r
        variance = q * r * r - mean * mean
        return variance / (variance + (1 + r - mean) ** 2)

    found: Any = optimize.minimize_scalar(
        lambda q: -light(q), bounds=(0, 1), method="bounded", options={"xatol": 1e-11}
    )
    return -float(found.fun)


def _exponent_options(inputs: Inputs) -> tuple[Any, int, int, float, bool]:
    return (
        _FORMATS[inputs.text("format")], inputs.integer("moments", default=1), inputs.integer("kernel", default=1),
        inputs.number("depth", default=1.0), bool(inputs.get("normalised", True)),
    )  # fmt: skip


def _exponent_bisected(inputs: Inputs) -> float:
    """Largest c at which the sum that the kernel makes of e^(mcz) is no larger than the format's largest number."""
    dtype, moments, kernel, depth, normalised = _exponent_options(inputs)
    room = float(np.finfo(dtype).max) / (1 if normalised else kernel * kernel)
    low, high = 0.0, 700.0 / moments / depth
    for _ in range(100):
        middle = (low + high) / 2
        low, high = (middle, high) if math.exp(middle * depth) ** moments <= room else (low, middle)
    return low


def _receiver_bisected(inputs: Inputs) -> float:
    """Largest c at which e^(−c·d) is not below the smallest number of the format, by bisection."""
    info = np.finfo(_FORMATS[inputs.text("format")])
    smallest = float(info.smallest_subnormal if inputs.get("subnormal", False) else info.smallest_normal)
    low, high = 0.0, 2000.0
    for _ in range(100):
        middle = (low + high) / 2
        low, high = (
            (middle, high) if math.exp(-middle * inputs.number("depth", default=1.0)) >= smallest else (low, middle)
        )
    return low


def _series_integrated(inputs: Inputs) -> float:
    """½ plus the integral of the series' slope, which without damping is sin(2Mπt)/sin(πt)."""
    terms, damping = inputs.integer("M"), inputs.number("alpha", default=0.0)
    k = np.arange(1, terms + 1)
    weight = np.exp(-damping * (k / terms) ** 2)

    def slope(t: float) -> float:
        # Σ cos((2k − 1)πt) = sin(2Mπt)/(2 sin πt).
        if damping == 0 and t != 0:
            return math.sin(2 * terms * math.pi * t) / math.sin(math.pi * t)
        return 2 * float(np.sum(weight * np.cos(np.pi * (2 * k - 1) * t)))

    return 0.5 + integrate.quad(slope, 0, inputs.number("t"), limit=400, epsabs=1e-13, epsrel=1e-13)[0]


def _next_moment(inputs: Inputs) -> float:
    """Least σ with μ² + σ² at the number of float32 that follows μ², which is a power of two, by bisection."""
    # A power of two is exact, and the gap above it is ε times itself: σ² must reach that gap.
    square = np.float32(inputs.number("mu") ** 2)
    following = float(np.nextafter(square, np.float32(np.inf)))
    low, high = 0.0, inputs.number("mu")
    for _ in range(100):
        middle = (low + high) / 2
        low, high = (low, middle) if middle * middle >= following - float(square) else (middle, high)
    return high


def _limit(
    name: str, place: str, statement: str, closed_form: Any, samples: tuple[Any, ...], **options: Any
) -> Equation:
    """An entry `filtering.beyond.name` whose routes run in float64."""
    routes = {kind: in_double(options.pop(kind)) for kind in ("independent", "measured") if kind in options}
    return Equation(
        id=f"filtering.beyond.{name}", source=f"filtering, beyond {place}", statement=statement, verdict="holds",
        closed_form=in_double(closed_form), samples=samples, **routes, **options,
    )  # fmt: skip


EQUATIONS: tuple[Equation, ...] = (
    _limit(
        "variance_bleed", "eq. 2.7", "Light behind two occluders in a variance map: q(1−q)r²/(q(1−q)r² + (1+(1−q)r)²).",
        lambda i: limits.variance_bleed(_spread(i), i.number("share")), _TWO, independent=_bleed_markov, tolerance=1e-8,
    ),
    _limit(
        "exponential_variance_bleed", "eq. 2.7", "The same for warped depths: r = (1 − e^(−cΔ))/(e^(cδ) − 1).",
        lambda i: limits.exponential_variance_bleed(*_depths(i), i.number("c")), _THREE + _FLAT,
        independent=_warped_bleed, tolerance=1e-8,
    ),
    _limit(
        "exponential_bleed", "eq. 2.21", "Light behind two occluders in an exponential map.",
        lambda i: limits.exponential_bleed(*_depths(i), i.number("c")), _THREE, independent=_exponential_mean,
    ),
    _limit(
        "least_bleed_clamp", "Algorithm 2", "Least clamp that leaves no light behind two occluders: (r/(r + 2))².",
        lambda i: limits.least_bleed_clamp(i.number("spread")), _SPREADS, independent=_bleed_over_shares,
        tolerance=1e-8,
    ),
    _limit(
        "largest_exponent", "section 2.5.1", "Largest c of a map of m moments filtered over K × K texels.",
        lambda i: limits.largest_exponent(*_exponent_options(i)),
        (
            {"format": "float32"}, {"format": "float16", "moments": 2, "depth": 0.8},
            {"format": "float16", "kernel": 5, "normalised": False},
        ),
        independent=_exponent_bisected, measured=lambda i: limits.measured_exponent(*_exponent_options(i)),
        measured_tolerance=2e-3,  # 25 roundings of float16 in e^c, over c
    ),
    _limit(
        "largest_receiver_exponent", "section 2.5.1", "Largest c at which the factor e^(−cd) keeps its digits.",
        lambda i: limits.largest_receiver_exponent(
            _FORMATS[i.text("format")], i.number("depth", default=1.0), bool(i.get("subnormal", False))),
        ({"format": "float32"}, {"format": "float16", "subnormal": True, "depth": 2}), independent=_receiver_bisected,
    ),
    _limit(
        "fourier_step", "eq. 2.17", "The series of the step in one difference t = z − d, damped or not.",
        lambda i: fourier_test(i.number("t"), i.integer("M"), i.number("alpha", default=0.0)),
        ({"t": 0.3, "M": 8}, {"t": -0.07, "M": 8}, {"t": 0.2, "M": 8, "alpha": 1.5}), independent=_series_integrated,
    ),
    _limit(
        "smallest_deviation", "section 2.3", "Deviation of depth that makes the second moment one number larger: μ√ε.",
        lambda i: limits.smallest_deviation(i.number("mu"), jnp.float32), ({"mu": 0.5}, {"mu": 8.0}),
        independent=_next_moment,
    ),
)  # fmt: skip
