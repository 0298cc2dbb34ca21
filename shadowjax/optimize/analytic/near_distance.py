"""Best virtual near distance n' by numerical search, with a certificate; the closed forms are held to it."""

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp

from shadowjax._checked import Checked, checked
from shadowjax._checks import require_choice
from shadowjax._numerics import larger, largest
from shadowjax._types import Array, ArrayLike, Float
from shadowjax.optimize.solution import Solution, SolutionKind, ended, with_slices
from shadowjax.theory.aliasing.error import error_pieces, max_error_x, max_error_z, storage_factor
from shadowjax.theory.aliasing.light_frustum import SECTIONS, LightFrustum, Section
from shadowjax.theory.aliasing.near_distances import generalised
from shadowjax.theory.aliasing.optimal import balanced, least_storage, minimax
from shadowjax.theory.aliasing.roots import least_largest
from shadowjax.theory.aliasing.rounding import rounding_bound


class Objective(NamedTuple):
    """What an n' is to make least; it must fall, then rise, along n', or do only one of both.

    Attributes:
        value: The objective of an n', a frustum and a section; positive.
        error: Name of the smooth functions whose largest it is, for `error_pieces`.
        closed: The best n' in closed form, if there is one.
        pieces: Smooth functions of n' and frustum whose largest is `value`, where `error` names none.
    """

    value: Callable[[Array, LightFrustum, Section], Array]
    error: str | None = None
    closed: Callable[[LightFrustum, Section], Array] | None = None
    pieces: Callable[[Array, LightFrustum], Array] | None = None


Functions = Callable[[Array], Array]
# n' and frustum → a positive number, or several smooth ones along a last axis, of which the largest counts.
Rated = Callable[[Array, LightFrustum], Array]


def _of_frustum(error: Callable[[LightFrustum, Array, Section], Array]) -> Callable[..., Array]:
    return lambda near_distance, frustum, section: error(frustum, near_distance, section)


def _larger(near_distance: Array, frustum: LightFrustum, section: Section) -> Array:
    return larger(max_error_x(frustum, near_distance, section), max_error_z(frustum, near_distance, section))


# Each is an `Objective`, or a function of n' and frustum as users give it; one line each.
WARP_OBJECTIVES: dict[str, Objective | Rated] = {
    "z": Objective(_of_frustum(max_error_z), "z", minimax),
    "storage": Objective(_of_frustum(storage_factor), "storage", least_storage),
    "both": Objective(_larger, "both", lambda frustum, section: balanced(frustum, section=section)),
}


@checked
def objective_of(objective: str | Rated) -> Objective:
    """The objective of a name, or of a function of n' and frustum.

    Raises:
        ValueError: If the name is unknown.
    """
    found: Any = objective
    if isinstance(objective, str):
        found = WARP_OBJECTIVES[require_choice(objective, "objective", WARP_OBJECTIVES)]
    if isinstance(found, Objective):
        return found

    def pieces(near_distance: Array, frustum: LightFrustum) -> Array:
        return jnp.atleast_1d(jnp.asarray(found(near_distance, frustum), near_distance.dtype))

    return Objective(lambda q, frustum, section: largest(pieces(q, frustum)), pieces=pieces)


