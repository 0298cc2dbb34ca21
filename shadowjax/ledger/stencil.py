"""Ledger of the stencil source: adjacent edges of figures 3 and 4, counting rules of the stencil, its tables."""

import functools
from collections import Counter
from collections.abc import Mapping
from fractions import Fraction
from typing import Any

import numpy as np

from shadowjax.geometry.adjacent_edges import AdjacentEdges, find_adjacent_edges
from shadowjax.ledger import volume_counts
from shadowjax.ledger.equation import Correction, Equation, Inputs, Unavailable
from shadowjax.ledger.inputs import Estimate
from shadowjax.ledger.volume_counts import Rule

# Polygons of figure 4. D and E are not legible in the source; these are the only ones that give its table.
_FIGURE_4 = {
    "A": [0, 1, 8, 3], "B": [3, 8, 10, 7], "C": [1, 4, 5, 11, 8], "D": [1, 2, 9, 6, 4], "E": [5, 6, 9, 11],
}  # fmt: skip
# Milliseconds a frame, scenes A to D, of tables 2 (with) and 3 (without 3-D acceleration).
_ACCELERATED = {
    "rendering": ("0.92", "1.12", "37.48", "52.08"), "generation": ("0.86", "0.36", "3.54", "6.56"),
    "capping": ("0.18", "0.08", "0.64", "1.42"),
}  # fmt: skip
_EMULATED = {
    "rendering": ("55.34", "99.14", "611.26", "1001.5"), "generation": ("1.26", "0.54", "4.98", "9.28"),
    "capping": ("0.32", "0.12", "0.96", "1.88"),
}  # fmt: skip
_SCENES = "ABCD"
_TOTALS = {  # as printed: all steps together
    "accelerated": ("1.96", "1.56", "41.66", "60.06"), "emulated": ("56.92", "99.8", "617.2", "1012.66"),
}  # fmt: skip
_SOUP_VERTICES, _SOUP_TRIANGLES, _SOUP_SEED = 6, 8, 5


def _polygons(inputs: Mapping[str, Any]) -> list[list[int]]:
    chosen = {name: value for name, value in inputs.items() if isinstance(value, list | tuple)} or _FIGURE_4
    return [[int(vertex) for vertex in chosen[name]] for name in sorted(chosen)]


def _walked(inputs: Inputs) -> list[tuple[int, int]]:
    """Every side as its polygon walks it, in order."""
    return [(i, j) for polygon in _polygons(inputs) for i, j in zip(polygon, polygon[1:] + polygon[:1], strict=True)]


def _found(inputs: Inputs) -> AdjacentEdges:
    return find_adjacent_edges(_polygons(inputs))


def _listed(edges: AdjacentEdges, visible: bool) -> list[list[int]]:
    """Entries as [i, j] in the order of the table: by list, then by place in it."""
    lists = edges.lists()
    return [[i, j] for i in sorted(lists) for j, shown in lists[i] if shown == visible]


def _unshared(inputs: Inputs) -> list[list[int]]:
    """Sides that no polygon walks the other way, by list and place in it."""
    walked = _walked(inputs)
    external = [side for side in walked if side[::-1] not in walked]
    return [list(side) for side in sorted(external, key=lambda side: (side[0], walked.index(side)))]


def _counts(inputs: Inputs) -> list[int]:
    """All sides, visible entries, invisible entries; each of the last stands for two sides."""
    edges = _found(inputs)
    return [sum(map(len, _polygons(inputs))), len(edges.external), len(edges.internal)]


def _counts_from_edges(inputs: Inputs) -> list[int]:
    """The same from how many sides each edge has, whichever way they run."""
    uses = Counter(frozenset(side) for side in _walked(inputs))
    alone, shared = (sum(count == number for count in uses.values()) for number in (1, 2))
    return [alone + 2 * shared, alone, shared]


def _loops(inputs: Inputs) -> list[list[int]]:
    """Closed walks along the visible entries, each from its smallest vertex."""
    following: dict[int, list[int]] = {}
    for i, j in _listed(_found(inputs), visible=True):
        following.setdefault(i, []).append(j)
    loops = []
    for start in sorted(following):
        loop, at = [], start
        while following.get(at):
            loop.append(at)
            at = following[at].pop(0)
        if loop:
            loops.append(loop)
    return loops


def _loops_from_boundary(inputs: Inputs) -> list[list[int]]:
    """The same from sets: a side is external iff no polygon walks it the other way."""
    sides = set(_walked(inputs))
    following = {i: j for i, j in sides if (j, i) not in sides}
    loops: list[list[int]] = []
    while following:
        loop = [min(following)]
        while (after := following.pop(loop[-1])) != loop[0]:
            loop.append(after)
        loops.append(loop)
    return loops


