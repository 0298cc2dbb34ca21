"""A grid of coherent rays: light space, plane map and resolution; the texel of a point and the ray of a texel."""

import math
from typing import Annotated

import equinox as eqx
import jax
import jax.numpy as jnp

from shadowjax._checked import Checked, checked
from shadowjax._checks import POSITIVE, require_int
from shadowjax._numerics import dot
from shadowjax._types import Array, Float, Points, Scalar
from shadowjax.geometry.camera import Camera
from shadowjax.geometry.light_space import LightSpace, camera_space
from shadowjax.rays.plane_map import Box, PlaneMap
from shadowjax.rays.ray import Rays

# How far the depths that a map and a receiver have on one plane differ at most, in roundings of the receiver's place
# along its normal and of its offset from where depths are counted.
PLANE_ROUNDINGS = 4.0
# Planes that the light grazes at less than a degree get no more tolerance than at a degree.
LEAST_COSINE = math.sin(math.pi / 180)


class RayGrid(Checked):
    """One ray through the centre of every cell of a regular grid on the unit square.

    Attributes:
        space: The light space (or camera) the rays belong to.
        plane_map: Where the unit square lies on its plane.
        far: Depth that a miss reports, world units, beyond the scene.
        num_rows: Cells along t (rows of the image).
        num_cols: Cells along s (columns).
        seen: Depth within which all lies that a view sees in this light, world units, at most `far`; None takes `far`.
            Rounding and filtered values spend their digits up to here; what lies beyond keeps its order.
    """

    space: LightSpace
    plane_map: PlaneMap
    far: Annotated[Scalar, POSITIVE]
    num_rows: int = eqx.field(static=True)
    num_cols: int = eqx.field(static=True)
    seen: Annotated[Scalar, POSITIVE] | None = None

    def __check_init__(self) -> None:
        require_int(self.num_rows, "num_rows", 1)
        require_int(self.num_cols, "num_cols", 1)

    @property
    def seen_or_far(self) -> Scalar:
        """`seen`, or `far` where no view is known."""
        return self.far if self.seen is None else self.seen

    @property
    def resolution(self) -> Float[Array, "2"]:
        """(columns, rows) as numbers."""
        return jnp.asarray([self.num_cols, self.num_rows], self.far.dtype)

    def receiver_rounding(self, points: Points, normals: Points) -> Float[Array, "*points"]:
        """What rounding may make of the difference between a receiver's depth and that of its own plane in the map.

        World coordinates of receivers and of rays' starts are rounded, and move a plane as far as they lie along its
        normal: a level floor stays where it is, however far away. Offsets from the start of the rays are rounded in
        every direction. Neither the scene's extent nor what else lies in the map counts.

        Args:
            points: Receivers.
            normals: Their unit normals.

        Returns:
            Distance along the light ray, world units.
        """
        offset = points - self.space.source
        along = _sum(jnp.abs(points * normals))
        cosine = jnp.maximum(jnp.abs(dot(normals, self.space.to_source(points))), LEAST_COSINE)
        return PLANE_ROUNDINGS * jnp.finfo(self.far.dtype).eps * (along + _sum(jnp.abs(offset))) / cosine

    def centres(self) -> Float[Array, "rows cols 2"]:
        """(s, t) of every cell's centre, (i + ½)/resolution."""
        s = (jnp.arange(self.num_cols, dtype=self.far.dtype) + 0.5) / self.num_cols
        t = (jnp.arange(self.num_rows, dtype=self.far.dtype) + 0.5) / self.num_rows
        return jnp.stack(jnp.meshgrid(s, t, indexing="xy"), axis=-1)

    def rays_at(self, square: Float[Array, "*points 2"]) -> Rays:
        """The rays through arbitrary positions (s, t) of the unit square."""
        origins, directions = self.space.ray(self.plane_map.inverse(square))
        zero = jnp.zeros((), self.far.dtype)
        return Rays(origins, directions, zero, self.far)

    def rays(self) -> Rays:
        """The ray of every cell, shape (rows, cols)."""
        return self.rays_at(self.centres())

    def locate(self, points: Points) -> tuple[Float[Array, "*points 2"], Float[Array, "*points"]]:
        """Grid position (x along columns, y along rows, in cells, centres at +½) and depth of world points."""
        plane, depth = self.space.project(points)
        return self.plane_map.forward(plane) * self.resolution, depth

    def point(self, position: Float[Array, "*points 2"], depth: Float[Array, "*points"]) -> Points:
        """World point at a grid position (in cells) and depth: the inverse of `locate`."""
        return self.space.point(self.plane_map.inverse(position / self.resolution), depth)

    def cell_vectors(self, points: Points) -> tuple[Points, Points]:
        """How far a world point moves when its grid position moves by one cell, at constant depth.

        Args:
            points: World points.

        Returns:
            World vectors for one column and for one row: the derivative of the map itself, so any warp is covered.
        """
        position, depth = self.locate(points)

        def along(unit: list[float]) -> Points:
            tangent = jnp.broadcast_to(jnp.asarray(unit, position.dtype), position.shape)
            return jax.jvp(lambda where: self.point(where, depth), (position,), (tangent,))[1]

        return along([1.0, 0.0]), along([0.0, 1.0])


def _sum(vectors: Points) -> Float[Array, "*points"]:
    return vectors[..., 0] + vectors[..., 1] + vectors[..., 2]


@checked
def pixel_footprint(view: RayGrid, grid: RayGrid, points: Points, normals: Points) -> Float[Array, "*points 2 2"]:
    """How far the place of a receiver in one grid moves while the eye moves by one cell of another: a true Jacobian.

    The pixel's ray is moved over the receiver's tangent plane, and the plane's points are located in the grid of the
    light, so perspective, warps and the receiver's slope are all in it.

    Args:
        view: Rays of the image.
        grid: Rays of the map.
        points: Receivers.
        normals: Their unit normals.

    Returns:
        `[..., i, j]` is the change of map coordinate i, in cells, for one pixel along image axis j (0: columns). A
        surface seen edge-on is taken as seen at 1°.
    """
    away = -view.space.to_source(points)
    cosine = dot(normals, away)
    least = jnp.asarray(LEAST_COSINE, points.dtype)
    cosine = jnp.where(jnp.abs(cosine) < least, jnp.where(cosine < 0, -least, least), cosine)
    columns = []
    for step in view.cell_vectors(points):
        # The step at constant distance, moved along the pixel's ray back onto the receiver's plane.
        on_plane = step - away * (dot(normals, step) / cosine)[..., None]
        columns.append(jax.jvp(lambda at: grid.locate(at)[0], (points,), (on_plane,))[1])
    return jnp.stack(columns, axis=-1)


@checked
def camera_grid(camera: Camera, width: int, height: int) -> RayGrid:
    """One ray through every pixel centre of a camera's image; row 0 is the top.

    Args:
        camera: The camera; its aspect should be width/height for square pixels.
        width: Columns, ≥ 1.
        height: Rows, ≥ 1.

    Raises:
        ValueError: If a size is less than 1.
    """
    flip = jnp.asarray([1.0, -1.0], camera.near.dtype)
    corner = camera.half_size * flip
    # Distances run further than the far *plane* towards the corners of the image.
    far = camera.far * jnp.sqrt(1.0 + jnp.sum(camera.half_size**2))
    return RayGrid(camera_space(camera), Box(-corner, corner), far, height, width)
