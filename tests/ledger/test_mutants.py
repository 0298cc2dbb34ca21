"""The ledger notices mistakes: small changes of the closed forms make a row fail."""

import json
import subprocess
import sys
from pathlib import Path

from shadowjax.ledger import equation as equation_module
from tests.ledger import mutant_reasons, mutant_syntax, mutants

ROOT = Path(__file__).parents[2]
# A worker that checks one row, unless its journal knows that the row does not end.
ENDLESS = """
import sys
from pathlib import Path
import jax
from shadowjax.ledger.equation import Equation
from tests.ledger import mutants

journal = mutants.Journal(Path(sys.argv[-1]))
if not journal.noticed:
    journal.note("try", "mutant", "row")
    mutants.failure(Equation(
        id="asm.endless", source="asm", statement="A loop.", verdict="holds", samples=({},), independent=lambda _: 0,
        closed_form=lambda _: jax.lax.while_loop(lambda x: x < 9, lambda x: (x + 1) % 7, 0),
    ), 0.3)
    raise SystemExit("the loop ended")
"""


def command(*words):
    """The tool in a process of its own: it changes the package's code."""
    return subprocess.run(
        [sys.executable, "-m", "tests.ledger.mutants", *words], cwd=ROOT, capture_output=True, text=True, check=False
    )


def test_a_sample_of_mutants_is_noticed():
    """Each by the row that noticed it when all were tried."""
    done = command("--sample", "30", "--seed", "1")
    assert done.returncode == 0, done.stdout + done.stderr[-4000:]
    assert "30 mutants, each noticed by its row" in done.stdout


def test_the_record_is_complete():
    """At least 95 of 100 mutants are noticed, the others have reasons, and every row notices some."""
    record = json.loads(mutants.RECORD.read_text(encoding="utf-8"))
    survivors = [name for name, row in record["mutants"].items() if not row]
    assert len(survivors) <= 0.05 * len(record["mutants"])
    assert not [name for name in survivors if not mutant_reasons.reason_of(name)]
    assert [name for name, mutant in record["rows"].items() if not mutant] == []


def test_the_record_knows_the_rows_and_functions_that_there_are():
    """Rows of the ledger one by one; functions by name, for their mutants change with every line."""
    record = json.loads(mutants.RECORD.read_text(encoding="utf-8"))
    known = equation_module.ledger()
    assert list(record["rows"]) == list(known)
    assert {row for row in record["mutants"].values() if row} <= set(known)
    assert set(record["endless"]) <= set(record["mutants"])
    modules = (*mutant_syntax.LIBRARY, *mutant_syntax.LEDGER)
    there = {
        place.split("#")[0]
        for module in modules
        for place, _ in mutant_syntax.places(mutant_syntax.source(module)[0], module)
    }
    named = {name.split(":")[0] for name in (*record["mutants"], *record["rows"].values(), *record["unused"])}
    assert named <= there, named - there


def test_what_does_not_end_is_noticed(tmp_path):
    """A loop in compiled code that takes no signal of Python's ends its process, and the next one goes on."""
    script = tmp_path / "endless.py"
    script.write_text(ENDLESS, encoding="utf-8")
    assert mutants.supervised([sys.executable, str(script)], tmp_path / "journal") == 0
    assert mutants.Journal(tmp_path / "journal").noticed == [["mutant", "row", mutants.ENDLESS]]


def test_a_function_has_mutants_of_every_kind():
    made = [
        one
        for one in mutant_syntax.mutants("theory.aliasing.near_distances")
        if one.place == "theory.aliasing.near_distances.eta_from_near_distance"
    ]
    assert {one.kind for one in made} >= {"constant", "sign", "term", "factor", "ends"}
    assert {one.kind for one in mutant_syntax.mutants("theory.aliasing.optimal")} >= {"extreme"}
    assert len({one.id for one in made}) == len(made)
    assert len(made) > 20
