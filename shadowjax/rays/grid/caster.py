"""The fast caster for coherent rays: each triangle is drawn into the cells whose rays can meet it."""

import math
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.custom_derivatives import SymbolicZero

from shadowjax._checked import checked
from shadowjax._numerics import one_by_one
from shadowjax._types import Array, Bool, Float, Int, Points
from shadowjax.geometry.light_space import LightSpace
from shadowjax.geometry.mesh import Mesh
from shadowjax.rays.brute import BruteForceCaster
from shadowjax.rays.bvh.caster import BvhCaster
from shadowjax.rays.caster import Caster, checked_start
from shadowjax.rays.grid._pairs import search_pairs
from shadowjax.rays.grid._plane import depth_tangent
from shadowjax.rays.grid._project import depth_of_key, key_of_depth, place, view
from shadowjax.rays.grid._tiles import search_tiles
from shadowjax.rays.grid._visible import lit
from shadowjax.rays.ray import MISS, Hit, Rays, faces_in_order, intersect
from shadowjax.rays.ray_grid import RayGrid

# What a tree that is built in every call costs, counted in pairs of ray and triangle that brute force tests: once, for
# each triangle, and for each ray. Measured by `python -m tests.benchmarks.thresholds`.
TREE_PAIRS, TREE_PAIRS_A_FACE, TREE_PAIRS_A_RAY = 300_000, 300, 32


class GridCaster(Caster):
    """Draws triangles into the grid of rays, as a rasteriser does, with the exact edge rule of every caster.

    Time grows with triangles plus the cells that their boxes cover, not with rays × triangles; nothing is built
    beforehand, so a new view or new vertices cost no more than the same ones again. No capacity can overflow. Rays of
    a space that bends lines (a point light's octahedron), and rays without a grid, go to `others`. Rays through a point
    begin where their distance along the view is 10⁻⁶ of the far limit: what is nearer is not seen.

    Attributes:
        others: The caster for rays that this one cannot draw; None takes what is faster for that many: a tree, which
            a traced mesh needs anew in every call, or brute force.
    """

    others: Caster | None = None

    def closest(self, mesh: Mesh, rays: Rays) -> Hit:
        """First hit of arbitrary rays, by `others`."""
        return self._others(mesh, math.prod(rays.shape)).closest(mesh, rays)

    def blocked(self, mesh: Mesh, rays: Rays) -> Bool[Array, "*points"]:
        """Whether a triangle lies on each of arbitrary rays, by `others`."""
        return self._others(mesh, math.prod(rays.shape)).blocked(mesh, rays)

    def closest_on_grid(self, mesh: Mesh, grid: RayGrid) -> Hit:
        """First hit of every ray of a grid, shape (rows, cols); ties in depth go to the lowest triangle index.

        Args:
            mesh: Triangles, of which any may cross the near limit, lie behind the light, or have no area.
            grid: Rays of one space; its plane map must keep the sides of the unit square straight.
        """
        if not grid.space.is_projective:
            return self._others(mesh, grid.num_rows * grid.num_cols).closest_on_grid(mesh, grid)
        _, face = _search(jax.lax.stop_gradient(mesh), jax.lax.stop_gradient(grid), True)
        return intersect(mesh, grid.rays(), face)

    def closest_beyond_on_grid(self, mesh: Mesh, grid: RayGrid, start_depth: Float[Array, "rows cols"]) -> Hit:
        """First hit of every ray from a depth of its own on; see `Caster`. Depth peeling by a minimum depth per ray; no
        tree is built.

        The depth that is compared with the start is that of `depth_on_grid`.
        """
        if not grid.space.is_projective:
            others = self._others(mesh, grid.num_rows * grid.num_cols)
            return others.closest_beyond_on_grid(mesh, grid, start_depth)
        start = checked_start(grid, start_depth)
        _, face = _search(*jax.lax.stop_gradient((mesh, grid)), True, start)
        return intersect(mesh, grid.rays(), face)

    def depth_on_grid(self, mesh: Mesh, grid: RayGrid) -> Float[Array, "rows cols"]:
        """Depth alone, the fastest answer; its gradient is that of `closest_on_grid`.

        Depth comes from the triangle's plane as it is drawn, and agrees with `closest_on_grid` to a few roundings of
        positions, each divided by the cosine between ray and normal, and, in a thin triangle, multiplied by length over
        width. Take the depth of `closest_on_grid` where rays graze triangles or triangles are needles.
        """
        if not grid.space.is_projective:
            return self._others(mesh, grid.num_rows * grid.num_cols).closest_on_grid(mesh, grid).depth
        return _depth(mesh, grid)

    def faces_on_grid(self, mesh: Mesh, grid: RayGrid) -> tuple[Float[Array, "rows cols"], Int[Array, "rows cols"]]:
        """Depth as in `depth_on_grid`, and the triangle hit (−1 for a miss), without barycentrics."""
        if not grid.space.is_projective:
            hit = self._others(mesh, grid.num_rows * grid.num_cols).closest_on_grid(mesh, grid)
            return hit.depth, hit.face
        return _depth_and_face(mesh, grid)

    def prepared(self, mesh: Mesh) -> "GridCaster":
        """With a caster for other rays that has built its tree, if it needs one."""
        return GridCaster(self._others(mesh, None).prepared(mesh))

    def prefers_images(self, space: LightSpace) -> bool:
        """True for spaces whose points are sorted: many at once, since all triangles are drawn for them."""
        return space.is_projective

    def visible(
        self, mesh: Mesh, space: LightSpace, points: Points, normals: Points | None = None
    ) -> Bool[Array, "*points"]:
        """The exact shadow test; see `Caster.visible`. All rays of a light share its plane, so no ray is traced."""
        if not space.is_projective:
            return self._others(mesh, math.prod(points.shape[:-1])).visible(mesh, space, points, normals)
        return _visible(*jax.lax.stop_gradient((mesh, space, points, normals)))

    def _others(self, mesh: Mesh, num_rays: int | None) -> Caster:
        """The caster for that many other rays; None for many casts of one tree."""
        if self.others is not None:
            return self.others
        return BvhCaster() if tree_is_faster(mesh.num_faces, num_rays) else BruteForceCaster()


