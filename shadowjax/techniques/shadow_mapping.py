"""Shadow maps: partition × warp × filter × caster."""

import dataclasses
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp

from shadowjax._checks import concrete, require, require_choice, require_int
from shadowjax._numerics import faces_light
from shadowjax._types import Array, Float, Int, Points
from shadowjax.bias.kinds import BiasSum, ReceiverPlane
from shadowjax.bias.rule import Bias, BiasRule, plane_gradient, texel_size
from shadowjax.filters.base import Filter, Lookup
from shadowjax.filters.hard import Hard
from shadowjax.geometry.camera import Camera
from shadowjax.geometry.light import Light
from shadowjax.geometry.mesh import Mesh
from shadowjax.geometry.outlines import MeshEdges, mesh_edges
from shadowjax.maps.shadow_map import ShadowMap, build_covered_map, build_shadow_map
from shadowjax.partitions.base import Partition
from shadowjax.partitions.single import SingleMap
from shadowjax.rays.caster import Caster
from shadowjax.rays.casters import default_caster
from shadowjax.rays.layers import LAYERS
from shadowjax.rays.precision import warn_of_coarse_texels
from shadowjax.rays.ray_grid import RayGrid, pixel_footprint
from shadowjax.techniques.base import Shadows, Technique
from shadowjax.theory.memory import planes_in_formats


class ShadowMapping(Technique):
    """Shadow maps: partition × warp × filter × caster.

    Attributes:
        filter: Turns stored depths into visibility.
        resolution: Texels along each side of every map, ≥ 1.
        partition: Regions of the light's plane, and the warp of each.
        caster: Fills the maps.
        bias: Depth tolerance of the test; None takes the smallest slope-scaled bias that removes shadow acne on planes
            for this filter, and none for layers behind the first.
        layer: Which depth each ray keeps: "first"; "second", the next surface; "back", the first surface met from
            behind, which is the second of closed bodies; "midpoint" of the first and the second.
        coverage: Whether texels that the outline of the nearest layer crosses hold values averaged over their area
            (`coverage_planes`), so that visibility has a gradient where outlines move. Needs a filter that averages
            values of single depths, and rays that keep lines straight: a `CubeMap` round a point light. Hidden outlines
            are in no map, so light bleeds through two layers as it does without.
        edges: From `mesh_edges`, for building under `jit` with coverage; found at each build if None.
    """

    filter: Filter = Hard()
    resolution: int = eqx.field(static=True, default=512)
    partition: Partition = SingleMap()
    caster: Caster = default_caster()
    bias: BiasRule | None = None
    layer: str = eqx.field(static=True, default="first")
    coverage: bool = eqx.field(static=True, default=False)
    edges: MeshEdges | None = None

    def __check_init__(self) -> None:
        require_int(self.resolution, "resolution", 1)
        require_choice(self.layer, "layer", LAYERS)
        if self.coverage:
            require(self.layer == "first", f"coverage follows the first layer; got layer {self.layer!r}")
            _require_codes(self.filter)

    def build(self, mesh: Mesh, light: Light, camera: Camera) -> "MappedShadows":
        """Cast the maps and let the filter prepare them.

        Warns:
            SceneWarning: If the maps lie so far from the origin of coordinates that rounding takes up half a texel.
        """
        # Filters that keep several samples a texel cast a finer map; their reach counts its cells.
        factor = self.filter.cast_factor
        partition = self.partition.with_margin(self.filter.reach * factor)
        partition, grids = _placed(partition, mesh, light, camera, self.resolution * factor)
        warn_of_coarse_texels(grids)
        if self.coverage:
            edges = _edges_of(mesh) if self.edges is None else self.edges
            maps = tuple(build_covered_map(self.caster, mesh, grid, edges) for grid in grids)
        else:
            maps = tuple(build_shadow_map(self.caster, mesh, grid, self.layer) for grid in grids)
        return _read_with(self.filter, partition, camera, maps, self.bias, self.layer)

    @property
    def num_tones(self) -> int | None:
        """The filter's bound."""
        return self.filter.num_tones

    @property
    def num_planes(self) -> int:
        """The filter's."""
        return self.filter.num_planes

    @property
    def num_fetches(self) -> int:
        """The filter's, as if one map answered."""
        return self.filter.num_fetches

    @property
    def num_maps(self) -> int:
        """The partition's."""
        return self.partition.num_maps

    @property
    def map_filter(self) -> Filter:
        """Its filter."""
        return self.filter

    @property
    def map_partition(self) -> Partition:
        """Its partition."""
        return self.partition

    @property
    def map_resolution(self) -> int:
        """Its resolution."""
        return self.resolution

    def resized(self, factor: float) -> "ShadowMapping":
        """With so many times the resolution, rounded, at least 1."""
        return dataclasses.replace(self, resolution=max(1, round(factor * self.resolution)))

    @property
    def parts(self) -> str:
        """Partition, its warp if it has one to choose, and filter."""
        warp = getattr(self.partition, "warp", None)
        made_of = (self.partition, *(() if warp is None else (warp,)), self.filter)
        return "+".join(type(part).__name__ for part in made_of)

    def as_shadow_mapping(self, what: str) -> "ShadowMapping":
        """Itself."""
        del what
        return self


