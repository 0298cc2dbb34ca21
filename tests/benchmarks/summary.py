"""What a run comes to: ratios to the fastest peer of each kind, for each mesh and resolution."""

import math
from collections.abc import Mapping, Sequence
from typing import Any


def ratios(records: Sequence[Mapping[str, Any]], kinds: Mapping[str, str]) -> list[dict[str, Any]]:
    """Time of the fastest ray caster and of the fastest rasteriser over ours, geometric mean over the projections.

    Args:
        records: What a session has collected.
        kinds: Kind of each contestant by name.

    Returns:
        One entry for each case, mesh and resolution that peers took part in; a ratio above 1 says that we are faster.
        Ratios are to our first contestant, which is one device; `best` is our fastest, which may use several.
    """
    groups: dict[tuple, list[Mapping[str, Any]]] = {}
    for record in records:
        if any(name in kinds and kinds[name] != "this package" for name in record["contestants"]):
            key = record["case"], record["mesh"], record["triangles"], record["rows"]
            groups.setdefault(key, []).append(record["contestants"])
    return [
        {"case": case, "mesh": mesh, "triangles": triangles, "rows": rows, **_fastest(each, kinds)}
        for (case, mesh, triangles, rows), each in groups.items()
    ]


def _fastest(entries: Sequence[Mapping[str, Any]], kinds: Mapping[str, str]) -> dict[str, Any]:
    """Of each kind of peer, the one with the smallest mean ratio, and the same of ours."""
    ours_ms = _mean([next(iter(entry.values()))["median_ms"] for entry in entries])
    result: dict[str, Any] = {"ours_ms": ours_ms}
    for kind in ("this package", "ray caster", "rasteriser"):
        names = [name for name in entries[0] if kinds.get(name) == kind and all(name in entry for entry in entries)]
        if not names:
            continue
        mean = {name: _mean([entry[name]["ratio"] for entry in entries]) for name in names}
        best = min(mean, key=mean.__getitem__)
        if kind == "this package":
            result["best"] = {"name": best, "ms": ours_ms * mean[best]}
        else:
            result[kind] = {"name": best, "ratio": mean[best]}
    return result


def _mean(values: Sequence[float]) -> float:
    """Geometric mean."""
    return math.exp(sum(map(math.log, values)) / len(values))
