"""Multi-depth source, chapter 5: cost in fetches, its crossover, and what the text says about it."""

import functools
import itertools
from fractions import Fraction

import jax.numpy as jnp
import numpy as np

from shadowjax._types import Array, Float, default_dtype
from shadowjax.ledger.equation import Correction, Equation, Inputs
from shadowjax.ledger.mdsm import measured as real
from shadowjax.theory import cost, tones
from shadowjax.theory.windows import kernel_width


def _map(size: int = 6) -> Float[Array, "rows cols"]:
    """Distinct depths on both sides of the receivers."""
    steps = np.random.default_rng(3).permutation(size * size).reshape(size, size)
    return jnp.asarray(real.RECEIVER + (steps - size * size / 2 + 0.25) / (size * size), dtype=default_dtype())


@functools.cache
def counted_taps(num_taps: int, policy: str = "1-SM") -> int:
    """Texels that one lookup of the package's filter reads, counted on real arrays."""
    stored = real.policy_planes(_map(), policy)
    width = kernel_width(num_taps)
    # At a texel's centre for odd kernels, between texels for even ones: the taps then lie on centres.
    middle = jnp.full((1, 2), 3.0 + (0.5 if width % 2 else 0.0), dtype=stored.dtype)
    return cost.count_lookup_fetches(lambda planes: real.visibility(planes, middle, width), stored)


@functools.cache
def counted_neighbours(policy: str = "2-SM max") -> int:
    """Depths that a texel of a multi-depth map reads when it is built, counted on real arrays."""
    return cost.count_build_fetches(lambda depth: real.planes(depth, policy), _map())


def _costs(inputs: Inputs) -> tuple[Fraction, Fraction, Fraction, Fraction]:
    names = (("f",), ("custo_transf", "transform"), ("custo_textura", "texture"), ("custo_ts", "test"))
    f, transform, fetch, test = (inputs.fraction(*name) for name in names)
    return f, transform, fetch, test


def _metered(inputs: Inputs) -> Fraction:
    """A plain filter run on a map, charged for every transform, fetch and test that it makes.

    64 fragments are run and their cost is scaled to f, since every fragment makes the same steps.
    """
    f, transform, fetch, test = _costs(inputs)
    width, spent = kernel_width(inputs.integer("k", default=1)), Fraction(0)
    stored, fragments = np.asarray(_map()), np.random.default_rng(4).random((64, 3))
    for fragment in fragments:
        row, col = (fragment[:2] * (stored.shape[0] - width + 1)).astype(int)
        spent += transform
        lit = 0
        for texel in itertools.product(range(row, row + width), range(col, col + width)):
            depth = stored[texel]
            spent += fetch
            lit += fragment[2] <= depth
            spent += test
    return f * spent / len(fragments)


def _map_cost(inputs: Inputs) -> int:
    return cost.build_fetches(inputs.integer("h"), inputs.integer("w"), inputs.integer("q"))


def _map_cost_counted(inputs: Inputs) -> int | None:
    return counted_neighbours() * inputs.integer("h") * inputs.integer("w") if inputs.integer("q") == 9 else None


def _multi_depth_counted(inputs: Inputs) -> int | None:
    if inputs.integer("q") != 9 or inputs.integer("k") not in (4, 9):
        return None
    taps = counted_taps(inputs.integer("k"), "2-SM max")
    return counted_neighbours() * inputs.integer("h") * inputs.integer("w") + inputs.integer("f") * taps


def _saved_taps(inputs: Inputs) -> int:
    """r, or the difference that a case such as `9->4` names."""
    if "r" in inputs:
        return inputs.integer("r")
    plain, multi = inputs.text("case").split()[0].split("->")
    return int(plain) - int(multi)


def _crossover(inputs: Inputs) -> Fraction:
    return cost.crossover_fragments(inputs.integer("h"), inputs.integer("w"), inputs.integer("q"), _saved_taps(inputs))


def _crossover_searched(inputs: Inputs) -> Fraction:
    """Where two straight lines of cost meet, from their values at two numbers of fragments."""
    h, w, q, taps, saved = *(inputs.integer(name) for name in ("h", "w", "q")), 4, _saved_taps(inputs)
    # Both costs are affine in the fragments, so two values give the zero of their difference.
    gap = [
        cost.multi_depth_fetches(h, w, q, fragments, taps) - cost.lookup_fetches(fragments, taps + saved)
        for fragments in (0, saved)
    ]
    return -Fraction(gap[0]) * saved / Fraction(gap[1] - gap[0])


