"""The protocol of every ray caster: closest hits of any rays or of a grid, and exact visibility of points."""

from abc import abstractmethod
from collections.abc import Callable
from typing import ClassVar

import jax
import jax.numpy as jnp

from shadowjax._checked import Checked, checked
from shadowjax._checks import require
from shadowjax._numerics import faces_light, map_in_chunks
from shadowjax._types import Array, Bool, Float, Int, Points
from shadowjax.geometry.light_space import LightSpace
from shadowjax.geometry.mesh import Mesh
from shadowjax.rays.ray import Hit, Rays
from shadowjax.rays.ray_grid import RayGrid

# How far a shadow ray starts above its receiver, in roundings of the receiver's place along its normal: a point that is
# on its surface, as nearly as its numbers can tell, is off it by half a rounding of each.
RECEIVER_ROUNDINGS = 8.0


class Caster(Checked):
    """Finds which triangle a ray meets first.

    A caster only *chooses* triangles, under `stop_gradient`; depth and barycentrics come from `ray.intersect`, so every
    caster has the same values and the same gradients. Of equally near triangles the one with the lowest index wins.
    """

    _remedy_: ClassVar = "Give an object, such as GridCaster()"

    @abstractmethod
    def closest(self, mesh: Mesh, rays: Rays) -> Hit:
        """First hit of arbitrary rays."""

    def closest_on_grid(self, mesh: Mesh, grid: RayGrid) -> Hit:
        """First hit of every ray of a grid, shape (rows, cols); casters for coherent rays override this."""
        return self.closest(mesh, grid.rays())

    def depth_on_grid(self, mesh: Mesh, grid: RayGrid) -> Float[Array, "rows cols"]:
        """Depth alone of every ray of a grid; casters that can find it faster override this."""
        return self.closest_on_grid(mesh, grid).depth

    def closest_beyond_on_grid(self, mesh: Mesh, grid: RayGrid, start_depth: Float[Array, "rows cols"]) -> Hit:
        """First hit of every ray of a grid from a depth of its own on: what depth peeling asks for.

        Args:
            mesh: What is cast.
            grid: The rays.
            start_depth: Least depth that counts along each ray, world units, ≥ 0. No gradient passes through it.

        Returns:
            The hit, with depth from where the rays of the grid start; a miss where nothing follows up to `grid.far`.

        Raises:
            ValueError: If there is not one start for each ray.
        """
        rays = grid.rays()
        return self.closest(mesh, Rays(rays.origins, rays.directions, checked_start(grid, start_depth), rays.t_max))

    def prepared(self, mesh: Mesh) -> "Caster":
        """A caster for many casts of one mesh: the same one, or one that holds what it would build in every cast."""
        del mesh
        return self

    def prefers_images(self, space: LightSpace) -> bool:
        """Whether `visible` is faster for points of an image, (rows, cols, 3), than for a list of them."""
        del space
        return False

    def visible(
        self, mesh: Mesh, space: LightSpace, points: Points, normals: Points | None = None
    ) -> Bool[Array, "*points"]:
        """Whether nothing lies between each point and the source of its ray: the exact shadow test.

        Args:
            mesh: Everything that casts shadows.
            space: The light space whose rays reach the points.
            points: World points, usually on surfaces of the mesh.
            normals: Unit normals of the side that is looked at. A side that faces away from the light is dark. Shadow
                rays start a few roundings of the point above the surface on that side. Without normals they start a few
                roundings towards the light.

        Returns:
            True where nothing blocks the ray. No ray arrives behind a spot light, so nothing blocks one there:
            `Light.covers` makes such points dark.
        """
        rays, facing = shadow_rays(space, points, normals)
        return facing & ~self.blocked(mesh, rays)

    @abstractmethod
    def blocked(self, mesh: Mesh, rays: Rays) -> Bool[Array, "*points"]:
        """Whether a triangle lies on each ray, nearer to neither of its ends than the triangle's own rounding.

        Rounding is that of the corners as seen from the ray's start (`ray.depth_rounding`), so the surface that a
        shadow ray starts on, or that its lamp lies on, is not in its way.
        """


@checked
def checked_start(grid: RayGrid, start_depth: Float[Array, "..."]) -> Float[Array, "rows cols"]:
    """Depths to start from, if there is one for each ray of a grid; constant."""
    shape = (grid.num_rows, grid.num_cols)
    require(
        start_depth.shape == shape,
        f"start_depth must have the shape of the grid, {shape}; got {start_depth.shape}; for one depth for all rays, "
        "use jnp.full(shape, depth)",
    )
    return jax.lax.stop_gradient(start_depth).astype(grid.far.dtype)


@checked
def receiver_gap(points: Points, side: Points) -> Float[Array, "*points"]:
    """How far a shadow test starts above the surface that a point lies on, world units.

    A few roundings of the point's own coordinates, as far as they move it off the surface: no more for a floor at
    height 0 a thousand kilometres from the origin. Neither the scene's size nor its distance counts.

    Args:
        points: World points on surfaces.
        side: Unit vectors along which they are raised: normals.
    """
    # A rounding of each coordinate, as far as it moves the point along its normal.
    off = jnp.abs(points[..., 0] * side[..., 0])
    for axis in (1, 2):
        off = off + jnp.abs(points[..., axis] * side[..., axis])
    return RECEIVER_ROUNDINGS * jnp.finfo(points.dtype).eps * off


@checked
def shadow_rays(space: LightSpace, points: Points, normals: Points | None) -> tuple[Rays, Bool[Array, "*points"]]:
    """Rays from a little above each point to its source that must be free for it to be lit, and whether it faces it.

    They start at the point, not at the light: offsets of triangles from there keep the digits of what is near.
    """
    to_source, _ = space.way_to_source(points)
    side = to_source if normals is None else normals
    start = points + receiver_gap(points, side)[..., None] * side
    directions, distance = space.way_to_source(start)
    plane, _ = space.project(points)
    # Nothing can meet a ray that ends before it starts.
    limit = jnp.where(space.is_reached(plane), distance, -jnp.ones_like(distance))
    return Rays(start, directions, jnp.zeros((), points.dtype), limit), faces_light(side, to_source)


@checked
def search_in_chunks(search: Callable[[Rays], Int[Array, "rays"]], rays: Rays, chunk: int) -> Int[Array, "*points"]:
    """Apply a search to lists of at most `chunk` rays and give its answers the shape of the rays."""
    flat = rays.flattened()
    num_rays = flat.t_max.shape[0]
    # Few distinct sizes mean few compilations: a short list of rays is filled up to a power of two.
    rows = min(chunk, 1 << max(num_rays - 1, 255).bit_length())
    spare = max(rows - num_rays, 0)
    flat = jax.tree.map(lambda x: jnp.concatenate([x, jnp.broadcast_to(x[:1], (spare, *x.shape[1:]))]), flat)
    return map_in_chunks(search, flat, chunk)[:num_rays].reshape(rays.shape)
