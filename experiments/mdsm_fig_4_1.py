"""mdsm, figure 4.1: how many tones a filter of n elements gives when each element takes one of w values.

The source plots k = (w − 1)·n + 1 (eq. 4.2) as a surface and concludes that a filter gains tones from elements with
more values, not only from more elements.

Measured, on the left: every multiset of equally spaced values is summed and the distinct sums are counted, and every
binary window of small PCF(k, n) filters goes through the package's own filter. Both must land on the lines.

Measured, on the right: the formula is no bound when the values are not equally spaced. Any w values give at most
C(n + w − 1, w − 1) tones, as many as there are multisets; values that are powers of n + 1 attain it. The values 0, 0.3
and 1 attain it up to n = 9 and then lose tones, because ten times 0.3 is three times 1. Composite tests return s/n,
which is equally spaced: for them eq. 4.2 is exact.

How to read it: lines are formulas, markers are counts.
"""

from dataclasses import dataclass
from fractions import Fraction
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure

from experiments.base import Claim
from shadowjax._checks import require, require_int
from shadowjax._types import Array
from shadowjax.filters.pcf import percentage_closer
from shadowjax.plotting import PALETTE, label, new_figure, series_style, styled
from shadowjax.theory.tones import count_sums, count_tones, max_tones, nominal_tones

THIRDS = (Fraction(0), Fraction(3, 10), Fraction(1))  # 0, 0.3, 1: unequal steps that meet again at ten elements


@dataclass(frozen=True)
class Config:
    """Settings.

    Attributes:
        max_elements: Largest n, elements of the filter, ≥ 1.
        num_levels: Values of w, ≥ 2.
        max_bits: Filters with up to this many binary tests have all their windows enumerated, 1 to 20.
    """

    max_elements: int = 16
    num_levels: tuple[int, ...] = (2, 3, 4, 5)
    max_bits: int = 18

    def __post_init__(self):
        require_int(self.max_elements, "max_elements", 1)
        require_int(self.max_bits, "max_bits", 1)
        require(self.max_bits <= 20, f"max_bits must be at most 20 (2^20 windows); got {self.max_bits}")
        require(len(self.num_levels) > 0, "num_levels must hold at least one number")
        for levels in self.num_levels:
            require_int(levels, "num_levels", 2)


@dataclass(frozen=True)
class Result:
    """Tones by formula and by count; arrays run over n = 1 … max_elements.

    Attributes:
        elements: n.
        formula: w → (w − 1)·n + 1.
        counted: w → distinct sums of equally spaced values.
        bound: w → C(n + w − 1, w − 1).
        generic: w → distinct sums of values that are powers of max_elements + 1.
        thirds: Distinct sums of 0, 0.3 and 1.
        filtered: (elements, values, tones) of every filter whose binary windows were all filtered.
    """

    elements: np.ndarray
    formula: dict[int, np.ndarray]
    counted: dict[int, np.ndarray]
    bound: dict[int, np.ndarray]
    generic: dict[int, np.ndarray]
    thirds: np.ndarray
    filtered: tuple[tuple[int, int, int], ...]


def all_windows(kernel_size: int, num_depths: int) -> Float[Array, "n rows cols"]:
    """Every pattern of near (0) and far (2) depths under a K × K kernel, side by side in one map with n planes."""
    bits = num_depths * kernel_size**2
    patterns = (np.arange(2**bits)[:, None] >> np.arange(bits)) & 1
    tiles = patterns.reshape(-1, num_depths, kernel_size, kernel_size).transpose(1, 2, 0, 3)
    return jnp.asarray(2.0 * tiles.reshape(num_depths, kernel_size, -1), jnp.float32)


def filtered_tones(kernel_size: int, num_depths: int) -> int:
    """Distinct visibilities over all binary windows of PCF(K², n), each through the package's filter."""
    planes = all_windows(kernel_size, num_depths)
    num_windows = planes.shape[-1] // kernel_size
    x = kernel_size * (np.arange(num_windows) + 0.5)
    position = jnp.asarray(np.stack([x, np.full_like(x, kernel_size / 2)], -1), jnp.float32)
    return count_tones(_filtered(planes, position, kernel_size))


@partial(jax.jit, static_argnums=2)
def _filtered(
    planes: Float[Array, "n rows cols"], position: Float[Array, "windows 2"], kernel_size: int
) -> Float[Array, "windows"]:
    depth = jnp.ones(position.shape[0], position.dtype)
    return percentage_closer(planes, position, depth, kernel_size, border="clamp")


