"""filtering, figures 2.8 and 2.9: the exponential step, where its premise fails, and where its exponent overflows.

The source plots e^(−c(d−z)), shows bright spots where a texel of the kernel lies behind the receiver, names c = 80 for
32-bit maps and c = 30 for 16-bit ones, and prefers a threshold to a classification by the largest depth.

Measured: a kernel with some share behind the receiver goes through the package's filter. Clamped at 1 it is fully lit
as soon as a single texel lies behind. The threshold and the largest depth both find so strong a violation, and then
bilinear PCF answers. And every dtype is filled with exponentials until it overflows: c = 30 does not fit into 16 bits
for z > 0.37; the limit is ln(65504) = 11.09. Filtering logarithms has no limit.

How to read it: left, the step; middle, the violation, where the truth is the dotted line; right, limits predicted
(bars) and found by filling the dtype (marks).
"""

from dataclasses import dataclass
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure

from experiments.base import Claim
from shadowjax._checks import require
from shadowjax._types import Array
from shadowjax.filters.base import Lookup
from shadowjax.filters.exponential import Exponential
from shadowjax.filters.prefilter import Prefilter
from shadowjax.plotting import MARKERS, PALETTE, label, new_figure, styled
from shadowjax.theory import limits

DTYPES = {"float16": jnp.float16, "bfloat16": jnp.bfloat16, "float32": jnp.float32}
MODES = ("none", "threshold", "z-max")
SIZE = 9  # texels of the blur: the receiver lies on the middle one of a small map


@dataclass(frozen=True)
class Config:
    """Settings.

    Attributes:
        exponents: c of the steps that are drawn, rising.
        near: Depth of the occluder, in [0, 1].
        far: Depth behind the receiver.
        receiver: Depth of the receiver, between them.
        violation_exponent: c of the map with the violation.
    """

    exponents: tuple[float, ...] = (10.0, 30.0, 80.0)
    near: float = 0.3
    far: float = 0.7
    receiver: float = 0.6
    violation_exponent: float = 80.0

    def __post_init__(self):
        require(0 <= self.near < self.receiver < self.far <= 1, "depths must rise: near, receiver, far, in [0, 1]")
        require(list(self.exponents) == sorted(self.exponents), "exponents must rise")


@dataclass(frozen=True)
class Result:
    """What was found.

    Attributes:
        distance: d − z.
        steps: c → e^(−c(d−z)).
        share: Share of the blur's weight that lies behind the receiver.
        answers: Mode → visibility.
        mean: The mean exponential without clamp at half the weight, by eq. 2.21.
        predicted: dtype → (largest c, the same for two moments).
        measured: The same by filling the dtype.
        steep: Visibility at c = 1000 in log space and float32, receiver behind two occluders.
        fits16: Largest depth at which c = 30 is finite in 16 bits.
    """

    distance: np.ndarray
    steps: dict[float, np.ndarray]
    share: np.ndarray
    answers: dict[str, np.ndarray]
    mean: float
    predicted: dict[str, tuple[float, float]]
    measured: dict[str, tuple[float, float]]
    steep: float
    fits16: float


def _map(columns: int, near: float, far: float) -> Array:
    """A map whose leftmost columns are far and the rest near; corners hold the ends of the range."""
    row = np.where(np.arange(2 * SIZE) < columns, far, near)
    depth = np.tile(row, (SIZE, 1))
    depth[0, 0], depth[0, 1] = 0.0, 1.0
    return jnp.asarray(np.concatenate([depth, np.tile(row, (2 * SIZE, 1))]), jnp.float32)


@eqx.filter_jit
def _visibility(filter_: Exponential, depth: Array, receiver: Array) -> Array:
    """Of a receiver on the middle of the map."""
    position = jnp.asarray([[SIZE + 0.5, 2 * SIZE + 0.5]], jnp.float32)
    zero, one = jnp.zeros(1, jnp.float32), jnp.ones(1, jnp.float32)
    return filter_.visibility(filter_.prepare(depth), Lookup(position, receiver[None], zero, one, "clamp"))[0]


