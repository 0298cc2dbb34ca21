"""Binary windows of a shadow map: every pattern, every straight edge, and the tones that a filter makes of them.

A composite test compares one receiver depth with many stored ones, so any depth map reduces to a binary one: stored
depth not in front of the receiver (lit, 1) or in front (0). A neighbourhood's maximum is lit iff any of its texels is,
its minimum iff all are. A window holds all texels that one filter position sees.
"""

import functools
import itertools
import math
from collections.abc import Mapping
from types import MappingProxyType

import numpy as np
from jaxtyping import Bool, Int

from shadowjax._checked import checked
from shadowjax._checks import require, require_choice, require_int

# Name of a policy -> which extremes of the neighbourhood join the texel's own depth.
POLICIES: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {"1-SM": (), "2-SM max": ("max",), "2-SM min": ("min",), "3-SM min/max": ("max", "min")}
)


@checked
def num_depths(policy: str) -> int:
    """Depths a texel holds under a policy (n of n-SM)."""
    return 1 + len(POLICIES[require_choice(policy, "policy", POLICIES)])


@checked
def kernel_width(num_taps: int) -> int:
    """K of a K × K filter with `num_taps` taps; ValueError unless that is a square."""
    width = math.isqrt(require_int(num_taps, "number of taps", 1))
    require(width * width == num_taps, f"the number of taps must be a square (1, 4, 9, 16, ...); got {num_taps}")
    return width


@checked
def lit_numerators(
    windows: Bool[np.ndarray, "*batch rows cols"], policy: str, size: int = 3, include_centre: bool = True
) -> Int[np.ndarray, "*batch"]:
    """Number of lit tests in each window, out of n·k; visibility is this over n·k.

    Args:
        windows: Lit texels; (K + size − 1)² of them for a K × K filter.
        policy: A name of POLICIES.
        size: Width of the neighbourhood, odd.
        include_centre: Whether a texel belongs to its own neighbourhood.

    Source: mdsm, section 4.4 (composite test s/n under PCF(k, n)).
    """
    margin = require_int(size, "neighbourhood size", 1) // 2
    require(size % 2 == 1, f"neighbourhood size must be odd; got {size}")
    rows, cols = windows.shape[-2] - 2 * margin, windows.shape[-1] - 2 * margin
    # Neighbourhoods of all taps along two new last axes; `keep` flattens them and leaves out the centre if asked.
    taps = np.lib.stride_tricks.sliding_window_view(windows, (size, size), axis=(-2, -1))
    keep = np.ones((size, size), bool)
    keep[margin, margin] = include_centre or size == 1
    near = taps[..., keep]
    # The texel's own depth, then one test for each extreme that the policy keeps.
    total = windows[..., margin : margin + rows, margin : margin + cols].astype(np.int64)
    for extreme in POLICIES[require_choice(policy, "policy", POLICIES)]:
        total = total + (near.any(-1) if extreme == "max" else near.all(-1))
    return np.asarray(total.sum((-2, -1)))


@checked
def enumerated_histogram(num_taps: int, policy: str, include_centre: bool = True) -> Int[np.ndarray, "tones"]:
    """How many of all 2^((K+2)²) binary windows give each number of lit tests; every window is visited.

    Source: mdsm, section 4.4; neighbourhood 3 × 3. At most 9 taps (2^25 windows, seconds).
    """
    width = kernel_width(num_taps)
    require(width <= 3, f"enumeration visits 2^((K+2)²) windows: at most 9 taps, got {num_taps}; use window_histogram")
    side = width + 2
    extremes = POLICIES[require_choice(policy, "policy", POLICIES)]
    histogram = np.zeros(num_depths(policy) * num_taps + 1, np.int64)
    # A window is an integer whose bit side·row + col is a texel; blocks of 2²⁰ bound the memory.
    for start in range(0, 2 ** (side * side), 2**20):
        windows = np.arange(start, min(start + 2**20, 2 ** (side * side)), dtype=np.uint32)
        total = np.zeros(windows.shape, np.uint8)
        for row in range(width):
            for col in range(width):
                block = sum(1 << (side * (row + i) + col + j) for i in range(3) for j in range(3))
                own = 1 << (side * (row + 1) + col + 1)
                near = windows & np.uint32(block if include_centre else block & ~own)
                total += (windows & np.uint32(own)) != 0
                for extreme in extremes:
                    full = np.uint32(block if include_centre else block & ~own)
                    # A window of bits: its maximum is lit where any bit is, its minimum where all are.
                    total += near != 0 if extreme == "max" else near == full
        histogram += np.bincount(total, minlength=histogram.size)
    return histogram


