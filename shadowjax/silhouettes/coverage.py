"""Edge-aware depth: means over texels that the outline of the nearest layer crosses, which have a gradient."""

from collections.abc import Callable

import equinox as eqx
import jax.numpy as jnp
from jax import lax

from shadowjax._checked import Checked, checked
from shadowjax._checks import require, require_int, warn, without_tracers
from shadowjax._numerics import dot
from shadowjax._types import Array, Bool, Float, Int, Points
from shadowjax.geometry.mesh import Mesh
from shadowjax.geometry.outlines import MeshEdges, outline
from shadowjax.rays.caster import Caster
from shadowjax.rays.casters import default_caster
from shadowjax.rays.ray import Rays
from shadowjax.rays.ray_grid import RayGrid
from shadowjax.silhouettes._cells import Crossings, blend, crossings, room
from shadowjax.silhouettes._pieces import Pieces, settle

Encode = Callable[[Array], Array]

# Pairs of edge and cell worked on together.
CHUNK = 4096
# How close to the plane through a perspective view's own position an edge is followed, as part of its farther end.
NEAREST = 1e-3


@checked
def plain_depth(depth: Float[Array, "*shape"]) -> Float[Array, "1 *shape"]:
    """Depth itself as the only plane."""
    return depth[None]


@checked
def powers(degree: int) -> Encode:
    """Encoder of the moments z, z², … up to a degree: what variance (2) and moment (4) shadow maps store."""
    require_int(degree, "degree", 1)
    return _Powers(degree)


class _Powers(Checked):
    degree: int = eqx.field(static=True)

    def __call__(self, depth: Float[Array, "*shape"]) -> Float[Array, "n *shape"]:
        planes = [depth]
        for _ in range(self.degree - 1):
            planes.append(planes[-1] * depth)
        return jnp.stack(planes)


@checked
def coverage_planes(
    mesh: Mesh,
    edges: MeshEdges,
    grid: RayGrid,
    encode: Encode = plain_depth,
    caster: Caster | None = None,
    max_pairs: int | None = None,
) -> Float[Array, "n rows cols"]:
    """Encoded depth (moments, basis values), averaged over every texel that the nearest layer's outline crosses.

    A texel that no outline crosses holds the values of the depth at its centre, as a plain map does. Where one crosses,
    the values on its two sides are blended by the exact area of the texel on either side, corners and several edges
    included. So the planes change with continuity as a silhouette moves, and their derivative, forward and reverse, in
    vertices, light and view is exact for straight edges: a unit step moves the edge's share of a texel by its length.

    What it does not see: outlines hidden behind the nearest layer; the curve in which two surfaces cross, where depth
    has a kink but no jump; edges of different parts that lie on one another without common ends; features narrower than
    the rounding of a cell. Over a texel each surface counts as flat, with the depth that its plane has on the ray
    through the texel's centre: the derivative is that of what is returned, and both differ from the true mean by the
    change of slope across the edge, times a part of a texel. A plane map that bends lines (logarithmic) is followed
    along chords.

    Args:
        mesh: What is cast.
        edges: From `mesh_edges`.
        grid: Rays of a directional, spot or camera space.
        encode: Takes depths of any shape and gives codes, stacked along a new first axis; element by element.
        caster: Any; the fastest if None. Two rays are cast for every pair of edge and texel.
        max_pairs: Room for such pairs: memory and an upper bound on time. A texel each, and at least 4096, if None.

    Raises:
        ValueError: If the grid bends lines (the octahedral map of a point light).
        RuntimeError: If outlines cross more texels than there is room for.

    Warns:
        SceneWarning: If no ray of the grid meets the mesh; under `grad` too, not under `jit` or `vmap`.
    """
    caster = default_caster() if caster is None else caster
    depth = _depth(mesh, grid, caster)
    pieces = outline_pieces(mesh, edges, grid, caster, max_pairs)
    known = without_tracers((depth, pieces.parts))
    if known is not None and bool(jnp.all(known[0] >= grid.far)) and not bool(jnp.any(known[1])):
        warn(
            "no ray of the grid meets the mesh, so every plane holds the farthest depth and no number has a gradient: "
            "turn the grid round, or move its map to where the mesh is"
        )
    return pieces.blended(encode(depth), encode)


