"""Best planes between depth slices: every pair of shares of ln(f/n) searched, against equal ratios."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp

from shadowjax._checked import Checked, checked
from shadowjax._checks import require_choice, require_int
from shadowjax._numerics import largest, safe_divide
from shadowjax._types import Array, ArrayLike, Float
from shadowjax.theory.aliasing import near_distances
from shadowjax.theory.aliasing.error import error_pieces, storage_factor
from shadowjax.theory.aliasing.light_frustum import SECTIONS, LightFrustum, Section
from shadowjax.theory.aliasing.optimal import (
    least_storage,
    minimax,
    near_branch_minimum,
    storage_minimum,
    storage_strength,
)
from shadowjax.theory.aliasing.roots import implicit, least

WARPS = {
    "uniform": lambda part, section: near_distances.uniform(part),
    "lispsm": lambda part, section: near_distances.generalised(part),
    "minimax": minimax,
    "least_storage": least_storage,
}
NUM_SHARES = 513  # tried between 0 and 1 before the best is polished


def _second(part: LightFrustum, warp: str, section: Section) -> tuple[Array, Array]:
    """1/n' of what a rule follows where it does not make errors equal, and where it does so."""
    if warp == "lispsm":
        return 1 / near_distances.faded(part), part.gamma < part.gamma_limit
    offset, _ = part.worst_line(section)
    if warp == "minimax":
        strength, other = safe_divide(part.slack(section), offset * part.extent), near_branch_minimum(part, section)
    else:
        strength, other = storage_strength(part, section), storage_minimum(part, section)
    return strength, other > near_distances.equalising(part, section)


def _on_branch(part: LightFrustum, branch: Array | None, warp: str, section: Section) -> tuple[Array, Array]:
    """ln of the eight functions whose largest is S with n' on a branch of its rule, or the one followed; which that is.

    Branches are: errors equal, what the rule follows else, and the uniform map, which bounds both.
    """
    uniform = 1 / part.uniform_near_distance
    if warp == "uniform":
        strength, branch = uniform, jnp.full(uniform.shape, 2)
    else:
        equal = near_distances.equalising(part, section if warp != "lispsm" else "axis")
        # where it is no n' it is not followed, and must not meet a logarithm
        first = 1 / jnp.where(equal > 0, equal, part.extent)
        second, follows = _second(part, warp, section)
        if branch is None:
            branch = jnp.where(jnp.where(follows, second, first) > uniform, follows.astype(int), 2)
        strength = jnp.where(branch == 2, uniform, jnp.where(branch == 1, second, first))
    return error_pieces(part, "storage", section).bent(strength), branch


class SplitCertificate(Checked):
    """Why the planes are optimal; every array has the shape of the views.

    Attributes:
        equal: Objective of equal ratios (warping, eq. 50).
        gain: That over the objective found, ≥ 1; 1 where equal ratios are best.
        slope_spread: For "sum": relative spread of the slices' dS/d ln(f_i/n_i); 0 at a smooth optimum,
            not where slices sit on a kink of S (with "lispsm", at the ratio whose γ_lim is γ).
        storage_spread: For "max": relative spread of the slices' storages; 0 where all are alike.
        starts: How many families of shares were searched.
    """

    equal: Float[Array, "..."]
    gain: Float[Array, "..."]
    slope_spread: Float[Array, "..."]
    storage_spread: Float[Array, "..."]
    starts: int = eqx.field(static=True)


class Splits(Checked):
    """The best planes of views and lights.

    Attributes:
        splits: k + 1 planes along the last axis, world units, n and f included; other axes are those of the views.
        storage: Sum or maximum of the slices' storage factors; it has the shape of the views.
        certificate: Evidence that it is optimal.
    """

    splits: Float[Array, "*views planes"]
    storage: Float[Array, "*views"]
    certificate: SplitCertificate

    def to_json(self) -> dict[str, Any]:
        """Plain numbers, as `optimize splits` writes them."""
        return {
            "splits": self.splits.tolist(),
            "storage": self.storage.tolist(),
            "certificate": {
                name: value.tolist() if isinstance(value, jax.Array) else value
                for name, value in vars(self.certificate).items()
            },
        }


