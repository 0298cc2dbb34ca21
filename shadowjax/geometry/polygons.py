"""Polygons of a mesh: neighbouring triangles of one plane count as one, as tests of polygon ids need."""

import jax.numpy as jnp
import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from shadowjax._checked import checked
from shadowjax._checks import concrete, require
from shadowjax._types import Array, Int
from shadowjax.geometry.edges import paired_sides, welded
from shadowjax.geometry.mesh import Mesh

# Sine of the angle between two triangles up to which they lie in one plane: some roundings of float32.
COPLANAR_SINE = 1e-4


@checked
def polygon_of_face(mesh: Mesh) -> Int[Array, "faces"]:
    """Number of the polygon that each triangle belongs to; host-side.

    Triangles that share an edge and lie in one plane are parts of one polygon, so the diagonals of quadrilaterals
    separate nothing.

    Args:
        mesh: A mesh with concrete vertices.

    Returns:
        Numbers from 0 to the number of polygons − 1.

    Raises:
        ValueError: If the vertices are traced.
    """
    require(concrete(mesh.vertices) is not None, "polygons are found on the host: give a mesh outside `jit` and `grad`")
    pairs, _ = paired_sides(welded(mesh))
    corners = np.asarray(mesh.vertices, np.float64)[np.asarray(mesh.faces)]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    normals = normals / np.where(length > 0, length, 1)
    # Side numbers are 3·face + i, so each pair names two neighbouring faces.
    one, two = pairs[:, 0] // 3, pairs[:, 1] // 3
    sine = np.linalg.norm(np.cross(normals[one], normals[two]), axis=1)
    # A small sine with opposite normals is a fold back onto itself, not a plane.
    flat = (sine <= COPLANAR_SINE) & (np.sum(normals[one] * normals[two], axis=1) > 0)
    num_faces = mesh.num_faces
    # Polygons are the connected parts of the graph whose links are flat edges.
    links = coo_array((np.ones(flat.sum(), np.int8), (one[flat], two[flat])), shape=(num_faces, num_faces))
    _, polygon = connected_components(links, directed=False)
    return jnp.asarray(polygon, jnp.int32)
