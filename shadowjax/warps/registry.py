"""The registry of warp fits by name, with their default settings: the `warp` of `SingleMap` and `Cascades`."""

from collections.abc import Callable

from shadowjax.warps.base import WarpFit
from shadowjax.warps.fit import NEAR_DISTANCES, LogarithmicFit, PerspectiveFit
from shadowjax.warps.stable import StableFit
from shadowjax.warps.uniform import UniformFit


def _perspective(rule: str) -> Callable[[], WarpFit]:
    return lambda: PerspectiveFit(rule)


WARP_FITS: dict[str, Callable[[], WarpFit]] = {
    "scene": UniformFit,
    "view": lambda: UniformFit("view"),
    "stable": StableFit,
    "logarithmic": LogarithmicFit,
    **{rule: _perspective(rule) for rule in NEAR_DISTANCES},
}

__all__ = ["WARP_FITS"]
