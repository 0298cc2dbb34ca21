"""How many texels a map needs: storage factor and critical resolution, whole and in depth slices (eq. 30–31, 50–54)."""

from collections.abc import Callable

import jax.numpy as jnp

from shadowjax._checked import checked
from shadowjax._checks import require_choice
from shadowjax._types import Array, Float
from shadowjax.theory.aliasing.error import error_x, error_z, max_error_x, max_error_z, storage_factor
from shadowjax.theory.aliasing.light_frustum import LightFrustum, Section, VirtualNear
from shadowjax.theory.aliasing.overhead import overhead_max_x, overhead_max_z

Numbers = Float[Array, "..."]
Rule = Callable[[LightFrustum], Numbers]


@checked
def overhead_storage(frustum: LightFrustum, near_distance: VirtualNear) -> Numbers:
    """S with the light overhead: (f/n − 1)/(2·tan φ_y), for every n' from n to n + √(fn); larger beyond.

    Source: warping, eq. 31.
    """
    return overhead_max_x(frustum, near_distance) * overhead_max_z(frustum, near_distance)


@checked
def critical_resolution(
    frustum: LightFrustum,
    near_distance: VirtualNear,
    image_columns: Numbers | float,
    image_rows: Numbers | float,
    section: Section = "axis",
) -> tuple[Numbers, Numbers]:
    """Columns and rows of the smallest map without perspective aliasing: M_x = M_z = 1.

    Args:
        frustum: View and light.
        near_distance: Virtual near distance n', world units.
        image_columns: Columns of the camera's image.
        image_rows: Rows of the camera's image.
        section: "axis" or "whole" vertical section.

    Source: warping, text before eq. 30.
    """
    columns = image_columns * max_error_x(frustum, near_distance, section)
    return columns, image_rows * max_error_z(frustum, near_distance, section)


@checked
def storage_z_partitions(frustum: LightFrustum, num_partitions: Numbers | float, warped: bool = True) -> Numbers:
    """S of k similar slices with the light overhead: k(q − 1)/(2·tan φ_y), times q for uniform maps; q = (f/n)^(1/k).

    Args:
        frustum: The view; its γ is not used.
        num_partitions: k ≥ 1, any real.
        warped: Whether each slice has a perspective warp with n' ≤ n + √(fn), or a uniform map.

    Source: warping, eq. 51.
    """
    # Eq. 31 for a slice of the ratio q, k times; a uniform map needs f_i/n_i = q times as much across.
    ratio = (frustum.far / frustum.near) ** (1 / num_partitions)
    storage = num_partitions * (ratio - 1) / (2 * frustum.tan_y)
    return storage if warped else storage * ratio


@checked
def storage_logarithmic(frustum: LightFrustum) -> Numbers:
    """S of the logarithmic map with the light overhead, the limit of k → ∞ slices: ln(f/n)/(2·tan φ_y).

    Source: warping, eq. 52.
    """
    return jnp.log(frustum.far / frustum.near) / (2 * frustum.tan_y)


@checked
def storage_parallel(frustum: LightFrustum, num_partitions: Numbers | float = 1.0) -> Numbers:
    """S with light and view parallel: k(f/n)^(2/k); not monotone in k.

    Source: warping, eq. 53 (k = 1) and 54.
    """
    return num_partitions * (frustum.far / frustum.near) ** (2 / num_partitions)


@checked
def best_parallel_partitions(frustum: LightFrustum) -> Numbers:
    """The real k of least `storage_parallel`, 2·ln(f/n); there S = 2e·ln(f/n), and more slices cost more.

    Source: derived from warping, eq. 54.
    """
    return 2 * jnp.log(frustum.far / frustum.near)


@checked
def slices(frustum: LightFrustum, splits: Float[Array, "*batch planes"]) -> LightFrustum:
    """The frustum's slices between planes, along a new last axis of every field."""

    def each(x: Numbers) -> Numbers:
        return jnp.broadcast_to(x[..., None], splits[..., 1:].shape)

    # Near planes are all planes but the last, far planes all but the first.
    return LightFrustum(
        splits[..., :-1], splits[..., 1:], each(frustum.phi_y), each(frustum.phi_x), each(frustum.gamma)
    )


@checked
def storage_of_splits(
    frustum: LightFrustum,
    splits: Float[Array, "*batch planes"],
    near_distance: Rule,
    objective: str = "sum",
    section: Section = "axis",
) -> Float[Array, "*batch"]:
    """Storage of a partition in depth, each slice with its own n'.

    Args:
        frustum: View and light.
        splits: k + 1 planes from n to f.
        near_distance: Rule for n', such as a value of `shadowjax.warps.fit.NEAR_DISTANCES`.
        objective: "sum", all texels of all maps, or "max", those of the largest.
        section: "axis" or "whole" vertical section.

    Source: warping, text around eq. 50–51, for any γ.
    """
    require_choice(objective, "objective", ("sum", "max"))
    parts = slices(frustum, splits)
    each = storage_factor(parts, near_distance(parts), section)
    return jnp.sum(each, axis=-1) if objective == "sum" else jnp.max(each, axis=-1)


@checked
def seam_jumps(
    frustum: LightFrustum, splits: Float[Array, "*batch planes"], near_distance: Rule
) -> tuple[Float[Array, "*batch cuts"], Float[Array, "*batch cuts"]]:
    """How much coarser or finer texels become at each cut: factor ≥ 1 between the errors on its two sides.

    Args:
        frustum: View and light.
        splits: k + 1 planes from n to f.
        near_distance: Rule for n'.

    Returns:
        Jump of m_x and of m_z on the view axis at each of the k − 1 cuts. With the light overhead and equal errors at
        both planes of every slice m_z does not jump and m_x does by √(f_i/n_i); uniform maps jump by f_i/n_i in both.

    Source: warping, text after eq. 52.
    """
    parts = slices(frustum, splits)
    distance = near_distance(parts)

    def jump(error: Callable[..., Numbers]) -> Numbers:
        # The same depth seen from both slices: the far plane of one, the near plane of the next.
        before = error(parts, distance, parts.far)[..., :-1]
        after = error(parts, distance, parts.near)[..., 1:]
        return jnp.maximum(after / before, before / after)

    return jump(error_x), jump(error_z)


@checked
def partitions_needed(ratio: Numbers, storage: Numbers) -> Numbers:
    """Smallest number of warped slices, light overhead, whose storage 2·tan φ_y·S keeps a bound above ln(f/n).

    k(r^(1/k) − 1) falls with k towards ln r, so the smallest whole k is found by counting up to 64.

    Args:
        ratio: f/n.
        storage: Bound on 2·tan φ_y·S; 65 comes back where 64 slices are too few.
    """
    k = jnp.arange(1, 65, dtype=ratio.dtype)
    # Monotone in k, so `argmax` finds the first True; expm1 keeps k(r^(1/k) − 1) exact for large k.
    enough = k * jnp.expm1(jnp.log(ratio)[..., None] / k) <= storage[..., None]
    return jnp.where(jnp.any(enough, axis=-1), jnp.argmax(enough, axis=-1).astype(ratio.dtype) + 1, 65)


__all__ = [
    "best_parallel_partitions", "critical_resolution", "overhead_storage", "partitions_needed", "seam_jumps", "slices",
    "storage_factor", "storage_logarithmic", "storage_of_splits", "storage_parallel", "storage_z_partitions",
]  # fmt: skip
