"""A uniform map that holds still as the camera moves: fixed size, fixed axes, origin snapped to whole texels."""

import equinox as eqx
import jax
import jax.numpy as jnp

from shadowjax._checked import checked
from shadowjax._checks import require_int
from shadowjax._numerics import dot
from shadowjax._types import Array, Float, Scalar, Vector3
from shadowjax.geometry.camera import Camera
from shadowjax.geometry.light import Light
from shadowjax.geometry.light_space import LightSpace
from shadowjax.geometry.mesh import Mesh
from shadowjax.geometry.transforms import any_perpendicular
from shadowjax.warps.base import WarpFit
from shadowjax.warps.perspective import PerspectiveWarp, components, from_components


class StableFit(WarpFit):
    """Covers the sphere around the camera's frustum with a uniform map that moves by whole texels only.

    As the camera moves or turns, the map keeps its size (the sphere depends on near, far and the angles of view alone),
    its axes (they depend on the light alone) and the places of its texels in the world (its origin jumps from one
    point of a fixed lattice to the next). So a static surface reads the same depths in both maps and does not shimmer.

    The lattice has `steps` cells along a side of the map: every resolution that is a multiple of it moves by whole
    texels. One cell is added to the sphere's diameter for the jumps, so the map is steps/(steps − 1) larger each way.

    Attributes:
        steps: Cells of the lattice along a side, ≥ 2; the map's resolution must be a multiple of it.
        snap: Whether the origin is snapped; without, only size and axes hold still.
    """

    steps: int = eqx.field(static=True, default=32)
    snap: bool = eqx.field(static=True, default=True)

    def __check_init__(self) -> None:
        require_int(self.steps, "steps, the lattice's cells along a side of the map,", 2)

    @property
    def holds_still(self) -> bool:
        """If it is snapped."""
        return self.snap

    def fit(self, space: LightSpace, light: Light, mesh: Mesh, camera: Camera) -> PerspectiveWarp:
        """The map around the frustum between the camera's own planes; the scene plays no part.

        Raises:
            ValueError: If the light is not directional: only parallel rays have texels of one size everywhere.
        """
        direction = light.as_directional("a stable map needs", ": use UniformFit").direction
        space = space.as_directional("a stable map needs")
        centre, radius = bounding_sphere(camera)
        size = 2 * radius * self.steps / (self.steps - 1)
        # a direction that the light alone decides, seen in the plane's coordinates, which turn with the view
        fixed = any_perpendicular(direction)
        axis = jnp.stack([dot(space.frame[0], fixed), dot(space.frame[2], fixed)])
        world_origin, _ = space.project(jnp.zeros_like(centre))
        middle, _ = space.project(centre)
        # Lower corner of the square around the sphere, in coordinates fixed to the world.
        lowest = jnp.stack(components(middle - world_origin, axis)) - size / 2
        if self.snap:
            cell = size / self.steps
            # Straight through: the origin snaps to the lattice, its gradient is that of the origin not snapped.
            lowest = lowest + jax.lax.stop_gradient(jnp.round(lowest / cell) * cell - lowest)
        zero = jnp.zeros_like(size)
        origin = world_origin + from_components(lowest[0], lowest[1], axis)
        return PerspectiveWarp(origin, axis, size, zero, jnp.stack([zero, size]))


@checked
def bounding_sphere(camera: Camera) -> tuple[Vector3, Scalar]:
    """Centre and radius of the smallest sphere around a camera's frustum: its radius does not depend on the pose.

    With τ the tangent of half the angle of view across the image's diagonal, the centre lies at depth
    min((n + f)(1 + τ²)/2, f).
    """
    square: Float[Array, ""] = jnp.sum(camera.half_size**2)
    # Equidistant from near and far corners; where that lies beyond the far plane, its corners alone decide.
    depth = jnp.minimum((camera.near + camera.far) * (1 + square) / 2, camera.far)
    radius = jnp.sqrt((camera.far - depth) ** 2 + camera.far**2 * square)
    return camera.position + depth * camera.forward, radius


__all__ = ["StableFit", "bounding_sphere"]
