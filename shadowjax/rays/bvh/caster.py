"""The caster for arbitrary rays: a bounding volume hierarchy, grouped on the host, fitted and walked under jit."""

import weakref
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from shadowjax._checked import Checked
from shadowjax._checks import concrete, require, require_memory
from shadowjax._numerics import one_by_one
from shadowjax._types import Array, Bool, Float, Int
from shadowjax.geometry.mesh import Mesh
from shadowjax.rays.bvh._build import NUM_OCTANTS, Topology, build_topology
from shadowjax.rays.bvh._search import Fitted, Links, fit, search
from shadowjax.rays.caster import Caster, search_in_chunks
from shadowjax.rays.ray import Hit, Rays, intersect

# Estimate of the peak memory of `build` for each triangle in 32 bits: its arrays added up, rounded upwards.
BYTES_TO_BUILD = 400


class Tree(Checked):
    """A grouping of triangles, and boxes that fit one mesh.

    Attributes:
        links: How triangles are grouped: no coordinates.
        vertices: Vertices that the boxes fit.
        faces: Triangles that the boxes fit.
        fitted: Corners and boxes.
    """

    links: Links
    vertices: Float[Array, "vertices 3"]
    faces: Int[Array, "faces 3"]
    fitted: Fitted


class BvhCaster(Caster):
    """Walks a tree of boxes: work per ray grows with the logarithm of the number of triangles.

    For rays without order: secondary rays, area lights, the octahedral map of a point light. `build` groups the
    triangles once, on the host. Moved vertices keep the grouping: boxes are compared with the mesh that is cast and
    fitted anew where it differs, so an answer is never stale; `refit` does it once for many casts. Without a tree, one
    is built for each new mesh and remembered while its arrays live; for a mesh that is being traced, it is built in
    every call.

    Memory beyond inputs and outputs: about 120 bytes for each triangle in 32 bits, and 72 for each ray of a chunk.
    XLA on a processor compiles the walk to plain loops over single rays. A graphics card needs another caster.

    Attributes:
        tree: The tree, or None to build one where it is needed.
        ray_chunk: Rays worked on together.
    """

    tree: Tree | None = None
    ray_chunk: int = eqx.field(static=True, default=65536)

    @classmethod
    def build(cls, mesh: Mesh, ray_chunk: int = 65536) -> "BvhCaster":
        """A caster with a tree over the triangles of a mesh; about 4 s for a million.

        Args:
            mesh: Any triangles: without area, repeated or crossing each other.
            ray_chunk: Rays worked on together.

        Raises:
            ValueError: If the mesh is being traced, for a tree is built on the host; or if it cannot fit the memory.
        """
        known = concrete(mesh.vertices) is not None and concrete(mesh.faces) is not None
        require(known, "a tree is built outside jit, grad and vmap; build it before, and call refit(mesh) inside")
        size = BYTES_TO_BUILD * mesh.vertices.dtype.itemsize // 4 * mesh.num_faces
        require_memory(size, f"a tree over {mesh.num_faces} triangles", "fewer triangles, or a GridCaster")
        triangles = np.asarray(mesh.vertices)[np.asarray(mesh.faces)]
        topology = build_topology(triangles.min(axis=1), triangles.max(axis=1))
        return cls(_fit_tree(_as_links(topology), mesh), ray_chunk)

    def refit(self, mesh: Mesh) -> "BvhCaster":
        """The same tree around other positions of its vertices; works under jit, and costs a pass over the triangles.

        Where triangles move far past each other, answers stay right but boxes overlap and rays visit more of them:
        build a new tree then.

        Args:
            mesh: A mesh with as many triangles as the tree.

        Raises:
            ValueError: If there is no tree yet, or the number of triangles differs.
        """
        if self.tree is None:
            raise ValueError("there is no tree to refit; make one with BvhCaster.build(mesh)")
        return BvhCaster(_fit_tree(_checked(self.tree, mesh).links, lax.stop_gradient(mesh)), self.ray_chunk)

    def prepared(self, mesh: Mesh) -> "BvhCaster":
        """With a tree, built on the host in every call where the mesh is traced; no gradient passes through it."""
        if self.tree is not None:
            return self.refit(mesh)
        return BvhCaster(lax.stop_gradient(_remembered_tree(lax.stop_gradient(mesh))), self.ray_chunk)

    def closest(self, mesh: Mesh, rays: Rays) -> Hit:
        """First hit of each ray; ties go to the lowest triangle index.

        Raises:
            ValueError: If the tree holds another number of triangles than the mesh.
        """
        return intersect(mesh, rays, self._faces(mesh, rays, False))

    def blocked(self, mesh: Mesh, rays: Rays) -> Bool[Array, "*points"]:
        """Whether a triangle lies on each ray, farther from both ends than its own rounding.

        A ray stops at the first triangle that it meets, wherever that lies on the way.
        """
        return self._faces(mesh, rays, True) >= 0

    def _faces(self, mesh: Mesh, rays: Rays, any_hit: bool) -> Int[Array, "*points"]:
        mesh = lax.stop_gradient(mesh)
        tree = _remembered_tree(mesh) if self.tree is None else _checked(self.tree, mesh)
        return _search(lax.stop_gradient(tree), mesh, lax.stop_gradient(rays), any_hit, self.ray_chunk)


