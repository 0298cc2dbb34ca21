"""Exponents, damping, terms and bleed clamps of least error over scenes, by pattern search."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import optimistix as optx

from shadowjax._checked import Checked, checked
from shadowjax._checks import require_choice, require_int, require_untraced
from shadowjax._types import Scalar
from shadowjax.filters.base import Filter
from shadowjax.filters.convolution import Convolution, FourierStep
from shadowjax.filters.exponential import Exponential
from shadowjax.filters.exponential_variance import ExponentialVariance
from shadowjax.filters.moment import Moments
from shadowjax.filters.prefilter import Prefilter
from shadowjax.filters.variance import Variance
from shadowjax.optimize.solution import Kind, Solution, ended, with_maps
from shadowjax.optimize.viewed.views import Viewed, Views, as_views, error_of
from shadowjax.theory.limits import largest_exponent


@checked
@dataclass(frozen=True)
class SearchParameter:
    """One number of a filter that is searched.

    Attributes:
        name: Of the number.
        start: Where the search begins: the filter's default.
        low: Least value.
        high: Largest value.
        step: First step: a factor if `log`, else a difference.
        log: Whether steps multiply.
        whole: Whether only whole numbers count.
    """

    name: str
    start: float
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
    """A filter with numbers to search.

    Attributes:
        knobs: The numbers.
        make: From their values, in order, and a blur to the filter.
    """

    knobs: tuple[SearchParameter, ...]
    make: Callable[[tuple[float, ...], Prefilter], Filter]


# A margin below the limit keeps the planar term of the second moment finite too.
_ONE, _TWO = (0.97 * largest_exponent(jnp.float32, moments) for moments in (1, 2))
_BLEED = SearchParameter("bleed_low", 0.0, 0.0, 0.9, 0.15)

FAMILIES: dict[str, Family] = {
    "vsm": Family((_BLEED,), lambda v, blur: Variance(prefilter=blur, bleed_low=v[0])),
    "esm": Family(
        (SearchParameter("exponent", 80.0, 2.0, 2000.0, 2.0, log=True),),
        lambda v, blur: Exponential(exponent=v[0], prefilter=blur),
    ),
    "esm-linear": Family(
        (SearchParameter("exponent", 0.8 * _ONE, 2.0, _ONE, 2.0, log=True),),
        lambda v, blur: Exponential(exponent=v[0], prefilter=blur, space="linear"),
    ),
    "evsm2": Family(
        (SearchParameter("positive", 40.0, 1.0, _TWO, 2.0, log=True), _BLEED),
        lambda v, blur: ExponentialVariance(positive=v[0], negative=None, prefilter=blur, bleed_low=v[1]),
    ),
    "evsm4": Family(
        (
            SearchParameter("positive", 40.0, 1.0, _TWO, 2.0, log=True),
            SearchParameter("negative", 5.0, 0.5, _TWO, 2.0, log=True),
            _BLEED,
        ),
        lambda v, blur: ExponentialVariance(positive=v[0], negative=v[1], prefilter=blur, bleed_low=v[2]),
    ),
    "msm": Family((_BLEED,), lambda v, blur: Moments(prefilter=blur, bleed_low=v[0])),
    "csm": Family(
        (SearchParameter("terms", 16.0, 2.0, 16.0, 4.0, whole=True), SearchParameter("damping", 1.0, 0.0, 4.0, 0.5)),
        lambda v, blur: Convolution(step=FourierStep(int(v[0]), v[1]), prefilter=blur),
    ),
}  # fmt: skip


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


KIND = Kind(
    (
        ("family", "certificate.family"), ("numbers", "value"), ("error", "objective_value"),
        ("default_numbers", "certificate.default_numbers"), ("default_error", "baselines.default"), ("gain", "gain"),
        ("at_bound", "certificate.at_bound"), ("test_error", "certificate.test_error"),
        ("test_default_error", "certificate.test_default_error"), ("tried", "certificate.tried"), ("result", "text"),
    ),
    rival="default",
    technique=lambda found, resolution, options: with_maps(resolution, options, filter=found.problem),
)  # fmt: skip


@checked
def mean_error(views: tuple[Viewed, ...], filter_: Filter) -> float:
    """Root mean square over scenes of a filter's error, with its default bias."""
    return float(np.sqrt(np.mean([float(error_of(view.read(filter_), view)) ** 2 for view in views])))


@checked
def exponent(
    views: Views,
    family: str = "evsm4",
    blur_size: int = 7,
    evaluations: int = 24,
    test_views: Views = (),
) -> Solution[dict[str, Scalar], FilterCertificate]:
    """The exponents, damping, terms and bleed clamp of a filter that make least error, by pattern search.

    A step up or down along each number in turn; steps halve when none helps.

    Args:
        views: Scenes to search over, their names, or from `view_scene`.
        family: Key of `FAMILIES`.
        blur_size: Taps of the Gaussian along an axis, odd.
        evaluations: Most filters to measure, ≥ 2; each is compiled.
        test_views: Scenes that are only measured.

    Returns:
        `value` name → number; `objective_value` the error; `baselines` "default", the filter's own numbers. Its
        technique is one uniform map with the filter of these numbers.

    Raises:
        ValueError: If the family is unknown or a size is out of range.
    """
    require_untraced("exponent", views, test_views)
    require_choice(family, "filter", FAMILIES)
    require_int(evaluations, "the number of evaluations", 2)
    views, test_views = as_views(views), as_views(test_views) if test_views != () else ()
    chosen, blur = FAMILIES[family], Prefilter(blur_size)
    tried: dict[tuple[float, ...], float] = {}

    # Each set of numbers is measured once; beyond the budget untried ones count as infinitely bad.
    def error(values: tuple[float, ...]) -> float:
        if values not in tried and len(tried) < evaluations:
            tried[values] = mean_error(views, chosen.make(values, blur))
        return tried.get(values, math.inf)

    start = tuple(knob.start for knob in chosen.knobs)
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
    tests = [number(mean_error(test_views, chosen.make(v, blur))) if test_views else None for v in (best, start)]
    named = lambda values: {name: number(v) for name, v in zip(names, values, strict=True)}  # noqa: E731
    certificate = FilterCertificate(family, named(start), ends, tests[0], tests[1], tuple(tried.items()))
    result = ended(jnp.asarray(scale <= 1 / 16), optx.RESULTS.nonlinear_max_steps_reached)
    default = {"default": number(tried[start])}
    return Solution(named(best), number(lowest), default, certificate, result, chosen.make(best, blur), KIND)


__all__ = ["FAMILIES", "Family", "FilterCertificate", "SearchParameter", "exponent", "mean_error"]
