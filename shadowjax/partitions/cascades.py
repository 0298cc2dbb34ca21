"""Slices of the view in depth (cascades), each with a map of its own: rules, choice by point, blending at seams."""

import dataclasses
import itertools
import math
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from shadowjax._checks import require, require_choice, require_int, require_value
from shadowjax._types import Array, ArrayLike, Float, Int, Points, Scalar, as_float_array
from shadowjax.geometry.camera import Camera
from shadowjax.geometry.light import Light
from shadowjax.geometry.mesh import Mesh
from shadowjax.partitions import seen_depths
from shadowjax.partitions.base import Partition
from shadowjax.partitions.single import SingleMap
from shadowjax.rays.caster import Caster
from shadowjax.rays.casters import default_caster
from shadowjax.rays.map_part import seen_space, starting_outside
from shadowjax.rays.ray_grid import RayGrid
from shadowjax.theory.aliasing.split_rules import (
    Splits,
    adaptive_splits,
    given_splits,
    iterate_adaptive,
    logarithmic_splits,
    practical_splits,
    splits_after,
    uniform_splits,
)
from shadowjax.warps.base import WarpFit
from shadowjax.warps.fit import PerspectiveFit, visible_range

SPLIT_RULES = ("uniform", "logarithmic", "practical", "adaptive", "shares", "first", *seen_depths.SEEN_RULES)
CHOICES = ("map", "depth")
LEAST_RATIO = 1 + 1e-3  # of far to near
MISSED = 0.05  # share by which the range of a coarse depth buffer is widened


