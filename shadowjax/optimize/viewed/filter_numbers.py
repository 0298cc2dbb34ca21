"""Exponents, damping, terms and bleed clamps of least error over scenes, by pattern search."""

import dataclasses
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import optimistix as optx

from shadowjax._checked import Checked, checked
from shadowjax._checks import require_int, require_untraced
from shadowjax._types import Scalar
from shadowjax.filters.base import Filter
from shadowjax.filters.convolution import Convolution
from shadowjax.filters.exponential import Exponential
from shadowjax.filters.exponential_variance import ExponentialVariance
from shadowjax.filters.moment import Moments
from shadowjax.filters.prefilter import Prefilter
from shadowjax.filters.variance import Variance
from shadowjax.optimize.solution import Solution, SolutionKind, ended, with_maps
from shadowjax.optimize.viewed.views import (
    Viewed,
    Views,
    as_maps,
    as_views,
    error_of,
    filter_of,
    parts_of,
    refiltered,
)
from shadowjax.techniques.base import Technique
from shadowjax.techniques.shadow_mapping import MappedShadows
from shadowjax.theory.limits import largest_exponent


@checked
@dataclass(frozen=True)
class SearchParameter:
    """One number of a filter that is searched; the search begins at the filter's own.

    Attributes:
        name: Of the number, an attribute.
        low: Least value.
        high: Largest value.
        step: First step: a factor if `log`, else a difference.
        log: Whether steps multiply.
        whole: Whether only whole numbers count.
    """

    name: str
    low: float
    high: float
    step: float
    log: bool = False
    whole: bool = False

    def move(self, value: float, steps: float) -> float:
        """The value some steps away, inside the range."""
        moved = value * self.step**steps if self.log else value + self.step * steps
        moved = min(max(moved, self.low), self.high)
        return float(round(moved)) if self.whole else moved


@checked
@dataclass(frozen=True)
class Family:
    """Filters with the same numbers to search.

    Attributes:
        knobs: The numbers.
        holds: Whether a filter is one of them.
        within: Attribute of the filter that holds the numbers; None for the filter itself.
    """

    knobs: tuple[SearchParameter, ...]
    holds: Callable[[Filter], bool]
    within: str | None = None

    def values(self, filter_: Filter) -> tuple[float, ...]:
        """The numbers of a filter, in order."""
        part = filter_ if self.within is None else getattr(filter_, self.within)
        return tuple(float(getattr(part, knob.name)) for knob in self.knobs)

    def make(self, filter_: Filter, values: tuple[float, ...]) -> Filter:
        """A filter with other numbers, in order."""
        named = {
            knob.name: round(value) if knob.whole else value for knob, value in zip(self.knobs, values, strict=True)
        }
        if self.within is None:
            return _with(filter_, **named)
        return _with(filter_, **{self.within: _with(getattr(filter_, self.within), **named)})


def _with(part: Any, **changed: Any) -> Any:
    return dataclasses.replace(part, **changed)


# A margin below the limit keeps the planar term of the second moment finite too.
_ONE, _TWO = (0.97 * largest_exponent(jnp.float32, moments) for moments in (1, 2))
_BLEED = SearchParameter("bleed_low", 0.0, 0.9, 0.15)
_POSITIVE = SearchParameter("positive", 1.0, _TWO, 2.0, log=True)

FAMILIES: dict[str, Family] = {
    "vsm": Family((_BLEED,), lambda f: isinstance(f, Variance)),
    "esm": Family(
        (SearchParameter("exponent", 2.0, 2000.0, 2.0, log=True),),
        lambda f: isinstance(f, Exponential) and f.space == "log",
    ),
    "esm-linear": Family(
        (SearchParameter("exponent", 2.0, _ONE, 2.0, log=True),),
        lambda f: isinstance(f, Exponential) and f.space == "linear",
    ),
    "evsm2": Family((_POSITIVE, _BLEED), lambda f: isinstance(f, ExponentialVariance) and f.negative is None),
    "evsm4": Family(
        (_POSITIVE, SearchParameter("negative", 0.5, _TWO, 2.0, log=True), _BLEED),
        lambda f: isinstance(f, ExponentialVariance) and f.negative is not None,
    ),
    "msm": Family((_BLEED,), lambda f: isinstance(f, Moments)),
    "csm": Family(
        (SearchParameter("terms", 2.0, 16.0, 4.0, whole=True), SearchParameter("damping", 0.0, 4.0, 0.5)),
        lambda f: isinstance(f, Convolution),
        "step",
    ),
}  # fmt: skip


def _family_of(filter_: Filter) -> tuple[str, Family]:
    """The family of a filter, its ranges wide enough for the filter's own numbers."""
    found = next((item for item in FAMILIES.items() if item[1].holds(filter_)), None)
    if found is None:
        raise ValueError(
            f"{type(filter_).__name__} has no numbers to search; take a technique with vsm, esm, evsm2, evsm4, "
            "msm-hamburger, msm-hausdorff or csm"
        )
    name, family = found
    knobs = tuple(
        dataclasses.replace(knob, low=min(knob.low, own), high=max(knob.high, own))
        for knob, own in zip(family.knobs, family.values(filter_), strict=True)
    )
    return name, dataclasses.replace(family, knobs=knobs)


