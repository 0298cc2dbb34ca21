"""Ledger of the stencil source: adjacent edges of figures 3 and 4, counting rules of the stencil, its tables."""

from collections.abc import Mapping
from fractions import Fraction
from typing import Any

from shadowjax.analysis.equations import Correction, Equation, Inputs, Unavailable
from shadowjax.analysis.ledger import _volumes

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


def _polygons(inputs: Mapping[str, Any]) -> list[list[int]]:
    chosen = {name: value for name, value in inputs.items() if isinstance(value, list | tuple)} or _FIGURE_4
    return [[int(vertex) for vertex in chosen[name]] for name in sorted(chosen)]


def edge_lists(polygons: list[list[int]]) -> tuple[dict[int, list[int]], list[list[int]]]:
    """The lists of figure 3 with marking instead of deletion: visible entries a list, and the marked [i, j] pairs.

    Only entries that are still visible match a side, as non-manifold input needs. Source: stencil, figures 3 and 4.
    """
    lists: dict[int, list[int]] = {vertex: [] for polygon in polygons for vertex in polygon}
    hidden: dict[int, list[int]] = {vertex: [] for vertex in lists}
    entries: dict[int, list[int]] = {vertex: [] for vertex in lists}
    for polygon in polygons:
        for i, j in zip(polygon, [*polygon[1:], polygon[0]], strict=True):
            if i in lists[j]:
                lists[j].remove(i)
                hidden[j].append(i)
            else:
                lists[i].append(j)
                entries[i].append(j)
    marked = [[i, j] for i in sorted(entries) for j in sorted(hidden[i], key=entries[i].index)]
    return lists, marked


def _loops(inputs: Inputs) -> list[list[int]]:
    """Closed walks along the visible entries, each from its smallest vertex."""
    lists, _ = edge_lists(_polygons(inputs))
    following = {i: list(js) for i, js in lists.items() if js}
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
    sides = {(i, j) for polygon in _polygons(inputs) for i, j in zip(polygon, polygon[1:] + polygon[:1], strict=True)}
    following = {i: j for i, j in sides if (j, i) not in sides}
    loops: list[list[int]] = []
    while following:
        loop = [min(following)]
        while (after := following.pop(loop[-1])) != loop[0]:
            loop.append(after)
        loops.append(loop)
    return loops


def _marked(inputs: Inputs) -> list[list[int]]:
    return edge_lists(_polygons(inputs))[1]


def _marked_from_sides(inputs: Inputs) -> list[list[int]]:
    """The first-walked direction of every side that two polygons share, by list and place in it."""
    walked = [(i, j) for polygon in _polygons(inputs) for i, j in zip(polygon, polygon[1:] + polygon[:1], strict=True)]
    first = [(i, j) for at, (i, j) in enumerate(walked) if (j, i) in walked[at + 1 :]]
    return [list(side) for side in sorted(first, key=lambda side: (side[0], walked.index(side)))]


def _rule(inputs: Inputs) -> dict[str, Any]:
    """Counting rule from a label such as `I inward: cap INCREMENT first, saturating8`."""
    label = inputs.label
    arithmetic = next((name for name in ("wrap8", "saturating8", "1-bit parity") if name in label), "")
    inward = "inward" in label
    if not arithmetic or not (inward or "outward" in label):
        raise Unavailable(f"no counting rule in the label {label!r}")
    cap = 0 if "no cap" in label else 1 if "cap INCREMENT" in label else -1
    return {"inward": inward, "cap": cap, "arithmetic": arithmetic}


def _always_right(rule: Mapping[str, Any]) -> bool:
    """Rules whose value is ± the number of volumes around the receiver in every configuration of few volumes."""
    if rule["arithmetic"] == "wrap8":
        return rule["cap"] == (1 if rule["inward"] else -1)
    return rule["arithmetic"] == "saturating8" and bool(rule["inward"]) and rule["cap"] == 1


