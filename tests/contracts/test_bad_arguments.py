"""Bad arguments are refused by name, as a user meets them: without the checker of annotations of the tests."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

SUPPORT = Path(__file__).parents[1] / "support"
# Arguments of any kind: trees of arrays, what a filter prepared or an optimiser found, values that are compared or
# written as they are.
ANYTHING = {
    "certificate", "content", "counterexample", "default", "expected", "options", "origin", "others", "otherwise",
    "pixels", "place", "planes", "prepared", "problem", "result", "spot", "tree", "value", "values", "vertices", "x",
    "y", "z",
}  # fmt: skip


def report(*arguments: str) -> dict:
    """What `support/refusals.py` finds, in a process of its own without the import hook of the tests."""
    environment = {**os.environ, "PYTHONPATH": f"{SUPPORT}{os.pathsep}{SUPPORT.parents[1]}"}
    command = [sys.executable, str(SUPPORT / "refusals.py"), *arguments]
    done = subprocess.run(command, capture_output=True, text=True, env=environment, check=False)
    assert done.returncode == 0, done.stderr[-2000:]
    return json.loads(done.stdout.splitlines()[-1])


def test_every_public_signature_refuses_what_does_not_fit():
    found = report("signatures")
    assert found["unchecked"] == [], "decorate them with `checked`, or let their class be a `Checked`"
    assert found["faults"] == []
    assert found["num_refused"] > 25_000
    assert {name for _, name in found["anything"]} <= ANYTHING


def test_the_front_door_refuses_bad_arguments_among_good_ones():
    found = report("calls")
    assert found["missing"] == [], "give these names an example in support/examples.py"
    assert found["faults"] == []
    assert found["num_refused"] > 2_500


@pytest.mark.long
def test_the_front_door_refuses_or_answers_every_bad_argument():
    found = report("calls", "--long")
    assert found["faults"] == []
    assert found["num_refused"] > 4_000
