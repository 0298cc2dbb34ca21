"""The search behind a shadow picture: every line across which visibility jumps in a view; no gradient."""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import lax

from shadowjax._checks import require_int
from shadowjax._numerics import dot, norm, normalize, safe_divide
from shadowjax._types import Array, Bool, Float, Int, Points, Scalar, Vector3
from shadowjax.geometry.light import Light
from shadowjax.geometry.light_space import LightSpace
from shadowjax.geometry.mesh import Mesh
from shadowjax.geometry.outlines import MeshEdges, free_side, outline
from shadowjax.rays.caster import Caster
from shadowjax.rays.ray import Hit, Rays, surface_points
from shadowjax.rays.ray_grid import RayGrid
from shadowjax.silhouettes._cells import map_present, room, spread
from shadowjax.silhouettes._pieces import Pieces, settle
from shadowjax.silhouettes.coverage import (
    CHUNK,
    default_room,
    edge_ends,
    pairs_of,
    rays_beside,
    segments_on,
)

# Pieces of a shadow's edge for each cell of the view, if the view shows just the scene.
PIECES = 1.0
# How far next to an edge the light's rays look, in roundings of the scene's size.
ASIDE = 1024.0


class Line(NamedTuple):
    """Where the line of each pair comes from: enough to draw it again, with a gradient.

    Attributes:
        falls: Whether it is the edge of a shadow on a face; else an edge that is seen itself.
        edge: Index of the edge: of the caster's edges if it falls, else of the receiver's.
        begin, end: Part of the edge that casts it.
        face: On which it falls.
    """

    falls: Bool[Array, "n"]
    edge: Int[Array, "n"]
    begin: Float[Array, "n"]
    end: Float[Array, "n"]
    face: Int[Array, "n"]


class Borders(NamedTuple):
    """All that is needed to draw a shadow picture and its derivative.

    Attributes:
        base: Visibility at the centres of the pixels.
        pieces: Pieces of lines in pixels: case 1 is brighter on the left, 2 on the right.
        line: The line of each piece.
    """

    base: Float[Array, "rows cols"]
    pieces: Pieces
    line: Line


def space_of(light: Light, mesh: Mesh, shown: Mesh) -> LightSpace:
    """Rays of a light around everything."""
    lower, upper = _bounds(mesh, shown)
    return light.space(jnp.asarray([0.36, 0.48, 0.8], lower.dtype), lower, upper)


def _bounds(mesh: Mesh, shown: Mesh) -> tuple[Vector3, Vector3]:
    (low, high), (low_shown, high_shown) = (lax.stop_gradient(part.bounds()) for part in (mesh, shown))
    return jnp.minimum(low, low_shown), jnp.maximum(high, high_shown)


def carried(points: Points, space: LightSpace, onto: Float[Array, "n 3 3"]) -> tuple[Points, Bool[Array, "n"]]:
    """Where the light's rays through points meet the planes of triangles, and whether they do so behind the points."""
    travel = -space.vector_to_source(points)
    corner = onto[:, 0]
    normal = jnp.cross(onto[:, 1] - corner, onto[:, 2] - corner)
    # Ray–plane intersection; 0 for a plane along the light, which then counts as not behind.
    along = safe_divide(dot(corner - points, normal), dot(travel, normal))
    return points + along[:, None] * travel, lax.stop_gradient(along) > 0


def on_edge(mesh: Mesh, edges: MeshEdges, edge: Int[Array, "n"], part: Float[Array, "n"]) -> Points:
    """Points of edges at a part of their length."""
    first, second = (mesh.vertices[edges.vertices[edge, k]] for k in range(2))
    return first + part[:, None] * (second - first)


