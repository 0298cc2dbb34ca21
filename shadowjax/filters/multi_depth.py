"""Multi-depth shadow maps: n depths a texel chosen from its neighbourhood, and the composite shadow test over them."""

import math
from abc import abstractmethod
from collections.abc import Sequence
from typing import Annotated

import equinox as eqx
import jax
import jax.numpy as jnp

from shadowjax._checked import Checked, checked
from shadowjax._checks import AT_LEAST_ONE, require, require_choice, require_int
from shadowjax._types import Array, Float
from shadowjax.filters.base import Filter, Lookup
from shadowjax.filters.pcf import percentage_closer_of

Depth = Float[Array, "rows cols"]
Planes = Float[Array, "n rows cols"]


@checked
def shifted(depth: Depth, d_row: int, d_col: int) -> Depth:
    """The map whose texel (r, c) holds `depth[r + d_row, c + d_col]`; beyond the border the edge texel repeats."""
    num_rows, num_cols = depth.shape
    rows, cols = abs(d_row), abs(d_col)
    # As many rows and columns on all sides as the shift is long; the slice below is the shifted map.
    padded = jnp.pad(depth, ((rows, rows), (cols, cols)), mode="edge")
    return padded[rows + d_row : rows + d_row + num_rows, cols + d_col : cols + d_col + num_cols]


