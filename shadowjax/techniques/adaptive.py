"""The technique of adaptive shadow maps: refine where a view's shadow edges are too coarse, within fixed memory."""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from shadowjax._checked import checked
from shadowjax._checks import concrete, require, require_choice, require_int
from shadowjax._numerics import dot, faces_light
from shadowjax._types import Array, Bool, Float, Int, Points
from shadowjax.bias.rule import Bias, plane_gradient
from shadowjax.filters.hard import is_lit
from shadowjax.geometry.camera import Camera
from shadowjax.geometry.light import Light
from shadowjax.geometry.mesh import Mesh
from shadowjax.geometry.polygons import polygon_of_face
from shadowjax.partitions.adaptive.footprint import FOOTPRINTS
from shadowjax.partitions.adaptive.refinement import Wishes, wishes
from shadowjax.partitions.adaptive.tile_map import MOST_ACROSS, AdaptiveMap, empty_map, straddles
from shadowjax.partitions.adaptive.tile_tree import MAX_LEVEL, place_of
from shadowjax.partitions.single import SingleMap
from shadowjax.rays.caster import Caster
from shadowjax.rays.casters import default_caster
from shadowjax.rays.ray import surface_points
from shadowjax.rays.ray_grid import RayGrid, camera_grid
from shadowjax.techniques.base import Shadows, Technique

TESTS = ("depth", "id", "hybrid")
# A plane that the light grazes at less than a thousandth has no depth to follow: texels next to it say nothing.
STEEPEST = 1000.0


class AdaptiveShadowMapping(Technique):
    """Adaptive shadow maps: a quadtree of small maps, finest where the camera sees shadow edges closely.

    Pixels at a depth discontinuity of the map ask for texels that are a share of themselves. Tiles are cast in the
    order of benefit over cost until no pixel asks for more or memory is full; then coarser tiles answer for the least
    worthy edges. Refinement runs on the host; what it leaves is read under `jit`.

    Attributes:
        budget_bytes: Bytes of all tiles together with the page table.
        tile_size: Texels along each side of a tile, a power of two.
        base_level: Coarsest level, whose tiles stay; None takes the finest that fills at most a quarter of the memory.
        max_level: Finest level, at most 15; None takes that of 65 536 texels across.
        footprint: How a pixel's need is found: a key of `FOOTPRINTS`.
        texels_per_pixel: Texels asked for along a pixel, > 0.
        test: "depth"; "id", lit where the texel sees the receiver's own polygon; "hybrid", lit where either says so.
            Ids need receivers of known triangle (`visibility_of`): the hybrid takes depth alone where it is unknown.
        bias: Depth tolerance of the test; "slope" and "texel" count texels of the tile that is read.
        levels_per_step: Most levels that one refinement of a cell goes down, ≥ 1.
        max_steps: Most steps while building, ≥ 0.
        per_texel: a of the cost a·N_required + b.
        fixed: b of it.
        num_rows: Rows of the image that is looked at while refining, ≥ 1.
        caster: Casts tiles and looks for the camera.

    Source: asm; the test of ids with depth is Hourcade's.
    """

    budget_bytes: int = eqx.field(static=True, default=1 << 20)
    tile_size: int = eqx.field(static=True, default=16)
    base_level: int | None = eqx.field(static=True, default=None)
    max_level: int | None = eqx.field(static=True, default=None)
    footprint: str = eqx.field(static=True, default="jacobian")
    texels_per_pixel: float = eqx.field(static=True, default=8.0)
    test: str = eqx.field(static=True, default="depth")
    bias: Bias | None = None
    levels_per_step: int = eqx.field(static=True, default=2)
    max_steps: int = eqx.field(static=True, default=16)
    per_texel: float = eqx.field(static=True, default=1.0)
    fixed: float = eqx.field(static=True, default=256.0)
    num_rows: int = eqx.field(static=True, default=360)
    caster: Caster = default_caster()

    def __check_init__(self) -> None:
        require_int(self.budget_bytes, "budget_bytes", 1)
        require_int(self.tile_size, "tile_size", 1)
        require(self.tile_size & (self.tile_size - 1) == 0, f"tile_size must be a power of two; got {self.tile_size}")
        require_choice(self.footprint, "footprint", FOOTPRINTS)
        require_choice(self.test, "test", TESTS)
        require(self.texels_per_pixel > 0, f"texels_per_pixel must be positive; got {self.texels_per_pixel}")
        require_int(self.levels_per_step, "levels_per_step", 1)
        require_int(self.max_steps, "max_steps", 0)
        require_int(self.num_rows, "num_rows", 1)
        costs = self.per_texel, self.fixed
        require(min(costs) >= 0 and max(costs) > 0, f"per_texel and fixed must be ≥ 0, one of them more; got {costs}")
        finest = require_int(self.finest_level, "max_level", 0)
        across = self.tile_size << finest
        require(
            finest <= MAX_LEVEL and across <= MOST_ACROSS,
            f"max_level {finest} with tiles of {self.tile_size} texels is too fine: at most level {MAX_LEVEL} and "
            f"{MOST_ACROSS} texels across",
        )
        base = 0 if self.base_level is None else require_int(self.base_level, "base_level", 0)
        require(base <= finest, f"base_level {base} must not exceed max_level {finest}")

    @property
    def finest_level(self) -> int:
        """Finest level that tiles may have."""
        if self.max_level is not None:
            return self.max_level
        return max(0, min(MAX_LEVEL, 17 - int(self.tile_size).bit_length()))

    @property
    def num_tones(self) -> int:
        """Lit or not."""
        return 2

    @property
    def num_planes(self) -> int:
        """A depth, and the surface it belongs to where ids are tested."""
        return 1 if self.test == "depth" else 2

    @property
    def num_fetches(self) -> int:
        """As many as planes."""
        return self.num_planes

    @property
    def num_maps(self) -> None:
        """As many tiles as the view asks for."""
        return

    def start(self, mesh: Mesh, light: Light, camera: Camera) -> "AdaptiveShadows":
        """The coarsest level alone.

        Args:
            mesh: Concrete: refinement runs on the host.
            light: Any light; its rays keep the orientation that the first camera gives them.
            camera: The first view.

        Raises:
            ValueError: If arguments are traced, or the budget does not hold the coarsest level.
        """
        traced = any(concrete(leaf) is None for leaf in jax.tree.leaves((mesh, light, camera)))
        require(not traced, "adaptive shadow maps are refined on the host: build them outside `jit` and `grad`")
        grid = _whole(mesh, light, camera, self.tile_size)
        keeps = self.test != "depth"
        polygons = polygon_of_face(mesh) if keeps else jnp.zeros(mesh.num_faces, jnp.int32)
        count = int(np.max(np.asarray(polygons))) + 1 if keeps else None
        base_level = self.base_level
        map_ = empty_map(grid, self.budget_bytes, base_level, count, self.finest_level)
        base = np.asarray(map_.store.keys)[: map_.store.num_pinned]
        map_ = map_.with_tiles(self.caster, mesh, polygons, map_.store, base, np.arange(len(base), dtype=np.int32))
        bias = Bias(jnp.asarray(0.5, mesh.vertices.dtype), "slope") if self.bias is None else self.bias
        return AdaptiveShadows(self, mesh, polygons, map_, bias)

    def build(self, mesh: Mesh, light: Light, camera: Camera) -> "AdaptiveShadows":
        """Refined for a view until it asks for nothing more, memory is full, or `max_steps` are done."""
        shadows = self.start(mesh, light, camera)
        return shadows.refined(shadows.look(camera), self.max_steps)[0]


