"""The ledger's machinery: what passes, what must fail, how values compare, and that every equation of it holds."""

import json
import math
from fractions import Fraction

import numpy as np
import pytest

from shadowjax.ledger import equation as equation_module
from shadowjax.ledger import reference
from shadowjax.ledger.equation import Correction, Equation, Inputs, Unavailable
from shadowjax.ledger.inputs import LARGEST_ERROR, Estimate, plain, relative_error


def an_equation(**changes):
    fields = {
        "id": "mdsm.test.square", "source": "mdsm", "statement": "x times x", "verdict": "holds",
        "closed_form": lambda i: i.number("x") ** 2, "independent": lambda i: i.number("x") * i.number("x"),
        "samples": ({"x": 3}, {"x": "1/2"}),
    }  # fmt: skip
    return Equation(**(fields | changes))


def test_a_right_equation_passes_with_a_check_a_sample():
    result = equation_module.check(an_equation(measured=lambda i: i.number("x") ** 2 + 1e-12))
    assert result.passed
    assert [check.name for check in result.checks] == [
        "independent [x=3]", "measured [x=3]", "independent [x=1/2]", "measured [x=1/2]",
    ]  # fmt: skip


@pytest.mark.parametrize("kind", equation_module.KINDS)
def test_a_wrong_route_fails(kind):
    result = equation_module.check(an_equation(**{kind: lambda i: i.number("x") ** 2 * (1 + 1e-6)}))
    assert not result.passed
    assert {check.name.split()[0] for check in result.checks if not check.passed} == {kind}


def test_an_equation_is_as_well_founded_as_its_strongest_check():
    def square(inputs):
        return inputs.number("x") ** 2

    routes = dict.fromkeys(equation_module.KINDS, square)
    for last, kind in enumerate(equation_module.KINDS):
        chosen = {name: routes[name] if at <= last else None for at, name in enumerate(equation_module.KINDS)}
        result = equation_module.check(an_equation(**chosen))
        assert result.kind == kind
        assert {check.kind for check in result.checks} == set(equation_module.KINDS[: last + 1])
    assert equation_module.check(an_equation(independent=square, measured=lambda i: None)).kind == "independent"


def test_no_equation_rests_on_its_own_formula_alone():
    weak = [one.id for one in equation_module.ledger().values() if set(one.routes()) == {"recomputed"}]
    assert not weak


def test_routes_that_go_nowhere_do_not_pass():
    assert not equation_module.check(an_equation(independent=lambda i: None)).passed


def test_an_erratum_passes_only_if_its_printed_form_is_refuted():
    wrong = Correction("x + x", "x times x", lambda i: 2 * i.number("x"), {"x": 3})
    harmless = Correction("x + x", "x times x", lambda i: 2 * i.number("x"), {"x": 2})
    assert equation_module.check(an_equation(verdict="erratum", correction=wrong)).passed
    assert not equation_module.check(an_equation(verdict="erratum", correction=harmless)).passed


def test_malformed_equations_are_refused():
    for changes, message in (
        ({"id": "nowhere.Eq1"}, "source"),
        ({"samples": ()}, "sample"),
        ({"independent": None}, "second route"),
        ({"verdict": "erratum"}, "corrections"),
        ({"verdict": "conditional"}, "condition"),
    ):
        with pytest.raises(ValueError, match=message):
            an_equation(**changes)


def test_patterns_turn_names_into_inputs():
    equation = an_equation(id="mdsm.test.3.square", pattern=r"mdsm\.test\.(?P<x>\d+)\.square", samples=({},))
    assert equation_module.check(equation).passed
    assert equation.matches("mdsm.test.12.square") == {"x": "12"}
    assert equation.matches("mdsm.test.square") is None
    assert equation_module.find("mdsm.test.12.square", {equation.id: equation}) is equation


def test_inputs_read_every_spelling():
    inputs = Inputs({"a": "0.1", "b": 3, "c": "255/1022", "d_deg": 60, "e": 0.1, "l": ["1", 2.5], "t": "x"})
    assert inputs.number("a") == 0.1
    assert inputs.fraction("a") == inputs.fraction("e") == Fraction(1, 10)
    assert inputs.integer("b") == 3
    assert inputs.fraction("c") == Fraction(255, 1022)
    assert inputs.angle("d_deg") == math.radians(60)
    assert inputs.numbers("l") == [1.0, 2.5]
    assert inputs.number("missing", default=2.0) == 2.0
    assert inputs.number("missing", "b") == 3.0
    for name, read in (("missing", inputs.number), ("t", inputs.number), ("a", inputs.integer)):
        with pytest.raises(Unavailable):
            read(name)


