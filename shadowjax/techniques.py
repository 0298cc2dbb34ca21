"""Techniques, each `build(mesh, light, camera)` then `visibility(points, normals)`; and the registry of named ones."""

import difflib
from abc import abstractmethod
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax.numpy as jnp

from shadowjax._checks import require, require_int
from shadowjax._numerics import dot
from shadowjax._types import Array, Float, Points
from shadowjax.filters.base import Filter, Lookup
from shadowjax.filters.bias import Bias, texel_size
from shadowjax.filters.hard import Hard
from shadowjax.filters.multi_depth import MultiDepth, Neighbourhood, Ring
from shadowjax.filters.pcf import BilinearPercentageCloser, PercentageCloser
from shadowjax.geometry.camera import Camera
from shadowjax.geometry.light import Light
from shadowjax.geometry.mesh import Mesh
from shadowjax.maps.shadow_map import ShadowMap, build_shadow_map
from shadowjax.partitions.base import Partition
from shadowjax.partitions.whole import Whole
from shadowjax.rays.brute import BruteForce
from shadowjax.rays.caster import SURFACE_ROUNDINGS, Caster
from shadowjax.rays.light_space import LightSpace, light_space
from shadowjax.rays.ray_grid import RayGrid


class Shadows(eqx.Module):
    """What a technique has built for one light: it answers for any point."""

    @abstractmethod
    def visibility(self, points: Points, normals: Points) -> Float[Array, "*points"]:
        """Fraction of the light that reaches each point, in [0, 1]: 1 lit, 0 in shadow.

        Args:
            points: World points on surfaces.
            normals: Unit normals of the side that is looked at; a side that faces away from the light is dark.
        """

    @property
    @abstractmethod
    def map_bytes(self) -> int:
        """Bytes of all stored planes."""

    @property
    def prefers_images(self) -> bool:
        """Whether `visibility` is faster for points of an image, (rows, cols, 3), than for a list of them."""
        return False


class Technique(eqx.Module):
    """A way to answer "how much of the light arrives here?"."""

    @abstractmethod
    def build(self, mesh: Mesh, light: Light, camera: Camera) -> Shadows:
        """Do the work that does not depend on receivers."""

    @property
    @abstractmethod
    def num_tones(self) -> int | None:
        """Upper bound on distinct visibilities; None where they are a continuum."""


class ShadowMapping(Technique):
    """Shadow maps: partition × warp × filter × caster.

    Attributes:
        filter: Turns stored depths into visibility.
        resolution: Texels along each side of every map, ≥ 1.
        partition: Regions of the light's plane, and the warp of each.
        caster: Fills the maps.
        bias: Depth the test forgives; None takes the smallest slope bias that frees a plane of acne for this filter.
    """

    filter: Filter = Hard()
    resolution: int = eqx.field(static=True, default=512)
    partition: Partition = Whole()
    caster: Caster = BruteForce()
    bias: Bias | None = None

    def __check_init__(self):
        require_int(self.resolution, "resolution", 1)

    def build(self, mesh: Mesh, light: Light, camera: Camera) -> "MappedShadows":
        """Cast the maps and let the filter prepare them."""
        grids = _grids(self.partition, mesh, light, camera, self.resolution)
        maps = tuple(build_shadow_map(self.caster, mesh, grid) for grid in grids)
        return _read_with(self.filter, self.partition, camera, maps, self.bias)

    @property
    def num_tones(self) -> int | None:
        """The filter's bound."""
        return self.filter.num_tones


def _read_with(
    filter_: Filter, partition: Partition, camera: Camera, maps: tuple[ShadowMap, ...], bias: Bias | None
) -> "MappedShadows":
    """Cast maps prepared for a filter, with the bias that frees a plane of acne for it where none is given."""
    if bias is None:
        bias = Bias(jnp.asarray(filter_.reach, maps[0].depth.dtype), "slope")
    planes = tuple(_planes(filter_, shadow_map.depth) for shadow_map in maps)
    return MappedShadows(filter_, partition, camera, maps, planes, bias)


# The steps of `build` are compiled one by one: techniques that differ in their filter share the compiled caster.
@eqx.filter_jit
def _grids(partition: Partition, mesh: Mesh, light: Light, camera: Camera, resolution: int) -> tuple[RayGrid, ...]:
    return partition.grids(mesh, light, camera, resolution)


