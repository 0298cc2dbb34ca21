"""Techniques, each `build(mesh, light, camera)` then `visibility(points, normals)`; and the registry of named ones."""

import difflib
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp

from shadowjax._checked import checked
from shadowjax._checks import concrete, require, require_choice, require_int
from shadowjax._numerics import faces_light
from shadowjax._types import Array, Float, Points
from shadowjax.adaptive import AdaptiveShadowMapping
from shadowjax.filters.base import Filter, Lookup
from shadowjax.filters.bias import Bias, BiasRule, plane_gradient, texel_size
from shadowjax.filters.bias_kinds import BiasSum, ReceiverPlane
from shadowjax.filters.brabec_seidel import PropagatedNeighbours, Supersampled
from shadowjax.filters.convolution import Convolution, MeanDepthConvolution
from shadowjax.filters.exponential import Exponential
from shadowjax.filters.exponential_variance import ExponentialVariance
from shadowjax.filters.hard import Hard
from shadowjax.filters.hierarchical_minimum import HierarchicalMinimum
from shadowjax.filters.moment import Moments
from shadowjax.filters.multi_depth import MultiDepth, Neighbourhood, Ring
from shadowjax.filters.pcf import BilinearPercentageCloser, PercentageCloser
from shadowjax.filters.pcss import ContactHardening
from shadowjax.filters.variance import Variance
from shadowjax.geometry.camera import Camera
from shadowjax.geometry.light import Light
from shadowjax.geometry.mesh import Mesh
from shadowjax.geometry.outlines import MeshEdges, mesh_edges
from shadowjax.maps.shadow_map import ShadowMap, build_covered_map, build_shadow_map
from shadowjax.partitions.base import Partition
from shadowjax.partitions.cube import Cube
from shadowjax.partitions.whole import Whole
from shadowjax.rays.brute import BruteForce
from shadowjax.rays.caster import Caster
from shadowjax.rays.layers import LAYERS
from shadowjax.rays.light_space import DirectionalSpace, LightSpace, light_space
from shadowjax.rays.ray_grid import RayGrid, pixel_footprint
from shadowjax.technique_base import Shadows, Technique
from shadowjax.volume_technique import ShadowVolumes


class ShadowMapping(Technique):
    """Shadow maps: partition × warp × filter × caster.

    Attributes:
        filter: Turns stored depths into visibility.
        resolution: Texels along each side of every map, ≥ 1.
        partition: Regions of the light's plane, and the warp of each.
        caster: Fills the maps.
        bias: Depth the test forgives; None takes the least slope bias that frees a plane of acne for this filter, and
            none for layers behind the first.
        layer: Which depth each ray keeps: "first"; "second", the next surface; "back", the first surface met from
            behind, which is the second of closed bodies; "midpoint" of the first and the second.
        coverage: Whether texels that the outline of the nearest layer crosses hold codes averaged over their area
            (`coverage_planes`), so that visibility has a gradient where outlines move. Needs a filter that averages
            codes of single depths, and rays that keep lines straight: a `Cube` round a point light. Hidden outlines
            are in no map, so light bleeds through two layers as it does without.
        edges: From `mesh_edges`, for building under `jit` with coverage; found at each build if None.
    """

    filter: Filter = Hard()
    resolution: int = eqx.field(static=True, default=512)
    partition: Partition = Whole()
    caster: Caster = BruteForce()
    bias: BiasRule | None = None
    layer: str = eqx.field(static=True, default="first")
    coverage: bool = eqx.field(static=True, default=False)
    edges: MeshEdges | None = None

    def __check_init__(self):
        require_int(self.resolution, "resolution", 1)
        require_choice(self.layer, "layer", LAYERS)
        if self.coverage:
            require(self.layer == "first", f"coverage follows the first layer; got layer {self.layer!r}")
            _require_codes(self.filter)

    def build(self, mesh: Mesh, light: Light, camera: Camera) -> "MappedShadows":
        """Cast the maps and let the filter prepare them."""
        factor = self.filter.cast_factor
        partition = self.partition.reaching(self.filter.reach * factor)
        partition, grids = _placed(partition, mesh, light, camera, self.resolution * factor)
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
        filter_.takes_outlines,
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
    placed = partition.placed(mesh, light, camera)
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
        bias: Depth the test forgives.
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
        result = jnp.maximum(1 - sum(shares), 0)  # lit where no map answers
        for index, share in enumerate(shares):
            result = result + share * self.read(index, points, normals)
        facing = faces_light(normals, self.maps[0].grid.space.to_source(points))
        return jnp.where(facing, result, jnp.zeros_like(result))

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
        return other if self.view is None else other.seen_by(self.view)

    def seen_by(self, view: RayGrid) -> "MappedShadows":
        """The same shadows for an image: lookups know the footprint of its pixels, taken on the receiver's plane.

        Args:
            view: Rays of the image, such as `camera_grid(camera, width, height)`.
        """
        return eqx.tree_at(lambda s: s.view, self, view, is_leaf=lambda leaf: leaf is None)

    def lookup(self, shadow_map: ShadowMap, points: Points, normals: Points) -> Lookup:
        """Where points read one map, and the bias of each."""
        grid = shadow_map.grid
        forgiven = self.bias.forgive(grid, points, normals)
        position, depth = grid.locate(forgiven.points)
        # On top of the chosen bias, forgive what rounding does to two computations of one depth.
        follows = forgiven.follows_plane or self.filter.follows_plane
        return Lookup(
            position,
            depth,
            forgiven.depth + grid.depth_rounding,
            texel_size(grid, points),
            shadow_map.border,
            None if self.view is None else pixel_footprint(self.view, grid, points, normals),
            isinstance(grid.space, DirectionalSpace),
            plane_gradient(grid, points, normals) if follows else None,
        )

    @property
    def map_bytes(self) -> int:
        """Bytes of the planes of all maps."""
        return sum(leaf.nbytes for leaf in jax.tree.leaves(self.planes) if leaf.ndim)