@checked
@functools.cache
def window_histogram(num_taps: int, policy: str, include_centre: bool = True) -> tuple[int, ...]:
    """The histogram of `enumerated_histogram`, counted row by row with a transfer matrix, for any square filter.

    The state is the last two rows of the window; a new row settles the taps of the row before it. Exact integers; work
    grows as 2^(3K+6), so 16 taps take a second and 25 some tens of them.
    """
    width = kernel_width(num_taps)
    side, extremes = width + 2, POLICIES[require_choice(policy, "policy", POLICIES)]
    own_bits = 0b101 if not include_centre else 0b111
    rows = np.arange(2**side)
    above, middle = rows[:, None], rows[None, :]
    tones = num_depths(policy) * num_taps + 1
    # counts[above, middle, t]: windows so far whose last two rows are these and of whose tests t are lit.
    counts = np.zeros((rows.size, rows.size, tones), np.int64)
    counts[..., 0] = 1
    for _ in range(width):
        grown = np.zeros_like(counts)
        for below in range(2**side):
            lit = np.zeros((rows.size, rows.size), np.int64)
            for col in range(width):
                # The three rows of bits of one tap's 3 × 3 neighbourhood.
                a, b, c = (above >> col) & 7, (middle >> col) & own_bits, (below >> col) & 7
                lit += (middle >> (col + 1)) & 1
                if "max" in extremes:
                    lit += (a | b | c) != 0
                if "min" in extremes:
                    lit += (a == 7) & (b == own_bits) & (c == 7)
            for value in range(int(lit.max()) + 1):
                # Adding `value` lit tests shifts the histogram; the oldest row is summed out.
                chosen = np.where((lit == value)[..., None], counts[..., : tones - value], 0)
                grown[:, below, value:] += chosen.sum(0)
        counts = grown
    return tuple(int(count) for count in counts.sum((0, 1)))


@checked
@functools.cache
def half_plane_windows(side: int) -> Bool[np.ndarray, "patterns rows cols"]:
    """Every distinct window that a straight edge can make: the linearly separable subsets of a side × side grid.

    Between two neighbouring critical directions (perpendicular to a difference of two texels) the order of the texels
    along the edge's normal is fixed, so the subsets are the prefixes of these orders. Exact integers.
    """
    require_int(side, "window side", 1)
    reach = range(max(side, 2))  # a single texel has no differences, and needs a direction all the same
    steps = [(x, y) for x in reach for y in reach if math.gcd(x, y) == 1]
    turned = sorted({(x, y) for x, y in steps} | {(-y, x) for x, y in steps}, key=lambda d: math.atan2(d[1], d[0]))
    turned.append((-turned[0][0], -turned[0][1]))  # half a turn closes the circle: complements do the rest
    y, x = np.divmod(np.arange(side * side), side)
    patterns = {np.zeros(side * side, bool).tobytes(), np.ones(side * side, bool).tobytes()}
    for (ax, ay), (bx, by) in itertools.pairwise(turned):
        # The sum of two neighbouring critical directions lies strictly between them.
        order = np.argsort((ax + bx) * x + (ay + by) * y, kind="stable")
        # Prefixes of the order are the half-planes of this direction; complements those of the opposite one.
        lit = np.zeros(side * side, bool)
        for texel in order:
            lit[texel] = True
            patterns |= {lit.tobytes(), (~lit).tobytes()}
    stacked = np.frombuffer(b"".join(sorted(patterns)), bool)
    return stacked.reshape(len(patterns), side, side)


@checked
def axis_step_windows(side: int) -> Bool[np.ndarray, "patterns rows cols"]:
    """Windows of an edge along the columns: the first 0, 1, ... `side` columns are in shadow."""
    columns = np.arange(side) >= np.arange(side + 1)[:, None]
    return np.broadcast_to(columns[:, None, :], (side + 1, side, side))


@checked
def diagonal_step_windows(side: int) -> Bool[np.ndarray, "patterns rows cols"]:
    """Windows of an edge at 45°: the first diagonals are in shadow."""
    diagonal = np.add.outer(np.arange(side), np.arange(side))
    return diagonal >= np.arange(2 * side)[:, None, None]


@checked
def disk_map(size: int, radius: float, centre: tuple[float, float]) -> Bool[np.ndarray, "size size"]:
    """Lit texels of a map whose occluder is a disk; texels are points at whole coordinates, `centre` is (row, col)."""
    row, col = np.ogrid[:size, :size]
    return (row - centre[0]) ** 2 + (col - centre[1]) ** 2 > radius**2