class Certificate(Checked):
    """Why a near distance is optimal, as numbers a reader can check; every array has the shape of the views.

    Attributes:
        published: n' of the source's eq. 42 with 44.
        equioscillation: |ln| of the ratio of the z errors at near and far plane; 0 where both are largest.
        slope_below: Derivative of ln(objective) by ln(n') just below the optimum; not positive.
        slope_above: The same just above; not negative, unless the optimum is the uniform map.
        uniform: Whether nothing beats the uniform map, whose n' is ∞ and reported as a large number.
        closed_form: n' of the closed form for the same objective; None, as the next four, where there is none.
        difference: |n' − closed_form| over the larger of them, in [0, 1); 0 where both are the uniform map.
        equally_good: Whether the objective at both is the same to within `rounding` of each; then a difference only
            says that the optimum is flat: M_x over the whole section is constant at γ_lim.
        excess: Objective at the closed form over the objective found, less 1.
        rounding: Bound on the relative rounding error of the objective, by running error analysis of its own sums and
            products for the numbers given (`shadowjax.theory.aliasing.rounding`): sums that lose digits make it large.
    """

    published: Float[Array, "..."]
    equioscillation: Float[Array, "..."]
    slope_below: Float[Array, "..."]
    slope_above: Float[Array, "..."]
    uniform: Array
    closed_form: Float[Array, "..."] | None = None
    difference: Float[Array, "..."] | None = None
    equally_good: Array | None = None
    excess: Float[Array, "..."] | None = None
    rounding: Float[Array, "..."] | None = None


NearDistance = Solution[Float[Array, "*views"], Certificate]

_KIND = SolutionKind(
    (
        ("near_distance", "value"), ("error", "objective_value"), ("published", "certificate.published"),
        ("gain", "gain"), ("certificate", "certificate"),
    ),
    technique=lambda found, resolution, options: with_slices(
        jnp.stack([found.problem.near, found.problem.far]), found.value[None], resolution, options
    ),
)  # fmt: skip


def _logs(objective: Objective, frustum: LightFrustum, section: Section) -> tuple[Functions, Functions]:
    """ln of the smooth functions whose largest is the objective, of ln n'; and slopes of each that are rounding."""
    eps = float(jnp.finfo(frustum.near.dtype).eps)
    if objective.error is not None:
        known = error_pieces(frustum, objective.error, section)
        return lambda x: known.logs(jnp.exp(x)), lambda x: 4 * eps * known.terms(jnp.exp(x))
    pieces = objective.pieces or (lambda q, frustum: objective.value(q, frustum, section)[None])
    logs = lambda x: jnp.log(pieces(jnp.exp(x), frustum))  # noqa: E731
    # How many digits a function that is only given loses is not known.
    return logs, lambda x: jnp.full_like(logs(x), 100 * eps)


def _search(objective: Objective, frustum: LightFrustum, section: Section) -> Array:
    logs, flat = _logs(objective, frustum, section)
    # Along ln n' every objective falls, then rises; a millionth of n is below any n' of use, the top is the uniform
    # map.
    low = jnp.log(frustum.near) - math.log(1e6)
    high = jnp.log(frustum.uniform_near_distance)
    return jnp.exp(least_largest(logs, low, high, flat))


@checked
def search(frustum: LightFrustum, objective: str | Rated = "z", section: Section = "axis") -> Float[Array, "..."]:
    """n' of every view by bisecting the sign of the objective's slope along ln n'; no closed form is used.

    Every objective here falls, then rises, along n', or only falls, towards the uniform map. The optimum carries its
    implicit derivative: at a smooth minimum from the slope, at a kink from the two pieces that meet there.
    """
    objective_of(objective)
    return _search_each(frustum, objective, section)


# One program, whatever the number of views: called as they stand, hundreds of small ones would be compiled.
@eqx.filter_jit
def _search_each(frustum: LightFrustum, objective: str | Rated, section: Section) -> Array:
    asked = objective_of(objective)
    return frustum.each(lambda one: _search(asked, one, section))


@checked
def solve_views(frustum: LightFrustum, objective: str | Rated = "z", section: Section = "axis") -> NearDistance:
    """Search and certificate of every view."""
    objective_of(objective)
    return _solve_each(frustum, objective, section)


@eqx.filter_jit
def _solve_each(frustum: LightFrustum, objective: str | Rated, section: Section) -> NearDistance:
    asked = objective_of(objective)
    return frustum.each(lambda one: _solve(one, asked, section))