@eqx.filter_jit
def find_borders(
    mesh: Mesh,
    edges: MeshEdges,
    light: Light,
    view: RayGrid,
    caster: Caster,
    shown: tuple[Mesh, MeshEdges] | None,
    max_pairs: int | None,
) -> Borders:
    """Base picture, and lines with what lies on their sides.

    Args:
        mesh: What casts shadows.
        edges: Of it.
        light: The light.
        view: Rays of the picture.
        caster: Casts the rays.
        shown: What the view sees, with its edges; the mesh itself if None.
        max_pairs: Room.
    """
    seen_mesh, seen_edges = (mesh, edges) if shown is None else shown
    space = space_of(light, mesh, seen_mesh)
    shadows = caster.prepared(mesh)
    eye = shadows if shown is None else caster.prepared(seen_mesh)

    def lit(hit: Hit, rays: Rays) -> Array:
        seen = hit.is_hit
        points = surface_points(seen_mesh, rays, hit)
        normals = seen_mesh.face_normals()[jnp.where(seen, hit.face, 0)]
        # The side that the view sees; visibility is judged there.
        normals = jnp.where((dot(normals, rays.directions) > 0)[..., None], -normals, normals)
        value = shadows.visible(mesh, space, *lax.optimization_barrier((points, normals)))
        return jnp.where(seen, value, jnp.ones_like(value)).astype(points.dtype)

    base = lit(eye.closest_on_grid(seen_mesh, view), view.rays())
    parts = (
        _seen_lines(seen_mesh, seen_edges, space, view),
        _fallen_lines(mesh, edges, seen_mesh, space, view, eye, max_pairs),
    )
    (start, end, present), line = jax.tree.map(lambda *both: jnp.concatenate(both), *parts)
    # One copy in memory: otherwise every use computes the lines again, and takes as long to compile.
    start, end, present, line = lax.optimization_barrier((start, end, present, line))
    pairs = pairs_of(start, end, present, view, max_pairs)

    def probe(left: Array, right: Array, exists: Array, segment: Array) -> tuple[Array, tuple[()]]:
        # Both sides in one cast: half the code to compile.
        rays = rays_beside(view, jnp.concatenate([left, right]), jnp.concatenate([exists, exists]))
        rays = lax.optimization_barrier(rays)
        hit = lax.optimization_barrier(eye.closest(seen_mesh, rays))
        faces, depths, values = (jnp.split(x, 2) for x in (hit.face, hit.depth, lit(hit, rays)))
        # A seen edge belongs to the nearer of its two sides; a shadow's edge to the lit one, on which it must have
        # fallen.
        nearer = jnp.where(depths[0] <= depths[1], *faces)
        brighter = jnp.where(values[0] >= values[1], *faces)
        falls, edge = line.falls[segment], line.edge[segment]
        own = jnp.where(falls, brighter == line.face[segment], seen_edges.touch(jnp.where(falls, 0, edge), nearer))
        case = jnp.where(values[0] > values[1], 1, jnp.where(values[0] < values[1], 2, 0))
        return jnp.where(own, case, 0).astype(jnp.int32), ()

    pieces = settle(pairs, start, end, probe)
    return Borders(base, pieces, jax.tree.map(lambda x: x[pieces.segment], line))


def _seen_lines(mesh: Mesh, edges: MeshEdges, space: LightSpace, view: RayGrid) -> tuple[tuple, Line]:
    """Edges that end a surface for the view, or its lit side."""
    start, end, inside = edge_ends(view, mesh, edges)
    first = mesh.vertices[edges.vertices[:, 0]]
    parts = outline(mesh, edges, view.space.vector_to_source(first))
    parts = parts | outline(mesh, edges, space.vector_to_source(first))
    number = jnp.arange(start.shape[0], dtype=jnp.int32)
    zeros = jnp.zeros_like(start[:, 0])
    return (start, end, inside & parts), Line(jnp.zeros_like(parts), number, zeros, zeros + 1, jnp.zeros_like(number))