@checked
class HeldView:
    """A camera that holds still while maps are refined: what it sees, and what tiles were worth to it at first.

    Attributes:
        points: Receivers that face the light, one for each pixel, as a list.
        normals: Their unit normals.
        counts: Pixels that count.
        grid: The image.
        benefits: Least benefit that each tile has had while the view holds. A coarse map shows wide bands of doubt, so
            an evicted tile would look worth more than the one that took its place, and the two would go on changing
            places.
    """

    def __init__(self, points: Points, normals: Points, counts: Bool[Array, "pixels"], grid: RayGrid) -> None:
        self.points, self.normals, self.counts, self.grid = points, normals, counts, grid
        self.benefits: dict[tuple[int, int, int], int] = {}

    def settled(self, found: Wishes) -> Wishes:
        """Wishes with benefits that never rise while the view holds."""
        names = [tuple(key) for key in found.keys.tolist()]
        counts = found.benefit.tolist()
        least = [min(self.benefits.get(name, count), count) for name, count in zip(names, counts, strict=True)]
        self.benefits.update(zip(names, least, strict=True))
        return found._replace(benefit=np.asarray(least, np.int32))


class Step(NamedTuple):
    """What one step of refinement did.

    Attributes:
        num_edge: Pixels at a discontinuity.
        num_lacking: Those of them whose texels are too coarse.
        num_wished: Tiles that they asked for.
        num_cast: Tiles that were cast.
        num_evicted: Tiles that left for them.
        num_refused: Tiles that found no place in memory.
        num_resident: Tiles held afterwards.
        num_read: Tiles that the view read before the step.
    """

    num_edge: int
    num_lacking: int
    num_wished: int
    num_cast: int
    num_evicted: int
    num_refused: int
    num_resident: int
    num_read: int


