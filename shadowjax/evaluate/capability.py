"""What each technique's gradient sees, parameter by parameter: the capability table."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

from shadowjax._checked import checked
from shadowjax._checks import require_choice
from shadowjax.filters.offset_pcf import OffsetPercentageCloser
from shadowjax.filters.pcf import BilinearPercentageCloser
from shadowjax.techniques.registry import TECHNIQUES, make_technique
from shadowjax.warps.uniform import UniformFit

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
    "bias": "the depth a test forgives",
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
    "exact": {"vertices": "values", "light": "values"},
    "shadow-volumes": {"vertices": "values", "light": "values"},
    "asm": {"vertices": "values", "light": "static", "camera": "static", "camera position": "static", "bias": "values"},
}


@checked
def capability(name: str, parameter: str) -> str:
    """What the gradient of a technique's visibility, or of a function's result, in a parameter sees.

    Args:
        name: Of `TECHNIQUES` or `FUNCTIONS`.
        parameter: Key of `PARAMETERS`.

    Returns:
        Key of `GRADES`.

    Raises:
        ValueError: If a name is unknown.
    """
    require_choice(name, "technique or function", (*TECHNIQUES, *FUNCTIONS))
    require_choice(parameter, "parameter", PARAMETERS)
    if name in _FOLLOWED:
        return "silhouettes" if parameter in _FOLLOWED[name] else "none"
    if name == "OffsetPercentageCloser" and parameter == "camera position":
        return "zero"
    if name == "OffsetPercentageCloser":
        return "topology" if parameter == "offsets" else _of_filter(OffsetPercentageCloser, False, parameter)
    if name in _COUNTED:
        return _COUNTED[name].get(parameter, "none")
    technique: Any = make_technique(name)
    if parameter == "camera position":
        return capability(name, "camera") if _follows(technique.partition) else "zero"
    if parameter in _NUMBERS:
        return "static" if _has(technique.filter, parameter) else "none"
    if technique.coverage and parameter in _MOVES_MAP:
        return "silhouettes"
    return _of_filter(type(technique.filter), not technique.filter.compares, parameter)


def _follows(partition: Any) -> bool:
    """Whether the maps of a partition move with the camera: a uniform map around the scene only turns with its view."""
    return not isinstance(getattr(partition, "warp", UniformFit()), UniformFit)


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