class Exact(Technique):
    """The truth: a shadow ray for every point, no map and no bias.

    With the `Grid` caster this is an alias-free shadow map: points are put into cells of the light's plane and
    triangles are drawn over them, which gives the same answers without a traced ray.

    Attributes:
        caster: Finds what blocks the shadow rays.
    """

    caster: Caster = BruteForce()

    def build(self, mesh: Mesh, light: Light, camera: Camera) -> "ExactShadows":
        """Nothing to prepare but the space of the light's rays."""
        lower, upper = mesh.bounds()
        return ExactShadows(mesh, light_space(light, camera.forward, lower, upper), self.caster)

    @property
    def num_tones(self) -> int:
        """Lit or not."""
        return 2


class ExactShadows(Shadows):
    """Shadow rays against a mesh.

    Attributes:
        mesh: Everything that casts shadows.
        space: The rays of the light.
        caster: Traces the shadow rays.
    """

    mesh: Mesh
    space: LightSpace
    caster: Caster

    def visibility(self, points: Points, normals: Points) -> Float[Array, "*points"]:
        """0 or 1."""
        return self.caster.visible(self.mesh, self.space, points, normals).astype(points.dtype)

    @property
    def map_bytes(self) -> int:
        """No map."""
        return 0

    @property
    def prefers_images(self) -> bool:
        """As its caster does for the light's rays."""
        return self.caster.prefers_images(self.space)


def _mapping(
    filter_: Callable[[], Filter],
    layer: str = "first",
    partition: Callable[[], Partition] = Whole,
    coverage: bool = False,
) -> Callable[..., Technique]:
    def make(resolution: int = 512, caster: Caster | None = None, **options: Any) -> Technique:
        caster = BruteForce() if caster is None else caster
        fields = {"layer": layer, "partition": partition(), "coverage": coverage, **options}
        return ShadowMapping(filter_(), resolution, caster=caster, **fields)

    return make


def _exact(resolution: int = 512, caster: Caster | None = None) -> Technique:
    del resolution  # the exact test has no map
    return Exact(BruteForce() if caster is None else caster)


def _volumes(resolution: int = 512, caster: Caster | None = None, **options: Any) -> Technique:
    del resolution, caster  # volumes have no map and cast no ray
    return ShadowVolumes(**options)


def _adaptive(resolution: int = 512, caster: Caster | None = None, **options: Any) -> Technique:
    # As many bytes as a plain map of that resolution has, but never less than a few of the smallest tiles.
    size = min(16, max(4, 1 << max(0, resolution.bit_length() - 4)))
    caster = BruteForce() if caster is None else caster
    chosen = {"budget_bytes": max(4 * resolution**2, 1024), "tile_size": size, **options}
    return AdaptiveShadowMapping(caster=caster, **chosen)


