"""Best virtual near distance n' by numerical search, with a certificate; the closed forms are held to it."""

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp

from shadowjax._checked import Checked, checked
from shadowjax._checks import require_choice
from shadowjax._numerics import larger
from shadowjax._types import Array, ArrayLike, Float
from shadowjax.theory.aliasing.error import error_pieces, max_error_x, max_error_z, storage_factor
from shadowjax.theory.aliasing.light_frustum import SECTIONS, LightFrustum, Section
from shadowjax.theory.aliasing.near_distances import generalised
from shadowjax.theory.aliasing.optimal import balanced, least_storage, minimax
from shadowjax.theory.aliasing.roots import least_largest
from shadowjax.theory.aliasing.rounding import rounding_bound


class Objective(NamedTuple):
    """What an n' is to make least.

    Attributes:
        value: The objective of a frustum, an n' and a section.
        closed: The best n' in closed form.
    """

    value: Callable[[LightFrustum, Array, Section], Array]
    closed: Callable[[LightFrustum, Section], Array]


def _larger(frustum: LightFrustum, near_distance: Array, section: Section) -> Array:
    return larger(max_error_x(frustum, near_distance, section), max_error_z(frustum, near_distance, section))


OBJECTIVES: dict[str, Objective] = {
    "z": Objective(max_error_z, minimax),
    "storage": Objective(storage_factor, least_storage),
    "both": Objective(_larger, lambda frustum, section: balanced(frustum, section=section)),
}


class Certificate(Checked):
    """Why a near distance is optimal, as numbers a reader can check.

    Attributes:
        equioscillation: |ln| of the ratio of the z errors at near and far plane; 0 where both are largest.
        slope_below: Derivative of ln(error) by ln(n') just below the optimum; not positive.
        slope_above: The same just above; not negative, unless the optimum is the uniform map.
        uniform: Whether nothing beats the uniform map, whose n' is ∞ and reported as a large number.
        closed_form: n' of the closed form for the same objective.
        difference: |n' − closed_form| over the larger of them, in [0, 1); 0 where both are the uniform map.
        equally_good: Whether the objective at both is the same to within `rounding` of each; then a difference only
            says that the optimum is flat: M_x over the whole section is constant at γ_lim.
        excess: Objective at the closed form over the objective found, less 1.
        rounding: Bound on the relative rounding error of `error`, by running error analysis of its own sums and
            products for the numbers given (`shadowjax.theory.aliasing.rounding`): sums that lose digits make it large.
    """

    equioscillation: Float[Array, "..."]
    slope_below: Float[Array, "..."]
    slope_above: Float[Array, "..."]
    uniform: Array
    closed_form: Float[Array, "..."]
    difference: Float[Array, "..."]
    equally_good: Array
    excess: Float[Array, "..."]
    rounding: Float[Array, "..."]


class NearDistance(Checked):
    """The best n' of views and lights; every field has the shape that the views' numbers broadcast to.

    Attributes:
        near_distance: n', world units.
        error: Value of the objective there.
        published: n' of the source's eq. 42 with 44.
        gain: Objective at the published n' over the objective here, ≥ 1.
        certificate: Evidence that it is optimal.
    """

    near_distance: Float[Array, "..."]
    error: Float[Array, "..."]
    published: Float[Array, "..."]
    gain: Float[Array, "..."]
    certificate: Certificate

    def to_json(self) -> dict[str, Any]:
        """Plain numbers, as `optimize near-distance` writes them."""
        numbers = {name: _plain(getattr(self, name)) for name in ("near_distance", "error", "published", "gain")}
        return {**numbers, "certificate": {name: _plain(value) for name, value in vars(self.certificate).items()}}


def _plain(value: Array) -> Any:
    return value.tolist()


