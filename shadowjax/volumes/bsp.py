"""BSP trees of polygons: built once, then a back-to-front order for any eye and a visible set for any light."""

import math
from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from shadowjax._checked import Checked, checked
from shadowjax._checks import require, require_int
from shadowjax._types import Array, Bool, DType, Float, Int, Vector3, default_dtype
from shadowjax.geometry.edges import welded
from shadowjax.geometry.light import Light
from shadowjax.geometry.mesh import Mesh
from shadowjax.volumes._building import Grown, grow
from shadowjax.volumes._cutting import Cutter

# What counts as on a plane, as a share of the scene's size: some roundings of the vertices' own dtype.
TOLERANCES = {4: 2e-6, 8: 1e-9}


class BspTree(Checked):
    """Polygons, cut where they had to be, in the order that planes give them.

    The tree is topology: it is built on the host, has no gradient and holds while nothing but the eye or the light
    moves. Orders and visible sets are array operations and work under `jit`.

    Pieces of one plane lie in one node. Where such pieces overlap no order is right, and the input's is kept: in a
    picture painted back to front the later polygon wins.

    Attributes:
        vertices: Corners: the input's vertices first, then those that cuts made.
        corners: Corners of every piece, in the sense of its polygon; the first is repeated behind the last.
        num_corners: How many corners each piece has.
        source: Input polygon that each piece comes from.
        node: Node that holds each piece.
        planes: n and d of every node's plane; n·x + d > 0 in front of it. Parents come before children.
        turned: Whether a piece looks against its node's plane.
        parent: Node above; -1 for the root.
        in_front: Whether a node lies in front of its parent's plane.
        ahead: Pieces in front of each node's plane, below it in the tree.
        behind: Pieces behind it.
        num_own: Pieces in its plane.
        place: Place of each piece among those of its node, in the order of the input.
        dropped: Input polygons without area, which the tree does not hold.
        num_splits: How many times a polygon was cut.
        height: Nodes on the longest way down.
    """

    vertices: Float[Array, "vertices 3"]
    corners: Int[Array, "pieces corners"]
    num_corners: Int[Array, "pieces"]
    source: Int[Array, "pieces"]
    node: Int[Array, "pieces"]
    planes: Float[Array, "nodes 4"]
    turned: Bool[Array, "pieces"]
    parent: Int[Array, "nodes"]
    in_front: Bool[Array, "nodes"]
    ahead: Int[Array, "nodes"]
    behind: Int[Array, "nodes"]
    num_own: Int[Array, "nodes"]
    place: Int[Array, "pieces"]
    dropped: tuple[int, ...] = eqx.field(static=True)
    num_splits: int = eqx.field(static=True)
    height: int = eqx.field(static=True)

    @property
    def num_pieces(self) -> int:
        """Polygons after cutting."""
        return self.corners.shape[0]

    @property
    def num_nodes(self) -> int:
        """Planes in the tree."""
        return self.planes.shape[0]

    def front_to_back(self, eye: Vector3) -> Int[Array, "pieces"]:
        """Pieces in an order in which none hides an earlier one from the eye.

        At each node come first the pieces on the eye's side of the plane, then those in it, then those beyond. All
        nodes do so at once: where a node's pieces begin is a sum over the nodes above it, taken by doubling.

        Args:
            eye: World position.

        Source: stencil, section 3.1.
        """
        before = self.planes[:, :3] @ eye + self.planes[:, 3] > 0
        above = jnp.maximum(self.parent, 0)
        near = jnp.where(before, self.ahead, self.behind)
        # What the parent puts before a node's first piece; then the sum along the way down.
        skipped = jnp.where(self.in_front == before[above], 0, near[above] + self.num_own[above])
        # Pointer doubling: after step j, `start` sums 2ʲ ancestors and `jump` points 2ʲ up; the root adds 0.
        start, jump = jnp.where(self.parent >= 0, skipped, 0), above
        for _ in range(math.ceil(math.log2(max(self.height, 2)))):
            start, jump = start + start[jump], jump[jump]
        # Of the pieces of a node the later comes first, as it is painted last.
        rank = (start + near + self.num_own - 1)[self.node] - self.place
        return jnp.zeros_like(rank).at[rank].set(jnp.arange(self.num_pieces, dtype=rank.dtype))

    def back_to_front(self, eye: Vector3) -> Int[Array, "pieces"]:
        """Pieces in the order in which a painter can paint them: the reverse of `front_to_back`.

        Args:
            eye: World position.

        Source: stencil, section 3.1.
        """
        return self.front_to_back(eye)[::-1]

    def facing(self, light: Light) -> Bool[Array, "pieces"]:
        """The visible set: pieces that look to a light, by the sides of the nodes' planes.

        These cast its shadow. It is what walking the tree and leaving out the hidden sides gives: of closed bodies it
        holds all that the light sees, and what is hidden behind other polygons too.

        Args:
            light: Any light. A polygon in whose plane it stands looks away.

        Source: stencil, sections 3.1 and 5.
        """
        height = (self.planes @ light.homogeneous)[self.node]
        return jnp.where(self.turned, -height, height) > 0

    def sources_facing(self, light: Light, num_polygons: int) -> Bool[Array, "polygons"]:
        """The visible set as a mask over the input's polygons.

        Args:
            light: Any light.
            num_polygons: How many polygons the input had.
        """
        return jnp.zeros(num_polygons, bool).at[self.source].max(self.facing(light))