class AdaptiveShadows(Shadows):
    """An adaptive map of one light, ready to be read and to be refined further.

    Attributes:
        technique: Settings.
        mesh: What the tiles see.
        polygons: Polygon of each triangle.
        map: The tiles.
        bias: Depth tolerance of the test.
    """

    technique: AdaptiveShadowMapping
    mesh: Mesh
    polygons: Int[Array, "faces"]
    map: AdaptiveMap
    bias: Bias

    def visibility(self, points: Points, normals: Points) -> Float[Array, "*points"]:
        """0 or 1, by depth.

        Raises:
            ValueError: If the technique compares ids alone: these points have none; use `visibility_of`.
        """
        require(
            self.technique.test != "id",
            "the test of ids needs the triangle of every receiver: use visibility_of(points, normals, faces), "
            "visibility_on(surface, shadows), or the test 'hybrid'",
        )
        return self._tested(points, normals, None)

    def visibility_of(self, points: Points, normals: Points, faces: Int[Array, "*points"]) -> Float[Array, "*points"]:
        """0 or 1, by depth, by id, or by both."""
        return self._tested(points, normals, None if self.technique.test == "depth" else faces)

    def _tested(self, points: Points, normals: Points, faces: Int[Array, "*points"] | None) -> Float[Array, "*points"]:
        square, depth = placed_on(self.map, points, normals)
        texel = self.map.read(square)
        # A texel of a level is so much smaller than those of level 0, in whose cells the grid counts.
        side = 1 / self.map.cells(texel.level)
        lit = is_lit(texel.depth, depth, self.bias.in_world(self.map.grid, points, normals, side))
        if faces is not None and texel.polygon is not None:
            none = jnp.asarray(-1, jnp.int32).astype(texel.polygon.dtype)
            own = jnp.where(faces >= 0, self.polygons[jnp.maximum(faces, 0)], -1).astype(texel.polygon.dtype)
            same = (texel.polygon == own) | (texel.polygon == none)  # where nothing is seen, nothing blocks
            lit = same if self.technique.test == "id" else same | lit
        facing = faces_light(normals, self.map.grid.space.to_source(points))
        return (lit & facing).astype(points.dtype)

    @property
    def depth_bias(self) -> Bias:
        """Its bias."""
        return self.bias

    def maps_of(self, points: Points) -> tuple[tuple[RayGrid, ...], Int[Array, "*points"]]:
        """The map of level 0, which is all of them at their coarsest."""
        return (self.map.grid,), jnp.zeros(points.shape[:-1], jnp.int32)

    @property
    def map_bytes(self) -> int:
        """Bytes of all tiles and of the page table."""
        return self.map.num_bytes

    def look(self, camera: Camera) -> HeldView:
        """What a camera sees of the receivers that face the light, in an image of the technique's rows."""
        height = self.technique.num_rows
        width = max(1, round(height * float(camera.aspect)))
        return HeldView(*_seen(self.technique.caster, self.mesh, camera, width, height, self.map.grid))

    def refine(self, view: HeldView, most_tiles: int | None = None) -> tuple["AdaptiveShadows", Step]:
        """One step: find the pixels that lack texels, choose tiles by benefit over cost, cast them.

        Args:
            view: From `look`; keep it while the camera holds still.
            most_tiles: Most tiles to cast, the time of a frame; None for no limit.
        """
        most = None if most_tiles is None else require_int(most_tiles, "most_tiles", 1)
        technique = self.technique
        rule, share, finest = technique.footprint, technique.texels_per_pixel, technique.finest_level
        receivers = view.points, view.normals
        # Found under `jit` for all pixels; what follows is host-side and looks only at pixels that count.
        asked = _asked(self.map, *receivers, view.grid, rule, share, finest)
        asked = [np.asarray(part) for part in asked]
        place, slot, level, needed, edge = (part[np.asarray(view.counts)] for part in asked)
        store = self.map.store.used(slot)
        found = wishes(
            place[edge], slot[edge], level[edge], needed[edge], technique.levels_per_step, self.map.tile_size**2,
            technique.per_texel, technique.fixed,
        )  # fmt: skip
        found = view.settled(found)
        placed = store.place(found.keys[:most], found.benefit[:most])
        map_ = eqx.tree_at(lambda m: m.store, self.map, placed.store)
        if len(placed.keys):
            map_ = map_.with_tiles(technique.caster, self.mesh, self.polygons, placed.store, placed.keys, placed.slots)
        step = Step(
            int(edge.sum()), int((edge & (needed > level)).sum()), len(found.keys), len(placed.keys),
            placed.num_evicted, placed.num_refused, placed.store.num_resident, len(np.unique(slot)),
        )  # fmt: skip
        return eqx.tree_at(lambda s: s.map, self, map_), step

    def refined(
        self, view: HeldView, max_steps: int, most_tiles: int | None = None
    ) -> tuple["AdaptiveShadows", tuple[Step, ...]]:
        """Steps until one casts nothing, at most `max_steps`; arguments as in `refine`."""
        shadows, steps = self, []
        for _ in range(max_steps):
            shadows, step = shadows.refine(view, most_tiles)
            steps.append(step)
            if step.num_cast == 0:
                break
        return shadows, tuple(steps)

    def square_of(self, view: HeldView) -> Float[Array, "pixels 2"]:
        """Where the pixels of a view read, (s, t) of the unit square."""
        return _square_of(self.map, view.points)

    def recast(self, mesh: Mesh) -> "AdaptiveShadows":
        """The same tiles of a moved mesh, under jit too; differentiable in its vertices at this structure.

        Args:
            mesh: As many faces as the mesh that the maps were built for.
        """
        require(
            mesh.num_faces == self.mesh.num_faces,
            f"recast needs the mesh's own faces, {self.mesh.num_faces} of them; got {mesh.num_faces}",
        )
        map_ = self.map.recast(self.technique.caster, mesh, self.polygons)
        return eqx.tree_at(lambda s: (s.mesh, s.map), self, (mesh, map_))


