"""Rows of reference values against the ledger: what is covered, what matches, and why the rest is not."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Literal

from shadowjax._checked import checked
from shadowjax.ledger.equation import Unavailable, evaluate, plain, relative_error
from shadowjax.ledger.inputs import Estimate

Status = Literal["matched", "differs", "not covered"]
TOLERANCE = 1e-9


@checked
@dataclass(frozen=True)
class RowOutcome:
    """What became of one row: its id, status, both values, the relative error, what was allowed, and a reason."""

    id: str
    status: Status
    value: Any = None
    expected: Any = None
    error: float = 0.0
    tolerance: float = TOLERANCE
    reason: str = ""


@checked
def family_of(row_id: str) -> str:
    """The family that a row's id names: what stands before the first bracket."""
    return row_id.split("[", 1)[0]


@checked
def row_tolerance(row: Mapping[str, Any]) -> float:
    """Relative error allowed: 1e-9, or half a unit of the last good digit where fewer are good."""
    digits = row.get("digits")
    return max(TOLERANCE, 0.5 * 10.0 ** (1 - digits)) if isinstance(digits, int) else TOLERANCE


@checked
def compare_row(row: Mapping[str, Any]) -> RowOutcome:
    """Evaluate one row.

    Args:
        row: `id`, `inputs` and `value` as in a values file; `digits` says how many of the value are good.

    Returns:
        Status `not covered`, with the reason, where no equation answers, the inputs do not suffice, or the value is a
        share of random configurations that the inputs do not give.
    """
    row_id, expected, tolerance = str(row["id"]), row["value"], row_tolerance(row)
    try:
        value = evaluate(family_of(row_id), row.get("inputs") or {}, row_id)
    except Unavailable as reason:
        return RowOutcome(row_id, "not covered", None, expected, tolerance=tolerance, reason=str(reason))
    if isinstance(value, Estimate):
        reason = f"a share of random configurations; of those drawn here it is {float(value):.4f}"
        return RowOutcome(row_id, "not covered", plain(value), expected, tolerance=tolerance, reason=reason)
    error = relative_error(value, expected)
    status: Status = "matched" if error <= tolerance else "differs"
    return RowOutcome(row_id, status, plain(value), expected, error, tolerance)


@checked
def compare_rows(rows: Iterable[Mapping[str, Any]]) -> list[RowOutcome]:
    """Evaluate every row, in order."""
    return [compare_row(row) for row in rows]


@checked
def summary(outcomes: Iterable[RowOutcome]) -> dict[str, int]:
    """Number of rows, of those covered, matched, differing and not covered."""
    listed = list(outcomes)
    counts = {status: sum(one.status == status for one in listed) for status in ("matched", "differs", "not covered")}
    return {"rows": len(listed), "covered": counts["matched"] + counts["differs"], **counts}
