"""Edges of a mesh: which faces meet at each, which are open or over-full, and the silhouette seen by a light."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from shadowjax._numerics import dot
from shadowjax._types import Array, Bool, Int
from shadowjax.geometry.light import Light
from shadowjax.geometry.mesh import Mesh

OPEN = -1


class EdgeAdjacency(eqx.Module):
    """Every edge of a mesh once, and the faces on its two sides.

    Topology, built on the host: it has no gradient and does not change while vertices move.

    Attributes:
        vertices: The edge's ends; the first of its faces runs through them in this order.
        faces: The two faces that meet here; -1 in place of the second where the edge is open.
        num_faces: How many faces meet: 1 open, 2 manifold, more where the mesh is not a manifold (further pairs of
            faces then follow as edges of their own).
    """

    vertices: Int[Array, "edges 2"]
    faces: Int[Array, "edges 2"]
    num_faces: Int[Array, "edges"]

    @property
    def is_closed(self) -> bool:
        """Whether exactly two faces meet at every edge."""
        return bool(jnp.all(self.num_faces == 2))


def welded(mesh: Mesh) -> Int[np.ndarray, "faces 3"]:
    """Faces with vertices at exactly equal positions counted as one; host-side."""
    _, place = np.unique(np.asarray(mesh.vertices), axis=0, return_inverse=True)
    return place.reshape(-1)[np.asarray(mesh.faces)]


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
    rank = np.arange(len(key)) - np.repeat(starts, np.diff(np.append(starts, len(key))))
    second = np.flatnonzero(rank % 2 == 1)
    pairs = np.stack([order[second - 1], order[second]], axis=-1)
    alone = np.setdiff1d(np.arange(len(key)), pairs.reshape(-1), assume_unique=True)
    return pairs, alone


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
    pairs, alone = paired_sides(faces)
    first = np.concatenate([pairs[:, 0], alone])
    second = np.concatenate([pairs[:, 1] // 3, np.full(len(alone), OPEN)])
    ends = np.stack([original, np.roll(original, -1, axis=1)], axis=-1).reshape(-1, 2)
    key = np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], axis=-1).reshape(-1, 2), axis=1)
    _, edge, count = np.unique(key, axis=0, return_inverse=True, return_counts=True)
    return EdgeAdjacency(
        jnp.asarray(ends[first], jnp.int32),
        jnp.asarray(np.stack([first // 3, second], axis=-1), jnp.int32),
        jnp.asarray(count[edge.reshape(-1)][first], jnp.int32),
    )


def silhouette(mesh: Mesh, edges: EdgeAdjacency, light: Light) -> Bool[Array, "edges"]:
    """Which edges part the side of a mesh that faces a light from the side that does not.

    Args:
        mesh: The mesh, moved or not since the edges were found.
        edges: From `edge_adjacency`.
        light: Seen from its position, or along its direction.

    Returns:
        A mask over the edges, under `jit` too; open edges always belong to the silhouette.
    """
    to_light, _ = light.to_light(mesh.triangles()[:, 0])
    facing = dot(mesh.area_vectors(), to_light) > 0
    one, two = facing[edges.faces[:, 0]], facing[jnp.maximum(edges.faces[:, 1], 0)]
    return (one != two) | (edges.faces[:, 1] == OPEN)
