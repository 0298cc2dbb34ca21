"""Claims from numbers: equal within a tolerance, at most a bound, or all true."""

from typing import Any

import numpy as np

from experiments.base import Claim


def agrees(name: str, found: Any, expected: Any, tolerance: float) -> Claim:
    """Arrays agree to a relative tolerance everywhere."""
    found, expected = np.broadcast_arrays(np.asarray(found, float), np.asarray(expected, float))
    largest = float(np.max(np.abs(found - expected) / np.abs(expected)))
    told = f"largest relative difference {largest:.1e} of {found.size}"
    return Claim(name, largest <= tolerance, told, f"at most {tolerance:.0e}")


def equals(name: str, found: Any, expected: Any, tolerance: float = 1e-9) -> Claim:
    """One number is another, to a relative tolerance."""
    found, expected = float(found), float(expected)
    return Claim(name, abs(found - expected) <= tolerance * abs(expected), f"{found:.10g}", f"{expected:.10g}")


def at_most(name: str, found: Any, bound: Any) -> Claim:
    """The largest of some numbers does not exceed a bound."""
    largest, bound = float(np.max(np.asarray(found, float))), float(bound)
    return Claim(name, largest <= bound, f"{largest:.6g}", f"at most {bound:.6g}")


def all_true(name: str, truths: Any, what: str) -> Claim:
    """A statement holds in every one of several cases.

    Args:
        name: The statement.
        truths: One boolean a case.
        what: What the cases are, in the plural.
    """
    truths = np.asarray(truths, bool)
    return Claim(name, bool(truths.all()), f"{int(truths.sum())} {what}", f"all {truths.size}")
