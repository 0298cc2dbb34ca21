"""The registry of warp fits by name, with their default settings: the `warp` of `SingleMap` and `Cascades`."""

from collections.abc import Callable

from shadowjax._registry import Entry, Registry
from shadowjax.warps.base import WarpFit
from shadowjax.warps.fit import NEAR_DISTANCES, LogarithmicFit, PerspectiveFit
from shadowjax.warps.stable import StableFit
from shadowjax.warps.uniform import UniformFit


def _perspective(rule: str) -> Callable[[], WarpFit]:
    return lambda: PerspectiveFit(rule)


# What is to be known of a rule for n'; one without a line here is listed by its name.
_RULES = {
    "psm": "perspective, n' = n (perspective shadow maps)",
    "lispsm": "perspective, n' of light-space perspective maps",
    "generalised": "perspective, n' of least error in z for any γ",
    "minimax": "perspective, n' of least largest error in z",
    "minimax_whole": "perspective, least error over the whole section",
    "least_storage": "perspective, n' of least storage",
    "balanced": "perspective, n' of least error in x and z alike",
    "trapezoidal": "perspective, n' that puts the focus on the 80 % line",
}

WARP_FITS: Registry[WarpFit] = Registry("warp", {
    "uniform": Entry(UniformFit, "texels of one size around the scene"),
    "uniform-view": Entry(lambda: UniformFit("view"), "texels of one size around what the view needs"),
    "uniform-frustum": Entry(_perspective("uniform"), "texels of one size along the view axis"),
    "stable": Entry(StableFit, "texels that keep their places while the camera moves"),
    "log": Entry(LogarithmicFit, "logarithmic along the view axis"),
    **{
        rule.replace("_", "-"): Entry(_perspective(rule), _RULES.get(rule, f"perspective, n' by the rule {rule}"))
        for rule in NEAR_DISTANCES
        if rule != "uniform"
    },
})  # fmt: skip

__all__ = ["WARP_FITS"]