@eqx.filter_jit
def _planes(filter_: Filter, depth: Float[Array, "rows cols"]) -> Float[Array, "n rows cols"]:
    return filter_.prepare(depth)


class MappedShadows(Shadows):
    """Shadow maps ready to be read.

    Attributes:
        filter: Turns stored depths into visibility.
        partition: Chooses the map of each point.
        camera: The view the maps were fitted to.
        maps: One map for each region.
        planes: What the filter prepared from each map.
        bias: Depth the test forgives.
    """

    filter: Filter
    partition: Partition
    camera: Camera
    maps: tuple[ShadowMap, ...]
    planes: tuple[Float[Array, "n rows cols"], ...]
    bias: Bias

    def visibility(self, points: Points, normals: Points) -> Float[Array, "*points"]:
        """Read the map of each point's region."""
        grids = tuple(shadow_map.grid for shadow_map in self.maps)
        region = self.partition.select(grids, self.camera, points) if len(self.maps) > 1 else None
        result = jnp.ones(points.shape[:-1], points.dtype)
        for index, (shadow_map, planes) in enumerate(zip(self.maps, self.planes, strict=True)):
            value = self.filter.visibility(planes, self.lookup(shadow_map, points, normals))
            result = value if region is None else jnp.where(region == index, value, result)
        facing = dot(normals, grids[0].space.to_source(points)) > 0
        return jnp.where(facing, result, jnp.zeros_like(result))

    def with_filter(self, filter_: Filter, bias: Bias | None = None) -> "MappedShadows":
        """The same maps read with another filter; its own default bias if none is given."""
        return _read_with(filter_, self.partition, self.camera, self.maps, bias)

    def lookup(self, shadow_map: ShadowMap, points: Points, normals: Points) -> Lookup:
        """Where points read one map, and the bias of each."""
        grid = shadow_map.grid
        position, depth = grid.locate(points)
        # On top of the chosen bias, forgive what rounding does to two computations of one depth.
        rounding = SURFACE_ROUNDINGS * jnp.finfo(points.dtype).eps * grid.far
        bias = self.bias.in_world(grid, points, normals) + rounding
        return Lookup(position, depth, bias, texel_size(grid, points), shadow_map.border)

    @property
    def map_bytes(self) -> int:
        """Bytes of the planes of all maps."""
        return sum(planes.nbytes for planes in self.planes)


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


def _mapping(filter_: Callable[[], Filter]) -> Callable[..., Technique]:
    def make(resolution: int = 512, caster: Caster | None = None, **options: Any) -> Technique:
        return ShadowMapping(filter_(), resolution, caster=BruteForce() if caster is None else caster, **options)

    return make


def _exact(resolution: int = 512, caster: Caster | None = None) -> Technique:
    del resolution  # the exact test has no map
    return Exact(BruteForce() if caster is None else caster)


TECHNIQUES: dict[str, Callable[..., Technique]] = {
    "exact": _exact,
    "hard": _mapping(Hard),
    "pcf-2x2": _mapping(lambda: PercentageCloser(2)),
    "pcf-3x3": _mapping(lambda: PercentageCloser(3)),
    "pcf-4x4": _mapping(lambda: PercentageCloser(4)),
    "pcf-bilinear": _mapping(lambda: BilinearPercentageCloser(1)),
    "pcf-bilinear-3x3": _mapping(lambda: BilinearPercentageCloser(3)),
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
}


def make_technique(name: str, resolution: int = 512, caster: Caster | None = None, **options: Any) -> Technique:
    """A technique by its registered name.

    Args:
        name: A key of `TECHNIQUES`.
        resolution: Texels along each side of a map.
        caster: Traces all rays; brute force if None.
        options: Further fields of `ShadowMapping` (partition, bias).

    Raises:
        ValueError: If the name is unknown; the nearest names are suggested.
    """
    if name not in TECHNIQUES:
        near = difflib.get_close_matches(name, TECHNIQUES, n=3, cutoff=0.4) or sorted(TECHNIQUES)
        require(False, f"unknown technique {name!r}; did you mean {', '.join(near)}? `TECHNIQUES` lists all")
    return TECHNIQUES[name](resolution=resolution, caster=caster, **options)