class Cascades(Partition):
    """Slices of the camera's frustum in depth, each with a map of its own (cascades).

    Every map is fitted to its own slice: to the frustum between the slice's planes, for uniform maps cut to the scene's
    box and a spot light's cone. Casters outside the slice are on the rays of its receivers, so none is lost.

    Points take the first map, from the nearest slice on, that holds them with all that the filter reads: a slice's map
    often reaches beyond its far plane, and points there then get its finer texels. Or they take the slice that their
    depth lies in; that is what blending needs, since only then is the next map known to cover the points next to the
    seam.

    A point light shines in every direction and its rays have no plane to fit slices to: it gets one map of `SingleMap`
    with this warp.

    Attributes:
        num_partitions: k, the number of maps.
        rule: "uniform", "logarithmic", "practical", "adaptive", "shares" or "first"; or, from the depths that the
            camera sees, "seen", "quantile" or "histogram" (`shadowjax.partitions.seen_depths`).
        weight: λ of the practical rule.
        ratio: α of every slice but the first, for the adaptive rule; lowered to what far/near allows.
        warp: How each slice's texels are spread.
        tight: Whether the range is cut to the depths at which the scene has vertices.
        blend: Width of the band before each cut in which the next slice's answer fades in, as a share of the nearer
            slice's range of ln z, in [0, 1]; with a width, points are chosen by depth.
        choose: "map" or "depth", as above.
        cuts: The k + 1 planes themselves, world units; they replace the rule.
        near_distances: n' of every slice, world units; they replace the rule of the warp, a `PerspectiveFit`, whose
            map then covers its slice from cut to cut, wherever the scene has vertices.
        num_rows: Rows of the depth buffer that the rules of seen depths look at. What lies between its rows, as a floor
            near the horizon may, and deeper than 1.05 times all that it sees, is in no slice and lit.
        caster: Traces that buffer.
        distance: The shadow distance, world units: slices end there, and everything deeper is lit. None for the
            camera's far plane. A map that does not follow what is seen (`StableFit`) spends its texels on all of it.
        fade: Share of the shadow distance, at its end, over which shadows fade out, in [0, 1].
        shares_of_range: The k − 1 cuts of the rule "shares", as rising shares of [near, far] in (0, 1).
        first: The first cut of the rule "first", world units; the other slices have equal ratios. Beyond the range it
            is left out, and all ratios are equal.
        margin: Texels beyond every edge of a slice that its uniform map has for filters to read, ≥ 0; a technique sets
            it by `with_margin`.
    """

    num_partitions: int = eqx.field(static=True, default=4)
    rule: str = eqx.field(static=True, default="logarithmic")
    weight: float = eqx.field(static=True, default=0.5)
    ratio: float = eqx.field(static=True, default=3.0)
    warp: WarpFit = PerspectiveFit()
    tight: bool = eqx.field(static=True, default=True)
    blend: float = eqx.field(static=True, default=0.0)
    choose: str = eqx.field(static=True, default="map")
    cuts: Splits | None = None
    near_distances: Float[Array, "slices"] | None = None
    num_rows: int = eqx.field(static=True, default=64)
    caster: Caster = default_caster()
    distance: float | Scalar | None = None
    fade: float = eqx.field(static=True, default=0.0)
    shares_of_range: tuple[float, ...] | None = eqx.field(static=True, default=None)
    first: float | Scalar | None = None
    margin: int = eqx.field(static=True, default=0)

    def __check_init__(self) -> None:
        require_int(self.num_partitions, "num_partitions", 1)
        require_choice(self.rule, "rule", SPLIT_RULES)
        require_choice(self.choose, "choose", CHOICES)
        require(0 <= self.weight <= 1, f"weight, λ, must lie in [0, 1]; got {self.weight}")
        require(self.ratio > 1, f"ratio, α, must exceed 1; got {self.ratio}")
        require(0 <= self.blend <= 1, f"blend, a share of a slice, must lie in [0, 1]; got {self.blend}")
        require(0 <= self.fade <= 1, f"fade, a share of the shadow distance, must lie in [0, 1]; got {self.fade}")
        require_int(self.num_rows, "num_rows", 1)
        require_int(self.margin, "margin", 0)
        if self.rule == "shares":
            given = self.shares_of_range or ()
            rises = all(0 < low < high < 1 for low, high in itertools.pairwise((*given, 1 - 1e-9)))
            require(
                len(given) == self.num_partitions - 1 and rises,
                f"the rule 'shares' needs {self.num_partitions - 1} rising shares in (0, 1) as shares_of_range; got "
                f"{self.shares_of_range}",
            )
        if self.rule == "first":
            require(self.first is not None, "the rule 'first' needs the first cut, world units, as first")
        if self.near_distances is not None:
            given = np.shape(self.near_distances)
            require(
                given == (self.num_partitions,),
                f"near_distances must hold one n' for each of {self.num_partitions} slices; got shape {given}",
            )
            require(
                isinstance(self.warp, PerspectiveFit),
                f"near_distances need the warp PerspectiveFit(); got {type(self.warp).__name__}",
            )
        for name, value in (("distance", self.distance), ("first", self.first)):
            if isinstance(value, int | float):
                require(value > 0, f"{name}, world units, must be positive; got {value}")

    @classmethod
    def at(cls, cuts: ArrayLike, near_distances: ArrayLike | None = None, **options: Any) -> "Cascades":
        """Slices between given planes, such as an optimiser's.

        Args:
            cuts: k + 1 rising depths, world units, the first > 0.
            near_distances: n' of every slice, world units, > 0; those of the warp's rule if None.
            options: Further attributes.

        Raises:
            ValueError: If there are fewer than two planes, they do not rise, or there is not one positive n' a slice.
        """
        planes = as_float_array(cuts)
        require(
            planes.ndim == 1 and planes.shape[0] > 1, f"cuts must be at least two planes in a row; got {planes.shape}"
        )
        rises = (planes[0] > 0) & jnp.all(planes[1:] > planes[:-1])
        planes = require_value(planes, rises, "cuts must be positive depths that rise")
        given = None
        if near_distances is not None:
            given = as_float_array(near_distances)
            given = require_value(given, given > 0, "near_distances must be positive")
        return cls(planes.shape[0] - 1, cuts=planes, near_distances=given, **options)

    def planes(self, mesh: Mesh, light: Light, camera: Camera) -> Splits:
        """The k + 1 depths of this partition for a scene and a view."""
        if self.cuts is not None:
            return self.cuts.astype(camera.near.dtype)
        near, far = visible_range(camera, mesh) if self.tight else (camera.near, camera.far)
        if self.distance is not None:
            reach = jnp.asarray(self.distance, near.dtype)
            near = jnp.where(reach > near * LEAST_RATIO, near, camera.near)
            far = jnp.maximum(jnp.minimum(far, reach), near * LEAST_RATIO)
        k = self.num_partitions
        if self.rule in seen_depths.SEEN_RULES:
            depth, seen = seen_depths.seen_depths(mesh, camera, self.caster, self.num_rows)
            return seen_depths.seen_splits(depth, seen & (depth <= far), near, far, k, self.rule, MISSED)
        if self.rule == "shares" and self.shares_of_range is not None:
            return given_splits(near, far, jnp.asarray(self.shares_of_range, near.dtype))
        if self.rule == "first" and self.first is not None:
            return splits_after(near, jnp.asarray(self.first, near.dtype), far, k)
        if self.rule == "uniform":
            return uniform_splits(near, far, k)
        if self.rule == "practical":
            return practical_splits(near, far, k, jnp.asarray(self.weight, near.dtype))
        if self.rule == "logarithmic" or not light.is_directional or k == 1:
            return logarithmic_splits(near, far, k)
        # Eq. 55 needs Πα ≤ f/n; equal ratios (f/n)^(1/k) are the largest that always fit.
        ratio = jnp.minimum(jnp.asarray(self.ratio, near.dtype), (far / near) ** (1 / k))
        weight = camera.gamma(light.as_directional("adaptive splits need").direction) / (math.pi / 2)
        return iterate_adaptive(near, far, weight, jnp.broadcast_to(ratio, (k - 1,)), 0.25)

    def with_margin(self, texels: float) -> "Cascades":
        """The slices with maps that hold what a filter reads `texels` away, and what a bias moves it further."""
        return dataclasses.replace(self, margin=2 * math.ceil(texels))

    def fit(self, mesh: Mesh, light: Light, camera: Camera) -> "Cascades":
        """With the planes of this scene and view as `cuts`."""
        planes = self.planes(mesh, light, camera)
        return eqx.tree_at(lambda p: p.cuts, self, planes, is_leaf=lambda x: x is None)

    def grids(self, mesh: Mesh, light: Light, camera: Camera, resolution: int) -> tuple[RayGrid, ...]:
        """One grid a slice, the nearest first; each reaches back over the band in which it fades in.

        One grid in all for a point light.
        """
        if light.is_omnidirectional:
            return SingleMap(self.warp).grids(mesh, light, camera, resolution)
        space = seen_space(light, mesh, camera)
        planes = self.planes(mesh, light, camera)
        # A slice's map begins where it fades in, before its own cut.
        starts = jnp.concatenate([planes[:1], self._bands(planes)])
        maps = []
        # at most half of a map is margin
        factor = resolution / max(resolution - 2 * self.margin, resolution / 2)
        for i in range(self.num_partitions):
            part = eqx.tree_at(lambda c: (c.near, c.far), camera, (starts[i], planes[i + 1]))
            maps.append(self._slice_warp(i).fit(space, light, mesh, part).enlarged(factor))
        return tuple(starting_outside(space, plane_map, mesh, resolution) for plane_map in maps)

    def _slice_warp(self, index: int) -> WarpFit:
        """How the texels of a slice are spread."""
        if self.near_distances is None:
            return self.warp.for_slices()
        assert isinstance(self.warp, PerspectiveFit)
        return dataclasses.replace(self.warp, near_distance=self.near_distances[index], tight=False)

    def _bands(self, planes: Splits) -> Float[Array, "cuts"]:
        """Depth at which each slice but the first begins to fade in."""
        cuts = planes[1:-1]
        # A share of the slice's range of ln z: at 0 the band has no width, at 1 it fills the slice.
        return cuts * (planes[:-2] / cuts) ** self.blend

    @property
    def num_maps(self) -> int:
        """One a slice."""
        return self.num_partitions

    def select(self, grids: tuple[RayGrid, ...], camera: Camera, points: Points) -> Int[Array, "*points"]:
        """The region of each point; by depth, that of the larger share."""
        if len(grids) == 1:
            return jnp.zeros(points.shape[:-1], jnp.int32)
        if self.choose == "depth" or self.blend > 0:
            planes = self._placed_planes()
            # Where both shares are ½: they change linearly in ln z between band and cut.
            middle = jnp.sqrt(self._bands(planes) * planes[1:-1])
            depth = camera.to_view(points)[..., 2]
            return jnp.sum(depth[..., None] >= middle, axis=-1, dtype=jnp.int32)
        # the first map that holds a point with what a filter reads around it, else the first that holds it at all
        # (s, t) of every point in every map; the second pass, with the inset, overwrites what the first found.
        squares = [grid.plane_map.forward(grid.space.project(points)[0]) for grid in grids]
        region = jnp.full(points.shape[:-1], len(grids) - 1, jnp.int32)
        for inset in (0.0, self.margin / grids[0].num_rows):
            for i in reversed(range(len(grids))):
                inside = jnp.all((squares[i] >= inset) & (squares[i] <= 1 - inset), axis=-1)
                region = jnp.where(inside, jnp.asarray(i, jnp.int32), region)
        return region

    def shares(self, grids: tuple[RayGrid, ...], camera: Camera, points: Points) -> tuple[Float[Array, "*points"], ...]:
        """One region alone, or two in the band before a cut, the farther one's share rising linearly with ln z.

        Nothing at the shadow distance and beyond it.
        """
        if self.blend == 0 or len(grids) == 1:
            shares = super().shares(grids, camera, points)
        else:
            planes = self._placed_planes()
            bands, cuts = self._bands(planes), planes[1:-1]
            depth = jnp.maximum(camera.to_view(points)[..., 2], planes[0])
            arrived = [
                jnp.clip(jnp.log(depth / bands[i]) / jnp.log(cuts[i] / bands[i]), 0, 1) for i in range(len(grids) - 1)
            ]
            # How far each slice has faded in; differences of neighbours are shares, so they sum to 1.
            reached = [jnp.ones_like(depth), *arrived, jnp.zeros_like(depth)]
            shares = tuple(reached[i] - reached[i + 1] for i in range(len(grids)))
        if self.distance is None:
            return shares
        end = jnp.asarray(self.distance, points.dtype)
        left = end - camera.to_view(points)[..., 2]
        kept = jnp.clip(left / (self.fade * end), 0, 1) if self.fade > 0 else (left > 0).astype(points.dtype)
        return tuple(share * kept for share in shares)

    def _placed_planes(self) -> Splits:
        require(self.cuts is not None, "slices chosen by depth must be fitted first, by partition.fit(…)")
        assert self.cuts is not None
        return self.cuts


__all__ = [
    "CHOICES",
    "SPLIT_RULES",
    "Cascades",
    "Splits",
    "adaptive_splits",
    "iterate_adaptive",
    "logarithmic_splits",
    "practical_splits",
    "uniform_splits",
]  # fmt: skip
