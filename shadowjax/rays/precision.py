"""Warnings where coordinates are rounded as coarsely as the pixels or texels that they must resolve."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from shadowjax._checked import checked
from shadowjax._checks import concrete, warn
from shadowjax._numerics import norm
from shadowjax._types import Array, Bool, Float, Points
from shadowjax.geometry.camera import Camera
from shadowjax.geometry.mesh import Mesh
from shadowjax.rays.ray_grid import RayGrid

# Rounding of a coordinate, in pixels or texels, from which on a warning is given.
COARSE = 0.5
# Share of the pixels that must be so coarse: a few lie right before the eye in any view.
SHARE = 0.01
# A map whose place is no farther from the origin of coordinates than this many of its depths is fine at any resolution.
CLOSE = 16.0

REMEDY = (
    "take the scene's coordinates from an origin near what is seen, subtracted in 64 bits (Mesh.about, and "
    "Mesh.to_local for cameras and lights), or work in float64"
)


@checked
def warn_of_coarse_pixels(
    mesh: Mesh, camera: Camera, height: int, points: Points, seen: Bool[Array, "*points"]
) -> None:
    """Warn (`SceneWarning`) where what is seen lies so far from the origin that rounding takes up half a pixel.

    Args:
        mesh: What is seen.
        camera: The view.
        height: Pixels down.
        points: World points that are seen.
        seen: Which of them count.
    """
    values = [concrete(part) for part in (mesh.vertices, camera.position, camera.near, camera.phi_y, points, seen)]
    forward = concrete(camera.forward)
    if forward is None or any(value is None for value in values):
        return
    vertices, position, near, phi, places, counts = (np.asarray(value) for value in values)
    eps = float(np.finfo(vertices.dtype).eps)
    pixel = 2 * float(np.tan(phi)) / height
    farthest = max(float(np.max(np.abs(part), initial=0.0)) for part in (vertices, position))
    # No pixel is narrower than those of the near plane, so most scenes need no closer look.
    if eps * farthest <= COARSE * pixel * float(near) or not counts.any():
        return
    places = places[counts]
    gap = eps * np.max(np.abs(places), axis=-1)
    width = pixel * np.maximum((places - position) @ forward, float(near))
    _warn_where(gap, width, "pixel", vertices.dtype)


@checked
def warn_of_coarse_texels(grids: tuple[RayGrid, ...]) -> None:
    """Warn (`SceneWarning`) where a map lies so far from the origin that rounding takes up half a texel.

    Args:
        grids: The light rays of the maps.
    """
    gaps, widths = [], []
    for grid in grids:
        known = concrete(grid.space.source), concrete(grid.far)
        if known[0] is None or known[1] is None or any(concrete(x) is None for x in jax.tree.leaves(grid)):
            return
        place = float(np.max(np.abs(known[0])))
        if place > CLOSE * float(known[1]):
            width = np.asarray(_texels(grid))
            gaps.append(np.full_like(width, float(np.finfo(width.dtype).eps) * place))
            widths.append(width)
    if gaps:
        _warn_where(np.concatenate(gaps), np.concatenate(widths), "texel", widths[0].dtype)


@eqx.filter_jit
def _texels(grid: RayGrid) -> Float[Array, "some"]:
    """Widths of some texels half of the farthest depth away, the shorter side of each, world units."""
    share = jnp.linspace(0.05, 0.95, 7, dtype=grid.far.dtype)
    square = jnp.stack(jnp.meshgrid(share, share), axis=-1).reshape(-1, 2)
    points = grid.point(square * grid.resolution, jnp.broadcast_to(0.5 * grid.far, square.shape[:1]))
    across, down = grid.cell_vectors(points)
    return jnp.minimum(norm(across), norm(down))


def _warn_where(gap: np.ndarray, width: np.ndarray, what: str, dtype: np.dtype) -> None:
    coarse = gap > COARSE * width
    if np.mean(coarse) > SHARE:
        worst = int(np.argmax(gap / width))
        warn(
            f"coordinates in {dtype} are {gap[worst]:.2g} apart where a {what} is {width[worst]:.2g} wide, so shadows "
            f"there are off by up to {gap[worst] / width[worst]:.2g} {what}s: {REMEDY}"
        )


__all__ = ["warn_of_coarse_pixels", "warn_of_coarse_texels"]
