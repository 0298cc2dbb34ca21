"""Slices of a view in depth: their planes and n', what they are compared with, and the maps they make."""

import jax.numpy as jnp

from shadowjax._checked import Checked, checked
from shadowjax._numerics import largest
from shadowjax._types import Array, Float
from shadowjax.optimize.solution import SolutionKind, with_slices
from shadowjax.theory.aliasing import near_distances
from shadowjax.theory.aliasing.error import storage_factor
from shadowjax.theory.aliasing.light_frustum import LightFrustum, Section
from shadowjax.theory.aliasing.optimal import least_storage, minimax

SPLIT_OBJECTIVES = ("max", "sum")

# How each named warp picks n'; one line a rule.
WARPS = {
    "uniform": lambda part, section: near_distances.uniform(part),
    "lispsm": lambda part, section: near_distances.generalised(part),
    "minimax": minimax,
    "least_storage": least_storage,
}


class Slices(Checked):
    """Slices of views in depth; other axes than the last are those of the views.

    Attributes:
        cuts: k + 1 planes along the last axis, world units, n and f included.
        near_distances: n' of every slice, world units; huge for a uniform map.
    """

    cuts: Float[Array, "*views planes"]
    near_distances: Float[Array, "*views slices"]

    @classmethod
    def between(cls, view: LightFrustum, log_ratios: Array, near_distances: Array) -> "Slices":
        """Of one view, from ln(f_i/n_i) of every slice and its n' over its near distance."""
        # `similar` slices have near distance 1; n' scales with n_i when they are put in their places.
        inner = view.near * jnp.exp(jnp.cumsum(log_ratios))
        cuts = jnp.concatenate([view.near[None], inner]).at[-1].set(view.far)
        return cls(cuts, near_distances * cuts[:-1])


SLICES_KIND = SolutionKind(
    (
        ("splits", "value.cuts"), ("storage", "objective_value"), ("near_distances", "value.near_distances"),
        ("baselines", "baselines"), ("gain", "gain"), ("certificate", "certificate"), ("result", "text"),
    ),
    technique=lambda found, resolution, options: with_slices(
        found.value.cuts, found.value.near_distances, resolution, options
    ),
)  # fmt: skip


@checked
def similar(view: LightFrustum, log_ratios: Array) -> LightFrustum:
    """Slices of given ln(f_i/n_i) and near distance 1: slices of one view are similar, so n_i does not matter."""
    one = jnp.ones_like(log_ratios)
    return LightFrustum(one, jnp.exp(log_ratios), one * view.phi_y, one * view.phi_x, one * view.gamma)


@checked
def total(storages: Float[Array, "slices"], objective: str) -> Float[Array, ""]:
    """The largest storage of a slice, or their sum."""
    return largest(storages) if objective == "max" else jnp.sum(storages)


@checked
def storages(view: LightFrustum, log_ratios: Array, warp: str, section: Section) -> Float[Array, "slices"]:
    """S of every slice with the n' of a rule."""
    parts = similar(view, log_ratios)
    return storage_factor(parts, WARPS[warp](parts, section), section)


@checked
def equal_ratios(
    view: LightFrustum, k: int, objective: str, warp: str, section: Section
) -> dict[str, Float[Array, ""]]:
    """Objectives of equal ratios (warping, eq. 50).

    "published" has the n' of eq. 42 and 44, "equal" that of a rule, "uniform" uniform maps.
    """
    lengths = jnp.full(k, 1 / k, view.near.dtype) * jnp.log1p((view.far - view.near) / view.near)
    rules = {"published": "lispsm", "equal": warp, "uniform": "uniform"}
    return {name: total(storages(view, lengths, rule, section), objective) for name, rule in rules.items()}


__all__ = ["SLICES_KIND", "SPLIT_OBJECTIVES", "WARPS", "Slices", "equal_ratios", "similar", "storages", "total"]
