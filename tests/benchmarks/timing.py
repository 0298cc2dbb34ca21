"""Interleaved timing: every contestant is called once a round, so that what disturbs the machine disturbs all alike."""

import statistics
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

STATUS = Path("/proc/self/status")
# Worker threads of one program may spin for a while when their work is done; they are given this long to go to sleep.
PAUSE_SECONDS = 0.002


def interleave(calls: Mapping[str, Callable[[int], Any]], rounds: int) -> dict[str, dict[str, Any]]:
    """Call everybody in turn, round after round.

    Args:
        calls: Work by name; it gets the number of the round, from 1, so that it can do something new each time. It must
            have been warmed up with round 0.
        rounds: How often each is called.

    Returns:
        For each name the median and the least time of a call in milliseconds, and the number of rounds.
    """
    taken: dict[str, list[float]] = {name: [] for name in calls}
    for step in range(1, rounds + 1):
        for name, call in calls.items():
            time.sleep(PAUSE_SECONDS)
            start = time.perf_counter()
            call(step)
            taken[name].append(1e3 * (time.perf_counter() - start))
    return {
        name: {"median_ms": statistics.median(times), "min_ms": min(times), "rounds": rounds}
        for name, times in taken.items()
    }


def timed(call: Callable[[], Any]) -> tuple[Any, float]:
    """What a call returns, and its milliseconds."""
    start = time.perf_counter()
    result = call()
    return result, 1e3 * (time.perf_counter() - start)


def resident_growth(call: Callable[[], Any]) -> tuple[Any, float | None]:
    """What a call returns, and by how many megabytes the process grew at its peak; None where Linux does not tell."""
    try:
        Path("/proc/self/clear_refs").write_text("5")
        before = _kilobytes("VmRSS")
    except OSError:
        return call(), None
    result = call()
    return result, max(_kilobytes("VmHWM") - before, 0) / 1e3


def _kilobytes(field: str) -> int:
    (line,) = (line for line in STATUS.read_text().splitlines() if line.startswith(field + ":"))
    return int(line.split()[1])