TECHNIQUES: dict[str, Callable[..., Technique]] = {
    "exact": _exact,
    "hard": _mapping(Hard),
    "asm": _adaptive,
    "pcf-2x2": _mapping(lambda: PercentageCloser(2)),
    "pcf-3x3": _mapping(lambda: PercentageCloser(3)),
    "pcf-4x4": _mapping(lambda: PercentageCloser(4)),
    "pcf-bilinear": _mapping(lambda: BilinearPercentageCloser(1)),
    "pcf-bilinear-3x3": _mapping(lambda: BilinearPercentageCloser(3)),
    "pcss": _mapping(ContactHardening),
    "second-depth": _mapping(Hard, "second"),
    "midpoint-depth": _mapping(Hard, "midpoint"),
    "brabec-seidel": _mapping(Supersampled),
    "brabec-seidel-propagated": _mapping(lambda: MultiDepth(PropagatedNeighbours())),
    "hyper-z": _mapping(lambda: MultiDepth(HierarchicalMinimum())),
    "vsm": _mapping(lambda: Variance(bleed_low=0.2)),
    # Six maps where a light is a point, since one around it would bend outlines; one for a directional light.
    "vsm+coverage": _mapping(lambda: Variance(bleed_low=0.2, footprint=0.0), partition=Cube, coverage=True),
    "esm": _mapping(Exponential),
    "esm-threshold": _mapping(lambda: Exponential(fallback="threshold")),
    "esm-z-max": _mapping(lambda: Exponential(fallback="z-max")),
    "evsm2": _mapping(lambda: ExponentialVariance(negative=None)),
    "evsm4": _mapping(ExponentialVariance),
    "msm-hamburger": _mapping(Moments),
    "msm-hausdorff": _mapping(lambda: Moments(problem="hausdorff")),
    "csm": _mapping(Convolution),
    "xcsm": _mapping(MeanDepthConvolution),
    "2sm-max": _mapping(lambda: MultiDepth(Neighbourhood("max"))),
    "2sm-min": _mapping(lambda: MultiDepth(Neighbourhood("min"))),
    "3sm": _mapping(lambda: MultiDepth(Neighbourhood("min-max"))),
    "4sm": _mapping(lambda: MultiDepth(Ring(4))),
    "5sm": _mapping(lambda: MultiDepth(Ring(5))),
    "2sm-max+pcf-2x2": _mapping(lambda: MultiDepth(Neighbourhood("max"), 2)),
    "2sm-max+pcf-3x3": _mapping(lambda: MultiDepth(Neighbourhood("max"), 3)),
    "2sm-min+pcf-3x3": _mapping(lambda: MultiDepth(Neighbourhood("min"), 3)),
    "3sm+pcf-2x2": _mapping(lambda: MultiDepth(Neighbourhood("min-max"), 2)),
    "3sm+pcf-3x3": _mapping(lambda: MultiDepth(Neighbourhood("min-max"), 3)),
    "4sm+pcf-3x3": _mapping(lambda: MultiDepth(Ring(4), 3)),
    "shadow-volumes": _volumes,
    "cube": _mapping(Hard, partition=Cube),
    "cube+pcf-3x3": _mapping(lambda: PercentageCloser(3), partition=Cube),
}


@checked
def make_technique(name: str, resolution: int = 512, caster: Caster | None = None, **options: Any) -> Technique:
    """A technique by its registered name.

    Args:
        name: A key of `TECHNIQUES`.
        resolution: Texels along each side of a map.
        caster: Traces all rays; brute force if None.
        options: Further fields of `ShadowMapping` (partition, bias) or of `ShadowVolumes` (method, casters, stencil).

    Raises:
        ValueError: If the name is unknown; the nearest names are suggested.
    """
    if name not in TECHNIQUES:
        near = difflib.get_close_matches(name, TECHNIQUES, n=3, cutoff=0.4) or sorted(TECHNIQUES)
        require(False, f"unknown technique {name!r}; did you mean {', '.join(near)}? `TECHNIQUES` lists all")
    return TECHNIQUES[name](resolution=resolution, caster=caster, **options)
