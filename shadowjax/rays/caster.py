"""The protocol of every ray caster: closest hits of any rays or of a grid, and exact visibility of points."""

from abc import abstractmethod
from collections.abc import Callable
from typing import ClassVar

import jax
import jax.numpy as jnp

from shadowjax._checked import Checked, checked
from shadowjax._checks import require
from shadowjax._numerics import dot, map_in_chunks
from shadowjax._types import Array, Bool, Float, Int, Points, Scalar
from shadowjax.geometry.mesh import Mesh
from shadowjax.rays.light_space import LightSpace, is_reached
from shadowjax.rays.ray import Hit, Rays
from shadowjax.rays.ray_grid import RayGrid

# How far a shadow ray keeps from the surface it ends on, in units of rounding of the scene's coordinates.
SURFACE_ROUNDINGS = 64.0


class Caster(Checked):
    """Finds which triangle a ray meets first.

    A caster only *chooses* triangles, under `stop_gradient`; depth and barycentrics come from `ray.intersect`, so every
    caster has the same values and the same gradients. Of equally near triangles the one with the lowest index wins.
    """

    _remedy_: ClassVar = "Give an object, such as BruteForce()"

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
                rays end a few roundings above the surface on that side. Without normals they end a few roundings
                towards the light.

        Returns:
            True where nothing blocks the ray. No ray arrives behind a spot light, so nothing blocks one there:
            `Light.covers` makes such points dark.
        """
        rays, facing = shadow_rays(mesh, space, points, normals)
        return facing & ~self.closest(mesh, rays).is_hit


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
def surface_gap(mesh: Mesh) -> Scalar:
    """How far a shadow test keeps from the surface that it starts on, world units: some roundings of positions."""
    size = jnp.maximum(mesh.extent, jnp.max(jnp.abs(jnp.stack(mesh.bounds()))))
    return SURFACE_ROUNDINGS * jnp.finfo(size.dtype).eps * size


@checked
def shadow_limits(
    space: LightSpace, points: Points, normals: Points | None, gap: Scalar
) -> tuple[Float[Array, "*points 2"], Float[Array, "*points"], Bool[Array, "*points"]]:
    """Plane position of the ray that reaches each point, the depth up to which it must be free, and whether the point
    faces the light; `gap` as `surface_gap` says."""
    to_source = space.to_source(points)
    side = to_source if normals is None else normals
    plane, depth = space.project(points + gap * side)
    # Nothing can meet a ray that ends before it starts.
    limit = jnp.where(is_reached(space, plane), depth - gap, -jnp.ones_like(depth))
    return plane, limit, dot(to_source, side) > 0


@checked
def shadow_rays(
    mesh: Mesh, space: LightSpace, points: Points, normals: Points | None
) -> tuple[Rays, Bool[Array, "*points"]]:
    """The part of a light's ray that must be free for each point to be lit, and whether the point faces the light."""
    plane, limit, facing = shadow_limits(space, points, normals, surface_gap(mesh))
    origins, directions = space.ray(plane)
    return Rays(origins, directions, jnp.zeros((), points.dtype), limit), facing


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
