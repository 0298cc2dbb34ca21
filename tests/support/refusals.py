"""Calls every public signature with bad arguments and prints, as JSON, what is not refused as it should be."""

import inspect
import json
import sys
import tempfile
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from examples import examples
from signatures import bad_values, everything_bad, outcome, refusal, signatures

import shadowjax as sj

# Calls that take long: in the short run they meet only what is refused before anything is computed.
SLOW = (
    "AdaptiveShadowMapping().build", "ShadowVolumes().build", "coverage_depth", "coverage_planes", "shade",
    "shadow_picture", "shadows.visibility", "trace_surface", "visibility_on", "build_shadow_map", "intersect",
    "Exact().build", "ShadowMapping().build", "make_scene", "mesh_edges", "compare", "measure", "render", "load_scene",
)  # fmt: skip
# Any tree can be given a dtype; a class that cannot be called with a depth is a function all the same.
GOOD_AFTER_ALL = {("astype", "tree"), ("coverage_planes", "encode")}


def of_signatures() -> dict[str, Any]:
    """Each argument alone: it is refused before those that are missing are asked for."""
    unchecked, faults, anything, num_refused = [], [], [], 0
    for signature in signatures():
        if not signature.is_checked:
            unchecked.append(signature.name)
            continue
        for name, hint in signature.hints.items():
            bad = bad_values(hint, name)
            if bad is None:
                anything.append((signature.name, name))
                continue
            for kind, value in bad.items():
                fault = refusal(signature, name, value)
                num_refused += not fault
                if fault:
                    faults.append(f"{signature.name}: {name} = {kind}: {fault}")
    return {"unchecked": unchecked, "faults": faults, "anything": anything, "num_refused": num_refused}


def all_arguments(call: Any, good: Mapping[str, Any]) -> dict[str, Any]:
    """The good arguments, and the defaults of those that are not given."""
    parameters = inspect.signature(call).parameters.values()
    named = [part for part in parameters if part.kind in (part.POSITIONAL_OR_KEYWORD, part.KEYWORD_ONLY)]
    return {part.name: good.get(part.name, part.default) for part in named} | dict(good)


def of_calls(is_long: bool) -> dict[str, Any]:
    """Each argument among good ones."""
    with tempfile.TemporaryDirectory() as folder:
        calls = examples(Path(folder))
        missing = sorted({name for name in sj.__all__ if callable(getattr(sj, name))} - set(calls))
        faults, num_refused = [], 0
        for name, (call, good) in calls.items():
            good = all_arguments(call, good)
            is_slow = name in SLOW and not is_long
            if not is_slow:
                call(**good)
            for argument in good:
                for kind, value in everything_bad(good[argument]).items():
                    if (name, argument) in GOOD_AFTER_ALL:
                        continue
                    said = outcome(call, good, argument, value, only_checks=is_slow)
                    num_refused += not said
                    if said and not said.startswith("finite"):
                        faults.append(f"{name}: {argument} = {kind}: {said}")
    return {"missing": missing, "faults": faults, "num_refused": num_refused}


if __name__ == "__main__":
    warnings.simplefilter("error")
    print(json.dumps(of_signatures() if sys.argv[1] == "signatures" else of_calls("--long" in sys.argv)))