def _checked(tree: Tree, mesh: Mesh) -> Tree:
    """The tree, if it can serve the mesh."""
    own = tree.faces.shape[0]
    require(
        own == mesh.num_faces,
        f"the tree holds {own} triangles, the mesh {mesh.num_faces}; make a tree for it with BvhCaster.build(mesh)",
    )
    return tree


@eqx.filter_jit
def _fit_tree(links: Links, mesh: Mesh) -> Tree:
    return Tree(links, mesh.vertices, mesh.faces, fit(links, mesh))


@eqx.filter_jit
def _search(tree: Tree, mesh: Mesh, rays: Rays, any_hit: bool, ray_chunk: int) -> Int[Array, "*points"]:
    """Triangles hit; under `vmap` one batch after the other, as the loops need."""

    @one_by_one
    def one(tree: Tree, mesh: Mesh, rays: Rays) -> Int[Array, "*points"]:
        fitted = _current(tree, mesh)
        return search_in_chunks(lambda chunk: search(tree.links, fitted, chunk, any_hit), rays, ray_chunk)

    return one(tree, mesh, rays)


def _current(tree: Tree, mesh: Mesh) -> Fitted:
    """Boxes for the mesh: the tree's own if it is the same one, by value."""
    if mesh.vertices.shape != tree.vertices.shape or mesh.vertices.dtype != tree.vertices.dtype:
        return fit(tree.links, mesh)
    same = jnp.all(mesh.vertices == tree.vertices) & jnp.all(mesh.faces == tree.faces)
    return lax.cond(same, lambda: tree.fitted, lambda: fit(tree.links, mesh))


def _as_links(topology: Topology) -> Links:
    return Links(*(jnp.asarray(array) for array in topology))


class _Remembered(NamedTuple):
    """A tree, and the arrays that it was built from: weakly held, so that their owner alone decides how long it lives.

    Attributes:
        vertices: The mesh's vertices.
        faces: Its faces.
        tree: With copies of both.
    """

    vertices: weakref.ref
    faces: weakref.ref
    tree: Tree


# Trees of meshes met without one, by the identity of their arrays. An entry goes with the first of the two that dies:
# from then on the number may be that of another array.
_TREES: dict[tuple[int, int], _Remembered] = {}


def _remembered_tree(mesh: Mesh) -> Tree:
    """A tree for a mesh, built at its first use; for a traced mesh, built by a call back to the host each time."""
    if concrete(mesh.vertices) is None or concrete(mesh.faces) is None:
        return _fit_tree(_links_by_callback(mesh), mesh)
    key = (id(mesh.vertices), id(mesh.faces))
    known = _TREES.get(key)
    if known is not None and known.vertices() is mesh.vertices and known.faces() is mesh.faces:
        return known.tree
    tree = BvhCaster.build(mesh).tree
    assert tree is not None
    # Not the mesh's own arrays, or they would live as long as the tree.
    tree = eqx.tree_at(lambda t: (t.vertices, t.faces), tree, (jnp.copy(tree.vertices), jnp.copy(tree.faces)))
    vertices, faces = (weakref.ref(part, lambda _: _TREES.pop(key, None)) for part in (mesh.vertices, mesh.faces))
    _TREES[key] = _Remembered(vertices, faces, tree)
    return tree


def _links_by_callback(mesh: Mesh) -> Links:
    """Group triangles on the host while tracing: arrays of the largest size that a tree can have."""
    num_faces = mesh.num_faces
    num_nodes, num_inner = 2 * num_faces - 1, num_faces - 1
    sizes = ((num_faces,), (num_nodes + 1,), (NUM_OCTANTS, num_nodes, 2), (num_inner,), (num_inner,))
    shapes = tuple(jax.ShapeDtypeStruct(size, jnp.int32) for size in sizes)

    def build(lower: Any, upper: Any) -> tuple[np.ndarray, ...]:
        tree = build_topology(np.asarray(lower), np.asarray(upper))
        spare_nodes, spare_inner = num_nodes + 1 - len(tree.first), num_inner - len(tree.inner)
        # Nodes beyond the tree are never reached; joining a node again, the root or one of those, changes nothing.
        again = (tree.inner[-1], tree.second[-1]) if len(tree.inner) else (num_nodes - 1, num_nodes - 1)
        links = np.where(tree.links == tree.links.shape[1], num_nodes, tree.links)
        return (
            tree.order,
            np.pad(tree.first, (0, spare_nodes), constant_values=num_faces),
            np.pad(links, ((0, 0), (0, spare_nodes), (0, 0)), constant_values=num_nodes).astype(np.int32),
            np.pad(tree.inner, (0, spare_inner), constant_values=again[0]),
            np.pad(tree.second, (0, spare_inner), constant_values=again[1]),
        )

    corners = mesh.triangles()
    topology = jax.pure_callback(
        build, shapes, jnp.min(corners, axis=1), jnp.max(corners, axis=1), vmap_method="sequential"
    )
    return Links(*topology)
