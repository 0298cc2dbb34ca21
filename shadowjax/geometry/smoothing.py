"""Smooth shading normals: which corners share one, and the normal of each group."""

import jax.numpy as jnp
import numpy as np
import scipy.sparse as sparse
from scipy.sparse.csgraph import connected_components

from shadowjax._checked import checked
from shadowjax._numerics import normalize
from shadowjax._types import Array, Float, Int
from shadowjax.geometry.edges import paired_sides, welded
from shadowjax.geometry.mesh import Mesh


@checked
def smooth_corner_groups(mesh: Mesh, crease_angle: float = 0.6) -> Int[Array, "faces 3"]:
    """Which corners share a shading normal: corners at one place whose faces meet at less than `crease_angle`.

    Host-side and static under differentiation, as it is topology; see `corner_normals`.

    Args:
        mesh: Any mesh with concrete vertices; vertices at equal positions count as one.
        crease_angle: Largest angle between neighbouring normals that is still shaded smoothly, radians.

    Returns:
        Group number of each corner of each face, counted from 0.
    """
    faces = welded(mesh)
    normals = np.asarray(mesh.face_normals())
    pairs, _ = paired_sides(faces)
    cosines = np.sum(normals[pairs[:, 0] // 3] * normals[pairs[:, 1] // 3], axis=1)
    pairs = pairs[cosines > np.cos(crease_angle)]
    # A side starts at the corner of its own number and ends at the next corner of its face.
    starts, ends = pairs, pairs // 3 * 3 + (pairs + 1) % 3
    # Neighbours usually run along their edge in opposite senses; badly oriented ones run alike.
    place = faces.reshape(-1)
    alike = (place[starts[:, 0]] == place[starts[:, 1]])[:, None]
    partner = np.where(alike, np.stack([starts[:, 1], ends[:, 1]], -1), np.stack([ends[:, 1], starts[:, 1]], -1))
    rows, cols = np.concatenate([starts[:, 0], ends[:, 0]]), partner.T.reshape(-1)
    graph = sparse.coo_array((np.ones(len(rows), np.int8), (rows, cols)), shape=(faces.size, faces.size))
    # Corners linked across smooth sides, transitively, shade as one.
    _, group = connected_components(graph, directed=False)
    return jnp.asarray(group.reshape(-1, 3), jnp.int32)


@checked
def corner_normals(mesh: Mesh, groups: Int[Array, "faces 3"]) -> Float[Array, "faces 3 3"]:
    """Shading normal of each corner: the area-weighted mean over its group, differentiable in the vertices.

    Args:
        mesh: The mesh, moved or not since the groups were found.
        groups: From `smooth_corner_groups`.
    """
    weighted = jnp.broadcast_to(mesh.area_vectors()[:, None], (*mesh.faces.shape, 3)).reshape(-1, 3)
    flat = groups.reshape(-1)
    summed = jnp.zeros_like(weighted).at[flat].add(weighted)
    return normalize(summed[flat]).reshape(*mesh.faces.shape, 3)
