"""Every policy for the extra depths of a texel by its name: planes from a depth map, arrays in and out."""

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import NamedTuple

from shadowjax._checked import checked
from shadowjax._checks import require, require_choice
from shadowjax._types import Array, Float
from shadowjax.filters.brabec_seidel import PropagatedNeighbours
from shadowjax.filters.chosen_depths import Cells, Ranks
from shadowjax.filters.hierarchical_minimum import HierarchicalMinimum
from shadowjax.filters.multi_depth import DepthPolicy, FixedNeighbour, Neighbourhood, Ring, StochasticNeighbour

Offsets = tuple[tuple[int, int], ...]


class _Settings(NamedTuple):
    """The numbers of all policies; each reads its own."""

    size: int
    num_depths: int
    cells: Offsets
    ranks: tuple[int, ...]
    blocks: tuple[int, ...]
    seed: int


def _ring(settings: _Settings) -> DepthPolicy:
    size = settings.size
    require(size >= 3 and size % 2 == 1, f"a ring lies round the border of an odd square, size ≥ 3; got {size}")
    return Ring(settings.num_depths, size // 2)


def _fixed(settings: _Settings) -> DepthPolicy:
    require(len(settings.cells) == 1, f"the fixed policy keeps one neighbour; got cells {settings.cells}: use 'cells'")
    return FixedNeighbour(settings.cells[0])


_POLICIES: Mapping[str, Callable[[_Settings], DepthPolicy]] = MappingProxyType({
    "single": lambda settings: Ring(1),
    "max": lambda settings: Neighbourhood("max", settings.size),
    "min": lambda settings: Neighbourhood("min", settings.size),
    "min-max": lambda settings: Neighbourhood("min-max", settings.size),
    "ring": _ring,
    "fixed": _fixed,
    "random": lambda settings: StochasticNeighbour(settings.seed, settings.size),
    "ranks": lambda settings: Ranks(settings.ranks, settings.size),
    "cells": lambda settings: Cells(settings.cells),
    "propagated": lambda settings: PropagatedNeighbours(),
    "block-minima": lambda settings: HierarchicalMinimum(settings.blocks),
})  # fmt: skip
POLICY_NAMES = tuple(_POLICIES)


@checked
def multi_depth(
    depth: Float[Array, "rows cols"],
    policy: str,
    size: int = 3,
    *,
    num_depths: int = 4,
    cells: Offsets = ((0, 1),),
    ranks: tuple[int, ...] = (3, 7),
    blocks: tuple[int, ...] = (2, 4),
    seed: int = 0,
) -> Float[Array, "n rows cols"]:
    """n depths for every texel of a map, its own first, for `composite_test` and PCF(k, n).

    Args:
        depth: Depth map, world units.
        policy: Which others are kept. "single": none. "max", "min", "min-max": extremes of the neighbourhood. "ring":
            `num_depths` − 1 samples evenly round it. "ranks": order statistics of it. "cells": chosen neighbours.
            "propagated": those to the right, below, and both (Brabec and Seidel). Three that fail, to show how:
            "fixed", one neighbour; "random", one drawn for each texel; "block-minima", of blocks fixed to the map.
        size: Width of the neighbourhood, texels, ≥ 2; of a ring, the odd width of its square, ≥ 3.
        num_depths: n of a ring.
        cells: (row, column) offsets of "cells", texels; "fixed" takes one.
        ranks: Of "ranks", from 1, the smallest, to size².
        blocks: Texels along a side of each level of "block-minima", ≥ 2.
        seed: Of "random".

    Raises:
        ValueError: If there is no such policy, or its numbers do not fit.

    Source: mdsm, section 4.5 and figures 4.7 to 4.11; section 3.5 on Brabec and Seidel 2001; section 5.2.4.
    """
    return _policy(policy, _Settings(size, num_depths, cells, ranks, blocks, seed)).planes(depth)


@checked
def multi_depth_shift(
    policy: str,
    size: int = 3,
    *,
    num_depths: int = 4,
    cells: Offsets = ((0, 1),),
    ranks: tuple[int, ...] = (3, 7),
    blocks: tuple[int, ...] = (2, 4),
    seed: int = 0,
) -> tuple[float, float]:
    """The `shift` of `percentage_closer` that keeps shadows in place where extra depths lie to one side of a texel.

    Args as of `multi_depth`; (0, 0) for depths on all sides of it.

    Returns:
        (x, y), texels.
    """
    row, col = _policy(policy, _Settings(size, num_depths, cells, ranks, blocks, seed)).centroid
    return -col, -row


def _policy(name: str, settings: _Settings) -> DepthPolicy:
    return _POLICIES[require_choice(name, "policy", POLICY_NAMES)](settings)


__all__ = ["POLICY_NAMES", "multi_depth", "multi_depth_shift"]
