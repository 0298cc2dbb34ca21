"""Which extra depths a multi-depth map should keep, by exhaustive search; where PCF's taps should lie, by gradient."""

import itertools
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx

from shadowjax._checked import Checked, checked
from shadowjax._checks import require, require_choice, require_int, require_untraced
from shadowjax._types import Array, Float, Int, Scalar
from shadowjax.bias.rule import Bias
from shadowjax.filters.base import Filter
from shadowjax.filters.chosen_depths import Cells, Ranks, neighbourhood_cells, ranked
from shadowjax.filters.hard import Hard
from shadowjax.filters.multi_depth import DepthPolicy, MultiDepth, ring_offsets, shifted
from shadowjax.filters.offset_pcf import OffsetPercentageCloser
from shadowjax.filters.pcf import BilinearPercentageCloser, PercentageCloser, kernel_offsets, percentage_closer_of
from shadowjax.optimize.solution import Solution, SolutionKind, ended, with_maps
from shadowjax.optimize.viewed.views import Viewed, Views, as_maps, as_views, filter_of, parts_of, refiltered
from shadowjax.techniques.base import Technique
from shadowjax.techniques.shadow_mapping import MappedShadows, ShadowMapping

CANDIDATES = ("ranks", "cells")


class DepthCertificate(Checked):
    """Measurements reported with the extra depths of least error.

    Attributes:
        candidates: "ranks" (order statistics of the 3 × 3 neighbourhood) or "cells" (its eight neighbours).
        chosen: Ranks, or (row, column) offsets.
        kernel_size: K of the PCF over the map.
        test_error: The error over other scenes.
        test_baselines: The same of the published choices.
        num_sets: Sets that were measured: all there are.
    """

    candidates: str = eqx.field(static=True)
    chosen: tuple[Any, ...] = eqx.field(static=True)
    kernel_size: int = eqx.field(static=True)
    test_error: Scalar
    test_baselines: dict[str, Scalar]
    num_sets: int = eqx.field(static=True)


def _technique(found: Any, resolution: int, options: dict[str, Any]) -> ShadowMapping:
    searched, texels = found.problem
    return with_maps(resolution, options, **{**parts_of(searched), "bias": Bias(texels, "slope")})


def _kernel_size(filter_: Filter) -> int:
    """K of a filter that counts tests one texel apart."""
    if isinstance(filter_, Hard):
        return 1
    counts = isinstance(filter_, PercentageCloser | BilinearPercentageCloser | MultiDepth)
    if not counts or getattr(filter_, "width_world", None) is not None:
        raise ValueError(
            f"taps and depths are searched for filters that count tests one texel apart; got {type(filter_).__name__}: "
            "take a technique with hard, pcf-KxK or pcf-bilinear-KxK"
        )
    return filter_.kernel_size


DEPTHS = SolutionKind(
    (
        ("candidates", "certificate.candidates"), ("chosen", "certificate.chosen"),
        ("kernel_size", "certificate.kernel_size"), ("error", "objective_value"),
        ("test_error", "certificate.test_error"), ("baselines", "baselines"),
        ("test_baselines", "certificate.test_baselines"), ("best_published", "kind.rival"), ("gain", "gain"),
        ("num_sets", "certificate.num_sets"), ("result", "text"),
    ),
    technique=_technique,
)  # fmt: skip


@eqx.filter_jit
def _plane_visibilities(
    shadows: MappedShadows, view: Viewed, candidates: str, kernel_size: int
) -> Float[Array, "planes points"]:
    """PCF over each candidate plane alone, the own depth first; a composite test is the mean of some of them."""
    cells = [cell for cell in neighbourhood_cells(3) if cell != (0, 0)]
    dtype = shadows.maps[0].depth.dtype
    biased = eqx.tree_at(lambda s: s.bias, shadows, Bias(jnp.asarray(_bias(kernel_size), dtype), "slope"))
    shares = shadows.partition.shares(shadows.grids, shadows.camera, view.points)
    total = jnp.maximum(1 - sum(shares), 0)  # lit where no map answers
    for share, shadow_map in zip(shares, shadows.maps, strict=True):
        others = ranked(shadow_map.depth) if candidates == "ranks" else _stacked(shadow_map.depth, cells)
        planes = jnp.concatenate([shadow_map.depth[None], others])
        lookup = biased.lookup(shadow_map, view.points, view.normals)
        total = total + share * jnp.stack([percentage_closer_of(plane[None], lookup, kernel_size) for plane in planes])
    return total


def _stacked(depth: Float[Array, "rows cols"], cells: list[tuple[int, int]]) -> Float[Array, "n rows cols"]:
    return jnp.stack([shifted(depth, *cell) for cell in cells])