def _solve(frustum: LightFrustum, asked: Objective, section: Section) -> NearDistance:
    distance = _search(asked, frustum, section)
    value = lambda q: asked.value(q, frustum, section)  # noqa: E731
    best, published, flat = value(distance), generalised(frustum), 1e-3 * frustum.uniform_near_distance
    exact = None if asked.closed is None else asked.closed(frustum, section)
    # beyond this n' the objective differs from the uniform map's by less than rounding
    uniform = (distance > flat) if exact is None else (distance > flat) & (exact > flat)
    x, eps = jnp.log(distance), float(jnp.finfo(distance.dtype).eps)
    # Slopes are taken √ε to both sides of the optimum, in ln n': a kink shows both signs, a smooth minimum none.
    step = eps**0.5 * jnp.ones_like(x)
    logs, _ = _logs(asked, frustum, section)
    largest_log = lambda x: jnp.max(logs(x))  # noqa: E731
    below, above = (jax.jvp(largest_log, (x + side * step,), (jnp.ones_like(x),))[1] for side in (-1, 1))
    # The near and the far piece of M_z: equal where the minimax equioscillates (eq. 39).
    along = error_pieces(frustum, "z", section).logs(distance)
    certificate = Certificate(published, jnp.abs(along[0] - along[1]), below, above, uniform)
    if exact is not None and asked.error is not None:
        # Where both are the uniform map, how large the numbers are that stand for ∞ has no meaning.
        difference = jnp.where(uniform, jnp.zeros_like(x), jnp.abs(distance - exact) / jnp.maximum(distance, exact))
        excess, bound = value(exact) / best - 1, rounding_bound(frustum, distance, asked.error, section)
        # Both objectives carry a rounding error of up to `bound` each.
        alike = jnp.abs(excess) <= 2 * bound
        certificate = Certificate(
            published, jnp.abs(along[0] - along[1]), below, above, uniform, exact, difference, alike, excess, bound
        )
    # Falling before, rising after, up to what a step of √ε can say; the uniform map needs no rise after it.
    stands = (below <= 1e3 * step) & ((above >= -1e3 * step) | (distance > flat))
    baselines = {"published": value(published), "uniform": value(frustum.uniform_near_distance)}
    return Solution(distance, best, baselines, certificate, ended(jnp.isfinite(best) & stands), frustum, _KIND)


@checked
def near_distance(
    near: ArrayLike,
    far: ArrayLike,
    phi: ArrayLike,
    gamma: ArrayLike,
    section: str = "axis",
    objective: str | Rated = "z",
) -> NearDistance:
    """The best n' of a perspective warp for one or many views and lights.

    The four numbers of a view broadcast against each other, and every result has their shape. n' and its objective
    carry their implicit derivative by all four, under `jit` and `vmap`, forward and reverse.

    Args:
        near: Depth n of the near plane, world units, > 0.
        far: Depth f of the far plane, world units, > near.
        phi: Half the vertical angle of view, radians, in (0, π/2).
        gamma: Angle between light and view directions, radians, in [0, π/2].
        section: "axis", the view axis only, or "whole", the whole vertical section.
        objective: "z" for least M_z, "storage" for least M_x·M_z, "both" for least max(M_x, M_z); or a function of n'
            and the `LightFrustum` of one view that gives a positive number, or several smooth ones in a row whose
            largest counts. Along n' it must fall, then rise, or do only one of both.

    Returns:
        `value` n', world units; `objective_value`; `baselines` "published", the source's eq. 42 with 44, and "uniform";
        all in the shape of the views. Its technique is one perspective map from near to far.

    Raises:
        ValueError: If a number is out of range or a name is unknown.

    Source: warping, eq. 37–42; the optima below γ_lim and over the whole section are derived here.
    """
    checked: Section = require_choice(section, "section", SECTIONS)
    return solve_views(LightFrustum.create(near, far, phi, gamma), objective, checked)


__all__ = [
    "WARP_OBJECTIVES",
    "Certificate",
    "NearDistance",
    "Objective",
    "Rated",
    "near_distance",
    "objective_of",
    "search",
    "solve_views",
]