@checked
def build_bsp(
    vertices: Any,
    polygons: Sequence[Sequence[int]] | np.ndarray,
    balance: float = 0.0,
    candidates: int = 16,
    repair: bool = True,
    seed: int = 0,
) -> BspTree:
    """Build the tree of convex polygons, on the host.

    Each node takes the plane of one of its polygons: of some tried ones, that with the least
    (1 - balance)·splits + balance·|polygons in front - polygons behind|.

    Args:
        vertices: (V, 3) finite positions, world units; the tree takes the dtype of a JAX array.
        polygons: Vertex indices of flat convex polygons, three or more each.
        balance: 0 avoids cuts, as the source does for its tables; 1 wants equal halves; in [0, 1].
        candidates: Planes tried for each node, ≥ 1. More cost time and save cuts.
        repair: Whether pieces take up the corners that cuts of their neighbours put on their sides, so that no
            T-junction is left and edges can be matched by their vertices.
        seed: Of the choice among planes.

    Returns:
        The tree. Polygons without area are left out and listed as `dropped`.

    Raises:
        ValueError: If an index is out of range, a number is not finite, a polygon is not flat or not convex, none has
            an area, or a parameter is out of its range.

    Source: stencil, section 3.1.
    """
    dtype: Any = vertices.dtype if isinstance(vertices, jax.Array) else default_dtype()
    points = np.asarray(vertices, np.float64)
    require(points.ndim == 2 and points.shape[1:] == (3,), f"vertices must have shape (V, 3); got {points.shape}")
    require(bool(np.isfinite(points).all()), "vertices must be finite; some are NaN or infinite")
    require(0.0 <= balance <= 1.0, f"balance must lie in [0, 1], from fewest cuts to equal halves; got {balance}")
    require_int(candidates, "candidates", 1)
    rings = [[int(corner) for corner in polygon] for polygon in polygons]
    require(len(rings) > 0, "a BSP tree needs at least one polygon; got none")
    size = float(np.linalg.norm(np.ptp(points, axis=0)))
    tolerance = TOLERANCES[4 if jnp.dtype(dtype).itemsize <= 4 else 8] * size
    planes, kept = _planes(points, rings, tolerance)
    require(len(kept) > 0, f"none of the {len(rings)} polygons has an area, so there is no plane to part by")
    cutter = Cutter(list(points), tolerance, planes)
    grown = grow(cutter, [cutter.ring(rings[i]) for i in kept], kept, balance, candidates, seed)
    if repair:
        grown.rings = [cutter.repaired(ring) for ring in grown.rings]
    dropped = tuple(sorted(set(range(len(rings))) - set(kept.tolist())))
    return _packed(grown, cutter, dropped, dtype)


@checked
def bsp_of_mesh(mesh: Mesh, balance: float = 0.0, candidates: int = 16, repair: bool = True, seed: int = 0) -> BspTree:
    """The tree of a mesh's triangles; vertices at equal positions are one. Arguments as in `build_bsp`.

    Args:
        mesh: A mesh with concrete vertices.
        balance: 0 avoids cuts, 1 wants equal halves.
        candidates: Planes tried for each node, ≥ 1.
        repair: Whether T-junctions are repaired.
        seed: Of the choice among planes.
    """
    places, faces = np.unique(np.asarray(mesh.vertices), axis=0), welded(mesh)
    return build_bsp(jnp.asarray(places), faces, balance, candidates, repair, seed)