@eqx.filter_jit
def _whole(mesh: Mesh, light: Light, camera: Camera, resolution: int) -> RayGrid:
    """The map of level 0."""
    return SingleMap().grids(mesh, light, camera, resolution)[0]


@eqx.filter_jit
def _seen(
    caster: Caster, mesh: Mesh, camera: Camera, width: int, height: int, grid: RayGrid
) -> tuple[Array, Array, Array, RayGrid]:
    """Points, normals and whether they count, of every pixel; and the image."""
    view = camera_grid(camera, width, height)
    hit = caster.closest_on_grid(mesh, view)
    rays = view.rays()
    points = surface_points(mesh, rays, hit).reshape(-1, 3)
    normals = mesh.face_normals()[jnp.maximum(hit.face, 0)]
    normals = jnp.where((dot(normals, rays.directions) > 0)[..., None], -normals, normals).reshape(-1, 3)
    # Level 0 is one tile: positions in its cells over its size are (s, t).
    square = grid.locate(points)[0] / grid.num_rows
    inside = jnp.all((square >= 0) & (square <= 1), axis=-1)
    facing = faces_light(normals, grid.space.to_source(points))
    return points, normals, hit.is_hit.reshape(-1) & facing & inside, view


@eqx.filter_jit
def _square_of(map_: AdaptiveMap, points: Points) -> Float[Array, "*points 2"]:
    return map_.grid.locate(points)[0] / map_.tile_size


@checked
def placed_on(
    map_: AdaptiveMap, points: Points, normals: Points
) -> tuple[Float[Array, "*points 2"], Float[Array, "*points"]]:
    """Where receivers read: (s, t), and depth less a tolerance for rounding, world units.

    Args:
        map_: Tiles.
        points: Receivers.
        normals: Their unit normals.
    """
    position, depth = map_.grid.locate(points)
    return position / map_.tile_size, depth - map_.grid.receiver_rounding(points, normals)


@eqx.filter_jit
def _asked(
    map_: AdaptiveMap,
    points: Points,
    normals: Points,
    view: RayGrid,
    rule: str,
    texels_per_pixel: float,
    finest: int,
) -> tuple[Array, ...]:
    """Of every pixel: place on the curve, slot and level that answer, level that it needs, whether an edge is near."""
    square, depth = placed_on(map_, points, normals)
    slot, level = map_.table.find(square)
    span = FOOTPRINTS[rule](view, map_.grid, points, normals)
    # Each level doubles the texels across a pixel; the span is kept from 0, where every level would be too coarse.
    wanted = jnp.ceil(jnp.log2(texels_per_pixel / jnp.maximum(span, texels_per_pixel / 2.0**finest)))
    needed = jnp.clip(wanted, 0, finest).astype(jnp.int32)
    gradient = plane_gradient(map_.grid, points, normals, STEEPEST)
    edge = straddles(map_, square, depth, gradient)
    return place_of(square), slot, level, needed, edge


__all__ = ["TESTS", "AdaptiveShadowMapping", "AdaptiveShadows", "HeldView", "Step", "placed_on"]
