"""Triangle meshes: the Mesh pytree, its checked constructor, normals, areas and bounds."""

from collections.abc import Sequence
from typing import Annotated, Any, ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from shadowjax._checked import Checked, checked
from shadowjax._checks import READ_INSIDE, concrete, require, require_finite, require_value
from shadowjax._numerics import norm, normalize, safe_divide
from shadowjax._types import Array, ArrayLike, DType, Float, Int, Scalar, Vector3, as_float_array
from shadowjax.geometry.origin import Origin, as_origin, to_local
from shadowjax.geometry.transforms import Matrix4, transform_points

DEFAULT_ALBEDO = 0.75


class Mesh(Checked):
    """A triangle soup with shared vertices.

    Attributes:
        vertices: Positions, world units.
        faces: Vertex indices of each triangle, counter-clockwise seen from outside.
        face_colors: Linear albedo of each triangle, each channel in [0, 1].
        origin: Where the zero of `vertices` lies in the world, in float64 and static: a position in the world is
            `origin` plus the local one. Cameras, lights and points are local too; `to_local` brings world positions
            there before they are rounded. Zero but for files that lie far from it.
    """

    _remedy_: ClassVar = "Mesh.create(vertices, faces) makes one"

    vertices: Float[Array, "vertices 3"]
    faces: Int[Array, "faces 3"]
    face_colors: Float[Array, "faces 3"]
    origin: Origin = eqx.field(static=True, converter=as_origin, default=(0.0, 0.0, 0.0))

    @classmethod
    def create(
        cls,
        vertices: Annotated[ArrayLike, READ_INSIDE],
        faces: ArrayLike,
        face_colors: Annotated[ArrayLike | None, READ_INSIDE] = None,
        dtype: DType | None = None,
        origin: Any = (0.0, 0.0, 0.0),
    ) -> "Mesh":
        """Check what a user gives and make a mesh of it.

        Args:
            vertices: (V, 3) finite positions, world units.
            faces: (F, 3) integer indices in [0, V); F ≥ 1.
            face_colors: (F, 3) or (3,) linear albedo in [0, 1]; light grey if None.
            dtype: Floating dtype; that of `vertices`, or JAX's default, if None.
            origin: Where the zero of `vertices` lies in the world, three numbers that keep 64 bits.

        Raises:
            ValueError: If a shape is wrong, an index is out of range, or a number is not finite.
        """
        vertices = as_float_array(vertices, dtype)
        require(
            vertices.ndim == 2 and vertices.shape[-1] == 3 and len(vertices) > 0,
            f"vertices must have shape (V, 3) with V ≥ 1; got {vertices.shape}",
        )
        vertices = require_finite(vertices, "vertices")
        indices: Any = np.asarray(faces) if concrete(faces) is not None else faces
        require(
            indices.ndim == 2 and indices.shape[-1] == 3 and len(indices) > 0,
            f"faces must have shape (F, 3) with F ≥ 1: a mesh needs triangles, not points; got {indices.shape}",
        )
        if isinstance(indices, np.ndarray):
            require(np.issubdtype(indices.dtype, np.integer), f"faces must hold integers; got {indices.dtype}")
            low, high = int(indices.min()), int(indices.max())
            require(
                low >= 0 and high < len(vertices),
                f"face indices must lie in [0, {len(vertices)}), the number of vertices; got {low} … {high}",
            )
        num_faces = indices.shape[0]
        colors = as_float_array(DEFAULT_ALBEDO if face_colors is None else face_colors, vertices.dtype)
        require(
            colors.shape in ((), (3,), (num_faces, 3)),
            f"face_colors must have shape ({num_faces}, 3), or (3,) for all faces; got {colors.shape}",
        )
        known, name = concrete(colors), "face_colors"
        if known is None:
            colors = require_finite(colors, name)
        # By NumPy: operations of JAX on their own would take longer than all the rest.
        elif not (known.min() >= 0 and known.max() <= 1 + 4 * jnp.finfo(colors.dtype).eps):
            message = f"{name}, linear albedo, must lie in [0, 1] (not 0 … 255)"
            require_value(require_finite(colors, name), np.zeros((), bool), message)
        if colors.ndim < 2:
            colors = jnp.broadcast_to(colors, (num_faces, 3))
        indices = jnp.asarray(indices, jnp.int32)
        return cls._trusted(vertices=vertices, faces=indices, face_colors=colors, origin=as_origin(origin))

    @property
    def num_faces(self) -> int:
        """Number of triangles."""
        return self.faces.shape[0]

    @property
    def num_vertices(self) -> int:
        """Number of vertices."""
        return self.vertices.shape[0]

    def bounds(self) -> tuple[Vector3, Vector3]:
        """Lower and upper corner of the axis-aligned bounding box, world units, about `origin`."""
        return jnp.min(self.vertices, axis=0), jnp.max(self.vertices, axis=0)

    @property
    def extent(self) -> Scalar:
        """Diagonal of the bounding box, world units."""
        lower, upper = self.bounds()
        return norm(upper - lower)

    def triangles(self) -> Float[Array, "faces 3 3"]:
        """Corner positions of every triangle: (face, corner, xyz)."""
        return self.vertices[self.faces]

    def area_vectors(self) -> Float[Array, "faces 3"]:
        """Normal of every triangle with its area for a length, world units squared."""
        a, b, c = jnp.moveaxis(self.triangles(), 1, 0)
        return 0.5 * jnp.cross(b - a, c - a)

    def face_normals(self) -> Float[Array, "faces 3"]:
        """Unit normals, right-handed about the corners; the zero vector for a triangle without area."""
        return normalize(self.area_vectors())

    def areas(self) -> Float[Array, "faces"]:
        """Area of every triangle, world units squared."""
        return norm(self.area_vectors())

    def vertex_normals(self) -> Float[Array, "vertices 3"]:
        """Area-weighted mean of the normals of the faces around each vertex, unit length or zero."""
        summed = jnp.zeros_like(self.vertices)
        weighted = self.area_vectors()
        for corner in range(3):
            # Area vectors add with their areas as weights, without a division.
            summed = summed.at[self.faces[:, corner]].add(weighted)
        return normalize(summed)

    def transformed(self, matrix: Matrix4) -> "Mesh":
        """Copy of the mesh moved in the world by an affine 4×4 matrix; a mirroring matrix also turns the faces round.

        An origin that is not zero moves along in float64, so that local positions stay small; under a traced matrix
        it stays, and the local positions take up what it moves by.
        """
        mirrored = jnp.linalg.det(matrix[:3, :3]) < 0
        faces = jnp.where(mirrored, self.faces[:, ::-1], self.faces)
        origin, known = self.origin, concrete(matrix)
        if any(origin) and known is not None:
            # M(p + o) + t = M·p + (M·o + t): local positions turn, the origin takes the rest.
            exact = known.astype(np.float64)
            origin = exact[:3, :3] @ np.asarray(origin) + exact[:3, 3]
            matrix = matrix.at[:3, 3].set(0)
        elif any(origin):
            # With the origin kept: M·p + (M − I)·o + t.
            moved = (matrix[:3, :3] - jnp.eye(3, dtype=matrix.dtype)) @ jnp.asarray(origin, matrix.dtype)
            matrix = matrix.at[:3, 3].add(moved)
        return Mesh(transform_points(matrix, self.vertices), faces, self.face_colors, origin)

    @staticmethod
    def merge(meshes: Sequence["Mesh"]) -> "Mesh":
        """One mesh holding all triangles of `meshes`, in order, about the origin of the first; vertices stay separate.

        A mesh with another origin is shifted by the difference, taken in float64.
        """
        require(len(meshes) > 0, "merge needs at least one mesh; got none")
        origin = meshes[0].origin
        starts = np.cumsum([0, *(mesh.num_vertices for mesh in meshes[:-1])])
        return Mesh(
            jnp.concatenate([mesh.about(origin).vertices for mesh in meshes]),
            jnp.concatenate([mesh.faces + np.int32(start) for mesh, start in zip(meshes, starts, strict=True)]),
            jnp.concatenate([mesh.face_colors for mesh in meshes]),
            origin,
        )

    def about(self, origin: Any) -> "Mesh":
        """The same mesh in the world with its local positions about another origin (three numbers)."""
        origin = as_origin(origin)
        if origin == self.origin:
            return self
        shift = np.asarray(self.origin) - np.asarray(origin)
        known, dtype = concrete(self.vertices), self.vertices.dtype
        if known is None:
            vertices = self.vertices + jnp.asarray(shift, dtype)
        else:
            vertices = jnp.asarray(known.astype(np.float64) + shift, dtype)
        return Mesh(vertices, self.faces, self.face_colors, origin)

    def to_local(self, points: ArrayLike) -> ArrayLike:
        """World positions (..., 3) about this mesh's origin, subtracted in float64."""
        return to_local(points, self.origin)


@checked
def zero_area_faces(mesh: Mesh) -> int:
    """Number of degenerate triangles (≤ 1e-12 of the squared extent); casters pass through them."""
    return int(jnp.sum(safe_divide(mesh.areas(), mesh.extent**2) <= 1e-12))