def _parts(view: LightFrustum, log_ratios: Array) -> LightFrustum:
    """Slices of given ln(f_i/n_i); slices of one view are similar, so n_i does not matter."""
    one = jnp.ones_like(log_ratios)
    return LightFrustum(one, jnp.exp(log_ratios), one * view.phi_y, one * view.phi_x, one * view.gamma)


def _storages(view: LightFrustum, log_ratios: Array, warp: str, section: Section) -> Array:
    part = _parts(view, log_ratios)
    return storage_factor(part, WARPS[warp](part, section), section)


class _Pair(eqx.Module):
    """Shares of two lengths: m slices of one ln ratio x, the others alike in what is left.

    Slices are similar, so their order does not matter, and a sum is stationary where slopes are equal: two lengths
    cover all but optima with a third at another branch of the storage, of which none is known.
    """

    view: LightFrustum
    span: Array
    first: Array  # m
    num: int = eqx.field(static=True)
    objective: str = eqx.field(static=True)
    warp: str = eqx.field(static=True)
    section: Section = eqx.field(static=True)

    def lengths(self, x: Array) -> Array:
        """Both ln ratios."""
        return jnp.stack([x, (self.span - self.first * x) / (self.num - self.first)])

    def _joined(self, logs: Array, leads: Array) -> Array:
        if self.objective == "max":
            return logs[leads]
        return jax.nn.logsumexp(logs + jnp.log(jnp.stack([self.first, self.num - self.first])))

    def active(self, x: Array) -> tuple[Array, Array, Array]:
        """Branch and largest function of both slices, and whose storage is the larger."""
        logs, branch = _on_branch(_parts(self.view, self.lengths(x)), None, self.warp, self.section)
        return branch, jnp.argmax(logs, axis=-1), jnp.argmax(jnp.max(logs, axis=-1))

    def value(self, x: Array, piece: tuple[Array, Array, Array]) -> Array:
        """ln of the objective on fixed branches."""
        branch, largest, leads = piece
        logs, _ = _on_branch(_parts(self.view, self.lengths(x)), branch, self.warp, self.section)
        return self._joined(jnp.take_along_axis(logs, largest[:, None], axis=-1)[:, 0], leads)

    def best(self) -> tuple[Array, Array]:
        """x and ln of the objective there: the best of a grid, polished between its neighbours."""
        share = jnp.linspace(0, 1, NUM_SHARES, dtype=self.span.dtype)[1:-1]
        whole = self.span / self.first
        values = jax.vmap(lambda x: self.value(x, self.active(x)))(share * whole)
        index = jnp.clip(jnp.argmin(values), 1, share.shape[0] - 2)
        rounding = 100 * float(jnp.finfo(share.dtype).eps)
        between = share[index - 1] * whole, share[index + 1] * whole
        polished = least(self.value, self.active, *between, lambda x, piece: rounding + 0 * x)
        value = self.value(polished, self.active(polished))
        # Between neighbours there may be two valleys; then the grid's point stands, and has no derivative to give.
        stands = implicit(lambda x: 0 * x, share[index] * whole)
        lower = value <= values[index] + rounding
        return jnp.where(lower, polished, stands), jnp.where(lower, value, values[index])


