"""Best virtual near distance n' by numerical search, with a certificate; the closed forms are held to it."""

import math
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import optimistix as optx

from shadowjax._checked import Checked, checked
from shadowjax._checks import require_choice
from shadowjax._types import Array, ArrayLike, Float
from shadowjax.warps.light_frustum import SECTIONS, LightFrustum, Section
from shadowjax.warps.lispsm import generalised
from shadowjax.warps.minimax import balanced, least_storage, minimax
from shadowjax.warps.prediction import max_error_x, max_error_z, storage_factor

Objective = Callable[[LightFrustum, Array, Section], Array]

OBJECTIVES: dict[str, tuple[Objective, Callable[[LightFrustum, Section], Array]]] = {
    "z": (max_error_z, minimax),
    "storage": (storage_factor, least_storage),
    "both": (
        lambda frustum, q, section: jnp.maximum(max_error_x(frustum, q, section), max_error_z(frustum, q, section)),
        lambda frustum, section: balanced(frustum, section=section),
    ),
}
STEPS = 80  # halvings of a bracket of at most 60 in ln n': finer than float64


class Certificate(Checked):
    """Why a near distance is optimal, as numbers a reader can check.

    Attributes:
        equioscillation: |ln| of the ratio of the z errors at near and far plane; 0 where both are largest.
        slope_below: Derivative of ln(error) by ln(n') just below the optimum; not positive.
        slope_above: The same just above; not negative, unless the optimum is the uniform map.
        uniform: Whether nothing beats the uniform map, whose n' is ∞ and reported as a large number.
        closed_form: n' of the closed form for the same objective.
        difference: |n'/closed_form − 1|, or 0 where both are the uniform map. Large where equally good n' differ: M_x
            over the whole section is constant at γ_lim.
        excess: Objective at the closed form over the objective found, less 1.
    """

    equioscillation: Float[Array, "..."]
    slope_below: Float[Array, "..."]
    slope_above: Float[Array, "..."]
    uniform: Array
    closed_form: Float[Array, "..."]
    difference: Float[Array, "..."]
    excess: Float[Array, "..."]


class NearDistance(Checked):
    """The best n' of a view and a light.

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
    """n' of one frustum by bisecting the sign of the objective's derivative; no closed form is used.

    Every objective here falls, then rises, along n' (or only falls, towards the uniform map), so the sign of its
    derivative by ln n' changes once, at a smooth minimum as well as at a kink between two branches.
    """
    value, _ = OBJECTIVES[objective]
    upper = jnp.log(frustum.uniform_near_distance)
    lower = jnp.log(frustum.near) - math.log(1e6)
    log_error = _log_error(value, frustum, section)

    def rises(x: Array, _: Any) -> Array:
        slope = jax.jvp(log_error, (x,), (jnp.ones_like(x),))[1]
        # A flat stretch counts as falling: of equally good n' take the largest. Rounding of the slope is that of W/n'.
        rounding = 8 * float(jnp.finfo(x.dtype).eps) * jnp.minimum(frustum.extent * jnp.exp(-x), 1.0)
        up = (slope > rounding) | (x >= upper)
        return jnp.where(up & (x > lower), 1.0, -1.0).astype(x.dtype)

    solver = optx.Bisection(rtol=1e-16, atol=1e-16, flip=False)
    ends = {"lower": jax.lax.stop_gradient(lower), "upper": jax.lax.stop_gradient(upper)}
    found = optx.root_find(rises, solver, (lower + upper) / 2, options=ends, max_steps=STEPS, throw=False)
    return jnp.exp(jax.lax.stop_gradient(found.value))


def _log_error(value: Objective, frustum: LightFrustum, section: Section) -> Callable[[Array], Array]:
    return lambda x: jnp.log(value(frustum, jnp.exp(x), section))


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
    log_error, x = _log_error(value, frustum, section), jnp.log(distance)
    step = float(jnp.finfo(x.dtype).eps) ** 0.5 * jnp.ones_like(x)
    slopes = [jax.jvp(log_error, (x + side * step,), (jnp.ones_like(x),))[1] for side in (-1, 1)]
    offset, slope = frustum.worst_line(section)
    high = 1 + offset / distance, 1 + (offset + slope * (frustum.far - frustum.near)) / distance
    unequal = jnp.abs(jnp.log(high[0] ** 2 / frustum.near / (high[1] ** 2 / frustum.far)))
    difference = jnp.where(uniform, jnp.zeros_like(x), jnp.abs(distance / exact - 1))
    certificate = Certificate(
        unequal, slopes[0], slopes[1], uniform, exact, difference, value(frustum, exact, section) / best - 1
    )
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