def _share(inputs: Inputs) -> Fraction:
    """Share of random configurations that a rule decides rightly; known beforehand only where it is all."""
    if not _always_right(_rule(inputs)):
        raise Unavailable("how often this wrong rule happens to be right depends on the random configurations drawn")
    return Fraction(1)


def _share_simulated(inputs: Inputs) -> Fraction:
    trials = inputs.integer("trials")
    return Fraction(_volumes.count_right(trials, **_rule(inputs)), trials)


def _ratios(inputs: Inputs) -> list[Fraction]:
    at = _scene(inputs)
    return [Fraction(_EMULATED[step][at]) / Fraction(_ACCELERATED[step][at]) for step in _ACCELERATED]


def _ratios_from_hz(inputs: Inputs) -> list[float]:
    """Ratios of the steps' rates, the reciprocals of their times."""
    at = _scene(inputs)
    return [(1000 / float(_ACCELERATED[step][at])) / (1000 / float(_EMULATED[step][at])) for step in _ACCELERATED]


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
_TRIALS = {"trials": 4000}

EQUATIONS: tuple[Equation, ...] = (
    Equation(
        id="stencil.fig4.invisible_entries",
        source="stencil, figures 3 and 4",
        statement="List entries that mark sides shared by two polygons.",
        verdict="conditional",
        condition="Consistently wound polygons; only entries still visible may match.",
        closed_form=_marked,
        derived=_marked_from_sides,
        samples=(_FIGURE_4, {"A": [0, 1, 2], "B": [2, 1, 3]}),
    ),
    Equation(
        id="stencil.fig4.loops",
        source="stencil, figure 4",
        statement="External sides close to an outer silhouette and a hole.",
        verdict="holds",
        closed_form=_loops,
        derived=_loops_from_boundary,
        samples=({}, {"A": [0, 1, 2], "B": [2, 1, 3]}),
    ),
    Equation(
        id="stencil.stencil",
        source="stencil, sections 4.1 and 7",
        statement="Share of configurations in which a counting rule finds the right shadow.",
        verdict="erratum",
        closed_form=_share,
        measured=_share_simulated,
        correction=Correction(
            printed="normals point into the shadow, not-facing sides increment, and the cap decrements",
            corrected="with these normals the cap increments; it decrements with outward normals and wrapping counts",
            printed_form=lambda i: Fraction(
                _volumes.count_right(i.integer("trials"), True, -1, "saturating8"), i.integer("trials")
            ),
            counterexample=_TRIALS,
            label=_RIGHT,
        ),
        samples=(
            (_TRIALS, _RIGHT),
            (_TRIALS, "I inward: cap INCREMENT first, wrap8"),
            (_TRIALS, "II outward: INC exiting, DEC entering, cap DECREMENT, wrap8"),
        ),
    ),
    Equation(
        id="stencil.text.one_bit",
        source="stencil, section 8",
        statement="Share of configurations that an 8-bit stencil decides rightly; one bit finds parity only.",
        verdict="erratum",
        closed_form=lambda i: Fraction(1),
        measured=lambda i: _share_simulated(Inputs(i, _RIGHT)),
        correction=Correction(
            printed="a stencil of one bit serves where there is no 3-D acceleration",
            corrected="parity is wrong wherever an even number of volumes is nested",
            printed_form=lambda i: _share_simulated(Inputs(i, _PARITY)),
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
            derived=_hz_from_steps(steps),
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
        derived=_ratios_from_hz,
        samples=tuple(({}, scene) for scene in _SCENES),
    ),
    Equation(
        id="stencil.text.sixty_times",
        source="stencil, section 9",
        statement="Largest ratio of rendering times without and with acceleration.",
        verdict="erratum",
        closed_form=lambda i: max(_ratios(Inputs({}, scene))[0] for scene in _SCENES),
        derived=lambda i: max(_ratios_from_hz(Inputs({}, scene))[0] for scene in _SCENES),
        correction=Correction(
            printed="rendering takes up to 60 times longer",
            corrected="60 times in scene A, 88.5 times in scene B",
            printed_form=lambda i: 60,
        ),
        samples=({},),
    ),
)
