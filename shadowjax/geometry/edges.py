"""Edges of a mesh: which faces meet at each, which are open or over-full, and the silhouette seen by a light."""

import jax.numpy as jnp
import numpy as np

from shadowjax._checked import Checked, checked
from shadowjax._numerics import dot
from shadowjax._types import Array, Bool, Int
from shadowjax.geometry.light import Light
from shadowjax.geometry.mesh import Mesh

OPEN = -1


class EdgeAdjacency(Checked):
    """Every edge of a mesh once, and the faces on its two sides.

    Topology, built on the host: it has no gradient and does not change while vertices move.

    Attributes:
        vertices: The edge's ends; the first of its faces runs through them in this order, the second against it.
        faces: The two faces that meet here; -1 in place of the second where the edge is open, and where no face is
            left that runs along it the other way: faces of unlike orientation do not pair.
        num_faces: How many faces meet: 1 open, 2 manifold, more where the mesh is not a manifold (further pairs of
            faces then follow as edges of their own).
    """

    vertices: Int[Array, "edges 2"]
    faces: Int[Array, "edges 2"]
    num_faces: Int[Array, "edges"]

    @property
    def is_closed(self) -> bool:
        """Whether exactly two faces meet at every edge, with one orientation."""
        return bool(jnp.all((self.num_faces == 2) & (self.faces[:, 1] != OPEN)))


@checked
def welded(mesh: Mesh) -> Int[np.ndarray, "faces 3"]:
    """Faces with vertices at exactly equal positions counted as one; host-side."""
    _, place = np.unique(np.asarray(mesh.vertices), axis=0, return_inverse=True)
    return place.reshape(-1)[np.asarray(mesh.faces)]


@checked
def paired_sides(faces: Int[np.ndarray, "faces 3"]) -> tuple[np.ndarray, np.ndarray]:
    """Sides of triangles that share an edge, as pairs of side numbers 3·face + i (side i runs from corner i to i + 1).

    Args:
        faces: Vertex indices, welded if the mesh repeats vertices.

    Returns:
        The pairs, and the sides left alone. Sides of an edge with more than two faces are paired in face order.
    """
    ends = np.stack([faces, np.roll(faces, -1, axis=1)], axis=-1).reshape(-1, 2)
    key = np.sort(ends, axis=1)
    # Side number last: a stable order within each edge.
    order = np.lexsort((np.arange(len(key)), key[:, 1], key[:, 0]))
    new = np.ones(len(key), bool)
    new[1:] = np.any(key[order[1:]] != key[order[:-1]], axis=1)
    starts = np.flatnonzero(new)
    # Place of each side within its edge: odd ones pair with the one before them.
    rank = np.arange(len(key)) - np.repeat(starts, np.diff(np.append(starts, len(key))))
    second = np.flatnonzero(rank % 2 == 1)
    pairs = np.stack([order[second - 1], order[second]], axis=-1)
    alone = np.setdiff1d(np.arange(len(key)), pairs.reshape(-1), assume_unique=True)
    return pairs, alone


@checked
def opposite_sides(faces: Int[np.ndarray, "faces 3"]) -> tuple[np.ndarray, np.ndarray]:
    """Sides of triangles that run along an edge in opposite senses, as pairs of side numbers 3·face + i.

    Args:
        faces: Vertex indices, welded if the mesh repeats vertices.

    Returns:
        The pairs, lower side number first, and the sides left alone. The first side one way is paired with the first
        the other way, and so on; sides from a vertex to itself have no length and are left out.
    """
    ends = np.stack([faces, np.roll(faces, -1, axis=1)], axis=-1).reshape(-1, 2)
    number = np.flatnonzero(ends[:, 0] != ends[:, 1])
    ends = ends[number]
    key = np.sort(ends, axis=1)

    def rank(columns: np.ndarray) -> np.ndarray:
        """Place of each row among equal rows."""
        _, group, count = np.unique(columns, axis=0, return_inverse=True, return_counts=True)
        # Stable order within equal rows, then the place counted from each group's start.
        group = group.reshape(-1)
        order = np.argsort(group, kind="stable")
        starts = np.cumsum(count) - count
        place = np.empty(len(group), int)
        place[order] = np.arange(len(group)) - starts[group[order]]
        return place

    # Sides of one edge and of one place within their own sense belong together.
    labelled = np.column_stack([key, rank(ends)])
    order = np.lexsort((number, labelled[:, 2], labelled[:, 1], labelled[:, 0]))
    same = np.all(labelled[order][1:] == labelled[order][:-1], axis=1)
    first = np.flatnonzero(same)
    pairs = np.stack([number[order[first]], number[order[first + 1]]], axis=-1)
    return pairs, np.setdiff1d(number, pairs.reshape(-1), assume_unique=True)


@checked
def edge_adjacency(mesh: Mesh, weld: bool = True) -> EdgeAdjacency:
    """Find the faces on both sides of every edge.

    Args:
        mesh: A mesh with concrete vertices.
        weld: Whether vertices at equal positions are one (as in files that repeat the corners of every triangle).

    Returns:
        All edges: first those with two faces, then open ones.
    """
    faces = welded(mesh) if weld else np.asarray(mesh.faces)
    original = np.asarray(mesh.faces)
    pairs, alone = opposite_sides(faces)
    first = np.concatenate([pairs[:, 0], alone])
    second = np.concatenate([pairs[:, 1] // 3, np.full(len(alone), OPEN)])
    ends = np.stack([original, np.roll(original, -1, axis=1)], axis=-1).reshape(-1, 2)
    # How many sides, paired or alone, run along the edge of each row.
    key = np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], axis=-1).reshape(-1, 2), axis=1)
    _, edge, count = np.unique(key, axis=0, return_inverse=True, return_counts=True)
    return EdgeAdjacency(
        jnp.asarray(ends[first], jnp.int32),
        jnp.asarray(np.stack([first // 3, second], axis=-1), jnp.int32),
        jnp.asarray(count[edge.reshape(-1)][first], jnp.int32),
    )


@checked
def silhouette(mesh: Mesh, edges: EdgeAdjacency, light: Light) -> Bool[Array, "edges"]:
    """Which edges separate the side of a mesh that faces a light from the side that does not.

    Args:
        mesh: The mesh, moved or not since the edges were found.
        edges: From `edge_adjacency`.
        light: Seen from its position, or along its direction.

    Returns:
        A mask over the edges, under `jit` too; open edges always belong to the silhouette. Where more than two faces
        meet, two edges of the mask may lie on one another in opposite senses and cancel: shadow sides along all edges
        of the mask with a facing face bound the shadow, and `silhouette_counts` says how few are enough.
    """
    to_light, _ = light.to_light(mesh.triangles()[:, 0])
    facing = dot(mesh.area_vectors(), to_light) > 0
    # OPEN is negative: a face of 0 stands in for it, and the last term answers.
    one, two = facing[edges.faces[:, 0]], facing[jnp.maximum(edges.faces[:, 1], 0)]
    return (one != two) | (edges.faces[:, 1] == OPEN)
