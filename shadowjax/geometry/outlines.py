"""Edges of a mesh, each once, as candidates for an outline: where the surface seen from a place may end."""

import jax.numpy as jnp
import numpy as np

from shadowjax._checked import Checked, checked
from shadowjax._numerics import dot
from shadowjax._types import Array, Bool, Float, Int, Points
from shadowjax.geometry.edges import OPEN, edge_adjacency, welded
from shadowjax.geometry.mesh import Mesh


class MeshEdges(Checked):
    """Every edge of a mesh once, whatever the number of faces that meet there.

    Topology, built on the host: it has no gradient and does not change while vertices move.

    Attributes:
        vertices: Indices of the ends.
        faces: Two of the faces that meet here; -1 in place of the second where there is none.
        always: Whether the edge may end the visible surface from everywhere: open, or with more than two faces.
        ends: As `vertices`, with vertices at equal positions counted as one.
        corners: Corners of every face, counted likewise.
    """

    vertices: Int[Array, "edges 2"]
    faces: Int[Array, "edges 2"]
    always: Bool[Array, "edges"]
    ends: Int[Array, "edges 2"]
    corners: Int[Array, "faces 3"]

    def touch(self, edge: Int[Array, "*n"], face: Int[Array, "*n"]) -> Bool[Array, "*n"]:
        """Whether faces (−1: none) have edges among their sides."""
        corners = self.corners[jnp.maximum(face, 0)]
        ends = self.ends[edge]
        both = jnp.any(corners == ends[..., :1], axis=-1) & jnp.any(corners == ends[..., 1:], axis=-1)
        return both & (face >= 0)


@checked
def mesh_edges(mesh: Mesh, weld: bool = True) -> MeshEdges:
    """Find every edge of a mesh once, on the host.

    Args:
        mesh: A mesh with concrete vertices.
        weld: Whether vertices at equal positions are one. Vertices that an optimiser moves apart stay apart: weld a
            mesh whose repeated vertices move together.
    """
    found = edge_adjacency(mesh, weld)
    corners = welded(mesh) if weld else np.asarray(mesh.faces)
    place = np.zeros(mesh.num_vertices, np.int64)
    place[np.asarray(mesh.faces).reshape(-1)] = corners.reshape(-1)
    vertices, faces, count = (np.asarray(part) for part in (found.vertices, found.faces, found.num_faces))
    ends = place[vertices]
    _, first = np.unique(np.sort(ends, axis=1), axis=0, return_index=True)
    keep = np.sort(first[ends[first, 0] != ends[first, 1]])  # an edge without length parts nothing
    if not len(keep):
        # Arrays of one edge without length keep the shapes that compiled programs need.
        vertices, faces, count, ends = np.zeros((1, 2)), np.array([[0, OPEN]]), np.ones(1), np.zeros((1, 2))
        keep = np.zeros(1, np.int64)
    return MeshEdges(
        jnp.asarray(vertices[keep], jnp.int32),
        jnp.asarray(faces[keep], jnp.int32),
        jnp.asarray((count[keep] != 2) | (faces[keep, 1] == OPEN)),
        jnp.asarray(ends[keep], jnp.int32),
        jnp.asarray(corners, jnp.int32),
    )


@checked
def outline(mesh: Mesh, edges: MeshEdges, towards: Float[Array, "edges 3"]) -> Bool[Array, "edges"]:
    """Which edges may end the surface that is seen from a place: both faces lie on one side of them.

    Unlike `edges.silhouette` it needs no orientation of the faces, and a face seen exactly edge-on counts as lying on
    either side.

    Args:
        mesh: The mesh, moved or not since its edges were found.
        edges: From `mesh_edges`.
        towards: From the first end of each edge to the place, any length.
    """
    one, two = _sides(mesh, edges, towards)
    return edges.always | (one * two >= 0)


@checked
def free_side(mesh: Mesh, edges: MeshEdges, towards: Float[Array, "edges 3"]) -> Float[Array, "edges"]:
    """On which side of an edge of an outline no face lies: 1 along (end − start) × towards, −1 against it.

    Of edges with more than two faces two are asked.
    """
    one, two = _sides(mesh, edges, towards)
    # Signs of the sides on which the faces lie: the free side is opposite their sum.
    both = one + jnp.where(edges.faces[:, 1] == OPEN, one, two)
    return jnp.where(both > 0, -jnp.ones_like(both), jnp.ones_like(both))


def _sides(mesh: Mesh, edges: MeshEdges, towards: Float[Array, "edges 3"]) -> list[Float[Array, "edges"]]:
    start, end = (mesh.vertices[edges.vertices[:, k]] for k in range(2))
    across = jnp.cross(end - start, towards)
    return [_side(mesh, edges.faces[:, k], start, across) for k in range(2)]


def _side(mesh: Mesh, face: Int[Array, "edges"], start: Points, across: Points) -> Float[Array, "edges"]:
    """Sign of the side of a plane through an edge on which the third corner of a face lies."""
    corners = mesh.faces[jnp.maximum(face, 0)]
    # The edge's own corners lie in the plane to a rounding, so the farthest of all three is the third corner.
    height = jnp.stack([dot(mesh.vertices[corners[:, k]] - start, across) for k in range(3)], axis=-1)
    least, most = jnp.min(height, axis=-1), jnp.max(height, axis=-1)
    return jnp.sign(jnp.where(-least > most, least, most))