def _edges_of(mesh: Mesh) -> MeshEdges:
    """Edges of a mesh, which must be known outside `jit`."""
    fixed = jax.lax.stop_gradient(mesh)
    require(
        concrete(fixed.vertices) is not None and concrete(fixed.faces) is not None,
        "coverage needs the edges of the mesh, which cannot be found under jit or vmap; give ShadowMapping "
        "edges=mesh_edges(mesh), made outside",
    )
    return mesh_edges(fixed)


def _require_codes(filter_: Filter) -> None:
    require(
        filter_.supports_coverage,
        f"coverage needs a filter that averages codes of single depths; got {type(filter_).__name__}, which does not: "
        "take Variance(footprint=0), ExponentialVariance(footprint=0), Moments or Convolution",
    )


def _read_with(
    filter_: Filter,
    partition: Partition,
    camera: Camera,
    maps: tuple[ShadowMap, ...],
    bias: BiasRule | None,
    layer: str,
) -> "MappedShadows":
    """Cast maps prepared for a filter, with the bias that frees a plane of acne for it where none is given."""
    if bias is None:
        # Behind the first layer the stored depth lies behind lit surfaces anyway.
        texels = filter_.bias_reach if layer == "first" else 0.0
        bias = Bias(jnp.asarray(texels, maps[0].depth.dtype), "slope")
    require(
        filter_.compares or not _follows_plane(bias),
        f"a receiver-plane bias needs a filter that compares depths; {type(filter_).__name__} reads averages: give a "
        "Bias or a NormalOffset",
    )
    if maps[0].outlines is not None:
        _require_codes(filter_)
    planes = tuple(_planes(filter_, shadow_map) for shadow_map in maps)
    return MappedShadows(filter_, partition, camera, maps, planes, bias, layer)


def _follows_plane(bias: BiasRule) -> bool:
    parts = bias.parts if isinstance(bias, BiasSum) else (bias,)
    return any(isinstance(part, ReceiverPlane) for part in parts)


# The steps of `build` are compiled one by one: techniques that differ in their filter share the compiled caster.
@eqx.filter_jit
def _placed(
    partition: Partition, mesh: Mesh, light: Light, camera: Camera, resolution: int
) -> tuple[Partition, tuple[RayGrid, ...]]:
    placed = partition.fit(mesh, light, camera)
    return placed, placed.grids(mesh, light, camera, resolution)


@eqx.filter_jit
def _planes(filter_: Filter, shadow_map: ShadowMap) -> Any:
    return filter_.prepare_map(shadow_map)