def _marked_from_sides(inputs: Inputs) -> list[list[int]]:
    """The first-walked direction of every side that two polygons share, by list and place in it."""
    walked = _walked(inputs)
    first = [(i, j) for at, (i, j) in enumerate(walked) if (j, i) in walked[at + 1 :]]
    return [list(side) for side in sorted(first, key=lambda side: (side[0], walked.index(side)))]


@functools.cache
def _soups(trials: int) -> tuple[list[list[int]], ...]:
    """Random triangles over few vertices: edges with any number of sides, walked either way."""
    generator = np.random.default_rng(_SOUP_SEED)
    drawn = generator.random((trials, _SOUP_TRIANGLES, _SOUP_VERTICES)).argsort(axis=-1)[..., :3].tolist()
    sizes = generator.integers(1, _SOUP_TRIANGLES + 1, trials)
    return tuple(soup[:size] for soup, size in zip(drawn, sizes, strict=True))


def _sides(triangles: list[list[int]]) -> list[tuple[int, int]]:
    return [(i, j) for a, b, c in triangles for i, j in ((a, b), (b, c), (c, a))]


def _boundary(sides: list[tuple[int, int]]) -> Counter[tuple[int, int]]:
    """The surplus of each side over the same side walked the other way."""
    walked = Counter(sides)
    return Counter(
        {side: surplus for side, count in walked.items() if (surplus := count - walked[side[1], side[0]]) > 0}
    )


def _left_visible(sides: list[tuple[int, int]], rule: str) -> Counter[tuple[int, int]]:
    """What figure 3's walk leaves: `delete` an entry that matches, `mark` it, or mark only one that is `visible`."""
    lists: dict[int, list[list[Any]]] = {}
    for i, j in sides:
        entries = lists.setdefault(j, [])
        match = next((one for one in entries if one[0] == i and (one[1] or rule == "mark")), None)
        if match is None:
            lists.setdefault(i, []).append([j, True])
        elif rule == "delete":
            entries.remove(match)
        else:
            match[1] = False
    return Counter((i, j) for i, entries in lists.items() for j, visible in entries if visible)


def _walk_share(inputs: Inputs, rule: str) -> Estimate:
    """Share of random soups in which a walk does not leave the boundary."""
    soups = [_sides(soup) for soup in _soups(inputs.integer("trials"))]
    return Estimate(sum(_left_visible(sides, rule) != _boundary(sides) for sides in soups), len(soups))


def _repeated_share(inputs: Inputs) -> Estimate:
    """Share of soups in which some edge is met twice or more against the sense in which it was met first.

    The first such side marks the edge's first entry; later ones mark it again, so one entry too many stays visible.
    """

    def wrong(sides: list[tuple[int, int]]) -> bool:
        first: set[tuple[int, int]] = set()
        against: Counter[tuple[int, int]] = Counter()
        for side in sides:
            if side[::-1] in first:
                against[side] += 1
            else:
                first.add(side)
        return max(against.values(), default=0) > 1

    soups = _soups(inputs.integer("trials"))
    return Estimate(sum(wrong(_sides(soup)) for soup in soups), len(soups))


def _found_share(inputs: Inputs) -> Fraction:
    """Share of the same soups in which the package's walk does not leave the boundary."""
    soups = _soups(inputs.integer("trials"))
    wrong = 0
    for soup in soups:
        external = Counter((int(i), int(j)) for i, j in find_adjacent_edges(soup).external)
        wrong += external != _boundary(_sides(soup))
    return Fraction(wrong, len(soups))


def _rule(inputs: Inputs) -> Rule:
    """Counting rule from a label such as `I inward: cap INCREMENT first, saturating8`.

    Caps that are not said to come first come last, as the source draws them.
    """
    label = inputs.label
    arithmetic = next((name for name in ("wrap8", "saturating8", "1-bit parity") if name in label), "")
    inward = "inward" in label
    if not arithmetic or not (inward or "outward" in label):
        raise Unavailable(f"no counting rule in the label {label!r}")
    cap = 0 if "no cap" in label else 1 if "cap INCREMENT" in label else -1
    order = "mixed" if "any order" in label else "cap first" if "first" in label else "cap last"
    return Rule(inward, cap, arithmetic, order)


def _share(inputs: Inputs) -> Fraction:
    """Share of random configurations that a rule decides rightly: all, if it counts the volumes around the receiver."""
    rule = _rule(inputs)
    return (
        Fraction(1) if rule.counts_volumes else Estimate(volume_counts.right_by_counts(inputs.integer("trials"), rule))
    )


def _share_drawn(inputs: Inputs, num_orders: int = 1) -> Fraction:
    return volume_counts.right_by_drawing(inputs.integer("trials"), _rule(inputs), num_orders)