class OutlinePieces(Checked):
    """Where the outline of the nearest layer crosses the cells of a grid, and how deep it is on either side.

    Attributes:
        start, end: Ends of the edge of each piece, grid positions.
        left, right: Depth of the surface on either side, world units: its plane met by the ray through the cell's
            centre.
        cell: Cell of each piece, row by row.
        first, last: Ends of the piece, as parts of the edge.
        parts: Whether depth jumps there.
    """

    start: Float[Array, "n 2"]
    end: Float[Array, "n 2"]
    left: Float[Array, "n"]
    right: Float[Array, "n"]
    cell: Int[Array, "n"]
    first: Float[Array, "n"]
    last: Float[Array, "n"]
    parts: Bool[Array, "n"]

    def blended(self, base: Float[Array, "n rows cols"], encode: Encode) -> Float[Array, "n rows cols"]:
        """Codes averaged over cells.

        Args:
            base: Codes of the depths at the centres of cells.
            encode: Made them, element by element.
        """
        return _blended(self, base, encode)


@checked
def outline_pieces(
    mesh: Mesh, edges: MeshEdges, grid: RayGrid, caster: Caster, max_pairs: int | None = None
) -> OutlinePieces:
    """The outline of the nearest layer, with a gradient in where it is and in the depths next to it.

    Two programs are compiled: one finds pieces, without a gradient; one computes them again, with it. Arguments, limits
    and errors are those of `coverage_planes`.
    """
    pieces = _find_pieces(*lax.stop_gradient((mesh, edges, grid, caster)), max_pairs)
    return _measured(mesh, edges, grid, pieces)


@eqx.filter_jit
def _find_pieces(mesh: Mesh, edges: MeshEdges, grid: RayGrid, caster: Caster, max_pairs: int | None) -> Pieces:
    """Pieces of the outline of the nearest layer, with the triangle on either side."""
    start, end, inside = edge_ends(grid, mesh, edges)
    seen = inside & outline(mesh, edges, grid.space.vector_to_source(mesh.vertices[edges.vertices[:, 0]]))
    pairs = pairs_of(start, end, seen, grid, max_pairs)
    caster = caster.prepared(mesh)

    def probe(left: Array, right: Array, exists: Array, segment: Array) -> tuple[Array, tuple[Array, ...]]:
        rays = rays_beside(grid, jnp.concatenate([left, right]), jnp.concatenate([exists, exists]))
        hit = caster.closest(mesh, rays)
        faces, depths = jnp.split(hit.face, 2), jnp.split(hit.depth, 2)
        # Depth jumps where the nearer side is a face of the edge itself; else the edge is hidden or only passes by.
        nearer = jnp.where(depths[0] < depths[1], *faces)
        return edges.touch(segment, nearer).astype(jnp.int32), tuple(faces)

    return settle(pairs, start, end, probe)