def _first_cheaper(inputs: Inputs) -> int:
    h, w, q = (inputs.integer(name) for name in ("h", "w", "q"))
    return cost.first_cheaper_fragments(h, w, q, _saved_taps(inputs))


def _first_cheaper_searched(inputs: Inputs) -> int:
    """Bisection on the two costs themselves."""
    h, w, q, r = (*(inputs.integer(name) for name in ("h", "w", "q")), _saved_taps(inputs))
    low, high = 0, h * w * q + 1  # dearer at low, cheaper at high
    while high - low > 1:
        middle = (low + high) // 2
        cheaper = cost.multi_depth_fetches(h, w, q, middle, 4) < cost.lookup_fetches(middle, 4 + r)
        low, high = (low, middle) if cheaper else (middle, high)
    return high


def _size_ratio(inputs: Inputs) -> Fraction:
    return cost.size_ratio_threshold(inputs.integer("q"), _saved_taps(inputs))


def _size_ratio_from_crossover(inputs: Inputs) -> Fraction:
    """Crossover over the texels of a map: each pixel shaded once, so fragments are pixels."""
    h, w = 512, 384
    return cost.crossover_fragments(h, w, inputs.integer("q"), _saved_taps(inputs)) / (h * w)


def _size_ratio_counted(inputs: Inputs) -> Fraction | None:
    """The ratio from counted reads of the package's own maximum policy and filters, where the case is one of them."""
    saved = {taps - fewer: (taps, fewer) for taps, fewer in ((9, 4), (16, 9), (16, 4))}
    if inputs.integer("q") != 9 or _saved_taps(inputs) not in saved:
        return None
    plain, multi = saved[_saved_taps(inputs)]
    return Fraction(counted_neighbours(), counted_taps(plain) - counted_taps(multi, "2-SM max"))


def _wins_at_equal_size(inputs: Inputs) -> bool:
    """Whether the multi-depth map costs less when image and map have one size and each pixel is shaded once."""
    size = 64
    plain = cost.lookup_fetches(size * size, inputs.integer("plain"))
    return cost.multi_depth_fetches(size, size, inputs.integer("q"), size * size, inputs.integer("multi")) < plain


def _nearest_plain_filter(inputs: Inputs) -> int:
    """Taps of the square plain filter whose tones come nearest to those of PCF(k, n)."""
    wanted = tones.predicted_tones(inputs.integer("k"), inputs.integer("n"))
    return min((width * width for width in range(1, 10)), key=lambda k: abs(tones.predicted_tones(k) - wanted))


def _nearest_counted(inputs: Inputs) -> int:
    """The same, from exact counts over windows."""
    wanted = len(tones.exhaustive_tones(inputs.integer("k"), {2: "2-SM max", 3: "3-SM min/max"}[inputs.integer("n")]))
    return min((1, 4, 9, 16), key=lambda k: abs(len(tones.exhaustive_tones(k, "1-SM")) - wanted))


_SCENE = {"f": 1000000, "custo_transf": 1, "custo_textura": 4, "custo_ts": 1}
_MAP = {"h": 512, "w": 512, "q": 9}