def _balance(inputs: Inputs) -> Fraction:
    """Share of volumes with (eye inside) + entered − left = (receiver inside)."""
    found = volume_counts.crossings(inputs.integer("trials"))
    counted = found.eye_inside.astype(int) + found.entered - found.left
    return Fraction(int(np.sum(counted == found.receiver_inside)), counted.size)


def _ratios(inputs: Inputs) -> list[Fraction]:
    at = _scene(inputs)
    return [Fraction(_EMULATED[step][at]) / Fraction(_ACCELERATED[step][at]) for step in _ACCELERATED]


def _ratios_from_totals(inputs: Inputs) -> list[Fraction]:
    """Each step's time as what the printed total leaves next to the other two, in both tables."""
    at = _scene(inputs)

    def left(table: Mapping[str, tuple[str, ...]], total: str, step: str) -> Fraction:
        return Fraction(total) - sum(Fraction(times[at]) for name, times in table.items() if name != step)

    emulated, accelerated = _TOTALS["emulated"][at], _TOTALS["accelerated"][at]
    return [left(_EMULATED, emulated, step) / left(_ACCELERATED, accelerated, step) for step in _ACCELERATED]


def _scene(inputs: Inputs) -> int:
    name = inputs.text("scene", inputs.label)
    if len(name) != 1 or name not in _SCENES:
        raise Unavailable(f"no scene {name!r} in the tables; known: A, B, C, D")
    return _SCENES.index(name)


def _hz(inputs: Inputs) -> float:
    return 1000 / inputs.number("total_ms")


def _hz_from_steps(table: Mapping[str, tuple[str, ...]]) -> Any:
    """Frames a second from the steps' milliseconds, added up."""
    return lambda i: float(1000 / sum(Fraction(times[_scene(i)]) for times in table.values()))


_RIGHT = "I inward: cap INCREMENT first, saturating8"
_PARITY = "I inward: cap INCREMENT first, 1-bit parity"
_PRINTED = "I inward: cap DECREMENT, saturating8"
_TRIALS = {"trials": 4000}
_POLYGONS = (_FIGURE_4, {"A": [0, 1, 2], "B": [2, 1, 3]})

