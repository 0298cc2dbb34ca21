"""Optimal split planes for depth slices whose n' follows a rule: slices of two lengths, compared with equal ratios."""

import equinox as eqx
import jax
import jax.numpy as jnp

from shadowjax._checked import Checked, checked
from shadowjax._numerics import safe_divide
from shadowjax._types import Array, Float
from shadowjax.optimize.analytic.slices import SLICES_KIND, WARPS, Slices, equal_ratios, similar, storages, total
from shadowjax.optimize.solution import Solution, ended
from shadowjax.theory.aliasing import near_distances
from shadowjax.theory.aliasing.error import error_pieces
from shadowjax.theory.aliasing.light_frustum import LightFrustum, Section
from shadowjax.theory.aliasing.optimal import near_branch_minimum, storage_minimum, storage_strength
from shadowjax.theory.aliasing.roots import implicit, least

NUM_SHARES = 513  # tried between 0 and 1 before the best is polished


def _second(part: LightFrustum, warp: str, section: Section) -> tuple[Array, Array]:
    """1/n' of what a rule follows where it does not make errors equal, and where it does so."""
    if warp == "lispsm":
        return 1 / near_distances.faded(part), part.gamma < part.gamma_limit
    offset, _ = part.worst_line(section)
    # The near branch's minimum as a strength: (W − 2E)/(E·W), which passes through 0 where the uniform map takes over.
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
        # `lispsm` is the source's own n' on the axis, whatever the section its errors are taken over.
        equal = near_distances.equalising(part, section if warp != "lispsm" else "axis")
        # where it is no n' it is not followed, and must not meet a logarithm
        first = 1 / jnp.where(equal > 0, equal, part.extent)
        second, follows = _second(part, warp, section)
        if branch is None:
            # The uniform map bounds the strength from below: smaller ones are branch 2.
            branch = jnp.where(jnp.where(follows, second, first) > uniform, follows.astype(int), 2)
        strength = jnp.where(branch == 2, uniform, jnp.where(branch == 1, second, first))
    return error_pieces(part, "storage", section).bent(strength), branch


class PairCertificate(Checked):
    """Why the planes are optimal; every array has the shape of the views.

    Attributes:
        slope_spread: For "sum": relative spread of the slices' dS/d ln(f_i/n_i); 0 at a smooth optimum,
            not where slices sit on a kink of S (with "lispsm", at the ratio whose γ_lim is γ).
        storage_spread: For "max": relative spread of the slices' storages; 0 where all are alike.
        starts: How many families of shares were searched.
    """

    slope_spread: Float[Array, "..."]
    storage_spread: Float[Array, "..."]
    starts: int = eqx.field(static=True)


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
        # ln(m·S₁ + (k − m)·S₂).
        return jax.nn.logsumexp(logs + jnp.log(jnp.stack([self.first, self.num - self.first])))

    def active(self, x: Array) -> tuple[Array, Array, Array]:
        """Branch and largest function of both slices, and whose storage is the larger."""
        logs, branch = _on_branch(similar(self.view, self.lengths(x)), None, self.warp, self.section)
        return branch, jnp.argmax(logs, axis=-1), jnp.argmax(jnp.max(logs, axis=-1))

    def value(self, x: Array, piece: tuple[Array, Array, Array]) -> Array:
        """ln of the objective on fixed branches."""
        branch, largest, leads = piece
        logs, _ = _on_branch(similar(self.view, self.lengths(x)), branch, self.warp, self.section)
        return self._joined(jnp.take_along_axis(logs, largest[:, None], axis=-1)[:, 0], leads)

    def best(self) -> tuple[Array, Array]:
        """x and ln of the objective there: the best of a grid, polished between its neighbours."""
        share = jnp.linspace(0, 1, NUM_SHARES, dtype=self.span.dtype)[1:-1]
        # The longest that m equal slices can be: all of ln(f/n).
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
def solve_pairs(
    view: LightFrustum, num_partitions: int, objective: str = "max", warp: str = "uniform", section: Section = "axis"
) -> Solution[Slices, PairCertificate]:
    """Planes and certificate of every view; planes stand along a last axis of their own."""
    return _solve_each(view, num_partitions, objective, warp, section)


@eqx.filter_jit
def _solve_each(
    view: LightFrustum, k: int, objective: str, warp: str, section: Section
) -> Solution[Slices, PairCertificate]:
    return view.each(lambda one: _solve(one, k, objective, warp, section))


def _solve(
    view: LightFrustum, k: int, objective: str, warp: str, section: Section
) -> Solution[Slices, PairCertificate]:
    dtype = view.near.dtype
    span = jnp.log1p((view.far - view.near) / view.near)
    lengths = jnp.full(k, 1 / k, dtype) * span
    baselines = equal_ratios(view, k, objective, warp, section)
    if k > 1:
        firsts = jnp.arange(1, k // 2 + 1).astype(dtype)
        xs, values = jax.vmap(lambda m: _Pair(view, span, m, k, objective, warp, section).best())(firsts)
        index = jnp.argmin(values)
        pair = _Pair(view, span, firsts[index], k, objective, warp, section).lengths(xs[index])
        # m slices of one length, k − m of the other; sorted, as their order does not matter.
        unequal = jnp.sort(jnp.where(jnp.arange(k).astype(dtype) < firsts[index], pair[0], pair[1]))
        # Unequal slices must be better by more than rounding, else equal ratios stand.
        few = max(1e-9, 8 * float(jnp.finfo(dtype).eps))
        lengths = jnp.where(values[index] < jnp.log(baselines["equal"]) - few, unequal, lengths)
    # Slices do not depend on each other, so one product with ones gives dS_i/d ln(f_i/n_i) of all of them.
    each, slopes = jax.jvp(lambda x: storages(view, x, warp, section), (lengths,), (jnp.ones_like(lengths),))
    value = Slices.between(view, lengths, WARPS[warp](similar(view, lengths), section))

    def spread(x: Array) -> Array:
        return (jnp.max(x) - jnp.min(x)) / jnp.mean(x)

    storage = total(each, objective)
    certificate = PairCertificate(spread(slopes), spread(each), k // 2 + 1)
    return Solution(value, storage, baselines, certificate, ended(jnp.isfinite(storage)), view, SLICES_KIND)


__all__ = ["PairCertificate", "solve_pairs"]
