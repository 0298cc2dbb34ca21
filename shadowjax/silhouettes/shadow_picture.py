"""Anti-aliased exact visibility of what a view sees: a shadow picture that has a gradient in everything that moves."""

import equinox as eqx
import jax.numpy as jnp
from jax import lax

from shadowjax._checked import Checked, checked
from shadowjax._checks import warn, without_tracers
from shadowjax._numerics import faces_light, norm
from shadowjax._types import Array, Bool, Float, Vector2, Vector3
from shadowjax.geometry.light import Light
from shadowjax.geometry.light_space import DirectionalSpace
from shadowjax.geometry.mesh import Mesh
from shadowjax.geometry.outlines import MeshEdges, mesh_edges
from shadowjax.rays.caster import Caster
from shadowjax.rays.casters import default_caster
from shadowjax.rays.plane_map import Box
from shadowjax.rays.ray_grid import RayGrid
from shadowjax.silhouettes._cells import blend
from shadowjax.silhouettes._search import Borders, fallen_ends, find_borders, on_edge, space_of
from shadowjax.silhouettes.coverage import segments_on


class Receiver(Checked):
    """What shadows fall on, where it is not the mesh that casts them.

    Attributes:
        mesh: Surfaces that the view sees. They cast no shadow.
        edges: Their edges.
    """

    mesh: Mesh
    edges: MeshEdges


@checked
def plane_receiver(
    origin: Vector3, axis_u: Vector3, axis_v: Vector3, lower: Vector2, upper: Vector2, shape: tuple[int, int]
) -> tuple[Receiver, RayGrid]:
    """A rectangle of a plane as receiver, and the view in which each cell is an equal part of it.

    Args:
        origin: World position of (u, v) = (0, 0).
        axis_u: Unit vector along u: columns.
        axis_v: Unit vector along v, perpendicular to it: rows.
        lower: (u, v) of the rectangle's first corner, world units.
        upper: (u, v) of the opposite one.
        shape: Rows and columns.

    Returns:
        The receiver, lit on the side of axis_v × axis_u, and its view.
    """
    # Parallel rays against the normal axis_v × axis_u, whose plane coordinates are (u, v) themselves.
    frame = jnp.stack([axis_u, jnp.cross(axis_v, axis_u), axis_v])
    size = norm(upper - lower)
    space = DirectionalSpace(origin + size * frame[1], frame)
    # A ray at the rectangle's very border may miss it by a rounding.
    rim = 64 * jnp.finfo(size.dtype).eps * size
    low, high = jnp.minimum(lower, upper) - rim, jnp.maximum(lower, upper) + rim
    ends = [(low[0], low[1]), (high[0], low[1]), (high[0], high[1]), (low[0], high[1])]
    corners = jnp.stack([origin + u * axis_u + v * axis_v for u, v in ends])
    faces = jnp.asarray([[0, 2, 1], [0, 3, 2]], jnp.int32)
    mesh = Mesh(corners, faces, jnp.full((2, 3), 0.75, size.dtype))
    return Receiver(mesh, mesh_edges(mesh, weld=False)), RayGrid(space, Box(lower, upper), 2 * size, *shape)