def run(config: Config) -> Result:
    """Count everything."""
    elements = np.arange(1, config.max_elements + 1)
    base = config.max_elements + 1

    def over_n(count: Any) -> np.ndarray:
        return np.array([count(int(n)) for n in elements])

    def counts(levels: tuple[Fraction, ...]) -> np.ndarray:
        return over_n(lambda n: count_sums(levels, n))

    widths = config.num_levels
    kernels = [(size, depths) for size in (1, 2, 3) for depths in range(1, max(widths))]
    return Result(
        elements,
        formula={w: over_n(lambda n, w=w: nominal_tones(n, w)) for w in widths},
        counted={w: counts(tuple(Fraction(i, w - 1) for i in range(w))) for w in widths},
        bound={w: over_n(lambda n, w=w: max_tones(n, w)) for w in widths},
        generic={w: counts((Fraction(0), *(Fraction(base**i) for i in range(w - 1)))) for w in widths},
        thirds=counts(THIRDS),
        filtered=tuple(
            (size**2, depths + 1, filtered_tones(size, depths))
            for size, depths in kernels
            if depths * size**2 <= config.max_bits
        ),
    )


def claims(result: Result) -> tuple[Claim, ...]:
    """Equal spacing makes eq. 4.2 exact; without it only the number of multisets bounds the tones."""
    cells = sum(counts.size for counts in result.counted.values())
    equal = sum(int((result.counted[w] == result.formula[w]).sum()) for w in result.counted)
    attained = sum(int((result.generic[w] == result.bound[w]).sum()) for w in result.generic)
    hit = sum(tones == nominal_tones(n, w) for n, w, tones in result.filtered)
    beyond = result.thirds > 2 * result.elements + 1
    multisets = np.array([max_tones(int(n), 3) for n in result.elements])
    attains = bool((result.thirds == multisets)[result.elements < 10].all())
    loses = bool((result.thirds < multisets)[result.elements >= 10].all())
    return (
        Claim("counts with equally spaced values equal (w − 1)n + 1", equal == cells, f"{equal} pairs", f"all {cells}"),
        Claim(
            "PCF(k, n) gives exactly nk + 1 tones over all its binary windows",
            hit == len(result.filtered), f"{hit} filters", f"all {len(result.filtered)}",
        ),
        Claim(
            "values without coincidences attain C(n + w − 1, w − 1)", attained == cells, f"{attained} pairs",
            f"all {cells}",
        ),
        Claim(
            "corrected: 0, 0.3 and 1 exceed eq. 4.2 at every n ≥ 2",
            bool((beyond == (result.elements >= 2)).all()), f"{result.thirds[-1]} tones at n = {result.elements[-1]}",
            f"more than {2 * result.elements[-1] + 1}",
        ),
        Claim(
            "0, 0.3 and 1 attain the true bound up to n = 9 and stay below it from n = 10", attains and loses,
            f"{result.thirds[-1]} at n = {result.elements[-1]}", f"against a bound of {multisets[-1]}",
        ),
    )  # fmt: skip


def numbers(result: Result) -> dict[str, Any]:
    """Formulas and counts."""
    return {
        "elements": result.elements, "formula": result.formula, "counted": result.counted, "bound": result.bound,
        "generic": result.generic, "levels_0_0.3_1": result.thirds,
        "filtered": [{"elements": n, "levels": w, "tones": tones} for n, w, tones in result.filtered],
    }  # fmt: skip


@styled
def draw(result: Result) -> Figure:
    """Equal spacing on the left, unequal on the right."""
    figure, axes = new_figure(9.2, 4.3, 1, 2)
    left, right = axes[0]
    for index, (w, formula) in enumerate(result.formula.items()):
        style = series_style(index)
        left.plot(result.elements, formula, color=style["color"], label=f"w = {w}: {w - 1 if w > 2 else ''}n + 1")
        left.plot(result.elements, result.counted[w], style["marker"], color=style["color"], markersize=4.5)
    across = [n for n, _, _ in result.filtered]
    left.plot(
        across, [tones for *_, tones in result.filtered], "o", markersize=11, markerfacecolor="none",
        markeredgecolor="#4d4d4d", markeredgewidth=1.2, label="all windows through the filter",
    )  # fmt: skip
    label(left, "n, elements of the filter", "k, distinct tones", "Equally spaced values: eq. 4.2 is exact")
    left.legend(loc="upper left")
    for index, (w, bound) in enumerate(result.bound.items()):
        style = series_style(index)
        right.plot(result.elements, bound, color=style["color"], label=f"w = {w}: C(n + {w - 1}, {w - 1})")
        right.plot(result.elements, result.generic[w], style["marker"], color=style["color"], markersize=4.5)
    right.plot(
        result.elements, 2 * result.elements + 1, color=PALETTE[1], linestyle=(0, (4, 3)), label="eq. 4.2, w = 3"
    )
    right.plot(result.elements, result.thirds, "x", color="#4d4d4d", markersize=7, label="values 0, 0.3 and 1")
    right.set_yscale("log")
    label(right, "n, elements of the filter", "k, distinct tones", "Any values: only multisets bound the tones")
    right.legend(loc="upper left", ncols=1)
    return figure
