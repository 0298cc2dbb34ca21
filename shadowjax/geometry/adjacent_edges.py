"""Sides that polygons share, by the source's walk over its lists; and how many shadow sides each edge needs."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np

from shadowjax._checked import Checked, checked
from shadowjax._checks import require, require_choice
from shadowjax._numerics import dot
from shadowjax._types import Array, Int
from shadowjax.geometry.edges import welded
from shadowjax.geometry.light import Light
from shadowjax.geometry.mesh import Mesh

CASTS = ("facing", "all")


@checked
@dataclass(frozen=True)
class AdjacentEdges:
    """The lists of a group of polygons, in the order in which their entries were made.

    Args:
        sides: (entries, 2) vertices of each entry's side, as its polygon walks it.
        polygons: (entries,) the polygon that made the entry.
        partners: (entries,) the polygon that walks the side the other way and so hides it; -1 where it is visible.
    """

    sides: np.ndarray
    polygons: np.ndarray
    partners: np.ndarray

    @property
    def external(self) -> np.ndarray:
        """(edges, 2) visible entries: the boundary of the group, with its sense."""
        return self.sides[self.partners < 0]

    @property
    def internal(self) -> np.ndarray:
        """(edges, 2) entries marked invisible: sides that two polygons share."""
        return self.sides[self.partners >= 0]

    def lists(self) -> dict[int, list[tuple[int, bool]]]:
        """The table of the source's figure 4: vertex → its entries, each with whether it is visible."""
        table: dict[int, list[tuple[int, bool]]] = {}
        for (i, j), partner in zip(self.sides.tolist(), self.partners.tolist(), strict=True):
            table.setdefault(i, []).append((j, partner < 0))
        return table


@checked
def find_adjacent_edges(polygons: Iterable[Sequence[int] | np.ndarray]) -> AdjacentEdges:
    """Find the sides that two polygons walk in opposite senses; host-side, in time linear in the sides.

    For the polygons that face a light, shadow sides are needed along the external edges only; caps of single polygons
    need the internal ones too, so these are marked, not deleted. An entry that is marked matches no further side: on
    edges with more than two polygons a list may hold one vertex several times, and each entry hides one side. So the
    visible entries of an edge are always the surplus of one sense over the other, in whatever order the polygons come.

    Polygons of unlike orientation walk a shared edge in one sense and both their sides stay visible. A side from a
    vertex to itself has no length and makes no entry.

    Args:
        polygons: Vertex indices of each, all walked in one sense as seen from the light.

    Returns:
        The entries. A hash table takes the place of the source's lists.

    Raises:
        ValueError: If a polygon has fewer than three corners.

    Source: stencil, section 6 and figure 3.
    """
    visible: dict[tuple[int, int], list[int]] = {}
    sides: list[tuple[int, int]] = []
    owners: list[int] = []
    partners: list[int] = []
    for number, polygon in enumerate(polygons):
        corners = [int(corner) for corner in polygon]
        require(len(corners) >= 3, f"a polygon has three corners or more; polygon {number} has {len(corners)}")
        for i, j in zip(corners, [*corners[1:], corners[0]], strict=True):
            if i == j:
                continue
            # A side that another polygon walks the other way hides that polygon's entry, and makes none of its own.
            opposite = visible.get((j, i))
            if opposite:
                partners[opposite.pop(0)] = number
                continue
            visible.setdefault((i, j), []).append(len(sides))
            sides.append((i, j))
            owners.append(number)
            partners.append(-1)
    return AdjacentEdges(np.array(sides, int).reshape(-1, 2), np.array(owners, int), np.array(partners, int))


class EdgeSides(Checked):
    """Every edge of a mesh once, and the sides of faces that run along it, however many.

    Attributes:
        vertices: The edge's ends.
        edge: Edge of side 3·face + i, which runs from corner i to the next.
        sense: 1 where a side runs from the edge's first end to its second, -1 where back, 0 where it has no length.
    """

    vertices: Int[Array, "edges 2"]
    edge: Int[Array, "sides"]
    sense: Int[Array, "sides"]

    @property
    def is_watertight(self) -> bool:
        """Whether as many sides run along every edge one way as the other: what a shadow volume needs of a body.

        Any number of faces may meet at an edge, but orientation counts.
        """
        return not bool(jnp.any(jnp.zeros(len(self.vertices), jnp.int32).at[self.edge].add(self.sense)))


@checked
def edge_sides(mesh: Mesh, weld: bool = True) -> EdgeSides:
    """Find the sides along every edge; host-side.

    Args:
        mesh: A mesh with concrete vertices.
        weld: Whether vertices at equal positions are one.
    """
    original = np.asarray(mesh.faces)
    faces = welded(mesh) if weld else original
    ends = np.stack([faces, np.roll(faces, -1, axis=1)], axis=-1).reshape(-1, 2)
    sense = np.sign(ends[:, 1] - ends[:, 0])
    _, first, edge = np.unique(np.sort(ends, axis=1), axis=0, return_index=True, return_inverse=True)
    # Ends by the mesh's own indices, from the first side of each edge, turned so that its sense is positive.
    corners = np.stack([original, np.roll(original, -1, axis=1)], axis=-1).reshape(-1, 2)[first]
    corners = np.where(sense[first][:, None] < 0, corners[:, ::-1], corners)
    return EdgeSides(
        jnp.asarray(corners, jnp.int32), jnp.asarray(edge.reshape(-1), jnp.int32), jnp.asarray(sense, jnp.int32)
    )


@checked
def silhouette_counts(mesh: Mesh, sides: EdgeSides, light: Light, casts: str = "facing") -> Int[Array, "edges"]:
    """How many shadow sides each edge needs, and in which sense: the boundary of what casts, under `jit` too.

    Where it is not 0 the edge belongs to the silhouette. It equals the visible entries of `find_adjacent_edges` for the
    casting faces, the first end's sense counted positive, and is right for any number of faces at an edge.

    Args:
        mesh: The mesh, moved or not since the edges were found.
        sides: From `edge_sides`.
        light: Seen from its position, or along its direction.
        casts: "facing": faces that look to the light cast, as in the source. That suits watertight bodies; in others,
            a face of the wrong orientation is missed. "all": every face casts, turned to the light if it looks away.
            Orientation then does not matter and neither do holes, but a body is counted twice, front and back.

    Returns:
        Whole numbers without gradient. A light in a face's plane leaves that face out.

    Raises:
        ValueError: If `casts` is unknown.
    """
    require_choice(casts, "casts", CASTS)
    to_light, _ = light.to_light(mesh.triangles()[:, 0])
    height = dot(mesh.area_vectors(), to_light)
    # A face that casts adds its sides with their sense: between two casting faces they cancel, what is left bounds
    # them.
    weight = (height > 0).astype(jnp.int32)
    if casts == "all":
        weight = weight - (height < 0).astype(jnp.int32)
    return jnp.zeros(len(sides.vertices), jnp.int32).at[sides.edge].add(sides.sense * jnp.repeat(weight, 3))


__all__ = ["CASTS", "AdjacentEdges", "EdgeSides", "edge_sides", "find_adjacent_edges", "silhouette_counts"]
