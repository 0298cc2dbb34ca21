"""The six faces of a cube around a light at a place, each with a map that reaches over its edges."""

import math

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from shadowjax._checked import checked
from shadowjax._checks import require, require_int
from shadowjax._types import Array, DType, Float, Int, Points
from shadowjax.geometry.camera import Camera
from shadowjax.geometry.light import Light
from shadowjax.geometry.light_space import PerspectiveSpace
from shadowjax.geometry.mesh import Mesh
from shadowjax.partitions.base import Partition
from shadowjax.partitions.single import SingleMap
from shadowjax.rays.map_part import starting_outside
from shadowjax.rays.plane_map import Box
from shadowjax.rays.ray_grid import RayGrid
from shadowjax.warps.receivers import with_seen_depth
from shadowjax.warps.uniform import UniformWarp

CUBE_FACES = ("+x", "-x", "+y", "-y", "+z", "-z")


class CubeMap(Partition):
    """Six square maps that together see every direction from a light.

    A point belongs to the face that its direction from the light points through: the axis of the largest component.
    Each map is a quarter turn wide and some texels more on every side. A filter that reads beyond the edge of a face
    thus reads what its own face sees there, on the same plane, with rays of the light like all others: no border, no
    seam, and no rule for which texel of which neighbour follows. The technique asks for as many texels as its filter
    reaches, and as many again for receivers that a bias moves.

    Faces share their lines of texels: two neighbours have the same coordinate along their common edge. Texels are of
    one size on the cube, so between 1 and 3√3 times finer in solid angle towards the corners.

    For a directional light all rays are parallel and one map serves: the cube is then `SingleMap`.

    Attributes:
        margin: Texels that each map has beyond every edge of its face, ≥ 0; a technique sets it by `with_margin`.

    Source: stencil, section 2 says that a light that shines everywhere needs several maps; margins are derived here.
    """

    margin: int = eqx.field(static=True, default=2)

    def __check_init__(self) -> None:
        require_int(self.margin, "margin", 0)

    def with_margin(self, texels: float) -> "CubeMap":
        """The cube with a margin for a filter that reads `texels` texels away."""
        return CubeMap(2 * math.ceil(texels) + 1)

    def grids(self, mesh: Mesh, light: Light, camera: Camera, resolution: int) -> tuple[RayGrid, ...]:
        """One grid a face, in the order of `CUBE_FACES`; one alone for a directional light.

        Raises:
            ValueError: If the margin leaves no texel for the faces themselves.
        """
        if light.is_directional:
            return SingleMap().grids(mesh, light, camera, resolution)
        inner = resolution - 2 * self.margin
        require(
            inner >= 1,
            f"a resolution of {resolution} texels leaves nothing inside margins of {self.margin} for this filter; use "
            f"at least {2 * self.margin + 1}",
        )
        position = light.homogeneous[:3]
        # A face spans [−1, 1]² in tangents; the margin widens it by whole texels of the same size.
        corner = jnp.full(2, resolution / inner, mesh.vertices.dtype)
        return tuple(
            with_seen_depth(
                starting_outside(space, UniformWarp(Box(-corner, corner)), mesh, resolution), light, mesh, camera
            )
            for space in (PerspectiveSpace(position, frame) for frame in face_frames(position.dtype))
        )

    @property
    def follows_camera(self) -> bool:
        """Its maps are fixed to the axes of the world."""
        return False

    @property
    def num_maps(self) -> int:
        """One a face."""
        return len(CUBE_FACES)

    def select(self, grids: tuple[RayGrid, ...], camera: Camera, points: Points) -> Int[Array, "*points"]:
        """The face through which each point's direction from the light points; at the light itself the first."""
        if len(grids) == 1:
            return jnp.zeros(points.shape[:-1], jnp.int32)
        return face_of(points - grids[0].space.source)


@checked
def face_frames(dtype: DType) -> tuple[Float[Array, "3 3"], ...]:
    """Right, up and forward of each face, in the order of `CUBE_FACES`: the axes of the world themselves.

    Args:
        dtype: Of the frames.
    """
    axes = np.eye(3)
    frames = []
    for axis in range(3):
        right, up, forward = axes[(axis + 1) % 3], axes[(axis + 2) % 3], axes[axis]
        # Opposite faces swap right and up, which keeps both frames right-handed.
        frames += [np.stack([right, up, forward]), np.stack([up, right, -forward])]
    return tuple(jnp.asarray(frame, dtype) for frame in frames)


@checked
def face_of(directions: Float[Array, "*points 3"]) -> Int[Array, "*points"]:
    """Index into `CUBE_FACES` of the face of a cube that a direction points through; on an edge the earlier axis.

    Args:
        directions: From the middle of the cube, of any length.
    """
    # `argmax` takes the first of equal components, so edges belong to the earlier axis.
    axis = jnp.argmax(jnp.abs(directions), axis=-1)
    along = jnp.take_along_axis(directions, axis[..., None], axis=-1)[..., 0]
    return 2 * axis.astype(jnp.int32) + (along < 0).astype(jnp.int32)


__all__ = ["CUBE_FACES", "CubeMap", "face_frames", "face_of"]