def _fallen_lines(
    mesh: Mesh,
    edges: MeshEdges,
    shown: Mesh,
    space: LightSpace,
    view: RayGrid,
    eye: Caster,
    max_pairs: int | None,
) -> tuple[tuple, Line]:
    """The light's outlines in short pieces, carried onto the planes of the faces behind the ends of each."""
    first, second = (mesh.vertices[edges.vertices[:, k]] for k in range(2))
    casts = outline(mesh, edges, space.vector_to_source(first))
    lower, upper = _bounds(mesh, shown)
    size: Scalar = jnp.maximum(norm(upper - lower), jnp.max(jnp.abs(jnp.stack([lower, upper]))))
    # Pieces about as long as a pixel, if the view shows just the scene.
    wanted = norm(second - first) / size * (PIECES * max(view.num_rows, view.num_cols))
    capacity, chunk = room(default_room(view) if max_pairs is None else require_int(max_pairs, "max_pairs", 1), CHUNK)
    counts = jnp.where(casts, jnp.clip(jnp.ceil(wanted), 1, capacity).astype(jnp.int32), 0)
    edge, piece, total = spread(counts, capacity)
    total = eqx.error_if(total, total > capacity, f"edges of shadows have more than {capacity} pieces; raise max_pairs")
    present = jnp.arange(capacity, dtype=jnp.int32) < total
    share = jnp.maximum(counts[edge], 1).astype(size.dtype)
    begin, end = (piece.astype(size.dtype) / share, (piece + 1).astype(size.dtype) / share)
    middle = on_edge(mesh, edges, edge, 0.5 * (begin + end))
    # Perpendicular to edge and light ray, towards the side where light passes: probes look just past the edge.
    across = normalize(jnp.cross(second[edge] - first[edge], space.vector_to_source(middle)))
    aside = ASIDE * jnp.finfo(size.dtype).eps * size
    across = across * (aside * free_side(mesh, edges, space.vector_to_source(first))[edge])[:, None]
    far = space.farthest(lower, upper)

    def search(part: tuple) -> tuple[Array, ...]:
        exists, *places = part
        plane, depth = space.project(jnp.concatenate(places))
        limit = jnp.where(jnp.tile(exists, len(places)), far, -jnp.ones_like(far))
        # Only what lies behind the edge can receive its shadow; whether light gets there is asked later.
        return tuple(jnp.split(eye.closest(shown, Rays(*space.ray(plane), depth + 8 * aside, limit)).face, len(places)))

    inset = float(jnp.finfo(size.dtype).eps) ** 0.5
    probes = [on_edge(mesh, edges, edge, begin + at * (end - begin)) + across for at in (inset, 1 - inset)]
    # What lies behind both ends of every piece, cast just past the edge; no gradient passes through it.
    face = jnp.stack(map_present(search, lax.optimization_barrier((present, *probes)), total, chunk), axis=-1)
    falls = present[:, None] & (face >= 0)
    # A piece that falls on one face is drawn once.
    falls = falls.at[:, 1].set(falls[:, 1] & ~(falls[:, 0] & (face[:, 0] == face[:, 1])))
    edge, begin, end = (jnp.concatenate([x, x]) for x in (edge, begin, end))
    face, falls = face.T.reshape(-1), falls.T.reshape(-1)
    line = Line(jnp.ones_like(falls), edge, begin, end, jnp.where(falls, face, 0))
    start, finish, before, ahead = fallen_ends(mesh, edges, shown, space, view, line)
    return (start, finish, falls & before & ahead), line


def fallen_ends(
    mesh: Mesh, edges: MeshEdges, shown: Mesh, space: LightSpace, view: RayGrid, line: Line
) -> tuple[Array, Array, Array, Array]:
    """Ends of shadows' edges in grid positions, differentiable; whether they lie before the view, and behind edges."""
    onto = shown.triangles()[line.face]
    ends, ahead = zip(*(carried(on_edge(mesh, edges, line.edge, at), space, onto) for at in line[2:4]), strict=True)
    start, end, before = segments_on(view, *ends)
    return start, end, before, ahead[0] & ahead[1]
