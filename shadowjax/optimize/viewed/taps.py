"""Which extra depths a multi-depth map should keep, by exhaustive search; where PCF's taps should lie, by gradient."""

import itertools
from dataclasses import asdict, dataclass
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import optimistix as optx

from shadowjax._checked import checked
from shadowjax._checks import require, require_choice, require_int, require_untraced
from shadowjax._types import Array, Float
from shadowjax.filters.chosen_depths import Cells, Ranks, neighbourhood_cells, ranked
from shadowjax.filters.multi_depth import DepthPolicy, ring_offsets, shifted
from shadowjax.filters.offset_pcf import OffsetPercentageCloser
from shadowjax.filters.pcf import kernel_offsets, percentage_closer
from shadowjax.optimize.viewed.views import Viewed

CANDIDATES = ("ranks", "cells")


@checked
@dataclass(frozen=True)
class BestDepths:
    """The extra depths of least error, and the published choices next to them.

    Attributes:
        candidates: "ranks" (order statistics of the 3 × 3 neighbourhood) or "cells" (its eight neighbours).
        chosen: Ranks, or (row, column) offsets.
        kernel_size: K of the PCF over the map.
        error: Root mean squared error over the scenes searched.
        test_error: The same over other scenes.
        published: Name → (error, test error) of the published choices with the same number of depths.
        best_published: Name of the one with the least error over the scenes searched.
        test_gain: Its test error over that of the chosen depths; above 1 the choice carries over.
        num_sets: Sets that were measured: all there are.
    """

    candidates: str
    chosen: tuple[Any, ...]
    kernel_size: int
    error: float
    test_error: float
    published: dict[str, tuple[float, float]]
    best_published: str
    test_gain: float
    num_sets: int

    def to_json(self) -> dict[str, Any]:
        """Plain values, as `optimize taps` writes them."""
        return asdict(self)

    @property
    def policy(self) -> DepthPolicy:
        """The policy that keeps the chosen depths."""
        return Ranks(self.chosen) if self.candidates == "ranks" else Cells(self.chosen)


@eqx.filter_jit
def _plane_visibilities(view: Viewed, candidates: str, kernel_size: int) -> Float[Array, "planes points"]:
    """PCF over each candidate plane alone, the own depth first; a composite test is the mean of some of them."""
    shadows = view.shadows
    shadow_map = shadows.maps[0]
    cells = [cell for cell in neighbourhood_cells(3) if cell != (0, 0)]
    others = ranked(shadow_map.depth) if candidates == "ranks" else _stacked(shadow_map.depth, cells)
    planes = jnp.concatenate([shadow_map.depth[None], others])
    biased = eqx.tree_at(
        lambda s: s.bias.value, shadows, jnp.asarray(kernel_size / 2 + 1, shadow_map.depth.dtype)
    )  # the same for every set: reach of the kernel and of the neighbourhood
    lookup = biased.lookup(shadow_map, view.points, view.normals)
    return jnp.stack([percentage_closer(plane[None], lookup, kernel_size) for plane in planes])


def _stacked(depth: Float[Array, "rows cols"], cells: list[tuple[int, int]]) -> Float[Array, "n rows cols"]:
    return jnp.stack([shifted(depth, *cell) for cell in cells])


@checked
def set_errors(
    visibilities: Float[np.ndarray, "planes points"], view: Viewed, sets: list[tuple[int, ...]]
) -> Float[np.ndarray, "sets"]:
    """Squared error of the composite test of the own depth and of each set of planes.

    The composite test is the mean of its planes' tests, so all sets follow from one matrix of inner products.
    """
    weight = np.asarray(view.weight, float)
    off = np.asarray(visibilities, float) - np.asarray(view.exact, float)
    products = (off * weight) @ off.T
    errors = []
    for members in sets:
        index = [0, *members]
        errors.append(products[np.ix_(index, index)].mean())
    return np.array(errors)


@checked
def best_depths(
    views: tuple[Viewed, ...],
    test_views: tuple[Viewed, ...],
    num_depths: int = 3,
    kernel_size: int = 1,
    candidates: str = "ranks",
) -> BestDepths:
    """Measure every set of extra depths on some scenes, take the best, and measure it on others.

    Args:
        views: Scenes that choose.
        test_views: Scenes that do not.
        num_depths: n, the own depth counted, 2 to 5.
        kernel_size: K of the PCF over the map, ≥ 1.
        candidates: "ranks" or "cells".

    Raises:
        ValueError: If a number or name is out of range.

    Source: mdsm leaves a better choice of the extra depths as future work.
    """
    require_untraced("best_depths", views, test_views)
    require_choice(candidates, "candidates", CANDIDATES)
    require_int(kernel_size, "kernel_size", 1)
    depths = require_int(num_depths, "num_depths", 2)
    require(depths <= 5, f"num_depths is at most 5, of which one is the texel's own; got {depths}")
    require(min(len(views), len(test_views)) > 0, "give at least one scene to choose by and one to test on")
    count = 9 if candidates == "ranks" else 8
    sets = list(itertools.combinations(range(1, count + 1), depths - 1))
    known = _published(candidates, depths)

    def error(some: tuple[Viewed, ...], chosen: list[tuple[int, ...]]) -> np.ndarray:
        each = [
            set_errors(np.asarray(_plane_visibilities(view, candidates, kernel_size)), view, chosen) for view in some
        ]
        return np.sqrt(np.mean(each, axis=0))

    measured, test = error(views, sets), error(test_views, sets)
    best = int(np.argmin(measured))
    where = {members: index for index, members in enumerate(sets)}
    published = {name: (float(measured[where[m]]), float(test[where[m]])) for name, m in known.items()}
    rival = min(published, key=lambda name: published[name][0])
    cells = [cell for cell in neighbourhood_cells(3) if cell != (0, 0)]
    chosen = sets[best] if candidates == "ranks" else tuple(cells[i - 1] for i in sets[best])
    return BestDepths(
        candidates, chosen, kernel_size, float(measured[best]), float(test[best]), published, rival,
        published[rival][1] / max(float(test[best]), 1e-12), len(sets),
    )  # fmt: skip