@checked
def tree_is_faster(num_faces: int, num_rays: int | None) -> bool:
    """Whether building a tree and walking it takes less time than brute force; for any number of rays if None."""
    if num_rays is None:
        return num_faces > TREE_PAIRS_A_RAY
    return num_rays * (num_faces - TREE_PAIRS_A_RAY) > TREE_PAIRS + TREE_PAIRS_A_FACE * num_faces


def _search(mesh: Mesh, grid: RayGrid, with_face: bool, start: Array | None = None) -> tuple[Array, Array]:
    """Depth, and face if asked for, of every ray; under `vmap` one view after the other, as its loops need.

    Without the depths to start from, nothing in the loops asks for them.
    """

    @one_by_one
    def one(mesh: Mesh, grid: RayGrid, start: Array | None) -> tuple[Array, Array]:
        # Depth alone has no ties, but it must be the depth that comes with the faces.
        mesh = Mesh(mesh.vertices, faces_in_order(mesh), mesh.face_colors)
        table = view(grid)
        floor = None if start is None else key_of_depth(grid, table, start)
        # A loop over triangles is the fastest way on a processor, and hopeless on an accelerator.
        search = search_tiles if jax.default_backend() == "cpu" else search_pairs
        key, face = search(grid, table, mesh, place(grid, table, mesh.vertices), with_face, floor)
        depth = depth_of_key(grid, table, key)
        return depth, jnp.zeros((), jnp.int32) if face is None else jnp.where(key < table.start, face, MISS)

    return one(mesh, grid, start)


@jax.custom_jvp
def _depth(mesh: Mesh, grid: RayGrid) -> Float[Array, "rows cols"]:
    """Depth of every ray; its derivative is that of the one intersection, see `_depth_and_face_jvp`."""
    return _search(mesh, grid, False)[0]


def _depth_jvp(primals: tuple[Mesh, RayGrid], tangents: tuple[Mesh, RayGrid]) -> tuple[Array, Array]:
    (depth, _), (tangent, _) = _depth_and_face_jvp(primals, tangents)
    return depth, tangent


_depth.defjvp(_depth_jvp, symbolic_zeros=True)


@jax.custom_jvp
def _depth_and_face(mesh: Mesh, grid: RayGrid) -> tuple[Array, Array]:
    """Depth of every ray, with the derivative of the one intersection, and its face."""
    return _search(mesh, grid, True)


def _depth_and_face_jvp(
    primals: tuple[Mesh, RayGrid], tangents: tuple[Mesh, RayGrid]
) -> tuple[tuple[Array, Array], tuple[Array, Any]]:
    mesh, grid = primals
    depth, face = _search(*jax.lax.stop_gradient(primals), True)
    change, turning = tangents
    if all(isinstance(leaf, SymbolicZero) for leaf in jax.tree.leaves(turning)):
        # Only vertices move: the planes of the triangles are enough, and several times cheaper to differentiate.
        tangent = depth_tangent(grid, view(grid), mesh, _dense(change.vertices), depth, face)
    else:
        dense = jax.tree.map(_dense, tangents, is_leaf=lambda leaf: isinstance(leaf, SymbolicZero))
        tangent = jax.jvp(lambda mesh, grid: intersect(mesh, grid.rays(), face).depth, primals, dense)[1]
    return (depth, face), (tangent, np.zeros(face.shape, jax.dtypes.float0))


_depth_and_face.defjvp(_depth_and_face_jvp, symbolic_zeros=True)


def _dense(tangent: Any) -> Any:
    """A tangent with the zeros written out that JAX knows by name."""
    if not isinstance(tangent, SymbolicZero):
        return tangent
    kind: Any = tangent.aval
    if kind.dtype == jax.dtypes.float0:
        return np.zeros(kind.shape, jax.dtypes.float0)
    return jnp.zeros(kind.shape, kind.dtype)


@one_by_one
def _visible(mesh: Mesh, space: LightSpace, points: Points, normals: Points | None) -> Bool[Array, "*points"]:
    """Lit points, by the irregular depth buffer: all rays of a light share its plane, so none is traced."""
    return lit(mesh, space, points, normals)
