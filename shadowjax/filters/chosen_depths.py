"""Multi-depth policies whose extra depths were chosen by search: ranks of a neighbourhood, or cells of it."""

import equinox as eqx
import jax.numpy as jnp

from shadowjax._checked import checked
from shadowjax._checks import require, require_int
from shadowjax._types import Array, Float
from shadowjax.filters.multi_depth import DepthPolicy, shifted


@checked
def neighbourhood_cells(size: int) -> tuple[tuple[int, int], ...]:
    """(row, column) offsets of a size × size neighbourhood in reading order, the centre included."""
    low, high = -((size - 1) // 2), size // 2
    return tuple((row, col) for row in range(low, high + 1) for col in range(low, high + 1))


@checked
def ranked(depth: Float[Array, "rows cols"], size: int = 3) -> Float[Array, "n rows cols"]:
    """All depths of every texel's neighbourhood in rising order: plane r holds the (r + 1)-th smallest.

    Args:
        depth: Depth map.
        size: Width of the neighbourhood, texels, ≥ 2.
    """
    require_int(size, "neighbourhood size", 2)
    # Neighbours along the first axis: sorted there, plane r is the (r + 1)-th smallest everywhere.
    return jnp.sort(jnp.stack([shifted(depth, *cell) for cell in neighbourhood_cells(size)]), axis=0)


class Ranks(DepthPolicy):
    """Keeps the texel's own depth and some order statistics of its neighbourhood; rank 1 is the smallest.

    The published policies are special cases: ranks (size²,) is the maximum, (1,) the minimum, (1, size²) both.

    Attributes:
        ranks: From 1 to size², at least one.
        size: Width of the neighbourhood, texels, ≥ 2.
    """

    ranks: tuple[int, ...] = eqx.field(static=True, default=(3, 7))
    size: int = eqx.field(static=True, default=3)

    def __check_init__(self) -> None:
        require_int(self.size, "neighbourhood size", 2)
        require(len(self.ranks) > 0, "ranks must hold at least one rank")
        for rank in self.ranks:
            largest = self.size**2
            require(
                isinstance(rank, int) and 1 <= rank <= largest,
                f"a rank of a {self.size} × {self.size} neighbourhood lies between 1 and {largest}; got {rank!r}",
            )

    def planes(self, depth: Float[Array, "rows cols"]) -> Float[Array, "n rows cols"]:
        """Own depth first."""
        order = ranked(depth, self.size)
        return jnp.stack([depth, *(order[rank - 1] for rank in self.ranks)])

    @property
    def num_depths(self) -> int:
        """One, and one for each rank."""
        return 1 + len(self.ranks)

    @property
    def radius(self) -> float:
        """The far side of the neighbourhood."""
        return float(self.size // 2)


class Cells(DepthPolicy):
    """Keeps the texel's own depth and those of chosen neighbours.

    Attributes:
        cells: (row, column) offsets, texels; at least one.
    """

    cells: tuple[tuple[int, int], ...] = eqx.field(static=True, default=((0, 1), (1, 0)))

    def __check_init__(self) -> None:
        require(len(self.cells) > 0, "cells must hold at least one (row, column) offset")

    def planes(self, depth: Float[Array, "rows cols"]) -> Float[Array, "n rows cols"]:
        """Own depth first."""
        return jnp.stack([depth, *(shifted(depth, *cell) for cell in self.cells)])

    @property
    def num_depths(self) -> int:
        """One, and one for each cell."""
        return 1 + len(self.cells)

    @property
    def radius(self) -> float:
        """The largest offset along an axis."""
        return float(max(max(map(abs, cell)) for cell in self.cells))


__all__ = ["Cells", "Ranks", "neighbourhood_cells", "ranked"]
