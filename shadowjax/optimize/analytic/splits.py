"""Where to cut a view in depth, and the n' of every slice: the search that fits what is asked for."""

from shadowjax._checked import checked
from shadowjax._checks import require_choice, require_int
from shadowjax._types import ArrayLike
from shadowjax.optimize.analytic import pairs
from shadowjax.optimize.analytic.joint import JOINT_WARPS, JointCertificate, joint_splits
from shadowjax.optimize.analytic.pairs import PairCertificate
from shadowjax.optimize.analytic.slices import SPLIT_OBJECTIVES, Slices
from shadowjax.optimize.solution import Solution
from shadowjax.theory.aliasing.light_frustum import SECTIONS, LightFrustum, Section


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
    seam_limit: ArrayLike | None = None,
) -> Solution[Slices, PairCertificate] | Solution[Slices, JointCertificate]:
    """The planes of least storage for k depth slices, of one or many views.

    The four numbers of a view broadcast against each other; planes stand along a last axis of their own. Planes and
    storage carry their implicit derivative by all four, under `jit` and `vmap`, forward and reverse.

    Equal ratios are best for the maximum of a storage that rises with the slice, and for the sum wherever storage is
    convex in ln(f/n): for uniform maps, and for all warps with the light overhead. Else there are exceptions. With the
    source's eq. 42 and 44 narrow slices fall below their own γ_lim, so slices just wide enough to stay above it, next
    to one narrow one, can need less. With minimax and least-storage n' likewise, at the ratio where a slice changes
    from a uniform to a warped map, or from one formula of n' to the other.

    With a limit on seams, or with the warp "free", planes and n' are found together on the host
    (`shadowjax.optimize.analytic.joint`), by a search of several starts.

    Args:
        near: Depth n, world units, > 0.
        far: Depth f, world units, > near.
        phi: Half the vertical angle of view, radians, in (0, π/2).
        gamma: Angle between light and view, radians, in [0, π/2].
        num_partitions: k ≥ 1.
        objective: "max", the largest slice's texels, or "sum", all texels.
        warp: "uniform", "lispsm" (eq. 42 with 44), "minimax", "least_storage", or "free" to choose every n'.
        section: "axis" or "whole" vertical section, over which errors are taken.
        seam_limit: Largest factor, > 1, by which m_x and m_z may change at a cut on the view axis; none if None.

    Returns:
        `value.cuts` and `value.near_distances`, world units, along a last axis; `objective_value`, a storage;
        `baselines` of equal ratios: "published" with n' of eq. 42 and 44, "equal" with this warp, "uniform". Its
        technique has one map a slice.

    Raises:
        ValueError: If a number is out of range, a name is unknown, or no planes keep the limit.

    Source: warping, eq. 50–51, for any γ; eq. 55 and the text on seams.
    """
    require_choice(objective, "objective", SPLIT_OBJECTIVES)
    require_choice(warp, "warp", JOINT_WARPS)
    checked: Section = require_choice(section, "section", SECTIONS)
    if seam_limit is not None or warp == "free":
        return joint_splits(near, far, phi, gamma, num_partitions, objective, warp, seam_limit, section)
    k = require_int(num_partitions, "the number of partitions k", 1)
    return pairs.solve_pairs(LightFrustum.create(near, far, phi, gamma), k, objective, warp, checked)


__all__ = ["splits"]
