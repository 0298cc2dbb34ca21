"""What each technique's gradient sees, parameter by parameter: the capability table."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

from shadowjax._checked import checked
from shadowjax._checks import require_choice
from shadowjax.filters.offset_pcf import OffsetPercentageCloser
from shadowjax.filters.pcf import BilinearPercentageCloser
from shadowjax.presets.names import as_technique
from shadowjax.techniques.adaptive import AdaptiveShadowMapping
from shadowjax.techniques.base import Technique
from shadowjax.techniques.exact import Exact
from shadowjax.techniques.registry import TECHNIQUES
from shadowjax.techniques.shadow_volumes import ShadowVolumes

GRADES: Mapping[str, str] = MappingProxyType({
    "silhouettes": "exact where surfaces are hit, and where an outline or a shadow's edge moves",
    "topology": "exact at fixed topology: which surface, texel and branch is met does not change",
    "zero": "exactly 0, as are differences: the map that the technique comes with does not follow it",
    "values": "the number changes values, and the gradient is 0",
    "static": "chosen before compilation: searched, not differentiated",
    "none": "there is no such number",
})  # fmt: skip
PARAMETERS: Mapping[str, str] = MappingProxyType({
    "vertices": "positions of the mesh",
    "light": "its position or direction",
    "camera": "the pose that maps are fitted to, with a partition that follows it, or that a picture is seen from",
    "camera position": "the same with the partition that the technique comes with",
    "bias": "depth tolerance of the test",
    "exponent": "of exponential filters",
    "kernel size": "how many texels a filter's kernel spans",
    "kernel weights": "how much each counts: the width of a Gaussian",
    "near distance": "n' of a perspective warp, by the grid of rays that it makes, with a partition that has one",
    "splits": "planes between depth slices, likewise; which slice answers for a point is a choice",
    "offsets": "where a filter's samples lie",
})  # fmt: skip
# Not in the registry of techniques: functions with a gradient for silhouettes, and the filter that learns its taps.
FUNCTIONS = ("shadow_picture", "coverage_planes", "OffsetPercentageCloser")
_FOLLOWED = {
    "shadow_picture": ("vertices", "light", "camera", "camera position"),
    "coverage_planes": ("vertices", "light", "camera", "camera position", "near distance", "splits"),
}
# Move the rays of a map, or what they meet.
_MOVES_MAP = ("vertices", "light", "camera", "near distance", "splits")
# Techniques without a filter. Adaptive tiles are chosen on the host, and then cast again for moved vertices (`recast`).
_COUNTED = {
    Exact: {"vertices": "values", "light": "values"},
    ShadowVolumes: {"vertices": "values", "light": "values"},
    AdaptiveShadowMapping: {
        "vertices": "values",
        "light": "static",
        "camera": "static",
        "camera position": "static",
        "bias": "values",
    },
}


@checked
def capability(name: str | Technique, parameter: str) -> str:
    """What the gradient of a technique's visibility, or of a function's result, in a parameter sees.

    Args:
        name: A technique by any name that `make_technique` takes, a technique, or a name of `FUNCTIONS`.
        parameter: Key of `PARAMETERS`.

    Returns:
        Key of `GRADES`.

    Raises:
        ValueError: If a name is unknown.
    """
    require_choice(parameter, "parameter", PARAMETERS)
    if isinstance(name, str) and name in FUNCTIONS:
        return _of_function(name, parameter)
    technique: Any = as_technique(name)
    if type(technique) in _COUNTED:
        return _COUNTED[type(technique)].get(parameter, "none")
    if parameter == "camera position":
        return capability(technique, "camera") if technique.partition.follows_camera else "zero"
    if parameter in _NUMBERS:
        return "static" if _has(technique.filter, parameter) else "none"
    if technique.coverage and parameter in _MOVES_MAP:
        return "silhouettes"
    return _of_filter(type(technique.filter), not technique.filter.compares, parameter)


def _of_function(name: str, parameter: str) -> str:
    """Of functions that have a gradient for silhouettes, and of the filter that learns its taps."""
    if name in _FOLLOWED:
        return "silhouettes" if parameter in _FOLLOWED[name] else "none"
    if parameter == "camera position":
        return "zero"
    return "topology" if parameter == "offsets" else _of_filter(OffsetPercentageCloser, False, parameter)


def _of_filter(kind: type, smooth: bool, parameter: str) -> str:
    """Of what moves a map or its lookups, without coverage."""
    if parameter in _NUMBERS:
        return "none"
    # Counts of comparisons; bilinear weights follow where a receiver lies in the map, which vertices move by its fit.
    weighted = issubclass(kind, BilinearPercentageCloser | OffsetPercentageCloser)
    return "topology" if smooth or (weighted and parameter in _MOVES_MAP) else "values"


# A filter's own numbers, and the fields that hold them: all are static.
_NUMBERS = {
    "exponent": ("exponent", "positive"),
    "kernel size": ("prefilter", "kernel_size", "num_taps"),
    "kernel weights": ("prefilter",),
    "offsets": ("policy",),
}


def _has(filter_: Any, parameter: str) -> bool:
    """Whether a filter has one of these numbers."""
    return any(hasattr(filter_, field) for field in _NUMBERS[parameter])


@checked
def capability_table() -> dict[str, dict[str, str]]:
    """Every technique and function with the grade of every parameter."""
    return {
        name: {parameter: capability(name, parameter) for parameter in PARAMETERS}
        for name in (*FUNCTIONS[:2], *TECHNIQUES, FUNCTIONS[2])
    }
