"""The ledger's types and runner: what an equation is, how it is checked, and where its ledgers are merged.

The closed form of an equation is compared with other routes to the same number, each of one kind:

- `recomputed`: the same formula evaluated again, by another function or from other numbers;
- `independent`: another derivation (other algebra, automatic differentiation, quadrature, enumeration, optimisation,
  exact arithmetic, first principles);
- `measured`: read off by casting, filtering arrays or simulating.

The last is the strongest, and an equation is as well founded as its strongest route. An erratum also shows the printed
form failing at a counterexample.
"""

import functools
import importlib
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, Literal

from shadowjax._checked import checked
from shadowjax._checks import require, require_choice
from shadowjax.ledger.inputs import Inputs, Unavailable, plain, relative_error

Verdict = Literal["holds", "conditional", "erratum"]
Kind = Literal["recomputed", "independent", "measured"]
Function = Callable[["Inputs"], Any]

VERDICTS: tuple[Verdict, ...] = ("holds", "conditional", "erratum")
KINDS: tuple[Kind, ...] = ("recomputed", "independent", "measured")  # from the weakest to the strongest
SOURCES = ("mdsm", "warping", "filtering", "stencil", "asm")
LEDGERS = {  # the module of `shadowjax.ledger` that holds the equations of each source
    "mdsm": "mdsm.all",
    "warping": "warping.all",
    "filtering": "filtering.all",
    "stencil": "stencil",
    "asm": "asm",
}


REFUTED = "printed form refuted"


@checked
@dataclass(frozen=True)
class Correction:
    """How an erratum is printed, how it should read, and inputs at which the two differ.

    Args:
        printed: What the source states, in our words.
        corrected: What is true.
        printed_form: The printed form as a function of inputs.
        counterexample: Inputs at which it gives another value than the true form.
        label: Label of the counterexample, for families that read it.
        corrected_form: The true form; the equation's closed form if None. Needed where the family itself names the
            literal reading.
    """

    printed: str
    corrected: str
    printed_form: Function
    counterexample: Mapping[str, Any] = field(default_factory=dict)
    label: str = ""
    corrected_form: Function | None = None


@checked
@dataclass(frozen=True)
class Equation:
    """One formula or claim of a source.

    Args:
        id: `source.family`, the part before `[` of the rows that it answers.
        source: Document and place, e.g. `mdsm, eq. 4.2`.
        statement: What it says, in our words.
        verdict: `holds`, `conditional` (true under `condition`) or `erratum` (false as printed; see `correction`).
        closed_form: True value as a function of inputs.
        samples: Inputs at which `verify` checks it; pairs (inputs, label) where a family needs the label.
        recomputed: The same formula evaluated again, or None; a route may return None where it does not go.
        independent: The same value by another derivation, or None.
        measured: The same value from casting, filtered arrays or a simulation, or None.
        condition: When a conditional equation holds.
        correction: The printed form of an erratum.
        tolerance: Relative error allowed between closed form and routes; absolute where the value is 0.
        measured_tolerance: The same for the measurement; `tolerance` if None.
        pattern: Regular expression of the families that this equation answers, if more than its id; named groups
            become inputs.
    """

    id: str
    source: str
    statement: str
    verdict: Verdict
    closed_form: Function
    samples: tuple[Mapping[str, Any] | tuple[Mapping[str, Any], str], ...]
    recomputed: Function | None = None
    independent: Function | None = None
    measured: Function | None = None
    condition: str = ""
    correction: Correction | None = None
    tolerance: float = 1e-9
    measured_tolerance: float | None = None
    pattern: str = ""

    def __post_init__(self) -> None:
        require_choice(self.verdict, f"verdict of {self.id}", VERDICTS)
        require_choice(self.id.split(".")[0], f"source of {self.id}", SOURCES)
        require(bool(self.samples), f"{self.id} needs sample inputs, or verify checks nothing")
        require(bool(self.routes()), f"{self.id} needs a second route to its value")
        require(
            (self.verdict == "erratum") == (self.correction is not None), f"{self.id}: errata alone have corrections"
        )
        require(self.verdict != "conditional" or bool(self.condition), f"{self.id} needs its condition in words")

    def matches(self, family: str) -> dict[str, str] | None:
        """Inputs read from the family's name if this equation answers it, else None."""
        if family == self.id and not self.pattern:
            return {}
        found = re.fullmatch(self.pattern, family) if self.pattern else None
        return None if found is None else {k: v for k, v in found.groupdict().items() if v is not None}

    def routes(self) -> dict[Kind, Function]:
        """The routes that the closed form is compared with, from the weakest kind to the strongest."""
        every: dict[Kind, Function | None] = {
            "recomputed": self.recomputed, "independent": self.independent, "measured": self.measured,
        }  # fmt: skip
        return {kind: route for kind, route in every.items() if route is not None}

    def inputs(self) -> tuple[Inputs, ...]:
        """The sample inputs, with what the id itself says."""
        from_id = self.matches(self.id) or {}
        pairs = (sample if isinstance(sample, tuple) else (sample, "") for sample in self.samples)
        return tuple(Inputs(values, label).merged(from_id) for values, label in pairs)