@checked
def search(frustum: LightFrustum, objective: str = "z", section: Section = "axis") -> Float[Array, ""]:
    """n' of one frustum by bisecting the sign of the objective's slope along ln n'; no closed form is used.

    Every objective here falls, then rises, along n', or only falls, towards the uniform map. The optimum carries its
    implicit derivative: at a smooth minimum from the slope, at a kink from the two pieces that meet there.
    """
    pieces = error_pieces(frustum, objective, section)
    rounding = 4 * float(jnp.finfo(frustum.near.dtype).eps)
    low = jnp.log(frustum.near) - math.log(1e6)
    high = jnp.log(frustum.uniform_near_distance)
    found = least_largest(lambda x: pieces.logs(jnp.exp(x)), low, high, lambda x: rounding * pieces.terms(jnp.exp(x)))
    return jnp.exp(found)


@checked
def solve(frustum: LightFrustum, objective: str = "z", section: Section = "axis") -> NearDistance:
    """Search and certificate of one frustum; `jit` and `vmap` it for many."""
    value, closed = OBJECTIVES[objective]
    distance = search(frustum, objective, section)
    best = value(frustum, distance, section)
    published = generalised(frustum)
    exact = closed(frustum, section)
    # beyond this n' the objective differs from the uniform map's by less than rounding
    flat = 1e-3 * frustum.uniform_near_distance
    uniform = (distance > flat) & (exact > flat)
    x = jnp.log(distance)
    step = float(jnp.finfo(x.dtype).eps) ** 0.5 * jnp.ones_like(x)
    pieces = error_pieces(frustum, objective, section)
    largest = lambda x: jnp.max(pieces.logs(jnp.exp(x)))  # noqa: E731
    slopes = [jax.jvp(largest, (x + side * step,), (jnp.ones_like(x),))[1] for side in (-1, 1)]
    along = error_pieces(frustum, "z", section).logs(distance)
    unequal = jnp.abs(along[0] - along[1])
    difference = jnp.where(uniform, jnp.zeros_like(x), jnp.abs(distance - exact) / jnp.maximum(distance, exact))
    excess = value(frustum, exact, section) / best - 1
    bound = rounding_bound(frustum, distance, objective, section)
    alike = jnp.abs(excess) <= 2 * bound
    certificate = Certificate(unequal, slopes[0], slopes[1], uniform, exact, difference, alike, excess, bound)
    return NearDistance(distance, best, published, value(frustum, published, section) / best, certificate)


@eqx.filter_jit
def _solve_all(frustum: LightFrustum, objective: str, section: Section) -> NearDistance:
    shape = jnp.broadcast_shapes(*(x.shape for x in jax.tree.leaves(frustum)))
    flat = jax.tree.map(lambda x: jnp.broadcast_to(x, shape).reshape(-1), frustum)
    found = jax.vmap(lambda one: solve(one, objective, section))(flat)
    return jax.tree.map(lambda x: x.reshape(shape), found)


@checked
def near_distance(
    near: ArrayLike,
    far: ArrayLike,
    phi: ArrayLike,
    gamma: ArrayLike,
    section: str = "axis",
    objective: str = "z",
) -> NearDistance:
    """The best n' of a perspective warp for one or many views and lights.

    The four numbers of a view broadcast against each other, and every result has their shape. n' and its error carry
    their implicit derivative by all four, under `jit` and `vmap`, forward and reverse.

    Args:
        near: Depth n of the near plane, world units, > 0.
        far: Depth f of the far plane, world units, > near.
        phi: Half the vertical angle of view, radians, in (0, π/2).
        gamma: Angle between light and view directions, radians, in [0, π/2].
        section: "axis", the view axis only, or "whole", the whole vertical section.
        objective: "z" for least M_z, "storage" for least M_x·M_z, "both" for least max(M_x, M_z).

    Raises:
        ValueError: If a number is out of range or a name is unknown.

    Source: warping, eq. 37–42; the optima below γ_lim and over the whole section are derived here.
    """
    checked: Section = require_choice(section, "section", SECTIONS)
    require_choice(objective, "objective", OBJECTIVES)
    return _solve_all(LightFrustum.create(near, far, phi, gamma), objective, checked)


__all__ = ["OBJECTIVES", "Certificate", "NearDistance", "near_distance", "search", "solve"]
