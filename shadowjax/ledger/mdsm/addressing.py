"""Multi-depth source, section 4.6: texture addressing, the printed programs and the convention of their result."""

import math
from collections.abc import Callable
from fractions import Fraction

import jax.numpy as jnp
import numpy as np

from shadowjax.filters import multi_depth
from shadowjax.ledger.equation import Correction, Equation, Inputs, Unavailable
from shadowjax.ledger.mdsm import measured as real
from shadowjax.maps.sampling import texel_index
from shadowjax.theory.windows import lit_numerators

GRID = 2**20  # positions of the sampled fraction; spaced evenly, in the middle of their cells


def _scale(size: int, rule: str) -> int:
    """Texture coordinate of the right border under (4.4); integer division loses one where the size is even."""
    return 2 * ((size - 1) // 2) if rule == "integer division" else size - 1


def _rule(inputs: Inputs) -> str:
    """How coordinates become texels, from a label such as `round` or `floor, C integer division ...`."""
    for rule in ("integer division", "round", "floor"):
        if rule in inputs.label:
            return rule
    raise Unavailable(f"no addressing rule in the label {inputs.label!r}; known: round, floor, integer division")


def _sampled_misaddress(inputs: Inputs) -> float:
    """Share of evenly spaced positions that (4.4) takes to another texel than the one that they lie in."""
    size, rule = inputs.integer("D"), _rule(inputs)
    twice = 2 * np.arange(GRID, dtype=np.int64) + 1  # position is twice / (2·GRID), so all is exact integers
    # Rounding is the floor of half a texel more, in the same exact integers.
    half = GRID if rule == "round" else 0
    addressed = (_scale(size, rule) * twice + half) // (2 * GRID)
    return float(np.mean(addressed != size * twice // (2 * GRID)))


def _exact_misaddress(inputs: Inputs) -> Fraction:
    """Length of the positions where the two step functions differ, summed between their exact breakpoints."""
    size, rule = inputs.integer("D"), _rule(inputs)
    scale, half = _scale(size, rule), Fraction(1, 2) if rule == "round" else Fraction(0)
    right = Fraction(0)
    for texel in range(size):
        # Where both step functions give this texel: the overlap of its own interval with that of (4.4).
        low = max(Fraction(texel, size), (texel - half) / scale)
        high = min(Fraction(texel + 1, size), (texel + 1 - half) / scale)
        right += max(high - low, Fraction(0))
    return 1 - right


def _round_fraction(inputs: Inputs) -> Fraction:
    """⌊(D−1)²/2⌋ / (2D(D−1)): breakpoint i is off by |D − 2i| / (2D(D−1))."""
    size = inputs.integer("D")
    return Fraction((size - 1) ** 2 // 2, 2 * size * (size - 1))


def _wrong_centres(rule: str) -> Callable[[Inputs], int]:
    """Count of texel centres that (4.4) takes to another texel, one by one in exact arithmetic."""

    def count(inputs: Inputs) -> int:
        size = inputs.integer("D")
        half = Fraction(1, 2) if rule == "round" else Fraction(0)
        centres = (Fraction(2 * texel + 1, 2 * size) for texel in range(size))
        addressed = (math.floor(centre * _scale(size, rule) + half) for centre in centres)
        return sum(found != texel for texel, found in enumerate(addressed))

    return count


def _wrong_centres_measured(rule: str) -> Callable[[Inputs], int]:
    """The same count through the package's own texel addressing, at coordinates from (4.4)."""

    def count(inputs: Inputs) -> int:
        size = inputs.integer("D")
        centre = (np.arange(size) + 0.5) / size
        coordinate = centre * _scale(size, rule) + (0.5 if rule == "round" else 0.0)
        found = np.asarray(texel_index(jnp.asarray(coordinate)))
        return int(np.count_nonzero(found != np.arange(size)))

    return count


def _integer_division_centres(inputs: Inputs) -> int:
    """D − ⌊D/4 + ½⌋ for even D: centre i lands at i + ½ − (2i+1)/D, right while 2(2i+1) ≤ D; odd D loses nothing."""
    size = inputs.integer("D")
    return size - (size + 2) // 4 if size % 2 == 0 else size // 2


def _rect_coordinate(inputs: Inputs) -> float:
    size = inputs.integer("D")
    return inputs.number("x_ndc") * size / 2 + size / 2


def _literal_coordinate(inputs: Inputs) -> float:
    size = inputs.integer("D")
    return inputs.number("x_ndc") * (size - 1) / 2 + (size - 1) / 2


def _literal_by_interpolation(inputs: Inputs) -> float:
    """The line through the ends that the text states: −1 to 0 and 1 to D − 1."""
    return float(np.interp(inputs.number("x_ndc"), [-1.0, 1.0], [0.0, inputs.integer("D") - 1.0]))


def _printed_attenuation(num_lit: int = 18) -> np.float32:
    """The printed program in float32: per-register sums of the constant 0.0555555, then the sum of five registers."""
    constant = np.float32(0.0555555)
    results = np.where(np.arange(18) < num_lit, constant, np.float32(0)).astype(np.float32)
    total = np.float32(0)
    # Four results a register, each register summed on its own, then the five sums.
    for start in range(0, 18, 4):
        register = np.float32(0)
        for value in results[start : start + 4]:
            register = np.float32(register + value)
        total = np.float32(total + register)
    return total


def _running_attenuation() -> np.float32:
    """Eighteen additions one after another, in float32."""
    return np.cumsum(np.full(18, np.float32(0.0555555)), dtype=np.float32)[-1]


def _lit_share(inputs: Inputs) -> float:
    """1 − mean of s/n over the taps, from counts of shadowed depths."""
    if "shadowed" not in inputs:
        raise Unavailable("a statement in words; verify checks what it says on arrays")
    shadowed, n = inputs["shadowed"], inputs.integer("n")
    return 1 - sum(shadowed) / (n * len(shadowed))


def _lit_share_measured(inputs: Inputs) -> float:
    """1 − mean attenuation of the package's composite test over taps with given counts of shadowing depths."""
    shadowed, n = np.array(inputs["shadowed"]), inputs.integer("n")
    stored = real.depths(np.arange(n)[:, None] >= shadowed)
    return float(np.mean(1 - np.asarray(real.attenuation(stored))))


def _printed_program(inputs: Inputs) -> float:
    """What the printed program adds up for these taps: its constant for each depth behind the receiver."""
    lit = inputs.integer("n") * len(inputs["shadowed"]) - sum(inputs["shadowed"])
    return float(_printed_attenuation(lit))


def _lone_hole(inputs: Inputs, include_centre: bool) -> float:
    """Second depth of a texel deeper than all its neighbours, by the package's maximum policy."""
    depth = np.full((5, 5), inputs.number("around"))
    depth[2, 2] = inputs.number("own")
    return float(real.planes(jnp.asarray(depth), "2-SM max", include_centre)[1, 2, 2])


def _extent_measured(inputs: Inputs) -> int:
    """Least coordinate, in half texels, that the package's addressing takes beyond the last of D texels."""
    halves = np.arange(4 * inputs.integer("D")) / 2
    index = np.asarray(texel_index(jnp.asarray(halves)))
    return round(float(halves[index >= inputs.integer("D")].min()))


def _own_depth(inputs: Inputs, plane: int) -> float:
    """What a plane of the package's two-depth maps holds where a texel lies before its neighbours."""
    depth = np.full((3, 3), inputs.number("around"))
    depth[1, 1] = inputs.number("depth")
    return float(real.planes(jnp.asarray(depth), "2-SM max")[plane, 1, 1])


def _ring_walked(i: Inputs) -> list[tuple[int, int]]:
    """Every n-th cell of a walk round the ring, from each start; the first walk whose cells add up to least."""
    r, count = i.integer("radius"), i.integer("n") - 1
    top, right = [(-r, c) for c in range(r)], [(row, r) for row in range(-r, r)]
    half = [*top, *right, *((r, c) for c in range(r, 0, -1))]
    cells = [*half, *((-row, -c) for row, c in half)]

    def walk(start: int) -> list[tuple[int, int]]:
        return [cells[(start + k * len(cells) // count) % len(cells)] for k in range(count)]

    return min((walk(start) for start in range(len(cells))), key=lambda w: np.sum(np.square(np.sum(w, axis=0))))


def _policy_read(policy: multi_depth.DepthPolicy) -> list[float]:
    """Number, middle, spread and reach of the offsets that a policy reads from, seen on a map of places."""
    size = 17
    places = np.arange(size * size, dtype=float).reshape(size, size)
    read = np.asarray(policy.planes(jnp.asarray(places)))[:, size // 2, size // 2]
    offsets = np.stack(np.divmod(read, size), axis=-1) - size // 2
    middle = offsets.mean(axis=0)
    return [len(read), *middle.tolist(), float(np.abs(offsets - middle).max()), float(np.abs(offsets).max())]


def _policy(i: Inputs) -> multi_depth.DepthPolicy:
    if "n" in i:
        return multi_depth.Ring(i.integer("n"), i.integer("radius"))
    return multi_depth.FixedNeighbour((i.integer("row"), i.integer("col")))


def _policy_said(i: Inputs) -> list[float]:
    policy = _policy(i)
    return [policy.num_depths, *policy.centroid, policy.spread, policy.radius]


_RINGS = tuple({"n": n, "radius": r} for n, r in ((2, 1), (4, 1), (6, 1), (8, 1), (9, 1), (6, 2), (12, 2), (8, 3)))
_SIZES = ({"D": 512}, {"D": 256}, {"D": 100}, {"D": 37})
_LIT_TAPS = {"n": 2, "shadowed": [2, 1, 0, 0, 2, 1, 0, 0, 1]}

EQUATIONS: tuple[Equation, ...] = (
    Equation(
        id="mdsm.ring.offsets",
        source="mdsm, section 4.5.4",
        statement="Offsets of an n-SM's extra samples, evenly round a square ring and turned to lie about the texel.",
        verdict="holds",
        closed_form=lambda i: multi_depth.ring_offsets(i.integer("n"), i.integer("radius")),
        independent=_ring_walked,
        samples=_RINGS,
    ),
    Equation(
        id="mdsm.policy.offsets",
        source="mdsm, sections 4.5.2 and 4.5.4",
        statement="Number, middle, spread and reach of the depths that a policy reads.",
        verdict="holds",
        closed_form=_policy_said,
        measured=lambda i: _policy_read(_policy(i)),
        measured_tolerance=1e-6,
        samples=(*_RINGS, {"n": 1, "radius": 1}, {"row": 2, "col": -1}, {"row": 0, "col": 3}),
    ),
    Equation(
        id="mdsm.Eq4.3.x",
        source="mdsm, eq. 4.3",
        statement="x/2 + ½ takes normalised device coordinates to [0, 1].",
        verdict="holds",
        closed_form=lambda i: i.number("x_ndc") / 2 + 0.5,
        independent=lambda i: float(np.interp(i.number("x_ndc"), [-1.0, 1.0], [0.0, 1.0])),
        samples=tuple({"x_ndc": x} for x in (-1, -0.5, 0, 0.3, 1)),
    ),
    Equation(
        id="mdsm.Eq4.4.x",
        source="mdsm, eq. 4.4",
        statement="Texture coordinate x·(D−1)/2 + (D−1)/2; its literal value.",
        verdict="erratum",
        closed_form=_literal_coordinate,
        independent=_literal_by_interpolation,
        correction=Correction(
            printed="coordinates of a texture of D texels span [0, D − 1], so x·(D−1)/2 + (D−1)/2",
            corrected="they span [0, D] with centres at i + ½, so x·D/2 + D/2",
            printed_form=_literal_coordinate,
            corrected_form=_rect_coordinate,
            counterexample={"x_ndc": 1, "D": 512},
        ),
        samples=tuple({"x_ndc": x, "D": size} for x in (-1, 0, 0.3, 1) for size in (512, 100)),
    ),
    Equation(
        id="mdsm.Eq4.4.misaddress_fraction",
        source="mdsm, eq. 4.4",
        statement="Share of positions that (4.4) takes to a wrong texel, over 2²⁰ evenly spaced positions.",
        verdict="erratum",
        closed_form=_sampled_misaddress,
        independent=_exact_misaddress,
        tolerance=1e-5,  # two positions a breakpoint over 2²⁰ positions and D breakpoints, D ≪ 2²⁰
        correction=Correction(
            printed="(4.4) addresses the texel that a position lies in",
            corrected="with floor half of all positions miss their texel, with rounding about a quarter",
            printed_form=lambda i: 0.0,
            counterexample={"D": 512},
            label="floor",
        ),
        samples=tuple(({"D": 512}, rule) for rule in ("round", "floor", "floor, C integer division")),
    ),
    Equation(
        id="mdsm.Eq4.4.round_fraction_exact",
        source="mdsm, eq. 4.4",
        statement="Exact share of positions that (4.4) misaddresses with rounding.",
        verdict="holds",
        closed_form=_round_fraction,
        independent=lambda i: _exact_misaddress(Inputs(i, "round")),
        samples=_SIZES,
    ),
    *(
        Equation(
            id=f"mdsm.Eq4.4.texel_centres_wrong_{name}",
            source=source,
            statement=statement,
            verdict="holds",
            closed_form=closed_form,
            independent=_wrong_centres(rule),
            measured=_wrong_centres_measured(rule),
            samples=_SIZES,
        )
        for name, rule, source, statement, closed_form in (
            (
                "floor",
                "floor",
                "mdsm, eq. 4.4",
                "With floor, (4.4) shifts the upper half of all texel centres by one.",
                lambda i: i.integer("D") // 2,
            ),
            (
                "round",
                "round",
                "mdsm, eq. 4.4",
                "With rounding, (4.4) takes every texel centre to its own texel.",
                lambda i: 0,
            ),
            (
                "intdiv",
                "integer division",
                "mdsm, figure 4.18",
                "With (D−1)/2 in integers and floor, three quarters of the texel centres are wrong for even D.",
                _integer_division_centres,
            ),
        )
    ),
    Equation(
        id="mdsm.fig4.18.extent",
        source="mdsm, figure 4.18",
        statement="Largest texture coordinate of the matrix in the figure.",
        verdict="erratum",
        closed_form=lambda i: round(_rect_coordinate(Inputs({"x_ndc": 1, "D": i["D"]}))),
        measured=_extent_measured,
        correction=Correction(
            printed="the matrix scales and shifts by (D−1)/2, written in integers: [0, 510] for D = 512",
            corrected="scale and shift by D/2: [0, D]",
            printed_form=lambda i: 2 * ((i.integer("D") - 1) // 2),
            counterexample={"D": 512},
        ),
        samples=({"D": 512}, {"D": 100}),
    ),
    Equation(
        id="mdsm.fig4.13.channel",
        source="mdsm, figures 4.13 and 4.16",
        statement="A pass that reads a texel's own depth reads the channel, here the plane, that it was written to.",
        verdict="erratum",
        closed_form=lambda i: i.number("depth"),
        measured=lambda i: _own_depth(i, plane=0),
        measured_tolerance=1e-6,
        correction=Correction(
            printed="figure 4.13 writes the depth to channel x, figure 4.16 reads channel z",
            corrected="one channel for both",
            printed_form=lambda i: _own_depth(i, plane=1),
            counterexample={"depth": 0.7, "around": 0.9},
        ),
        samples=({"depth": 0.7, "around": 0.9}, {"depth": 3.25, "around": 4.0}),
    ),
    Equation(
        id="mdsm.fig4.16.neighbour",
        source="mdsm, figure 4.16",
        statement="The largest neighbour of a texel that is deeper than all its neighbours is one of them.",
        verdict="erratum",
        closed_form=lambda i: i.number("around"),
        measured=lambda i: _lone_hole(i, include_centre=False),
        measured_tolerance=1e-6,
        correction=Correction(
            printed="the loop over the neighbourhood visits the centre too, so it returns the texel's own depth",
            corrected="leave the centre out, or call it the neighbourhood's maximum",
            printed_form=lambda i: _lone_hole(i, include_centre=True),
            counterexample={"own": 5.0, "around": 2.0},
        ),
        samples=({"own": 5.0, "around": 2.0},),
    ),
    Equation(
        id="mdsm.fig4.19.att_all_lit_float32",
        source="mdsm, figure 4.19",
        statement="The figure's sum of 18 lit tests in float32, which falls short of 1.",
        verdict="erratum",
        closed_form=lambda i: float(_printed_attenuation()),
        independent=lambda i: 18 * 0.0555555,
        tolerance=2e-7,  # 17 roundings of float32 at most, far fewer in the registers' order
        correction=Correction(
            printed="18 additions of 0.0555555 give 1 where all is lit",
            corrected="0.999999 in exact arithmetic; count the lit tests and divide once",
            printed_form=lambda i: float(_printed_attenuation()),
            corrected_form=lambda i: lit_numerators(np.ones((5, 5), bool), "2-SM max") / 18,
        ),
        samples=({},),
    ),
    Equation(
        id="mdsm.convention",
        source="mdsm, section 4.2 and figure 4.19",
        statement="Visibility is 1 − the mean of s/n over the taps; s counts the depths that shadow the receiver.",
        verdict="erratum",
        closed_form=_lit_share,
        measured=_lit_share_measured,
        measured_tolerance=1e-6,
        correction=Correction(
            printed="s/n is 0 where lit and 1 in shadow (4.2), and the figure's att is called the same attenuation",
            corrected="the figure adds 1/18 for each depth behind the receiver: att is the lit share, 1 − mean s/n",
            printed_form=_printed_program,
            corrected_form=lambda i: 1 - _lit_share(i),
            counterexample=_LIT_TAPS,
        ),
        samples=(_LIT_TAPS, {"n": 2, "shadowed": [0] * 9}, {"n": 3, "shadowed": [3, 2, 1, 0]}),
    ),
)