def _planes(points: np.ndarray, rings: list[list[int]], tolerance: float) -> tuple[np.ndarray, np.ndarray]:
    """Planes of all polygons, and those that have an area; complains about what is not a flat convex polygon."""
    count = np.array([len(ring) for ring in rings])
    require(bool((count >= 3).all()), f"a polygon has three corners or more; polygon {int(count.argmin())} has "
            f"{int(count.min())}")  # fmt: skip
    width = int(count.max())
    corners = np.array([ring + ring[:1] * (width - len(ring)) for ring in rings])
    low, high = int(corners.min()), int(corners.max())
    require(
        low >= 0 and high < len(points), f"corners must lie in [0, {len(points)}), the vertices; got {low} … {high}"
    )
    where = points[corners]
    relative = where - where[:, :1]
    # Area vectors of the fan around corner 0; their sum is the polygon's, also for corners that repeat.
    turns = np.cross(relative, np.roll(relative, -1, axis=1))
    normals = turns.sum(axis=1)
    length = np.linalg.norm(normals, axis=1)
    # Thinner than the tolerance along its whole length: every plane through it would do.
    longest = np.sqrt((relative**2).sum(axis=2)).max(axis=1)
    flat = length > tolerance * longest
    unit = np.where(flat[:, None], normals, 0) / np.where(flat, length, 1)[:, None]
    # Of every corner from the plane through corner 0.
    distance = (relative * unit[:, None]).sum(axis=2)
    bent = flat & (np.abs(distance).max(axis=1) > tolerance)
    require(not bent.any(), f"polygons must be flat: corners of polygon {int(bent.argmax())} lie up to "
            f"{np.abs(distance).max():.3g} off its plane; give triangles")  # fmt: skip
    sides = np.roll(where, -1, axis=1) - where
    # Into the polygon, perpendicular to each side within its plane.
    inward = np.cross(unit[:, None], sides)
    side_length = np.linalg.norm(sides, axis=2)
    # Signed distance of every corner from every side, all inside for a convex polygon.
    reach = ((where[:, None] - where[:, :, None]) * inward[:, :, None]).sum(axis=3)
    outside = (reach < -tolerance * np.maximum(side_length, tolerance)[:, :, None]).any(axis=(1, 2)) & flat
    require(not outside.any(), f"polygons must be convex; polygon {int(outside.argmax())} is not: give triangles")
    offset = -(unit * where.mean(axis=1)).sum(axis=1)
    return np.concatenate([unit, offset[:, None]], axis=1), np.flatnonzero(flat)


def _packed(grown: Grown, cutter: Cutter, dropped: tuple[int, ...], dtype: DType) -> BspTree:
    """The arrays of a grown tree, pieces sorted by node and, within a node, as the input was."""
    node, source = np.array(grown.nodes), np.array(grown.sources)
    order = np.lexsort((source, node))
    rings = [grown.rings[i][0] for i in order]
    count = np.array([len(ring) for ring in rings])
    width = int(count.max())
    node, source = node[order], source[order]
    parent = np.array(grown.parents)
    in_front = np.array(grown.in_front)
    own = np.bincount(node, minlength=len(parent))
    below = np.zeros((2, len(parent)), int)  # behind, ahead
    depth = np.ones(len(parent), int)
    # Parents come before children: one backward pass sums subtrees, one forward pass counts depths.
    for child in range(len(parent) - 1, 0, -1):
        below[int(in_front[child]), parent[child]] += own[child] + below[:, child].sum()
    for child in range(1, len(parent)):
        depth[child] = depth[parent[child]] + 1
    planes = cutter.planes[np.array(grown.planes)]
    turned = (cutter.planes[source, :3] * planes[node, :3]).sum(axis=1) < 0
    return BspTree(
        vertices=jnp.asarray(np.stack(cutter.points), dtype),
        corners=jnp.asarray([ring + ring[:1] * (width - len(ring)) for ring in rings], jnp.int32),
        num_corners=jnp.asarray(count, jnp.int32),
        source=jnp.asarray(source, jnp.int32),
        node=jnp.asarray(node, jnp.int32),
        planes=jnp.asarray(planes, dtype),
        turned=jnp.asarray(turned),
        parent=jnp.asarray(parent, jnp.int32),
        in_front=jnp.asarray(in_front),
        ahead=jnp.asarray(below[1], jnp.int32),
        behind=jnp.asarray(below[0], jnp.int32),
        num_own=jnp.asarray(own, jnp.int32),
        place=jnp.asarray(np.arange(len(node)) - np.searchsorted(node, node), jnp.int32),
        dropped=dropped,
        num_splits=grown.num_splits,
        height=int(depth.max()),
    )


__all__ = ["BspTree", "bsp_of_mesh", "build_bsp"]