EQUATIONS: tuple[Equation, ...] = (
    Equation(
        id="stencil.fig4.invisible_entries",
        source="stencil, figures 3 and 4",
        statement="List entries that mark sides shared by two polygons.",
        verdict="conditional",
        condition="Consistently wound polygons; only entries still visible may match.",
        closed_form=lambda i: _listed(_found(i), visible=False),
        independent=_marked_from_sides,
        samples=_POLYGONS,
    ),
    Equation(
        id="stencil.fig4.external_edges",
        source="stencil, figure 4",
        statement="List entries that stay visible: the sides of one polygon alone.",
        verdict="holds",
        closed_form=lambda i: _listed(_found(i), visible=True),
        independent=_unshared,
        samples=({}, _POLYGONS[1]),
    ),
    Equation(
        id="stencil.fig4.counts",
        source="stencil, figure 4",
        statement="Sides of all polygons, visible entries and invisible ones: 22 = 12 + 2 · 5.",
        verdict="holds",
        closed_form=_counts,
        independent=_counts_from_edges,
        samples=({}, _POLYGONS[1]),
    ),
    Equation(
        id="stencil.fig4.loops",
        source="stencil, figure 4",
        statement="External sides close to an outer silhouette and a hole.",
        verdict="holds",
        closed_form=_loops,
        independent=_loops_from_boundary,
        samples=({}, {"A": [0, 1, 2], "B": [2, 1, 3]}),
    ),
    Equation(
        id="stencil.fig3.delete",
        source="stencil, figure 3",
        statement="Share of random triangle soups in which deleting entries, or marking visible ones, leaves another "
        "set than the boundary.",
        verdict="holds",
        closed_form=lambda i: 0,
        independent=_found_share,
        measured=lambda i: _walk_share(i, "delete") + _walk_share(i, "visible"),
        samples=({"trials": 3000},),
    ),
    Equation(
        id="stencil.fig3.mark_vs_delete_nonmanifold",
        source="stencil, figures 3 and 4 and section 5",
        statement="Share of random triangle soups in which marking entries, as the text does, leaves another set than "
        "deleting them, as figure 3 does, if marked entries match again.",
        verdict="erratum",
        closed_form=_repeated_share,
        measured=lambda i: _walk_share(i, "mark"),
        correction=Correction(
            printed="an entry that matches is marked invisible (text), or deleted (figure 3), as if it were the same",
            corrected="it is the same only if entries already marked match no more; else edges of four and more sides "
            "go wrong",
            printed_form=lambda i: _walk_share(i, "delete"),
            counterexample={"trials": 3000},
        ),
        samples=({"trials": 3000},),
    ),
    Equation(
        id="stencil.stencil",
        source="stencil, sections 4.1 and 7",
        statement="Share of configurations in which a counting rule finds the right shadow.",
        verdict="erratum",
        closed_form=_share,
        measured=_share_drawn,
        correction=Correction(
            printed="normals point into the shadow, not-facing sides increment, and the cap decrements",
            corrected="with these normals the cap increments, first of all where counters saturate; it decrements with "
            "outward normals and wrapping counts",
            printed_form=lambda i: _share_drawn(Inputs(i, _PRINTED)),
            counterexample=_TRIALS,
            label=_RIGHT,
        ),
        samples=tuple(
            (_TRIALS, label)
            for label in (
                _RIGHT,
                "I inward: cap INCREMENT first, wrap8",
                "I inward: cap INCREMENT (after DEC), saturating8",
                "I inward: cap INCREMENT (after DEC), wrap8",
                "I inward: cap INCREMENT, any order, wrap8",
                _PRINTED,
                "I inward: no cap, saturating8",
                "I inward: cap DECREMENT, 1-bit parity",
                "II outward: INC exiting, DEC entering, cap DECREMENT, wrap8",
                "II outward: INC exiting, DEC entering, cap DECREMENT, saturating8",
                "II outward: INC exiting, DEC entering, cap DECREMENT first, saturating8",
                "II outward: no cap, wrap8",
            )
        ),
    ),
    Equation(
        id="stencil.any_order",
        source="stencil, section 4.1",
        statement="Share of configurations that saturating counters decide rightly if fragments come in any order.",
        verdict="conditional",
        condition="Counters that saturate need every increment before the first decrement; wrapping ones do not.",
        closed_form=_share,
        measured=lambda i: _share_drawn(i, num_orders=50),
        measured_tolerance=3e-3,  # 3 standard errors of 200 000 draws, a third of them left to chance
        samples=tuple(
            (_TRIALS, f"{case}, any order, saturating8")
            for case in ("I inward: cap INCREMENT", "I inward: no cap", "II outward: cap DECREMENT")
        ),
    ),
    Equation(
        id="stencil.identity",
        source="stencil, section 7",
        statement="Share of volumes with (eye inside) + walls entered − walls left = (receiver inside).",
        verdict="holds",
        closed_form=lambda i: 1,
        measured=_balance,
        samples=(_TRIALS,),
    ),
    Equation(
        id="stencil.text.one_bit",
        source="stencil, section 8",
        statement="Share of configurations that an 8-bit stencil decides rightly; one bit finds parity only.",
        verdict="erratum",
        closed_form=lambda i: Fraction(1),
        measured=lambda i: _share_drawn(Inputs(i, _RIGHT)),
        correction=Correction(
            printed="a stencil of one bit serves where there is no 3-D acceleration",
            corrected="parity is wrong wherever an even number of volumes is nested",
            printed_form=lambda i: _share_drawn(Inputs(i, _PARITY)),
            counterexample=_TRIALS,
        ),
        samples=(_TRIALS,),
    ),
    *(
        Equation(
            id=f"stencil.Tab{table}.Hz",
            source=f"stencil, table {table}",
            statement="Frames a second are 1000 over the total of the steps in milliseconds.",
            verdict="holds",
            closed_form=_hz,
            independent=_hz_from_steps(steps),
            samples=tuple(({"total_ms": total}, scene) for scene, total in zip(_SCENES, totals, strict=True)),
        )
        for table, steps, totals in (
            (2, _ACCELERATED, (1.96, 1.56, 41.66, 60.06)),
            (3, _EMULATED, (56.92, 99.8, 617.2, 1012.66)),
        )
    ),
    Equation(
        id="stencil.Tab23.ratio",
        source="stencil, tables 2 and 3",
        statement="How many times longer rendering, generation and capping take without 3-D acceleration.",
        verdict="holds",
        closed_form=_ratios,
        independent=_ratios_from_totals,
        samples=tuple(({}, scene) for scene in _SCENES),
    ),
    Equation(
        id="stencil.text.sixty_times",
        source="stencil, section 9",
        statement="Largest ratio of rendering times without and with acceleration.",
        verdict="erratum",
        closed_form=lambda i: max(_ratios(Inputs({}, scene))[0] for scene in _SCENES),
        independent=lambda i: max(_ratios_from_totals(Inputs({}, scene))[0] for scene in _SCENES),
        correction=Correction(
            printed="rendering takes up to 60 times longer",
            corrected="60 times in scene A, 88.5 times in scene B",
            printed_form=lambda i: 60,
        ),
        samples=({},),
    ),
)