def _bias(kernel_size: int) -> float:
    """Texels of slope, the same for every set: reach of the kernel and of the neighbourhood."""
    return kernel_size / 2 + 1


@checked
@eqx.filter_jit
def set_errors(
    visibilities: Float[Array, "planes points"], view: Viewed, sets: Int[Array, "sets members"]
) -> Float[Array, "sets"]:
    """Error of the composite test of the own depth and of each set of planes: the mean of its planes' tests."""

    def one(members: Int[Array, "members"]) -> Array:
        chosen = jnp.concatenate([visibilities[:1], visibilities[members]])
        return view.error(jnp.mean(chosen, axis=0))

    return jax.lax.map(one, sets)


@checked
def depths(
    views: Views,
    test_views: Views,
    num_depths: int = 3,
    technique: str | Technique | Filter = "hard",
    candidates: str = "ranks",
) -> Solution[DepthPolicy, DepthCertificate]:
    """The extra depths of least error for a multi-depth map: every set on some scenes, the best on others too.

    Args:
        views: Scenes that choose, their names, or from `view_scene`.
        test_views: Scenes that do not.
        num_depths: n, the own depth counted, 2 to 5.
        technique: Shadow maps whose filter says how many taps read the depths, by name ("pcf-2x2", as fine as the first
            view's map) or as an object, whose own bias is left aside; or a filter alone, over each view's map.
        candidates: "ranks" or "cells".

    Returns:
        `value` the policy that keeps the chosen depths; `objective_value` the error; `baselines` the published choices
        of as many depths, the best of which the gain counts against. Its technique is the one given, or one uniform
        map, with these depths.

    Raises:
        ValueError: If a number or name is out of range, or the filter does not count tests.

    Source: mdsm leaves a better choice of the extra depths as future work.
    """
    require_untraced("depths", views, test_views, technique)
    require_choice(candidates, "candidates", CANDIDATES)
    num = require_int(num_depths, "num_depths", 2)
    require(num <= 5, f"num_depths is at most 5, of which one is the texel's own; got {num}")
    views, test_views = as_views(views), as_views(test_views)
    searched = as_maps(technique, views[0].resolution)
    kernel_size = _kernel_size(filter_of(searched))
    # Maps reach as far beyond their region as any of the choices reads.
    cast = refiltered(searched, MultiDepth(Ranks((9,)), kernel_size))
    # All sets of extra depths: nine ranks, or eight neighbours, taken num − 1 at a time.
    sets = list(itertools.combinations(range(1, 10 if candidates == "ranks" else 9), num - 1))

    def errors(some: tuple[Viewed, ...]) -> np.ndarray:
        each = [
            set_errors(_plane_visibilities(view.build(cast), view, candidates, kernel_size), view, jnp.asarray(sets))
            for view in some
        ]
        return np.sqrt(np.mean(np.square(np.asarray(each, float)), axis=0))

    # The set is chosen on the first scenes alone; the others only say how it does elsewhere.
    measured, test = errors(views), errors(test_views)
    best = int(np.argmin(measured))
    where = {members: index for index, members in enumerate(sets)}
    known = {name: where[members] for name, members in _published(candidates, num).items()}
    number = lambda x: jnp.asarray(x, views[0].exact.dtype)  # noqa: E731
    cells = [cell for cell in neighbourhood_cells(3) if cell != (0, 0)]
    places = tuple(cells[i - 1] for i in sets[best]) if candidates == "cells" else ()
    policy = Cells(places) if places else Ranks(sets[best])
    certificate = DepthCertificate(
        candidates, places or sets[best], kernel_size, number(test[best]),
        {name: number(test[i]) for name, i in known.items()}, len(sets),
    )  # fmt: skip
    problem = refiltered(searched, MultiDepth(policy, kernel_size)), number(_bias(kernel_size))
    error = number(measured[best])
    kind = DEPTHS._replace(rival=min(known, key=lambda name: measured[known[name]]))
    baselines = {name: number(measured[i]) for name, i in known.items()}
    return Solution(policy, error, baselines, certificate, ended(jnp.isfinite(error)), problem, kind)


def _published(candidates: str, depths: int) -> dict[str, tuple[int, ...]]:
    """Published choices among the candidates, as numbers of planes; plane 0 is the own depth."""
    if candidates == "ranks":
        choices = {2: {"max": (9,), "min": (1,)}, 3: {"min-max": (1, 9)}}
        return choices.get(depths, {"evenly spread": tuple(np.linspace(1, 9, depths - 1).round().astype(int).tolist())})
    cells = [cell for cell in neighbourhood_cells(3) if cell != (0, 0)]
    return {"ring": tuple(sorted(1 + cells.index(offset) for offset in ring_offsets(depths)))}