@checked
@dataclass(frozen=True)
class Check:
    """One comparison: a name, its kind, whether it passed, the value, what it should be, and the relative error."""

    name: str
    kind: Kind
    passed: bool
    value: Any
    expected: Any
    error: float


@checked
@dataclass(frozen=True)
class Result:
    """What `verify` found about one equation; its kind is the strongest of its checks."""

    id: str
    source: str
    verdict: Verdict
    passed: bool
    kind: Kind
    checks: tuple[Check, ...]


def _check(name: str, kind: Kind, value: Any, expected: Any, tolerance: float) -> Check:
    error = relative_error(value, expected)
    return Check(name, kind, error <= tolerance, plain(value), plain(expected), error)


def _name(kind: str, inputs: Inputs) -> str:
    case = inputs.label or ", ".join(f"{name}={plain(value)}" for name, value in inputs.items())
    return f"{kind} [{case}]" if case else kind


@checked
def checks(equation: Equation) -> Iterator[Check]:
    """The checks of one equation, each made as it is asked for.

    For each sample every route = closed form, and for an erratum that the printed form, evaluated again, differs from
    the truth at the counterexample.
    """
    for inputs in equation.inputs():
        expected = equation.closed_form(inputs)
        loose = equation.tolerance if equation.measured_tolerance is None else equation.measured_tolerance
        for kind, route in equation.routes().items():
            value = route(inputs)
            if value is not None:
                allowed = loose if kind == "measured" else equation.tolerance
                yield _check(_name(kind, inputs), kind, value, expected, allowed)
    if equation.correction is not None:
        correction = equation.correction
        inputs = Inputs(correction.counterexample, correction.label).merged(equation.matches(equation.id) or {})
        truth, printed = (correction.corrected_form or equation.closed_form)(inputs), correction.printed_form(inputs)
        error = relative_error(printed, truth)
        differs = error > max(equation.tolerance, equation.measured_tolerance or 0.0)
        name = _name(REFUTED, inputs)
        yield Check(name, "recomputed", differs, plain(printed), plain(truth), error)


@checked
def check(equation: Equation) -> Result:
    """Make all checks of one equation; it passes if there are some other than the refutation, and all pass."""
    made = tuple(checks(equation))
    passed = any(not one.name.startswith(REFUTED) for one in made) and all(one.passed for one in made)
    kinds = {one.kind for one in made}
    kind: Kind = "measured" if "measured" in kinds else "independent" if "independent" in kinds else "recomputed"
    return Result(equation.id, equation.source, equation.verdict, passed, kind, made)


@functools.cache
def ledger() -> Mapping[str, Equation]:
    """Every equation of the package by id, in the order of the sources.

    Raises:
        ValueError: If two ledgers use one id.
    """
    merged: dict[str, Equation] = {}
    for name in LEDGERS.values():
        for equation in importlib.import_module(f"shadowjax.ledger.{name}").EQUATIONS:
            require(equation.id not in merged, f"two equations are called {equation.id}")
            merged[equation.id] = equation
    return MappingProxyType(merged)


@checked
def find(family: str, equations: Mapping[str, Equation] | None = None) -> Equation | None:
    """The equation that answers a family of reference values, or None."""
    known = ledger() if equations is None else equations
    if family in known:
        return known[family]
    return next((equation for equation in known.values() if equation.matches(family) is not None), None)


@checked
def evaluate(family: str, inputs: Mapping[str, Any], row_id: str = "") -> Any:
    """True value of a family at named inputs.

    Args:
        family: Id of an equation, or a name that its pattern matches.
        inputs: Name to number, decimal string or list; angles in degrees end in `_deg`.
        row_id: Full id of a row, `family[label]`; some families name a case only in the label.

    Raises:
        Unavailable: If no equation answers the family, an input is missing, or the value cannot be recomputed.
    """
    equation = find(family)
    if equation is None:
        raise Unavailable(f"no equation of the ledger answers {family!r}")
    label = row_id[row_id.index("[") + 1 : row_id.rindex("]")] if "[" in row_id and "]" in row_id else ""
    return equation.closed_form(Inputs(inputs, label).merged(equation.matches(family) or {}))


@checked
def verify(
    equations: Iterable[Equation] | None = None, progress: Callable[[Result], None] | None = None
) -> list[Result]:
    """Check equations, all of the ledger by default.

    Args:
        equations: What to check.
        progress: Called with each result as it is found.
    """
    results = []
    for equation in ledger().values() if equations is None else equations:
        results.append(check(equation))
        if progress is not None:
            progress(results[-1])
    return results


@checked
def to_json(results: Iterable[Result]) -> dict[str, Any]:
    """Results as what `verify --json` writes."""
    return {
        "equations": [
            {
                "id": result.id,
                "source": result.source,
                "verdict": result.verdict,
                "passed": result.passed,
                "kind": result.kind,
                "checks": [vars(one) for one in result.checks],
            }
            for result in results
        ]
    }


__all__ = [
    "KINDS", "Check", "Correction", "Equation", "Inputs", "Kind", "Result", "Unavailable", "Verdict",
    "check", "checks", "evaluate", "find", "ledger", "plain", "relative_error", "to_json", "verify",
]  # fmt: skip