class FilterCertificate(Checked):
    """Measurements reported with the best numbers of a filter.

    Attributes:
        family: Key of `FAMILIES`.
        default_numbers: Name to the filter's default.
        at_bound: Names of the numbers that ended at an end of their range.
        test_error: Error over scenes that were not searched, at the best values; None without such scenes.
        test_default_error: The same at the defaults.
        tried: (values, error) of all that was measured, in order.
    """

    family: str = eqx.field(static=True)
    default_numbers: dict[str, Scalar]
    at_bound: tuple[str, ...] = eqx.field(static=True)
    test_error: Scalar | None
    test_default_error: Scalar | None
    tried: tuple[tuple[tuple[float, ...], float], ...] = eqx.field(static=True)


_KIND = SolutionKind(
    (
        ("family", "certificate.family"), ("numbers", "value"), ("error", "objective_value"),
        ("default_numbers", "certificate.default_numbers"), ("default_error", "baselines.default"), ("gain", "gain"),
        ("at_bound", "certificate.at_bound"), ("test_error", "certificate.test_error"),
        ("test_default_error", "certificate.test_default_error"), ("tried", "certificate.tried"), ("result", "text"),
    ),
    rival="default",
    technique=lambda found, resolution, options: with_maps(resolution, options, **parts_of(found.problem)),
)  # fmt: skip


@checked
def rms_error(views: tuple[Viewed, ...], built: tuple[MappedShadows, ...], filter_: Filter) -> float:
    """Root mean square over views of a filter's error on maps that are built, with its default bias."""
    each = [float(error_of(maps.with_filter(filter_), view)) for maps, view in zip(built, views, strict=True)]
    return float(np.sqrt(np.mean(np.square(each))))


@checked
def exponent(
    views: Views,
    technique: str | Technique | Filter = "evsm4",
    blur_size: int | None = None,
    evaluations: int = 24,
    test_views: Views = (),
) -> Solution[dict[str, Scalar], FilterCertificate]:
    """The exponents, damping, terms and bleed clamp of a filter that make least error, by pattern search.

    A step up or down along each number in turn; steps halve when none helps.

    Args:
        views: Scenes to search over, their names, or from `view_scene`.
        technique: Shadow maps, by name (as fine as the first view's map) or as an object, whose own bias is left aside;
            or a filter alone, which reads each view's map. The filter is one of `FAMILIES`; the search begins at its
            own numbers.
        blur_size: Taps of the Gaussian along an axis, odd; None keeps the filter's own prefilter.
        evaluations: Most filters to measure, ≥ 2; each is compiled.
        test_views: Scenes that are only measured.

    Returns:
        `value` name → number; `objective_value` the error; `baselines` "default", the filter's own numbers. Its
        technique is the one given, or one uniform map with the filter, with these numbers.

    Raises:
        ValueError: If a name is wrong, the technique reads no map, its filter has no such numbers, or a size is out of
            range.
    """
    require_untraced("exponent", views, technique, test_views)
    require_int(evaluations, "the number of evaluations", 2)
    views, test_views = as_views(views), as_views(test_views) if test_views != () else ()
    searched = as_maps(technique, views[0].resolution)
    own = filter_of(searched)
    family, chosen = _family_of(own)
    if blur_size is not None:
        own = _with(own, prefilter=Prefilter(blur_size))
    searched = refiltered(searched, own)
    built, test_built = (tuple(view.build(searched) for view in some) for some in (views, test_views))
    tried: dict[tuple[float, ...], float] = {}

    # Each set of numbers is measured once; beyond the budget untried ones count as infinitely bad.
    def error(values: tuple[float, ...]) -> float:
        if values not in tried and len(tried) < evaluations:
            tried[values] = rms_error(views, built, chosen.make(own, values))
        return tried.get(values, math.inf)

    start = chosen.values(own)
    best, scale = start, 1.0
    lowest = error(start)
    while len(tried) < evaluations and scale > 1 / 16:
        before = lowest
        for index, knob in enumerate(chosen.knobs):
            for sign in (1.0, -1.0):
                moved = (*best[:index], knob.move(best[index], sign * scale), *best[index + 1 :])
                if error(moved) < lowest:
                    best, lowest = moved, error(moved)
                    break
        # A round without gain halves all steps, as pattern searches do.
        scale = scale if lowest < before else scale / 2
    ends = tuple(knob.name for knob, value in zip(chosen.knobs, best, strict=True) if value in (knob.low, knob.high))
    names = [knob.name for knob in chosen.knobs]
    number = lambda x: jnp.asarray(x, views[0].exact.dtype)  # noqa: E731
    made = {values: chosen.make(own, values) for values in (best, start)}
    tests = [
        number(rms_error(test_views, test_built, made[values])) if test_views else None for values in (best, start)
    ]
    named = lambda values: {name: number(v) for name, v in zip(names, values, strict=True)}  # noqa: E731
    certificate = FilterCertificate(family, named(start), ends, tests[0], tests[1], tuple(tried.items()))
    result = ended(jnp.asarray(scale <= 1 / 16), optx.RESULTS.nonlinear_max_steps_reached)
    default = {"default": number(tried[start])}
    return Solution(named(best), number(lowest), default, certificate, result, refiltered(searched, made[best]), _KIND)


__all__ = ["FAMILIES", "Family", "FilterCertificate", "SearchParameter", "exponent", "rms_error"]
