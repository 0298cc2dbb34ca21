"""The trivial partition: one map for the whole scene; and the same map of a directional light from arrays alone."""

import itertools

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from shadowjax._checked import checked
from shadowjax._checks import concrete, require
from shadowjax._types import Array, Float, Int, Points, Vector3
from shadowjax.geometry.camera import Camera
from shadowjax.geometry.light import Light
from shadowjax.geometry.light_space import DirectionalSpace
from shadowjax.geometry.mesh import Mesh
from shadowjax.geometry.transforms import light_frame
from shadowjax.partitions.base import Partition
from shadowjax.rays.map_part import grid_around, seen_space, starting_outside
from shadowjax.rays.plane_map import Box
from shadowjax.rays.ray_grid import RayGrid
from shadowjax.warps.base import WarpFit, bounding_box
from shadowjax.warps.receivers import with_seen_depth
from shadowjax.warps.uniform import UniformFit


class SingleMap(Partition):
    """One map.

    Attributes:
        warp: How the map's texels are spread over the light's plane.
    """

    warp: WarpFit = UniformFit()

    def grids(self, mesh: Mesh, light: Light, camera: Camera, resolution: int) -> tuple[RayGrid, ...]:
        """One grid around everything."""
        space = seen_space(light, mesh, camera)
        grid = starting_outside(space, self.warp.fit(space, light, mesh, camera), mesh, resolution)
        return (with_seen_depth(grid, light, mesh, camera),)

    @property
    def follows_camera(self) -> bool:
        """As its warp."""
        return self.warp.follows_camera

    @property
    def num_maps(self) -> int:
        """One."""
        return 1

    def select(self, grids: tuple[RayGrid, ...], camera: Camera, points: Points) -> Int[Array, "*points"]:
        """Region 0 for every point."""
        return jnp.zeros(points.shape[:-1], jnp.int32)


@checked
def map_rays(
    direction: Vector3, lower: Vector3, upper: Vector3, resolution: int, view: Vector3 | None = None
) -> tuple[Float[Array, "rows cols 3"], Float[Array, "rows cols 3"]]:
    """The ray through the centre of each texel of a directional light's map: what `SingleMap` casts around a box.

    Args:
        direction: In which the light travels, of any nonzero length.
        lower: Lower corner of a box around all that casts or receives shadows, world units.
        upper: Upper corner of the box.
        resolution: Texels along each side, ≥ 1.
        view: Which way the map's second axis points, across the light; any way across it if None.

    Returns:
        World origins, on a plane before the box, and unit directions. Row 0 has the least t.

    Raises:
        ValueError: If the direction is zero or a corner lies on the wrong side.
    """
    return _origins_and_directions(_box_grid(direction, lower, upper, resolution, view))


@jax.jit
def _origins_and_directions(grid: RayGrid) -> tuple[Float[Array, "rows cols 3"], Float[Array, "rows cols 3"]]:
    rays = grid.rays()
    return rays.origins, rays.directions


@checked
def to_map(
    points: Points, direction: Vector3, lower: Vector3, upper: Vector3, resolution: int, view: Vector3 | None = None
) -> tuple[Float[Array, "*points 2"], Float[Array, "*points"]]:
    """Where world points lie in the map of `map_rays`, of which the other arguments are.

    Args:
        points: World points in the box; the map knows nothing of what lies beside or behind it.
        direction: In which the light travels.
        lower: Lower corner of the box.
        upper: Upper corner of the box.
        resolution: Texels along each side.
        view: Which way the map's second axis points, across the light.

    Returns:
        (x, y) in texels, x along columns, centres at +½; and the distance along the ray from its origin, world units.
    """
    return jax.jit(RayGrid.locate)(_box_grid(direction, lower, upper, resolution, view), points)


def _box_grid(direction: Vector3, lower: Vector3, upper: Vector3, resolution: int, view: Vector3 | None) -> RayGrid:
    """The grid that `SingleMap` makes of a box with a camera in its middle."""
    known = concrete(direction), concrete(lower), concrete(upper)
    require(known[0] is None or bool(np.any(known[0])), "light direction must not be the zero vector")
    ordered = known[1] is None or known[2] is None or bool(np.all(known[1] <= known[2]))
    require(ordered, f"upper must not lie below lower along any axis; got {known[1]} and {known[2]}")
    return _grid_of_box(direction, lower, upper, resolution, view)


@eqx.filter_jit
def _grid_of_box(direction: Vector3, lower: Vector3, upper: Vector3, resolution: int, view: Vector3 | None) -> RayGrid:
    middle = 0.5 * (lower + upper)
    space = DirectionalSpace(middle, light_frame(-direction, direction if view is None else view))
    # The eight corners of the box: its shadow on the plane is theirs.
    which = np.array(list(itertools.product([False, True], repeat=3)))
    plane, _ = space.project(jnp.where(which, upper, lower))
    return grid_around(space, Box(*bounding_box(plane)), lower - middle, upper - middle, resolution)


__all__ = ["SingleMap", "map_rays", "to_map"]
