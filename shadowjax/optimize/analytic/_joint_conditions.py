"""Planes and near distances together as a smooth problem: objective, constraints, and the conditions of an optimum."""

import functools
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp

from shadowjax._checked import checked
from shadowjax._numerics import larger
from shadowjax._types import Array, Float
from shadowjax.optimize.analytic.slices import WARPS, similar
from shadowjax.theory.aliasing.error import error_pieces, error_x, error_z
from shadowjax.theory.aliasing.light_frustum import LightFrustum, Section


def distances_of(parts: LightFrustum, bend: Array, warp: str, section: Section) -> Array:
    """n' of slices: by rule, or W(1 − b)/b of free bends b = W/(n' + W) in (0, 1), of which 0 is the uniform map."""
    if warp != "free":
        return WARPS[warp](parts, section)
    # b = W/(n' + W) solved for n'; b near 0 gives ∞, which `bounded` takes.
    return parts.bounded(parts.extent * (1 - bend) / bend)


@checked
def log_storages(frustum: LightFrustum, near_distance: Array, section: Section) -> Float[Array, "slices 8"]:
    """ln of the eight smooth functions whose largest is a slice's S.

    Their maximum is smooth nowhere that matters, so the optimiser is given all eight as constraints.
    """
    return error_pieces(frustum, "storage", section).logs(near_distance)


@checked
def log_jumps(parts: LightFrustum, distance: Array) -> Float[Array, "cuts 2"]:
    """ln of the error after over the error before each cut, for m_x and m_z on the view axis, of similar slices."""

    def jump(error: Any) -> Array:
        # seen from the cut, both slices have it at depth 1: errors of similar slices do not depend on scale
        return jnp.log(error(parts, distance, parts.near)[1:] / error(parts, distance, parts.far)[:-1])

    return jnp.stack([jump(error_x), jump(error_z)], axis=-1)


def excesses(parts: LightFrustum, distance: Array) -> Float[Array, "cuts 6"]:
    """Functions of each cut whose largest is the jump's logarithm, up or down, for m_x and m_z.

    A slice is as wide as its near or its far plane needs. Each of these widths is a function of its own where it makes
    a jump larger, for the optimum may lie where both are equal.
    """
    strength = 1 / distance
    # ln of both candidates z/(1 + low/n') for P's half width; m_x is their maximum times (1 + offset/n')/z.
    planes = (parts.near, parts.low_near), (parts.far, parts.low_far)
    widths = jnp.stack([jnp.log(depth) - jnp.log1p(strength * low) for depth, low in planes])

    def worst(depth: Array) -> Array:
        return jnp.log1p(parts.offset(depth) * strength) - jnp.log(depth)

    # Errors at a cut: of the slice behind it at its near plane, of the one in front at its far plane; tan φ_x and scale
    # cancel between them.
    after = widths[:, 1:] + worst(parts.near)[1:]
    before = widths[:, :-1] + worst(parts.far)[:-1]
    # Upwards each candidate of the numerator is a constraint; the denominator is a maximum, so the difference stays
    # below it as a whole. Downwards the roles change.
    up, down = after - larger(before[0], before[1]), before - larger(after[0], after[1])
    along = log_jumps(parts, distance)[:, 1]
    return jnp.stack([*up, *down, along, -along], axis=-1)


class Problem(NamedTuple):
    """What is asked for, apart from numbers."""

    k: int
    objective: str
    warp: str
    section: Section
    limited: bool


def functions_of(v: Array, view: LightFrustum, limit: Array, kind: Problem) -> tuple[Array, Array]:
    """The objective and all constraints (≥ 0), at log ratios, bends and ln S."""
    k = kind.k
    log_ratios, bend, level = v[:k], v[k : 2 * k], v[2 * k :]
    parts = similar(view, log_ratios)
    distance = distances_of(parts, bend, kind.warp, kind.section)
    # Epigraph form: each level is a variable above its slice's eight pieces, so that minimising it finds their maximum.
    above = level[:, None] - log_storages(parts, distance, kind.section)
    held = [above.reshape(-1)]
    if kind.limited:
        held.append((limit - excesses(parts, distance)).reshape(-1))
    # ln of the sum of storages, from their logarithms without overflow.
    worst = level[0] if kind.objective == "max" else jax.nn.logsumexp(level)
    return worst, jnp.concatenate(held)


# A search asks for these thousands of times: one vector of near, far, φ_y, φ_x, γ and limit is quickly given.
@functools.partial(jax.jit, static_argnames="kind")
def functions_and_slopes(v: Array, numbers: Float[Array, "6"], kind: Problem) -> tuple[Any, Any]:
    """Value and slope of the objective, and values and slopes of all constraints."""
    *fields, limit = numbers
    functions = lambda v: functions_of(v, LightFrustum(*fields), limit, kind)  # noqa: E731
    return functions(v), jax.jacfwd(functions)(v)


@functools.partial(jax.jit, static_argnames="kind")
def storages_and_jumps(v: Array, numbers: Float[Array, "6"], kind: Problem) -> tuple[Array, Array]:
    """ln of every slice's storage, and ln of the jumps at cuts."""
    view = LightFrustum(*numbers[:-1])
    parts = similar(view, v[: kind.k])
    distance = distances_of(parts, v[kind.k : 2 * kind.k], kind.warp, kind.section)
    return jnp.max(log_storages(parts, distance, kind.section), axis=-1), log_jumps(parts, distance)


def condition_of(
    z: Array, view: LightFrustum, limit: Array, start: Array, holds: Array, fixed: Array, kind: Problem
) -> Array:
    """What vanishes at a stationary point: balance of slopes, active constraints, the sum of log ratios."""
    num = start.shape[0]
    v, forces = z[:num], z[num:]
    span = jnp.log1p((view.far - view.near) / view.near)
    sums = (jnp.arange(num) < kind.k).astype(v.dtype)

    # The Lagrangian: its gradient by v vanishes at an optimum (stationarity).
    def balance(v: Array) -> Array:
        worst, held = functions_of(v, view, limit, kind)
        return worst - jnp.sum(jnp.where(holds, forces[:-1] * held, 0.0)) - forces[-1] * jnp.sum(sums * v)

    _, held = functions_of(v, view, limit, kind)
    # A fixed variable keeps its value instead; an inactive constraint has its multiplier held at 0 instead of its
    # value.
    slopes = jnp.where(fixed, v - start, jax.grad(balance)(v))
    return jnp.concatenate([slopes, jnp.where(holds, held, forces[:-1]), (jnp.sum(sums * v) - span)[None]])


@eqx.filter_jit
def condition_and_slope(z: Array, *args: Any) -> tuple[Array, Array]:
    """`condition_of`, and its derivative by the variables and multipliers."""
    condition = lambda z: condition_of(z, *args)  # noqa: E731
    return condition(z), jax.jacfwd(condition)(z)


__all__ = [
    "Problem",
    "condition_and_slope",
    "condition_of",
    "distances_of",
    "functions_and_slopes",
    "functions_of",
    "log_jumps",
    "log_storages",
    "storages_and_jumps",
]
