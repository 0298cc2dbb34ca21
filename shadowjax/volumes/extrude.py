"""Shadow volumes from a mesh: which edges and faces bound them, and their corners, some of them at infinity."""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Num

from shadowjax._checked import Checked, checked
from shadowjax._checks import concrete, require, require_choice
from shadowjax._types import Array, Float, Int
from shadowjax.geometry.light import Light
from shadowjax.geometry.mesh import Mesh

# Which faces cast: every face, or only those whose outer side the light sees.
CASTERS = ("both", "facing")


class VolumeEdges(Checked):
    """The edges of a mesh as a chain: each face's sides as edges, run one way or the other.

    Topology, built on the host. Any number of faces may share an edge, wound either way.

    Attributes:
        ends: The two vertices of every edge.
        side_edges: The edge of each side of each face; side i runs from corner i to corner i + 1.
        side_signs: 1 where the side runs from the edge's first end to its second, −1 where it runs back, 0 where the
            side has no length.
    """

    ends: Int[Array, "edges 2"]
    side_edges: Int[Array, "faces 3"]
    side_signs: Int[Array, "faces 3"]

    @property
    def boundary(self) -> Int[Array, "edges"]:
        """How often the faces run along each edge, one way less the other: 0 everywhere on a closed, oriented mesh."""
        total = jnp.zeros(self.ends.shape[0], jnp.int32)
        return total.at[self.side_edges.reshape(-1)].add(self.side_signs.reshape(-1))


@checked
def volume_edges(mesh: Mesh) -> VolumeEdges:
    """Edges of a mesh, with vertices at equal positions counted as one.

    A mesh that is being traced cannot be welded: each face then keeps three edges of its own, and so a volume of its
    own. Counts are the same; there are more quads.
    """
    vertices, faces = concrete(mesh.vertices), concrete(mesh.faces)
    if vertices is None or faces is None:
        sides = jnp.arange(3 * mesh.num_faces, dtype=jnp.int32).reshape(-1, 3)
        ends = jnp.stack([mesh.faces, jnp.roll(mesh.faces, -1, axis=1)], axis=-1).reshape(-1, 2)
        return VolumeEdges(ends, sides, jnp.ones_like(sides))
    _, first, place = np.unique(vertices, axis=0, return_index=True, return_inverse=True)
    faces = first[place.reshape(-1)][faces]
    # Side i from corner i to corner i + 1; its edge is the sorted pair, its sign the sense.
    sides = np.stack([faces, np.roll(faces, -1, axis=1)], axis=-1).reshape(-1, 2)
    ends, edge = np.unique(np.sort(sides, axis=1), axis=0, return_inverse=True)
    return VolumeEdges(
        jnp.asarray(ends, jnp.int32),
        jnp.asarray(edge.reshape(-1, 3), jnp.int32),
        jnp.asarray(np.sign(sides[:, 1] - sides[:, 0]).reshape(-1, 3), jnp.int32),
    )


@checked
def require_closed(edges: VolumeEdges) -> None:
    """Raise ValueError unless every edge is run along as often one way as the other.

    Only then do the faces that the light sees bound the shadow of the whole mesh.
    """
    boundary = concrete(edges.boundary)
    require(
        boundary is not None and not boundary.any(),
        "volumes of the faces that face the light need a closed mesh, wound outwards all over; "
        + (
            "this one is being traced, so that nobody can tell"
            if boundary is None
            else f"{int(np.count_nonzero(boundary))} of {boundary.size} edges are open or wound inconsistently"
        )
        + '; use casters="both", which takes any mesh',
    )


@checked
def cross(a: Num[Array, "*n 3"], b: Num[Array, "*n 3"]) -> Num[Array, "*n 3"]:
    """Cross product, of integers too."""
    (ax, ay, az), (bx, by, bz) = ([part[..., axis] for axis in range(3)] for part in (a, b))
    return jnp.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], axis=-1)


@checked
def inner(a: Num[Array, "*#n 3"], b: Num[Array, "*#n 3"]) -> Num[Array, "*n"]:
    """Inner product, of integers too."""
    return a[..., 0] * b[..., 0] + a[..., 1] * b[..., 1] + a[..., 2] * b[..., 2]


@checked
def at_infinity(vertices: Num[Array, "*n 3"], light: Num[Array, "4"]) -> Num[Array, "*n 3"]:
    """Direction in which the light throws each vertex: its point at infinity is (direction, 0)."""
    return light[3] * vertices - light[:3]


@checked
def face_signs(
    vertices: Num[Array, "vertices 3"], faces: Int[Array, "faces 3"], light: Num[Array, "4"], casters: str = "both"
) -> Int[Array, "faces"]:
    """How each face casts: 1 where the light sees its outer side, −1 its inner side, 0 where it casts nothing.

    A face without area, or whose plane holds the light, casts nothing. With casters="facing" neither does one that
    shows the light its inner side.
    """
    require_choice(casters, "casters", CASTERS)
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    # (b − a) × (c − a)·(l − w·a): the homogeneous light's side of the face's plane.
    sign = -jnp.sign(inner(cross(b - a, c - a), at_infinity(a, light))).astype(jnp.int32)
    return sign if casters == "both" else jnp.maximum(sign, 0)


@checked
def edge_weights(edges: VolumeEdges, signs: Int[Array, "faces"]) -> Int[Array, "edges"]:
    """Quads to draw for every edge: the sum over its faces, each turned to the light, of how it runs along the edge.

    0 inside a sheet that faces the light, so such edges drop out; ±1 at a silhouette where only faces that see the
    light cast, ±2 where both sides do, ±1 at an open edge, and whatever the faces add up to on an edge of many.

    Source: stencil, section 6, extended to edges of any number of faces, wound in any way.
    """
    total = jnp.zeros(edges.ends.shape[0], jnp.int32)
    return total.at[edges.side_edges.reshape(-1)].add((edges.side_signs * signs[:, None]).reshape(-1))


@checked
def shadow_quads(mesh: Mesh, light: Light, edges: VolumeEdges) -> Float[Array, "edges 4 4"]:
    """The shadow quad of every edge: its ends, then the same two thrown to infinity by the light (w = 0).

    For a directional light the last two are one point, and the quad is a triangle with a corner at infinity.

    Args:
        mesh: The caster.
        light: Of any kind.
        edges: From `volume_edges`; `edge_weights` tells which quads bound the shadow.

    Returns:
        Homogeneous corners (x, y, z, w): first end, second end, second end and first end at infinity.
    """
    # Near ends with w = 1, then where the light throws them, w = 0, in reverse order round the quad.
    corners = mesh.vertices[edges.ends]
    away = at_infinity(corners, light.homogeneous)
    near = jnp.concatenate([corners, jnp.ones_like(corners[..., :1])], axis=-1)
    far = jnp.concatenate([away, jnp.zeros_like(away[..., :1])], axis=-1)
    return jnp.concatenate([near, far[:, ::-1]], axis=1)
