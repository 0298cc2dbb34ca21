"""Sweeps over γ × f/n × φ × k in one program, sharded across devices."""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.sharding import Mesh, NamedSharding, PartitionSpec

from shadowjax._checked import Checked, checked
from shadowjax._checks import require, require_choice, require_value
from shadowjax._types import Array, ArrayLike, Float, as_float_array
from shadowjax.optimize.solution import Solution, SolutionKind, ended, with_slices
from shadowjax.techniques.shadow_mapping import ShadowMapping
from shadowjax.theory.aliasing.error import max_error_x, max_error_z, storage_factor
from shadowjax.theory.aliasing.light_frustum import SECTIONS, LightFrustum, Section
from shadowjax.theory.aliasing.near_distances import generalised
from shadowjax.theory.aliasing.optimal import balanced, least_storage, minimax


class Sweep(Checked):
    """n' and storage of the other rules at every combination; all arrays have the shape (γ, f/n, φ, k).

    Attributes:
        least_storage: n' of least M_x·M_z, in units of the first slice's near distance.
        balanced: n' of least max(M_x, M_z).
        published: n' of eq. 42 with 44.
        max_error_x: M_x of the minimax n'.
        storage_minimax: Σ S of k equal ratios with the minimax n'.
        storage_least: The same with the n' of least storage.
        storage_published: The same with the published n'.
        storage_uniform: The same with uniform maps.
    """

    least_storage: Float[Array, "..."]
    balanced: Float[Array, "..."]
    published: Float[Array, "..."]
    max_error_x: Float[Array, "..."]
    storage_minimax: Float[Array, "..."]
    storage_least: Float[Array, "..."]
    storage_published: Float[Array, "..."]
    storage_uniform: Float[Array, "..."]


class _Point(NamedTuple):
    """What a combination is of: the first slice, and how many follow."""

    slice: LightFrustum
    num_slices: Array


def _frozen(found: Any, resolution: int, options: dict[str, Any]) -> ShadowMapping:
    """Equal ratios from depth 1 on."""
    point: _Point = found.problem
    k = round(float(point.num_slices))
    require(k == float(point.num_slices), f"{float(point.num_slices):g} slices make no technique; take a whole number")
    cuts = point.slice.far ** jnp.arange(k + 1, dtype=found.value.dtype)
    return with_slices(cuts, found.value * cuts[:-1], resolution, options)


_KIND = SolutionKind(
    (
        ("near_distance", "value"), ("error", "objective_value"), ("baselines", "baselines"), ("gain", "gain"),
        ("certificate", "certificate"), ("result", "text"),
    ),
    technique=_frozen,
)  # fmt: skip


def _one(gamma: Array, ratio: Array, phi: Array, k: Array, section: Section) -> Solution[Array, Sweep]:
    """One combination: its k slices are similar, so one of them stands for all."""
    part = LightFrustum(jnp.ones_like(ratio), ratio ** (1 / k), phi, phi, gamma)
    best, small, old = minimax(part, section), least_storage(part, section), generalised(part)
    error, even = max_error_z(part, best, section), part.uniform_near_distance

    def total(distance: Array) -> Array:
        return k * storage_factor(part, distance, section)

    beside = Sweep(
        small, balanced(part, section=section), old, max_error_x(part, best, section), total(best), total(small),
        total(old), total(even),
    )  # fmt: skip
    baselines = {"published": max_error_z(part, old, section), "uniform": max_error_z(part, even, section)}
    return Solution(best, error, baselines, beside, ended(jnp.isfinite(error)), _Point(part, k), _KIND)


@eqx.filter_jit
def _all(points: Float[Array, "points 4"], section: Section) -> Solution[Array, Sweep]:
    return jax.vmap(lambda p: _one(p[0], p[1], p[2], p[3], section))(points)


@checked
def sweep(
    gammas: ArrayLike, ratios: ArrayLike, phis: ArrayLike, num_partitions: ArrayLike, section: str = "axis"
) -> Solution[Array, Sweep]:
    """The n' of least M_z for every combination of four lists in one `vmap`, sharded over all devices.

    Combinations are laid out in a row, padded to a multiple of the number of devices and split between them; each
    device computes its part alone. The result is the same for any number of devices.

    Args:
        gammas: Angles between light and view, radians, in [0, π/2].
        ratios: f/n, > 1.
        phis: Half angles of view, radians, in (0, π/2).
        num_partitions: Numbers k ≥ 1 of slices of equal ratio; need not be whole.
        section: "axis" or "whole" vertical section, over which errors are taken.

    Returns:
        `value` n' in units of the first slice's near distance; `objective_value` M_z; `baselines` "published" and
        "uniform"; all of shape (γ, f/n, φ, k). The technique of a point has k slices from depth 1 on.

    Raises:
        ValueError: If a list is empty or a number is out of range.
    """
    checked: Section = require_choice(section, "section", SECTIONS)
    lists = [jnp.atleast_1d(as_float_array(x)) for x in (gammas, ratios, phis, num_partitions)]
    dtype = jnp.result_type(*lists)
    lists = [x.astype(dtype) for x in lists]
    for values, name in zip(lists, ("gammas", "ratios", "phis", "num_partitions"), strict=True):
        require(values.ndim == 1 and values.size > 0, f"{name} must be a list of at least one number")
    # Each list is checked by itself, with harmless values for the others; the grid below is then valid as a whole.
    LightFrustum.create(jnp.ones_like(lists[1]), lists[1], jnp.full_like(lists[1], 0.5))
    LightFrustum.create(1.0, 2.0, lists[2], 0.5)
    LightFrustum.create(1.0, 2.0, 0.5, lists[0])
    require_value(lists[3], lists[3] >= 1, "every number of partitions k must be at least 1")
    shape = tuple(x.size for x in lists)
    points = jnp.stack([x.reshape(-1) for x in jnp.meshgrid(*lists, indexing="ij")], axis=-1)
    found = _all(laid_out(points), checked)
    return jax.tree.map(lambda x: x[: len(points)].reshape(shape), found)


@checked
def laid_out(rows: ArrayLike) -> Array:
    """Rows padded with copies of the first to a multiple of the number of devices, and split between them."""
    rows, devices = as_float_array(rows), np.asarray(jax.devices())
    # −len % devices rows are missing; copies of the first are valid views and are cut off afterwards.
    padding = jnp.broadcast_to(rows[:1], (-len(rows) % len(devices), *rows.shape[1:]))
    layout = NamedSharding(Mesh(devices, ("rows",)), PartitionSpec("rows"))
    return jax.device_put(jnp.concatenate([rows, padding]), layout)


__all__ = ["Sweep", "laid_out", "sweep"]