EQUATIONS: tuple[Equation, ...] = (
    Equation(
        id="mdsm.Eq5.1",
        source="mdsm, eq. 5.1",
        statement="Cost of a scene with a plain map: f·(transform + fetch + test).",
        verdict="holds",
        closed_form=lambda i: cost.scene_cost(*_costs(i)),
        measured=_metered,
        samples=(_SCENE, {"f": 17, "custo_transf": 0.5, "custo_textura": 2, "custo_ts": 0.25}),
    ),
    Equation(
        id="mdsm.Eq5.2",
        source="mdsm, eq. 5.2",
        statement="Cost of a scene with a filter of k taps: f·(transform + k·(fetch + test)).",
        verdict="holds",
        closed_form=lambda i: cost.scene_cost(*_costs(i), i.integer("k")),
        measured=_metered,
        samples=({**_SCENE, "k": 9}, {**_SCENE, "k": 4}),
    ),
    Equation(
        id="mdsm.Eq5.3",
        source="mdsm, eq. 5.3",
        statement="Fetches of a scene with a filter of k taps: f·k.",
        verdict="holds",
        closed_form=lambda i: cost.lookup_fetches(i.integer("f"), i.integer("k")),
        measured=lambda i: i.integer("f") * counted_taps(i.integer("k")),
        samples=({"f": 471860, "k": 9}, {"f": 1000, "k": 4}, {"f": 1000, "k": 16}),
    ),
    Equation(
        id="mdsm.Eq5.4",
        source="mdsm, eq. 5.4",
        statement="Fetches that build a multi-depth map: h·w·q.",
        verdict="holds",
        closed_form=_map_cost,
        measured=_map_cost_counted,
        samples=(_MAP,),
    ),
    Equation(
        id="mdsm.Eq5.5",
        source="mdsm, eq. 5.5",
        statement="Fetches of a scene with a multi-depth map: h·w·q + f·k.",
        verdict="holds",
        closed_form=lambda i: cost.multi_depth_fetches(
            i.integer("h"), i.integer("w"), i.integer("q"), i.integer("f"), i.integer("k")
        ),
        recomputed=lambda i: i.integer("h") * i.integer("w") * i.integer("q") + i.integer("f") * i.integer("k"),
        measured=_multi_depth_counted,
        samples=({**_MAP, "f": 471860, "k": 4}, {**_MAP, "f": 1000, "k": 9}),
    ),
    Equation(
        id="mdsm.Eq5.6.f_threshold",
        source="mdsm, eq. 5.6",
        statement="The multi-depth map needs fewer fetches above f = q·h·w/r fragments.",
        verdict="holds",
        closed_form=_crossover,
        independent=_crossover_searched,
        samples=({**_MAP, "r": 5}, {**_MAP, "r": 7}, {**_MAP, "r": 12}, {"h": 300, "w": 200, "q": 25, "case": "16->4"}),
    ),
    Equation(
        id="mdsm.Eq5.6.first_integer_f",
        pattern=r"mdsm\.Eq5\.6\.first_(integer_)?f",
        source="mdsm, eq. 5.6",
        statement="First whole number of fragments at which the multi-depth map needs fewer fetches.",
        verdict="holds",
        closed_form=_first_cheaper,
        independent=_first_cheaper_searched,
        samples=({**_MAP, "r": 5}, {"h": 10, "w": 10, "q": 9, "r": 9}),
    ),
    Equation(
        id="mdsm.Eq5.7.q_over_r",
        source="mdsm, eq. 5.7",
        statement="With each pixel shaded once, the multi-depth map is cheaper when image/map area exceeds q/r.",
        verdict="holds",
        closed_form=_size_ratio,
        independent=_size_ratio_from_crossover,
        measured=_size_ratio_counted,
        samples=({"q": 9, "r": 5}, {"q": 9, "r": 7}, {"q": 9, "r": 12}, {"q": 9, "r": 16}),
    ),
    Equation(
        id="mdsm.text.equal_sizes",
        source="mdsm, text after eq. 5.7",
        statement="At equal sizes of image and map the multi-depth map is cheaper exactly if q < r.",
        verdict="erratum",
        closed_form=lambda i: i.integer("q") < i.integer("plain") - i.integer("multi"),
        independent=_wins_at_equal_size,
        correction=Correction(
            printed="at equal sizes (5.7) is never satisfied",
            corrected="it is where q < r: 16 taps replaced by 4 give q/r = 9/12",
            printed_form=lambda i: False,
            counterexample={"q": 9, "plain": 16, "multi": 4},
        ),
        samples=tuple({"q": 9, "plain": plain, "multi": multi} for plain, multi in ((9, 4), (16, 4), (16, 9), (25, 9))),
    ),
    Equation(
        id="mdsm.text.fig5.4",
        source="mdsm, section 5.1 and caption of figure 5.4",
        statement="The plain filter whose tones are nearest to those of 2-SM with 9 taps has 16 taps.",
        verdict="erratum",
        closed_form=_nearest_plain_filter,
        independent=_nearest_counted,
        correction=Correction(
            printed="section 5.1 compares it with a plain filter of 4 taps",
            corrected="the caption's 16 taps (17 tones against 19; 4 taps give 5)",
            printed_form=lambda i: 4,
            counterexample={"k": 9, "n": 2},
        ),
        samples=({"k": 9, "n": 2}, {"k": 4, "n": 2}),
    ),
)