def _published(candidates: str, depths: int) -> dict[str, tuple[int, ...]]:
    """Published choices among the candidates, as numbers of planes; plane 0 is the own depth."""
    if candidates == "ranks":
        choices = {2: {"max": (9,), "min": (1,)}, 3: {"min-max": (1, 9)}}
        return choices.get(depths, {"evenly spread": tuple(np.linspace(1, 9, depths - 1).round().astype(int).tolist())})
    cells = [cell for cell in neighbourhood_cells(3) if cell != (0, 0)]
    return {"ring": tuple(sorted(1 + cells.index(offset) for offset in ring_offsets(depths)))}


@checked
@dataclass(frozen=True)
class BestTaps:
    """Learned offsets of bilinear PCF taps.

    Attributes:
        offsets: (x, y) of each tap, texels.
        start_offsets: Where they began: a K × K grid one texel apart.
        error: Root mean squared error over the scenes learned from.
        start_error: That of the grid.
        test_error: Over other scenes.
        test_start_error: That of the grid there.
        steps: Steps of the minimiser.
    """

    offsets: tuple[tuple[float, float], ...]
    start_offsets: tuple[tuple[float, float], ...]
    error: float
    start_error: float
    test_error: float
    test_start_error: float
    steps: int

    def to_json(self) -> dict[str, Any]:
        """Plain values, as `optimize taps` writes them."""
        return asdict(self)


@eqx.filter_jit
def _taps_error(offsets: Float[Array, "taps 2"], views: tuple[Viewed, ...], extent: float) -> Float[Array, ""]:
    """Mean squared error of taps at these offsets."""
    total = jnp.zeros((), views[0].exact.dtype)
    filter_ = OffsetPercentageCloser(offsets, extent)
    for view in views:
        shadow_map = view.shadows.maps[0]
        biased = eqx.tree_at(lambda s: s.bias.value, view.shadows, jnp.asarray(filter_.reach, shadow_map.depth.dtype))
        lookup = biased.lookup(shadow_map, view.points, view.normals)
        value = filter_.visibility(shadow_map.depth[None], lookup)
        total = total + jnp.sum(view.weight * (value - view.exact) ** 2)
    return total / len(views)


@checked
def best_taps(
    views: tuple[Viewed, ...], test_views: tuple[Viewed, ...], kernel_size: int = 2, steps: int = 24
) -> BestTaps:
    """Learn where K² bilinear taps should lie, by BFGS on the squared error.

    Tests of depth are steps, but bilinear weights are not: the gradient tells how the error changes as taps move. Taps
    stay inside the grid's own extent plus a texel, so that one bias serves all of them.

    Args:
        views: Scenes to learn from.
        test_views: Scenes to test on.
        kernel_size: K, taps along an axis, ≥ 1.
        steps: Most steps of the minimiser, ≥ 1.

    Raises:
        ValueError: If a number is out of range.
    """
    require_untraced("best_taps", views, test_views)
    require_int(kernel_size, "kernel_size", 1)
    require_int(steps, "steps", 1)
    require(min(len(views), len(test_views)) > 0, "give at least one scene to learn from and one to test on")
    line = kernel_offsets(kernel_size)
    start = jnp.asarray([(x, y) for y in line for x in line], views[0].exact.dtype)
    extent = float(max(map(abs, line))) + 1.0
    room = extent + 1e-3
    # The unconstrained variable of offset = room · tanh(u)
    free = jnp.arctanh(start / room)

    def loss(u: Array, viewed: tuple[Viewed, ...]) -> Array:
        return _taps_error(room * jnp.tanh(u), viewed, extent)

    solver = optx.BFGS(rtol=1e-4, atol=1e-6)
    found = optx.minimise(loss, solver, free, views, max_steps=steps, throw=False)
    learned = room * jnp.tanh(found.value)

    def error(offsets: Array, some: tuple[Viewed, ...]) -> float:
        return float(jnp.sqrt(_taps_error(offsets, some, extent)))

    learned = learned if error(learned, views) <= error(start, views) else start

    def pairs(offsets: Array) -> tuple[tuple[float, float], ...]:
        return tuple((float(x), float(y)) for x, y in np.asarray(offsets))

    return BestTaps(
        pairs(learned), pairs(start), error(learned, views), error(start, views), error(learned, test_views),
        error(start, test_views), int(found.stats["num_steps"]),
    )  # fmt: skip


__all__ = ["CANDIDATES", "BestDepths", "BestTaps", "best_depths", "best_taps", "set_errors"]