@pytest.mark.parametrize(
    ("value", "expected", "error"),
    [
        (1.0, "1.0000000000000000000", 0.0),
        (Fraction(255, 1022), "255/1022", 0.0),
        (0.0, 0, 0.0),
        (1e-3, 0, 1e-3),
        (1.1, 1, pytest.approx(0.1)),
        ([1, [2, 3]], [1, [2, 3]], 0.0),
        ([1, 2], [1, 2, 3], LARGEST_ERROR),
        (math.nan, 1.0, LARGEST_ERROR),
        (math.inf, 1.0, LARGEST_ERROR),
        ("lit", "lit", 0.0),
        ("lit", "dark", LARGEST_ERROR),
        (True, False, LARGEST_ERROR),
        ([True, False], True, LARGEST_ERROR),
        (True, [True, False], LARGEST_ERROR),
        (np.arange(3), [0, 1, 2], 0.0),
        (np.float32(0.5), "0.5", 0.0),
    ],
)
def test_values_of_every_kind_compare(value, expected, error):
    assert relative_error(value, expected) == error


def test_plain_values_are_json():
    value = {"a": Fraction(1, 3), "b": np.arange(2), "c": np.float32(0.5), "d": math.inf, "e": None, "f": Fraction(4)}
    expected = {"a": "1/3", "b": [0, 1], "c": 0.5, "d": "inf", "e": None, "f": 4}
    assert json.loads(json.dumps(plain(value), allow_nan=False)) == expected


def test_unknown_families_are_unavailable():
    with pytest.raises(Unavailable, match="no equation"):
        equation_module.evaluate("mdsm.nothing", {})
    with pytest.raises(Unavailable, match="missing"):
        equation_module.evaluate("mdsm.Eq4.2.k", {"n": 3})


@pytest.mark.parametrize("source", [name for name in equation_module.LEDGERS if name != "warping"])
def test_every_equation_of_a_source_holds(source):
    chosen = [one for one in equation_module.ledger().values() if one.id.startswith(source + ".")]
    results = equation_module.verify(chosen)
    assert results
    failed = {
        result.id: [check for check in result.checks if not check.passed] for result in results if not result.passed
    }
    assert not failed
    written = json.loads(json.dumps(equation_module.to_json(results), allow_nan=False))
    keys = ["id", "source", "verdict", "passed", "kind", "checks"]
    assert [list(one) for one in written["equations"]] == [keys] * len(results)
    assert all(one["kind"] in equation_module.KINDS[1:] for one in written["equations"])
    fields = {"name", "kind", "passed", "value", "expected", "error"}
    assert all(set(check) == fields for one in written["equations"] for check in one["checks"])


def test_the_order_of_fragments_decides_what_saturating_counters_hold():
    """Caps that come after the decrements find a counter that has lost them; wrapping counters lose nothing."""

    def share(label):
        return float(
            equation_module.evaluate("stencil.stencil", {"trials": 4000}, f"stencil.stencil[I inward: {label}]")
        )

    assert share("cap INCREMENT first, saturating8") == 1
    for label in ("cap INCREMENT (after DEC), saturating8", "cap INCREMENT, any order, saturating8"):
        assert 0.8 < share(label) < 0.95
        assert share(label.replace("saturating8", "wrap8")) == 1


def test_shares_of_random_configurations_are_no_reference_values():
    row = {"id": "stencil.stencil[II outward: no cap, wrap8]", "inputs": {"trials": 4000}, "value": "3390/4000"}
    outcome = reference.compare_row(row)
    assert outcome.status == "not covered"
    assert "random" in outcome.reason
    assert isinstance(equation_module.evaluate("stencil.stencil", row["inputs"], row["id"]), Estimate)


def test_the_errata_of_the_multi_depth_source_are_errata():
    known = equation_module.ledger()
    for name in ("mdsm.Eq4.4.x", "mdsm.notation.C_z", "mdsm.fig4.18.extent", "mdsm.fig4.13.channel", "mdsm.convention",
                 "mdsm.fig4.16.neighbour", "mdsm.text.equal_sizes", "mdsm.text.fig5.4"):  # fmt: skip
        assert known[name].verdict == "erratum"