def run(config: Config) -> Result:
    """Steps, violations and limits."""
    distance = np.linspace(0, 0.3, 121)
    weights = np.ones(SIZE) / SIZE
    columns = np.arange(SIZE // 2 + 1, SIZE + SIZE // 2 + 2)
    receiver = jnp.asarray(config.receiver, jnp.float32)
    answers = {}
    with jax.debug_nans(False):
        for mode in MODES:
            filter_ = Exponential(
                config.violation_exponent,
                Prefilter(SIZE, "box", sampling="nearest"),
                fallback=mode,
                fallback_size=SIZE - 1,
            )
            answers[mode] = np.array(
                [float(_visibility(filter_, _map(int(n), config.near, config.far), receiver)) for n in columns]
            )
        steep = Exponential(exponent=1000.0, prefilter=Prefilter(SIZE, "box", sampling="nearest"))
        dark = float(_visibility(steep, _map(SIZE + 1, config.near, config.receiver - 0.05), receiver))
    # texels SIZE//2 + 1 … lie under the kernel of the middle texel
    share = np.array([weights[: max(0, int(n) - (SIZE - SIZE // 2))].sum() for n in columns])
    c = config.violation_exponent
    half = 0.5 * (np.exp(c * (config.near - config.receiver)) + np.exp(c * (config.far - config.receiver)))
    return Result(
        distance,
        {c: np.exp(-c * distance) for c in config.exponents},
        share,
        answers,
        float(half),
        {name: (limits.largest_exponent(kind), limits.largest_exponent(kind, 2)) for name, kind in DTYPES.items()},
        {name: (limits.measured_exponent(kind), limits.measured_exponent(kind, 2)) for name, kind in DTYPES.items()},
        dark,
        limits.largest_exponent(jnp.float16) / 30,
    )


def claims(result: Result) -> tuple[Claim, ...]:
    """Violation and overflow."""
    none = result.answers["none"]
    some = (result.share > 0.02) & (result.share < 0.98)
    truth = result.share
    off = {mode: float(np.abs(result.answers[mode] - truth)[some].max()) for mode in MODES}
    worst = max(
        abs(p / m - 1) for name in DTYPES for p, m in zip(result.predicted[name], result.measured[name], strict=True)
    )
    c16 = result.predicted["float16"][0]
    return (
        Claim(
            "half a kernel behind the receiver gives 1490, not ½",
            abs(result.mean - 1490.478993520883) < 1e-6,
            f"{result.mean:.6f}",
            "1490.478994",
        ),
        Claim("clamped, any violation is fully lit", bool((none[some] == 1).all()), f"{none[some].min():.3f}", "1"),
        Claim(
            "the largest depth finds every violation",
            off["z-max"] < 0.15,
            f"off by {off['z-max']:.3f} from the share lit",
            "what PCF's own taps allow, 0.15",
        ),
        Claim(
            "z-max is nearer to the truth than the clamp",
            off["z-max"] < off["none"],
            f"{off['z-max']:.3f}",
            f"less than {off['none']:.3f}",
        ),
        Claim(
            "and never farther than the threshold",
            off["z-max"] <= off["threshold"] + 1e-6,
            f"{off['z-max']:.3f}",
            f"at most {off['threshold']:.3f}",
        ),
        Claim(
            "limits are ln(largest number) over the moment",
            worst < 1e-3,
            f"off by {worst:.1e}",
            "rounding of the dtype",
        ),
        Claim(
            "corrected: c = 30 overflows 16 bits for z > 0.3697",
            abs(result.fits16 - 0.36966221628203387) < 1e-12,
            f"{result.fits16:.6f}",
            "0.369662",
        ),
        Claim(
            "corrected: 16 bits hold c = 11.09, and 5.545 with two moments",
            abs(c16 - 11.0898664885) < 1e-9,
            f"{c16:.4f}, {result.predicted['float16'][1]:.4f}",
            "11.0899, 5.5449",
        ),
        Claim("logarithms hold c = 1000 in 32 bits", result.steep < 1e-6, f"{result.steep:.1e} of light", "0"),
    )


def numbers(result: Result) -> dict[str, Any]:
    """Answers and limits."""
    return {
        "share_behind": result.share, "answers": result.answers, "predicted_exponents": result.predicted,
        "measured_exponents": result.measured, "largest_depth_at_c_30_in_float16": result.fits16,
    }  # fmt: skip


@styled
def draw(result: Result) -> Figure:
    """Step, violation, limits."""
    figure, axes = new_figure(11.0, 3.9, 1, 3)
    left, middle, right = axes[0]
    for index, (c, step) in enumerate(result.steps.items()):
        left.plot(result.distance, step, color=PALETTE[index], marker=MARKERS[index], markevery=15, label=f"c = {c:g}")
    left.legend()
    label(left, "d − z (of the range)", "visibility", "Steeper with c")
    names = {"none": "clamped to 1", "threshold": "threshold", "z-max": "largest depth"}
    for index, (mode, values) in enumerate(result.answers.items()):
        middle.plot(result.share, values, color=PALETTE[index], marker=MARKERS[index], label=names[mode])
    middle.plot([0, 1], [0, 1], color="#5c6575", linestyle=(0, (1, 2)), label="truth")
    middle.legend(loc="lower right")
    label(middle, "share of the kernel behind the receiver", "visibility", "Some texels behind the receiver")
    rows = np.arange(len(DTYPES))
    for offset, moment in ((-0.2, 0), (0.2, 1)):
        values = [result.predicted[name][moment] for name in DTYPES]
        name = "one moment" if moment == 0 else "two moments"
        right.barh(rows + offset, values, height=0.36, color=PALETTE[4 if moment else 0], label=name)
        found = [result.measured[name][moment] for name in DTYPES]
        right.plot(found, rows + offset, "|", color="#1d2330", markersize=12, markeredgewidth=2)
        for row, value in zip(rows, values, strict=True):
            right.text(value + 2, row + offset, f"{value:.2f}", va="center", fontsize=8)
    right.set_yticks(rows, list(DTYPES))
    right.set_xlim(0, 112)
    right.grid(axis="y", visible=False)
    right.legend(loc="lower right")
    label(right, "largest exponent c for z in [0, 1]", "", "Where exp(c z) overflows")
    return figure
