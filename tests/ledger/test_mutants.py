"""The ledger notices mistakes: small changes of the closed forms make a row fail."""

import json
import subprocess
import sys
from pathlib import Path

from tests.ledger import mutant_reasons, mutant_syntax, mutants

ROOT = Path(__file__).parents[2]


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
    """At least 95 of 100 mutants are noticed, the others have reasons, and rows notice some, but for a few."""
    record = json.loads(mutants.RECORD.read_text(encoding="utf-8"))
    survivors = [name for name, row in record["mutants"].items() if not row]
    assert len(survivors) <= 0.05 * len(record["mutants"])
    assert not [name for name in survivors if not mutant_reasons.reason_of(name)]
    silent = {name for name, mutant in record["rows"].items() if not mutant}
    assert silent <= {
        "warping.Eq54.k_opt_real",
        "warping.Eq37.ratio_dz_over_true",
        "warping.beyond.log_least",
        "filtering.Eq2.7.meaning",
    }


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