class MappedShadows(Shadows):
    """Shadow maps ready to be read.

    Attributes:
        filter: Turns stored depths into visibility.
        partition: Chooses the map of each point.
        camera: The view the maps were fitted to.
        maps: One map for each region.
        planes: What the filter prepared from each map.
        bias: Depth tolerance of the test.
        layer: Which depth the maps keep.
        view: The grid of an image's pixels, for filters that average over a pixel's footprint; None without an image.
    """

    filter: Filter
    partition: Partition
    camera: Camera
    maps: tuple[ShadowMap, ...]
    planes: tuple[Any, ...]
    bias: BiasRule
    layer: str = eqx.field(static=True, default="first")
    view: RayGrid | None = None

    def visibility(self, points: Points, normals: Points) -> Float[Array, "*points"]:
        """Read the map of each point's region, or the maps that share it."""
        shares = self.partition.shares(self.grids, self.camera, points)
        # Shares may sum to less than 1 where shadows end; rounding must not make the rest negative.
        result = jnp.maximum(1 - sum(shares), 0)  # lit where no map answers
        for index, share in enumerate(shares):
            result = result + share * self.read(index, points, normals)
        facing = faces_light(normals, self.maps[0].grid.space.to_source(points))
        return jnp.where(facing, result, jnp.zeros_like(result))

    @property
    def depth_bias(self) -> BiasRule:
        """Its bias."""
        return self.bias

    def maps_of(self, points: Points) -> tuple[tuple[RayGrid, ...], Int[Array, "*points"]]:
        """The grids, and the region that the partition selects."""
        return self.grids, self.partition.select(self.grids, self.camera, points)

    @property
    def grids(self) -> tuple[RayGrid, ...]:
        """The light rays of every region's map."""
        return tuple(shadow_map.grid for shadow_map in self.maps)

    def read(self, region: int, points: Points, normals: Points) -> Float[Array, "*points"]:
        """What the map of one region answers, wherever the points lie and whichever side they face."""
        return self.filter.visibility(self.planes[region], self.lookup(self.maps[region], points, normals))

    def with_filter(self, filter_: Filter, bias: BiasRule | None = None) -> "MappedShadows":
        """The same maps read with another filter; its own default bias if none is given.

        Raises:
            ValueError: If the filter needs another number of rays a texel than were cast.
        """
        require(
            filter_.cast_factor == self.filter.cast_factor,
            f"{type(filter_).__name__} needs {filter_.cast_factor} rays a texel along an axis, but these maps have "
            f"{self.filter.cast_factor}; build the technique anew",
        )
        other = _read_with(filter_, self.partition, self.camera, self.maps, bias, self.layer)
        return other if self.view is None else other.with_pixel_footprints(self.view)

    def with_pixel_footprints(self, view: RayGrid) -> "MappedShadows":
        """The same shadows for an image: lookups know the footprint of its pixels, taken on the receiver's plane.

        Args:
            view: Rays of the image, such as `camera_grid(camera, width, height)`.
        """
        return eqx.tree_at(lambda s: s.view, self, view, is_leaf=lambda leaf: leaf is None)

    def lookup(self, shadow_map: ShadowMap, points: Points, normals: Points) -> Lookup:
        """Where points read one map, and the bias of each."""
        grid = shadow_map.grid
        forgiven = self.bias.apply(grid, points, normals)
        position, depth = grid.locate(forgiven.points)
        # What no surface of the map lies behind is tested as if it lay there.
        depth = jnp.minimum(depth, grid.far)
        # On top of the chosen bias, a tolerance for what rounding does to two computations of one depth.
        follows = forgiven.follows_plane or self.filter.follows_plane
        return Lookup(
            position,
            depth,
            forgiven.depth + grid.receiver_rounding(points, normals),
            texel_size(grid, points),
            shadow_map.border,
            None if self.view is None else pixel_footprint(self.view, grid, points, normals),
            grid.space.is_parallel,
            plane_gradient(grid, points, normals, forgiven.plane_limit) if follows else None,
        )

    @property
    def map_bytes(self) -> int:
        """Bytes of the planes of all maps."""
        return sum(leaf.nbytes for leaf in jax.tree.leaves(self.planes) if leaf.ndim)

    @property
    def texture_bytes(self) -> int:
        """The filter's planes of every map in textures of their own bits."""
        bits = 32 if self.maps[0].depth.dtype.itemsize > 2 else 16
        textures = planes_in_formats(self.filter.num_planes, bits)
        sides = [shadow_map.depth.shape[0] for shadow_map in self.maps]
        return sum(texture.num_bytes(side) for side in sides for texture in textures)

    @property
    def cast_maps(self) -> tuple[ShadowMap, ...]:
        """Its maps."""
        return self.maps