@checked
def solve(
    frustum: LightFrustum, num_partitions: int, objective: str = "max", warp: str = "uniform", section: Section = "axis"
) -> Splits:
    """Planes and certificate of one frustum; `jit` and `vmap` it for many."""
    k = num_partitions
    dtype = frustum.near.dtype
    span = jnp.log1p((frustum.far - frustum.near) / frustum.near)
    lengths = jnp.full(k, 1 / k, dtype) * span

    def total(each: Array) -> Array:
        return largest(each) if objective == "max" else jnp.sum(each)

    equal = total(_storages(frustum, lengths, warp, section))
    if k > 1:
        firsts = jnp.arange(1, k // 2 + 1).astype(dtype)
        xs, values = jax.vmap(lambda m: _Pair(frustum, span, m, k, objective, warp, section).best())(firsts)
        index = jnp.argmin(values)
        pair = _Pair(frustum, span, firsts[index], k, objective, warp, section).lengths(xs[index])
        unequal = jnp.sort(jnp.where(jnp.arange(k).astype(dtype) < firsts[index], pair[0], pair[1]))
        few = max(1e-9, 8 * float(jnp.finfo(dtype).eps))
        lengths = jnp.where(values[index] < jnp.log(equal) - few, unequal, lengths)
    each, slopes = jax.jvp(
        lambda x: _storages(frustum, x, warp, section), (lengths,), (jnp.ones_like(lengths),)
    )  # fmt: skip
    storage = total(each)
    inner = frustum.near * jnp.exp(jnp.cumsum(lengths))
    planes = jnp.concatenate([frustum.near[None], inner]).at[-1].set(frustum.far)

    def spread(x: Array) -> Array:
        return (jnp.max(x) - jnp.min(x)) / jnp.mean(x)

    certificate = SplitCertificate(equal, equal / storage, spread(slopes), spread(each), k // 2 + 1)
    return Splits(planes, storage, certificate)


@eqx.filter_jit
def _solve_all(frustum: LightFrustum, k: int, objective: str, warp: str, section: Section) -> Splits:
    shape = jnp.broadcast_shapes(*(x.shape for x in jax.tree.leaves(frustum)))
    flat = jax.tree.map(lambda x: jnp.broadcast_to(x, shape).reshape(-1), frustum)
    found = jax.vmap(lambda one: solve(one, k, objective, warp, section))(flat)
    return jax.tree.map(lambda x: x.reshape(*shape, *x.shape[1:]), found)


@checked
def splits(
    near: ArrayLike,
    far: ArrayLike,
    phi: ArrayLike,
    gamma: ArrayLike,
    num_partitions: int,
    objective: str = "max",
    warp: str = "uniform",
    section: str = "axis",
) -> Splits:
    """The planes of least storage for k depth slices, of one or many views.

    The four numbers of a view broadcast against each other; planes stand along a last axis of their own. Planes and
    storage carry their implicit derivative by all four, under `jit` and `vmap`, forward and reverse.

    Equal ratios are best for the maximum of a storage that rises with the slice, and for the sum wherever storage is
    convex in ln(f/n): for uniform maps, and for all warps with the light overhead. Else there are exceptions. With the
    source's eq. 42 and 44 narrow slices fall below their own γ_lim, so slices just wide enough to stay above it, next
    to one narrow one, can need less. With minimax and least-storage n' likewise, at the ratio where a slice changes
    from a uniform to a warped map, or from one formula of n' to the other.

    Args:
        near: Depth n, world units, > 0.
        far: Depth f, world units, > near.
        phi: Half the vertical angle of view, radians, in (0, π/2).
        gamma: Angle between light and view, radians, in [0, π/2].
        num_partitions: k ≥ 1.
        objective: "max", the largest slice's texels, or "sum", all texels.
        warp: "uniform", "lispsm" (eq. 42 with 44), "minimax" or "least_storage".
        section: "axis" or "whole" vertical section, over which errors are taken.

    Raises:
        ValueError: If a number is out of range or a name is unknown.

    Source: warping, eq. 50–51, for any γ.
    """
    require_choice(objective, "objective", ("max", "sum"))
    require_choice(warp, "warp", WARPS)
    checked: Section = require_choice(section, "section", SECTIONS)
    frustum = LightFrustum.create(near, far, phi, gamma)
    k = require_int(num_partitions, "the number of partitions k", 1)
    return _solve_all(frustum, k, objective, warp, checked)


__all__ = ["WARPS", "SplitCertificate", "Splits", "solve", "splits"]