def _extreme(depth: Depth, size: int, include_centre: bool, choose) -> Depth:
    """`choose` (maximum or minimum) over the size × size neighbourhood of every texel."""
    require_int(size, "neighbourhood size", 2)
    low, high = -((size - 1) // 2), size // 2
    if include_centre:
        # Extremes are separable: along columns first, then of these along rows.
        across = depth
        for offset in range(low, high + 1):
            across = choose(across, shifted(depth, 0, offset))
        result = across
        for offset in range(low, high + 1):
            result = choose(result, shifted(across, offset, 0))
        return result
    # Without the centre they are not: every neighbour in turn.
    cells = [(r, c) for r in range(low, high + 1) for c in range(low, high + 1) if (r, c) != (0, 0)]
    result = shifted(depth, *cells[0])
    for cell in cells[1:]:
        result = choose(result, shifted(depth, *cell))
    return result


@checked
def single(depth: Depth) -> Planes:
    """1-SM: the traditional map."""
    return depth[None]


@checked
def max_neighbour(depth: Depth, size: int = 3, include_centre: bool = True) -> Planes:
    """2-SM with the largest depth of the size × size neighbourhood next to the texel's own.

    Source: mdsm, section 4.5.2 and figure 4.8 (the code of figure 4.16 includes the centre; with `include_centre`
    False it is left out).
    """
    return jnp.stack([depth, _extreme(depth, size, include_centre, jnp.maximum)])


@checked
def min_neighbour(depth: Depth, size: int = 3, include_centre: bool = True) -> Planes:
    """2-SM with the smallest depth of the neighbourhood. Source: mdsm, section 4.5.2."""
    return jnp.stack([depth, _extreme(depth, size, include_centre, jnp.minimum)])


@checked
def min_max_neighbours(depth: Depth, size: int = 3, include_centre: bool = True) -> Planes:
    """3-SM with the largest and the smallest depth of the neighbourhood. Source: mdsm, section 4.5.3."""
    largest = _extreme(depth, size, include_centre, jnp.maximum)
    smallest = _extreme(depth, size, include_centre, jnp.minimum)
    return jnp.stack([depth, largest, smallest])


@checked
def ring_offsets(num_depths: int, radius: int = 1) -> tuple[tuple[int, int], ...]:
    """(row, column) offsets of the n − 1 extra samples of an n-SM, spread evenly round a square ring.

    Args:
        num_depths: n ≥ 2, the texel's own depth counted.
        radius: Distance of the ring, texels, ≥ 1; it has 8·radius cells.

    Returns:
        Offsets whose mean is as near the texel as turning the ring by whole cells brings it. For radius 1 and 2 that is
        at the texel, but where one cell or all but one are read (n = 2 and n = 8·radius), which no turn can balance.

    Raises:
        ValueError: If the ring has fewer cells than samples asked for.

    Source: mdsm, section 4.5.4, figures 4.9 and 4.11, which start straight up and leave 6-SMs next to their texel.
    """
    require_int(num_depths, "num_depths", 2)
    require_int(radius, "radius", 1)
    num_cells, num_samples = 8 * radius, num_depths - 1
    require(
        num_samples <= num_cells,
        f"a {num_depths}-SM needs {num_samples} neighbours but a ring of radius {radius} has only {num_cells} cells; "
        f"use num_depths ≤ {num_cells + 1} or radius ≥ {math.ceil(num_samples / 8)}",
    )
    ring = _ring_cells(radius)

    def turned(by: int) -> tuple[tuple[int, int], ...]:
        # Whole cells nearest below even spacing; ties between turns go to the first.
        return tuple(ring[(by + i * num_cells // num_samples) % num_cells] for i in range(num_samples))

    return min((turned(by) for by in range(num_cells)), key=_imbalance)


def _imbalance(offsets: tuple[tuple[int, int], ...]) -> int:
    """Square of the sum of offsets."""
    return sum(row for row, _ in offsets) ** 2 + sum(col for _, col in offsets) ** 2


def _ring_cells(radius: int) -> list[tuple[int, int]]:
    """Cells of a square ring in order of angle, from straight up (row −radius)."""
    cells = [
        (r, c) for r in range(-radius, radius + 1) for c in range(-radius, radius + 1) if max(abs(r), abs(c)) == radius
    ]
    # atan2 of (column, −row): 0 is straight up, and angles grow clockwise, towards greater columns.
    return sorted(cells, key=lambda cell: math.atan2(cell[1], -cell[0]) % (2 * math.pi))


@checked
def ring(depth: Depth, num_depths: int, radius: int = 1) -> Planes:
    """n-SM with n − 1 samples evenly round the texel. Source: mdsm, section 4.5.4."""
    return jnp.stack([depth, *(shifted(depth, *offset) for offset in ring_offsets(num_depths, radius))])


@checked
def fixed_neighbour(depth: Depth, offset: tuple[int, int] = (0, 1)) -> Planes:
    """2-SM with the neighbour at one (row, column) offset: misses edges along that offset. Source: mdsm, figure 4.7."""
    return jnp.stack([depth, shifted(depth, *offset)])


@checked
def stochastic_neighbour(depth: Depth, key: Array, size: int = 3) -> Planes:
    """2-SM with a neighbour drawn evenly, for each texel, from its size × size neighbourhood without the centre.

    Source: mdsm, figure 4.7: it too can miss an edge.
    """
    low, high = -((size - 1) // 2), size // 2
    cells = [(r, c) for r in range(low, high + 1) for c in range(low, high + 1) if (r, c) != (0, 0)]
    choice = jax.random.randint(key, depth.shape, 0, len(cells), dtype=jnp.int32)
    drawn = depth
    for index, cell in enumerate(cells):
        drawn = jnp.where(choice == index, shifted(depth, *cell), drawn)
    return jnp.stack([depth, drawn])


class DepthPolicy(Checked):
    """Chooses the extra depths of every texel from a traditional depth map."""

    @abstractmethod
    def planes(self, depth: Depth) -> Planes:
        """The n depths of every texel; the texel's own comes first."""

    @property
    @abstractmethod
    def num_depths(self) -> int:
        """n."""

    @property
    @abstractmethod
    def radius(self) -> float:
        """How far away, in texels along an axis, the extra depths come from."""

    @property
    def centroid(self) -> tuple[float, float]:
        """(row, column) offset from the texel of the middle of what its depths stand for; lookups are moved against it.

        Where it is not 0, shadows would lie off their place by as much.
        """
        return 0.0, 0.0

    @property
    def spread(self) -> float:
        """How far from that middle, in texels along an axis, the depths come from."""
        return self.radius


def _beside(offsets: Sequence[tuple[float, float]]) -> tuple[tuple[float, float], float]:
    """Mean of offsets, and the largest distance from it along an axis."""
    rows, cols = zip(*offsets, strict=True)
    middle = sum(rows) / len(rows), sum(cols) / len(cols)
    return middle, max(max(abs(row - middle[0]), abs(col - middle[1])) for row, col in offsets)


class Neighbourhood(DepthPolicy):
    """Keeps the largest, the smallest or both depths of the surrounding texels.

    Attributes:
        keep: "max", "min" or "min-max".
        size: Width of the neighbourhood, texels, ≥ 2.
        include_centre: Whether the texel itself takes part.
    """

    keep: str = eqx.field(static=True, default="max")
    size: int = eqx.field(static=True, default=3)
    include_centre: bool = eqx.field(static=True, default=True)

    def __check_init__(self) -> None:
        require_choice(self.keep, "keep", ("max", "min", "min-max"))
        require_int(self.size, "neighbourhood size", 2)

    def planes(self, depth: Depth) -> Planes:
        """2 or 3 planes."""
        make = {"max": max_neighbour, "min": min_neighbour, "min-max": min_max_neighbours}[self.keep]
        return make(depth, self.size, self.include_centre)

    @property
    def num_depths(self) -> int:
        """3 for "min-max", else 2."""
        return 3 if self.keep == "min-max" else 2

    @property
    def radius(self) -> float:
        """The far side of the neighbourhood."""
        return float(self.size // 2)

    @property
    def centroid(self) -> tuple[float, float]:
        """0 for odd sizes; the middle of an even neighbourhood is half a texel off for all depths but the own."""
        # Even neighbourhoods reach one texel further right and down; the own depth has no offset.
        off = 0.0 if self.size % 2 else 0.5 * (self.num_depths - 1) / self.num_depths
        return off, off

    @property
    def spread(self) -> float:
        """The far side of the neighbourhood from that middle."""
        return self.radius - self.centroid[0]


class Ring(DepthPolicy):
    """Keeps n − 1 samples spread evenly round the texel.

    Attributes:
        num_depths: n, from 1 (the traditional map) to 8·radius + 1.
        ring_radius: Distance of the ring, texels, ≥ 1.
    """

    num_depths: int = eqx.field(static=True, default=4)  # pyright: ignore[reportIncompatibleMethodOverride]
    ring_radius: Annotated[int, AT_LEAST_ONE] = eqx.field(static=True, default=1)

    def __check_init__(self) -> None:
        require_int(self.num_depths, "num_depths", 1)
        if self.num_depths > 1:
            ring_offsets(self.num_depths, self.ring_radius)

    def planes(self, depth: Depth) -> Planes:
        """n planes."""
        return single(depth) if self.num_depths == 1 else ring(depth, self.num_depths, self.ring_radius)

    @property
    def radius(self) -> float:
        """The ring's; 0 without extra samples."""
        return float(self.ring_radius) if self.num_depths > 1 else 0.0

    @property
    def _offsets(self) -> tuple[tuple[int, int], ...]:
        return ((0, 0), *(ring_offsets(self.num_depths, self.ring_radius) if self.num_depths > 1 else ()))

    @property
    def centroid(self) -> tuple[float, float]:
        """0 but for one extra sample, and for all cells of the ring but one (8-SM with radius 1: an eighth)."""
        return _beside(self._offsets)[0]

    @property
    def spread(self) -> float:
        """The farthest sample from that middle."""
        return _beside(self._offsets)[1]


class FixedNeighbour(DepthPolicy):
    """Keeps the neighbour at one offset: a policy that fails, kept to show how.

    Attributes:
        offset: (row, column) of the neighbour, texels.
    """

    offset: tuple[int, int] = eqx.field(static=True, default=(0, 1))

    def planes(self, depth: Depth) -> Planes:
        """2 planes."""
        return fixed_neighbour(depth, self.offset)

    @property
    def num_depths(self) -> int:
        """2."""
        return 2

    @property
    def radius(self) -> float:
        """The offset's larger component."""
        return float(max(map(abs, self.offset)))

    @property
    def centroid(self) -> tuple[float, float]:
        """Half way to the neighbour."""
        return self.offset[0] / 2, self.offset[1] / 2

    @property
    def spread(self) -> float:
        """Half the way."""
        return self.radius / 2


class StochasticNeighbour(DepthPolicy):
    """Keeps a random neighbour of each texel: a policy that fails, kept to show how.

    Attributes:
        seed: Of the random choice; the same seed gives the same map.
        size: Width of the neighbourhood, texels, ≥ 2.
    """

    seed: int = eqx.field(static=True, default=0)
    size: int = eqx.field(static=True, default=3)

    def __check_init__(self) -> None:
        require_int(self.size, "neighbourhood size", 2)

    def planes(self, depth: Depth) -> Planes:
        """2 planes."""
        return stochastic_neighbour(depth, jax.random.key(self.seed), self.size)

    @property
    def num_depths(self) -> int:
        """2."""
        return 2

    @property
    def radius(self) -> float:
        """The far side of the neighbourhood."""
        return float(self.size // 2)

    @property
    def centroid(self) -> tuple[float, float]:
        """0 for odd sizes; for even ones the mean over all draws."""
        # The offsets of size² cells average ½; without the centre their sum ½·size² is shared by one cell less, and
        # half of the depths are the own.
        off = 0.0 if self.size % 2 else 0.25 * self.size**2 / (self.size**2 - 1)
        return off, off


class MultiDepth(Filter):
    """PCF(k, n) over a multi-depth map: composite tests, averaged over a K × K kernel.

    Lookups are moved against the policy's centroid, so that no choice of extra depths moves shadows sideways.

    Attributes:
        policy: How the extra depths of a texel are chosen.
        kernel_size: K, taps along an axis; 1 for the composite test alone.
    """

    policy: DepthPolicy = Neighbourhood()
    kernel_size: int = eqx.field(static=True, default=1)

    def __check_init__(self) -> None:
        require_int(self.kernel_size, "kernel_size", 1)

    def prepare(self, depth: Depth) -> Planes:
        """The n-SM."""
        return self.policy.planes(depth)

    def visibility(self, planes: Planes, lookup: Lookup) -> Float[Array, "*points"]:
        """PCF(k, n)."""
        row, col = self.policy.centroid
        return percentage_closer_of(planes, lookup, self.kernel_size, shift=(-col, -row))

    @property
    def num_planes(self) -> int:
        """n."""
        return self.policy.num_depths

    @property
    def num_tones(self) -> int:
        """nk + 1. Source: mdsm, section 4.4."""
        return self.policy.num_depths * self.kernel_size**2 + 1

    @property
    def num_fetches(self) -> int:
        """nk depths; the source counts k texels, each read in one fetch of up to four channels."""
        return self.policy.num_depths * self.kernel_size**2

    @property
    def reach(self) -> float:
        """The kernel's reach and the neighbourhood's beyond it."""
        return self.kernel_size / 2 + self.policy.spread