@eqx.filter_jit
def _measured(mesh: Mesh, edges: MeshEdges, grid: RayGrid, pieces: Pieces) -> OutlinePieces:
    """Ends of edges, and depths on both sides, differentiable."""
    start, end, _ = edge_ends(grid, mesh, edges)
    # Column and row of each piece's cell; the ray through its centre meets both surfaces' planes.
    corner = jnp.stack([pieces.cell % grid.num_cols, pieces.cell // grid.num_cols], axis=-1)
    rays = grid.rays_at((corner.astype(start.dtype) + 0.5) / grid.resolution)
    left, right = (_plane_depth(mesh, rays, face) for face in pieces.found)
    piece = pieces.cell, pieces.first, pieces.last, pieces.case > 0
    return OutlinePieces(start[pieces.segment], end[pieces.segment], left, right, *piece)


def _plane_depth(mesh: Mesh, rays: Rays, face: Int[Array, "n"]) -> Float[Array, "n"]:
    """Depth at which rays meet the planes of triangles (−1: none), within reach of the triangles themselves.

    Planes seen nearly edge-on are met anywhere: no depth is farther from a triangle than the triangle is deep.
    """
    missed = face < 0
    offsets = mesh.triangles()[jnp.where(missed, 0, face)] - rays.origins[:, None]
    depths = dot(offsets, jnp.broadcast_to(rays.directions[:, None], offsets.shape))
    # From next to the triangle, which keeps digits; the step has no gradient of its own.
    step = lax.stop_gradient(depths[:, 0])
    a, b, c = jnp.moveaxis(offsets - (step[:, None] * rays.directions)[:, None], 1, 0)
    normal = jnp.cross(b - a, c - a)
    # The plane is met at step + rise/fall; a fall near 0 is a plane seen edge-on, whose depth is limited instead.
    rise, fall = dot(a, normal), dot(rays.directions, normal)
    # No depth lies farther from the triangle's own than the triangle is deep.
    low, high = jnp.min(depths, axis=-1), jnp.max(depths, axis=-1)
    reach = high - low
    beyond = jnp.abs(rise) >= 2 * reach * jnp.abs(fall)
    depth = step + rise / jnp.where(beyond, jnp.ones_like(fall), fall)
    last = jnp.where(rise * fall < 0, low - reach, high + reach)
    depth = jnp.where(beyond, last, jnp.clip(depth, low - reach, high + reach))
    return jnp.where(missed, rays.t_max, jnp.clip(depth, jnp.zeros_like(depth), rays.t_max))


@eqx.filter_jit
def _blended(pieces: OutlinePieces, base: Float[Array, "n rows cols"], encode: Encode) -> Float[Array, "n rows cols"]:
    piece = pieces.cell, pieces.first, pieces.last, pieces.parts
    left, right = encode(pieces.left), encode(pieces.right)
    flat = blend(base.reshape(base.shape[0], -1), left, right, pieces.start, pieces.end, piece, base.shape[2])
    return flat.reshape(base.shape)


@eqx.filter_jit
def _depth(mesh: Mesh, grid: RayGrid, caster: Caster) -> Float[Array, "rows cols"]:
    return caster.closest_on_grid(mesh, grid).depth


@checked
def coverage_depth(
    mesh: Mesh, edges: MeshEdges, grid: RayGrid, caster: Caster | None = None, max_pairs: int | None = None
) -> Float[Array, "rows cols"]:
    """Depth averaged over every texel that the outline of the nearest layer crosses; see `coverage_planes`.

    Filters that average codes want averaged codes, not codes of this depth.
    """
    return coverage_planes(mesh, edges, grid, plain_depth, caster, max_pairs)[0]


@checked
def rays_beside(grid: RayGrid, position: Float[Array, "n 2"], present: Bool[Array, "n"]) -> Rays:
    """Rays through grid positions; those that are not present hit nothing."""
    rays = grid.rays_at(position / grid.resolution)
    return Rays(rays.origins, rays.directions, rays.t_min, jnp.where(present, grid.far, -jnp.ones_like(grid.far)))


@checked
def pairs_of(
    start: Float[Array, "segments 2"],
    end: Float[Array, "segments 2"],
    present: Bool[Array, "segments"],
    grid: RayGrid,
    max_pairs: int | None,
) -> Crossings:
    """Segments with the cells they cross, checked for room."""
    wanted = default_room(grid) if max_pairs is None else require_int(max_pairs, "max_pairs", 1)
    capacity, _ = room(wanted, CHUNK)
    pairs = crossings(start, end, present, (grid.num_rows, grid.num_cols), capacity)
    return eqx.error_if(pairs, pairs.num > capacity, f"outlines cross more than {capacity} cells; raise max_pairs")


@checked
def default_room(grid: RayGrid) -> int:
    """Room for pairs where none is asked for."""
    return max(CHUNK, grid.num_rows * grid.num_cols)


@checked
def segments_on(grid: RayGrid, first: Points, second: Points) -> tuple[Array, Array, Bool[Array, "n"]]:
    """Ends of straight lines of the world in grid positions, the part behind a perspective view cut away.

    Returns:
        Both ends, differentiable, and whether any part lies before the view.

    Raises:
        ValueError: If the space bends lines.
    """
    space = grid.space
    require(
        space.is_projective,
        f"outlines need rays that keep lines straight; {type(space).__name__} bends them: use a directional or a spot "
        "light, or a camera",
    )
    before = jnp.ones(first.shape[:-1], bool)
    if not space.is_parallel:
        forward = space.rows[2]
        # Distance of both ends along the view; a part with one end behind is cut, not dropped.
        ahead = [dot(points - space.source, jnp.broadcast_to(forward, points.shape)) for points in (first, second)]
        most = jnp.maximum(*ahead)
        before = most > 0
        # Clipped just in front of the view's plane, where projection would divide by 0, and moved along the line
        # itself.
        limit = NEAREST * jnp.where(before, most, jnp.ones_like(most))

        def moved(one: int, points: Points, others: Points) -> Points:
            short = ahead[one] < limit
            # Where nothing is cut, the divisor is 1, so that lines level with the view give no 0/0.
            gap = jnp.where(short & before, ahead[1 - one] - ahead[one], jnp.ones_like(limit))
            part = jnp.where(short & before, (limit - ahead[one]) / gap, jnp.zeros_like(limit))
            return points + part[..., None] * (others - points)

        first, second = moved(0, first, second), moved(1, second, first)
    return grid.locate(first)[0], grid.locate(second)[0], before


@checked
def edge_ends(grid: RayGrid, mesh: Mesh, edges: MeshEdges) -> tuple[Array, Array, Bool[Array, "edges"]]:
    """Ends of all edges of a mesh in grid positions, and whether any part of each can be seen."""
    return segments_on(grid, *(mesh.vertices[edges.vertices[:, k]] for k in range(2)))


__all__ = [
    "Encode", "OutlinePieces", "coverage_depth", "coverage_planes", "default_room", "edge_ends", "outline_pieces",
    "pairs_of", "plain_depth", "powers", "rays_beside", "segments_on",
]  # fmt: skip