@checked
def shadow_picture(
    mesh: Mesh,
    edges: MeshEdges,
    light: Light,
    view: RayGrid,
    caster: Caster | None = None,
    receiver: Receiver | None = None,
    max_pairs: int | None = None,
) -> Float[Array, "rows cols"]:
    """Share of the light that reaches what each pixel sees, averaged over the pixel: 1 lit, 0 in shadow.

    The exact shadow test at the centre of every pixel, corrected by the exact area on the other side of every edge that
    crosses the pixel: outlines seen by the view, lines between faces that look towards the light and away from it, and
    edges of shadows, which are the light's outlines carried onto the surface behind them. Values lie in [0, 1]. The
    derivative, forward and reverse, in vertices, light, view and receiver is the integral of each edge's speed over its
    length, exact for straight edges: where a shadow's edge advances by a pixel, the pixels it crosses change by −1 for
    each pixel of its length. Values at pixels' centres have no gradient of their own: visibility is 0 or 1.

    What it does not see: the curve in which two surfaces cross, seen or as a caster of shadows; edges of different
    parts that lie on one another without common ends; faces that receive less than a pixel's length of a shadow's edge,
    between two others; the rim of a spot light. Sky counts as lit.

    Two programs are compiled: one finds the edges, without a gradient; one draws them, with it.

    Args:
        mesh: What casts shadows.
        edges: From `mesh_edges(mesh)`, made once outside `jit`.
        light: Directional, spot or point light.
        view: Rays of the picture: `camera_grid(camera, width, height)`, or from `plane_receiver`.
        caster: Any; the fastest if None.
        receiver: What the view sees; the mesh itself if None.
        max_pairs: Room for pairs of edge and pixel, and for pieces of shadows' edges. A pixel each, and at least 4096,
            if None. It bounds memory; time follows what there is.

    Raises:
        ValueError: If the view bends lines, or the light is of an unknown kind.
        RuntimeError: If there are more pairs or pieces than there is room for.

    Warns:
        SceneWarning: If no triangle shows view and light the same side; under `grad` too, not under `jit` or `vmap`.
    """
    caster = default_caster() if caster is None else caster
    shown = None if receiver is None else (receiver.mesh, receiver.edges)
    seen = mesh if receiver is None else receiver.mesh
    known = without_tracers((mesh, seen, light, view))
    if known is not None and not _faces_light(*known):
        warn(
            "no surface that the view may see faces the light, so all of it is dark and no number has a gradient: "
            "turn the receiver round, or give the direction to the sun as DirectionalLight.create(towards=…)"
        )
    borders = find_borders(*lax.stop_gradient((mesh, edges, light, view, caster, shown)), max_pairs)
    return _drawn(mesh, edges, light, view, shown, borders)


@eqx.filter_jit
def _faces_light(mesh: Mesh, seen: Mesh, light: Light, view: RayGrid) -> Bool[Array, ""]:
    """Whether some triangle has view and light on the same side."""
    middles, normals = jnp.mean(seen.triangles(), axis=1), seen.face_normals()
    spaces = view.space, space_of(light, mesh, seen)
    eye, lamp = (space.to_source(middles) for space in spaces)
    fronts = faces_light(normals, eye) & faces_light(normals, lamp)
    return jnp.any(fronts | (faces_light(-normals, eye) & faces_light(-normals, lamp)))


@eqx.filter_jit
def _drawn(
    mesh: Mesh,
    edges: MeshEdges,
    light: Light,
    view: RayGrid,
    shown: tuple[Mesh, MeshEdges] | None,
    borders: Borders,
) -> Float[Array, "rows cols"]:
    """The picture, with a gradient through the ends of every line."""
    seen_mesh, seen_edges = (mesh, edges) if shown is None else shown
    line, pieces = borders.line, borders.pieces
    counts = pieces.case > 0
    # Pieces that part nothing take harmless lines.
    falls = line.falls & counts
    kept = jnp.where(falls, line.edge, 0), line.begin, line.end, jnp.where(falls, line.face, 0)
    space = space_of(light, mesh, seen_mesh)
    *fallen, _, _ = fallen_ends(mesh, edges, seen_mesh, space, view, type(line)(line.falls, *kept))
    edge = jnp.where(line.falls, 0, line.edge)
    zeros = jnp.zeros_like(line.begin)
    *seen, _ = segments_on(view, *(on_edge(seen_mesh, seen_edges, edge, zeros + at) for at in (0.0, 1.0)))
    start, end = (jnp.where(falls[:, None], *both) for both in zip(fallen, seen, strict=True))
    # Visibility next to a border is 0 or 1, and the case says which side is lit.
    left = (pieces.case == 1).astype(line.begin.dtype)[None]
    piece = pieces.cell, pieces.first, pieces.last, counts
    flat = blend(borders.base.reshape(1, -1), left, 1 - left, start, end, piece, view.num_cols)
    picture = flat.reshape(borders.base.shape)
    # Borders that are not followed may leave a little too much or too little: cut from the value, not from its slope.
    return picture + lax.stop_gradient(jnp.clip(picture, 0.0, 1.0) - picture)


__all__ = ["Receiver", "plane_receiver", "shadow_picture"]
