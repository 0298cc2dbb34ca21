"""Triangle meshes: the Mesh pytree, its checked constructor, loading through trimesh, normals, areas and bounds."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import trimesh
from trimesh.visual.color import uv_to_color

from shadowjax._checks import concrete, require, require_finite
from shadowjax._numerics import norm, normalize, safe_divide
from shadowjax._types import Array, ArrayLike, Float, Int, Scalar, Vector3, as_float_array
from shadowjax.geometry.transforms import Matrix4, transform_points

DEFAULT_ALBEDO = 0.75


class Mesh(eqx.Module):
    """A triangle soup with shared vertices.

    Attributes:
        vertices: Positions, world units.
        faces: Vertex indices of each triangle, counter-clockwise seen from outside.
        face_colors: Linear albedo of each triangle, each channel in [0, 1].
    """

    vertices: Float[Array, "vertices 3"]
    faces: Int[Array, "faces 3"]
    face_colors: Float[Array, "faces 3"]

    @classmethod
    def create(
        cls, vertices: ArrayLike, faces: ArrayLike, face_colors: ArrayLike | None = None, dtype: Any = None
    ) -> "Mesh":
        """Check what a user gives and make a mesh of it.

        Args:
            vertices: (V, 3) finite positions, world units.
            faces: (F, 3) integer indices in [0, V); F ≥ 1.
            face_colors: (F, 3) or (3,) linear albedo in [0, 1]; light grey if None.
            dtype: Floating dtype; that of `vertices`, or JAX's default, if None.

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
        if colors.ndim < 2:
            colors = jnp.broadcast_to(colors, (num_faces, 3))
        require(colors.shape == (num_faces, 3), f"face_colors must have shape ({num_faces}, 3); got {colors.shape}")
        return cls(vertices, jnp.asarray(indices, jnp.int32), require_finite(colors, "face_colors"))

    @property
    def num_faces(self) -> int:
        """Number of triangles."""
        return self.faces.shape[0]

    @property
    def num_vertices(self) -> int:
        """Number of vertices."""
        return self.vertices.shape[0]

    def bounds(self) -> tuple[Vector3, Vector3]:
        """Lower and upper corner of the axis-aligned bounding box, world units."""
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
            summed = summed.at[self.faces[:, corner]].add(weighted)
        return normalize(summed)

    def transformed(self, matrix: Matrix4) -> "Mesh":
        """Copy of the mesh moved by an affine 4×4 matrix; a mirroring matrix also turns the faces round."""
        mirrored = jnp.linalg.det(matrix[:3, :3]) < 0
        faces = jnp.where(mirrored, self.faces[:, ::-1], self.faces)
        return Mesh(transform_points(matrix, self.vertices), faces, self.face_colors)

    @staticmethod
    def merge(meshes: Sequence["Mesh"]) -> "Mesh":
        """One mesh holding all triangles of `meshes`, in order; vertices stay separate."""
        require(len(meshes) > 0, "merge needs at least one mesh; got none")
        starts = np.cumsum([0, *(mesh.num_vertices for mesh in meshes[:-1])])
        return Mesh(
            jnp.concatenate([mesh.vertices for mesh in meshes]),
            jnp.concatenate([mesh.faces + np.int32(start) for mesh, start in zip(meshes, starts, strict=True)]),
            jnp.concatenate([mesh.face_colors for mesh in meshes]),
        )


def load(path: str | Path, dtype: Any = None) -> Mesh:
    """Read a mesh file of any kind that trimesh reads (OBJ, PLY, STL, GLB, …).

    A scene graph is merged into one mesh with the transforms of its nodes. Colours come from the file where it has
    them (face or vertex colours, or the material's main colour), else a light grey.

    Args:
        path: File to read.
        dtype: Floating dtype of the result; JAX's default if None.

    Returns:
        The mesh, in the file's own units.

    Raises:
        ValueError: If the file is missing, cannot be read as a mesh, or holds no triangles or non-finite numbers.
    """
    path = Path(path)
    require(path.exists(), f"no such mesh file: {path}")
    require(path.is_file(), f"{path} is a folder; give the mesh file inside it")
    known = {f".{kind}" for kind in trimesh.available_formats()}
    require(
        path.suffix.lower() in known,
        f"{path} has an ending that no mesh reader knows ({path.suffix or 'none'}); "
        f"use one of {', '.join(sorted(known))}",
    )
    try:
        loaded = trimesh.load_scene(path, process=False)
        parts = [part for part in loaded.dump() if isinstance(part, trimesh.Trimesh) and len(part.faces)]
    except Exception as error:  # the readers of strangers' files raise everything; each means one thing to the user
        raise ValueError(f"{path} cannot be read as a mesh: {type(error).__name__}: {error}") from error
    require(len(parts) > 0, f"{path} holds no triangles (a point cloud or an empty file); export it as a surface")
    try:
        return Mesh.merge([Mesh.create(part.vertices, part.faces, _albedo(part), dtype) for part in parts])
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error


def _albedo(part: Any) -> np.ndarray | None:
    """Linear face colours of one part of a file, or None where the file has none."""
    visual = part.visual
    if visual is None or not getattr(visual, "defined", False):
        return None
    srgb = _texture_colors(part, visual) if visual.kind == "texture" else np.asarray(visual.face_colors)[:, :3] / 255.0
    return None if srgb is None else np.broadcast_to(srgb**2.2, (len(part.faces), 3))


def _texture_colors(part: Any, visual: Any) -> np.ndarray | None:
    """sRGB colour of each face: the texture at its middle if there is one, else the material's main colour."""
    material, uv = visual.material, visual.uv
    image = getattr(material, "baseColorTexture", None) or getattr(material, "image", None)
    if image is not None and uv is not None and len(uv) == len(part.vertices):
        centres = np.asarray(uv)[part.faces].mean(axis=1)
        return uv_to_color(centres, image)[:, :3] / 255.0
    main = getattr(material, "main_color", None)
    return None if main is None else np.asarray(main)[:3] / 255.0


def zero_area_faces(mesh: Mesh) -> int:
    """How many triangles have no area worth the name (≤ 1e-12 of the squared extent); casters pass through them."""
    return int(jnp.sum(safe_divide(mesh.areas(), mesh.extent**2) <= 1e-12))