class TapCertificate(Checked):
    """Measurements reported with learned tap offsets.

    Attributes:
        start_offsets: Where they began: a K × K grid one texel apart, texels.
        test_error: Error over other scenes.
        test_start_error: That of the grid there.
        steps: Steps of the minimiser.
    """

    start_offsets: Float[Array, "taps 2"]
    test_error: Scalar
    test_start_error: Scalar
    steps: int = eqx.field(static=True)


TAPS = SolutionKind(
    (
        ("offsets", "value"), ("start_offsets", "certificate.start_offsets"), ("error", "objective_value"),
        ("start_error", "baselines.start"), ("gain", "gain"), ("test_error", "certificate.test_error"),
        ("test_start_error", "certificate.test_start_error"), ("steps", "certificate.steps"), ("result", "text"),
    ),
    rival="start",
    technique=_technique,
)  # fmt: skip


@eqx.filter_jit
def _taps_error(
    offsets: Float[Array, "taps 2"], views: tuple[Viewed, ...], built: tuple[MappedShadows, ...]
) -> Float[Array, ""]:
    """Mean over views of the squared error of taps at these offsets, on maps built for taps."""
    total = jnp.zeros((), views[0].exact.dtype)
    for view, maps in zip(views, built, strict=True):
        moved = eqx.tree_at(lambda s: s.filter.offsets, maps, offsets)
        total = total + view.error(moved.visibility(view.points, view.normals)) ** 2
    return total / len(views)


@checked
def taps(
    views: Views, test_views: Views, technique: str | Technique | Filter = "pcf-2x2", steps: int = 24
) -> Solution[Float[Array, "taps 2"], TapCertificate]:
    """Where K² bilinear taps of PCF should lie, learned by BFGS on the squared error.

    Tests of depth are steps, but bilinear weights are not: the gradient says how the error changes as taps move. Taps
    stay inside the grid's own extent plus a texel, so that one bias serves all of them.

    Args:
        views: Scenes to learn from, their names, or from `view_scene`.
        test_views: Scenes to test on.
        technique: Shadow maps whose filter says how many taps there are, K², by name (as fine as the first view's map)
            or as an object, whose own bias is left aside; or a filter alone, over each view's map.
        steps: Most steps of the minimiser, ≥ 1.

    Returns:
        `value` (x, y) of each tap, texels; `objective_value` the error; `baselines` "start", a grid one texel apart.
        Its technique is the one given, or one uniform map, read through these taps.

    Raises:
        ValueError: If a number or name is out of range, or the filter does not count tests.
    """
    require_untraced("taps", views, test_views, technique)
    require_int(steps, "steps", 1)
    views, test_views = as_views(views), as_views(test_views)
    searched = as_maps(technique, views[0].resolution)
    line = kernel_offsets(_kernel_size(filter_of(searched)))
    start = jnp.asarray([(x, y) for y in line for x in line], views[0].exact.dtype)
    extent = float(max(map(abs, line))) + 1.0
    room = extent + 1e-3
    cast = refiltered(searched, OffsetPercentageCloser(start, extent))
    built, test_built = (tuple(view.build(cast) for view in some) for some in (views, test_views))
    # The unconstrained variable of offset = room · tanh(u)
    free = jnp.arctanh(start / room)

    def loss(u: Array, some: tuple[tuple[Viewed, ...], tuple[MappedShadows, ...]]) -> Array:
        return _taps_error(room * jnp.tanh(u), *some)

    solver = optx.BFGS(rtol=1e-4, atol=1e-6)
    found = optx.minimise(loss, solver, free, (views, built), max_steps=steps, throw=False)
    # Back to offsets, which the hyperbolic tangent keeps within the room.
    learned = room * jnp.tanh(found.value)

    def error(offsets: Array, *some: Any) -> Array:
        return jnp.sqrt(_taps_error(offsets, *some))

    before, after = error(start, views, built), error(learned, views, built)
    helped = bool(after <= before)
    learned, after = (learned, after) if helped else (start, before)
    result = found.result if helped else optx.RESULTS.stagnation
    certificate = TapCertificate(
        start,
        error(learned, test_views, test_built),
        error(start, test_views, test_built),
        int(found.stats["num_steps"]),
    )
    filter_ = OffsetPercentageCloser(learned, extent)
    problem = refiltered(searched, filter_), jnp.asarray(filter_.reach, start.dtype)
    return Solution(learned, after, {"start": before}, certificate, result, problem, TAPS)


__all__ = ["CANDIDATES", "DepthCertificate", "TapCertificate", "depths", "set_errors", "taps"]
