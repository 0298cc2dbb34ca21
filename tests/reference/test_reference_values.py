"""Every row of a file of reference values that the ledger covers; SHADOWJAX_REFERENCE_VALUES names another file."""

import collections
import json
import os
from pathlib import Path

import pytest

from shadowjax.ledger import reference

DEFAULT = Path(__file__).parent / "values.json"


@pytest.fixture(scope="module")
def rows():
    path = Path(os.environ.get("SHADOWJAX_REFERENCE_VALUES") or DEFAULT)
    return json.loads(path.read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def outcomes(rows):
    return reference.compare_rows(rows)


def test_reference_values(outcomes, record_property, capsys):
    """Every covered row matches; the counts and the reasons of the rest are printed and recorded."""
    counts = reference.summary(outcomes)
    for name, count in counts.items():
        record_property(name.replace(" ", "_"), count)
    reasons = collections.defaultdict(list)
    for outcome in outcomes:
        if outcome.status == "not covered":
            reasons[outcome.reason].append(outcome.id)
    with capsys.disabled():
        print("\nreference values: " + ", ".join(f"{count} {name}" for name, count in counts.items()))
        for reason, ids in reasons.items():
            print(f"  not covered ({len(ids)}): {reason}: {', '.join(ids[:6])}{', ...' if len(ids) > 6 else ''}")
    differing = [outcome for outcome in outcomes if outcome.status == "differs"]
    assert not differing, "\n".join(
        f"{one.id}: got {one.value}, expected {one.expected}, relative error {one.error:.3g} > {one.tolerance:.3g}"
        for one in differing
    )
    assert counts["covered"] > 0


@pytest.mark.skipif("SHADOWJAX_REFERENCE_VALUES" in os.environ, reason="the numbers are those of the file kept here")
def test_coverage_of_the_file_kept_here(outcomes):
    """What is not covered is listed by name, so that coverage cannot shrink unseen."""
    uncovered = {one.id for one in outcomes if one.status == "not covered" and not one.id.startswith("warping.")}
    assert uncovered == {
        "mdsm.tones.image[3-SM min/max,k=4,random]",
        "mdsm.tones.image[3-SM min/max,k=9,random]",
        "mdsm.convention",
        "stencil.stencil[I inward: cap DECREMENT, 1-bit parity]",
        "stencil.stencil[II outward: INC exiting, DEC entering, cap DECREMENT, saturating8]",
        "stencil.stencil[II outward: no cap, wrap8]",
    }


def test_a_wrong_value_is_seen(rows):
    """A row whose value is off in its tenth digit differs."""
    row = next(row for row in rows if row["id"].startswith("mdsm.Eq4.3.x["))
    assert reference.compare_row(row).status == "matched"
    changed = {**row, "value": str(float(row["value"]) * (1 + 3e-9))}
    assert reference.compare_row(changed).status == "differs"


def test_fewer_good_digits_allow_more():
    """Half a unit of the last good digit, and never less than 1e-9."""
    assert reference.row_tolerance({"digits": 6}) == pytest.approx(5e-6)
    assert reference.row_tolerance({"digits": 20}) == reference.row_tolerance({"digits": "exact"}) == 1e-9
