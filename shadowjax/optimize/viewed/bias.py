"""The bias of least error over a scene: every kind by search, next to the default that theory gives."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from shadowjax._checked import Checked, checked
from shadowjax._checks import require_choice, require_int, require_untraced, warn
from shadowjax._types import Array, Float, Scalar
from shadowjax.bias.kinds import NormalOffset
from shadowjax.bias.rule import Bias, BiasRule
from shadowjax.evaluate.acne import needed_bias
from shadowjax.evaluate.slope_limits import SlopeLimit, slope_limit, told
from shadowjax.filters.base import Filter
from shadowjax.optimize.solution import Solution, SolutionKind, ended, with_maps
from shadowjax.optimize.viewed.views import Viewed, Views, as_maps, as_views, error_of, filter_of, parts_of
from shadowjax.techniques.base import Technique
from shadowjax.techniques.shadow_mapping import MappedShadows

SEARCHED_UNITS = ("world", "texel", "slope", "normal")
ROUNDS = 3  # of the grid: each looks closer round the best value of the one before


class BiasCertificate(Checked):
    """Measurements reported with the bias of least error.

    Attributes:
        unit: "world", "texel", "slope", or "normal" for a normal offset in texels times the sine of incidence.
        default_slope: The default, the least slope bias that frees planes of acne, texels of slope.
        needed_slope: Slope bias that 99 % of the lit receivers need, measured on one uniform map around each scene, the
            largest over the scenes.
        values: Values tried, rising, in the unit.
        errors: Error at each.
        slope_limit: Acne that the default's limit leaves where light grazes, the most over the scenes; None for none.
    """

    unit: str = eqx.field(static=True)
    default_slope: Scalar
    needed_slope: Scalar
    values: Float[Array, "tried"]
    errors: Float[Array, "tried"]
    slope_limit: SlopeLimit | None = eqx.field(static=True, default=None)


_KIND = SolutionKind(
    (
        ("unit", "certificate.unit"), ("value", "value.value"), ("error", "objective_value"),
        ("default_error", "baselines.default"), ("default_slope", "certificate.default_slope"),
        ("no_bias_error", "baselines.none"), ("needed_slope", "certificate.needed_slope"), ("gain", "gain"),
        ("values", "certificate.values"), ("errors", "certificate.errors"),
        ("slope_limit", "certificate.slope_limit"), ("result", "text"),
    ),
    rival="default",
    technique=lambda found, resolution, options: with_maps(
        resolution, options, **{**parts_of(found.problem), "bias": found.value}
    ),
)  # fmt: skip


@checked
def rule_of(unit: str, value: Float[Array, ""]) -> BiasRule:
    """The rule of a unit with one number."""
    return NormalOffset(value, "texel", True) if unit == "normal" else Bias(value, unit)


@eqx.filter_jit
def _errors(shadows: MappedShadows, viewed: Viewed, unit: str, values: Float[Array, "values"]) -> Array:
    """Error of every value, one after the other in one program."""

    def one(value: Array) -> Array:
        changed = eqx.tree_at(lambda s: s.bias, shadows, rule_of(unit, value), is_leaf=lambda x: x is shadows.bias)
        return viewed.error(changed.visibility(viewed.points, viewed.normals))

    return jax.lax.map(one, values)


@checked
def bias(
    views: Views, technique: str | Technique | Filter, unit: str = "slope", num_values: int = 17
) -> Solution[BiasRule, BiasCertificate]:
    """Search the bias of least error over scenes.

    Errors of depth tests are steps in the bias and have no gradient, so values are tried: a grid, then twice a finer
    one round its best.

    Args:
        views: Scenes, their names, or from `view_scene`; errors are root mean squares over all of them.
        technique: Shadow maps, by name (as fine as the first view's map) or as an object, whose own bias is left aside;
            or a filter alone, which reads each view's map.
        unit: "world", "texel", "slope" or "normal".
        num_values: Values in each round, ≥ 5.

    Returns:
        `value` the rule, a `Bias` or a `NormalOffset`, that `ShadowMapping` takes; `objective_value` the error;
        `baselines` "default", the least slope bias that frees planes of acne, against which the gain counts, and
        "none". Its technique is the one given, or one uniform map with the filter, with this bias.

    Raises:
        ValueError: If the unit or a name is unknown, or the technique reads no map.

    Warns:
        SceneWarning: Where the limit of the default slope bias leaves acne, with the remedy.
    """
    require_untraced("bias", views, technique)
    require_choice(unit, "bias unit", SEARCHED_UNITS)
    require_int(num_values, "the number of values", 5)
    views = as_views(views)
    searched = as_maps(technique, views[0].resolution)
    filter_ = filter_of(searched)
    built = [view.build(searched) for view in views]

    def errors(values: np.ndarray, kind: str = unit) -> np.ndarray:
        dtype = views[0].exact.dtype
        asked = jnp.asarray(values, dtype)
        each = [np.asarray(_errors(b, v, kind, asked), float) for b, v in zip(built, views, strict=True)]
        return np.sqrt(np.mean(np.square(each), axis=0))

    tried: dict[float, float] = {}
    # No bias at all, then 64th parts of the largest upwards in equal ratios: errors fall steeply near 0.
    grid = np.concatenate([[0.0], np.geomspace(1 / 64, 1, num_values - 1)]) * _largest(views, filter_, unit)
    for _ in range(ROUNDS):
        tried.update(zip(grid.tolist(), errors(grid).tolist(), strict=True))
        known = sorted(tried)
        best = min(range(len(known)), key=lambda i: (tried[known[i]], known[i]))
        # Between the neighbours of the best so far lies the next, finer round.
        low, high = known[max(best - 1, 0)], known[min(best + 1, len(known) - 1)]
        grid = np.linspace(low, high, num_values)
    value = min(tried, key=lambda v: (tried[v], v))
    # The maps were built with their own default bias, so reading them as they are gives the baseline.
    default = float(np.sqrt(np.mean([float(error_of(b, v)) ** 2 for b, v in zip(built, views, strict=True)])))
    ordered = sorted(tried)
    limits = [
        (view.name, slope_limit(shadows, view.points, view.normals, view.faces, view.exact > 0, view.valid))
        for shadows, view in zip(built, views, strict=True)
    ]
    said = told(limits)
    if said is not None:
        warn(said)
    worst = max((one for _, one in limits if one is not None), key=lambda one: one.acne, default=None)
    dtype = views[0].exact.dtype
    number = lambda x: jnp.asarray(x, dtype)  # noqa: E731
    certificate = BiasCertificate(
        unit, number(filter_.bias_reach), number(_needed(views, filter_)), number(ordered),
        number([tried[v] for v in ordered]), worst,
    )  # fmt: skip
    baselines = {"default": number(default), "none": number(tried[0.0])}
    error = number(tried[value])
    rule = rule_of(unit, number(value))
    return Solution(rule, error, baselines, certificate, ended(jnp.isfinite(error)), searched, _KIND)


def _largest(views: tuple[Viewed, ...], filter_: Filter, unit: str) -> float:
    """Where the search ends: four times what planes need at 45°, in the unit."""
    # At 45° a plane's depth changes by a texel over a texel; half a texel is a lookup without a filter.
    texels = 4.0 * max(filter_.reach, 0.5)
    if unit != "world":
        return texels
    grid = views[0].shadows.maps[0].grid
    across, _ = grid.cell_vectors(views[0].points[:1])
    return texels * float(jnp.linalg.norm(across[0]))


def _needed(views: tuple[Viewed, ...], filter_: Filter) -> float:
    """Slope bias that 99 % of lit receivers need for as many taps as reach so far."""
    size = max(1, round(2 * filter_.reach))
    return max(
        needed_bias(
            view.shadows, view.mesh, view.points, view.normals, view.faces, (view.exact > 0) & view.valid, size
        ).least("slope", 0.99)
        for view in views
    )


__all__ = ["SEARCHED_UNITS", "BiasCertificate", "bias", "rule_of"]
