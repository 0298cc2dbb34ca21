"""What each technique's gradient sees, parameter by parameter: the capability table."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

from shadowjax._checks import require_choice
from shadowjax.filters.pcf import BilinearPercentageCloser
from shadowjax.techniques import TECHNIQUES, make_technique

GRADES: Mapping[str, str] = MappingProxyType({
    "silhouettes": "exact where surfaces are hit, and where an outline or a shadow's edge moves",
    "topology": "exact at fixed topology: which surface, texel and branch is met does not change",
    "values": "the number changes values, and the gradient is 0",
    "static": "chosen before compilation: searched, not differentiated",
    "none": "there is no such number",
})  # fmt: skip
PARAMETERS: Mapping[str, str] = MappingProxyType({
    "vertices": "positions of the mesh",
    "light": "its position or direction",
    "camera": "the pose that maps are fitted to, or that a picture is seen from",
    "bias": "the depth a test forgives",
    "exponent": "of exponential filters",
    "kernel": "size and weights of a filter's kernel",
    "near distance": "n' of a perspective warp, by the grid of rays that it makes",
    "splits": "planes between depth slices, likewise",
    "offsets": "where a filter's samples lie",
})  # fmt: skip
# Not in the registry of techniques: functions with a gradient for silhouettes, and the filter that learns its taps.
FUNCTIONS = ("shadow_picture", "coverage_planes", "OffsetPercentageCloser")
_FOLLOWED = {
    "shadow_picture": ("vertices", "light", "camera"),
    "coverage_planes": ("vertices", "light", "camera", "near distance", "splits"),
}
_MOVES_GRID = ("light", "camera", "near distance", "splits")


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
    if name == "OffsetPercentageCloser":
        apart = {"kernel": "none", "exponent": "none", "bias": "values"}
        return apart.get(parameter, "topology")
    filter_: Any = getattr(make_technique(name), "filter", None)
    if filter_ is None:  # the exact test has no map
        return "values" if parameter in ("vertices", "light") else "none"
    if parameter in ("exponent", "kernel", "offsets"):
        return "static" if _has(filter_, parameter) else "none"
    if not filter_.compares:
        return "topology"
    # Counts of comparisons; bilinear weights follow where a receiver lies in the map, which vertices move by its fit.
    weighted = isinstance(filter_, BilinearPercentageCloser)
    return "topology" if weighted and (parameter in _MOVES_GRID or parameter == "vertices") else "values"


def _has(filter_: Any, parameter: str) -> bool:
    """Whether a filter has an exponent, or a kernel, or samples at offsets of its own."""
    if parameter == "exponent":
        return hasattr(filter_, "exponent") or hasattr(filter_, "positive")
    if parameter == "kernel":
        return any(hasattr(filter_, name) for name in ("prefilter", "size", "kernel_size", "num_taps"))
    return hasattr(filter_, "policy")


def capability_table() -> dict[str, dict[str, str]]:
    """Every technique and function with the grade of every parameter."""
    return {
        name: {parameter: capability(name, parameter) for parameter in PARAMETERS}
        for name in (*FUNCTIONS[:2], *TECHNIQUES, FUNCTIONS[2])
    }
