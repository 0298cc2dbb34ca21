"""The pixels a camera really sees as the light sees them, and the mean error of a warped map over them in closed form.

A texel of a perspective warp covers m = m_x·m_z pixels of the image where, with κ = 1/n' and u a pixel's offset,

    m = w(κ)·W/(1 + Wκ)/(4·tan φ_x·tan φ_y) · (1 + uκ)³/z²,

and w is the width of the warp's trapezium around the frustum's eight corners, whatever the camera's roll. Its sum over
any set of pixels is a cubic in κ whose coefficients are four moments Σ weight·u^j/z²; running sums of them over depth
give the error of every slice between two planes at once.
"""

from typing import Annotated, NamedTuple

import equinox as eqx
import jax.numpy as jnp

from shadowjax._checked import Checked, checked
from shadowjax._checks import MAY_BE_INFINITE
from shadowjax._numerics import dot, largest, norm, safe_divide
from shadowjax._types import Array, Float, Scalar, Vector2
from shadowjax.geometry.camera import Camera
from shadowjax.geometry.light import Light
from shadowjax.geometry.transforms import light_frame
from shadowjax.shading import Surface, valid_receivers
from shadowjax.theory.aliasing.light_frustum import LightFrustum
from shadowjax.warps.fit import light_frustum

STEEPEST = 16.0  # largest projection error that counts: beyond, the surface hardly catches light


class SeenPixels(Checked):
    """What the camera sees where shadows matter, as the light sees it.

    Attributes:
        frustum: View and light over the range of depths that is seen, upright about the view (for the published n').
        edges: The frustum's four edges from the eye on the light's plane, along the view and across it, per depth.
        half_size: Half width and half height of the image plane at distance 1.
        depth: Depth z of every pixel along the view, world units.
        rise: z' of its surface from the eye, world units.
        weight: What an error there costs, ≥ 0; 0 where no shadow falls into view.
    """

    frustum: LightFrustum
    edges: Float[Array, "4 2"]
    half_size: Vector2
    depth: Float[Array, "pixels"]
    rise: Float[Array, "pixels"]
    weight: Float[Array, "pixels"]


@checked
@eqx.filter_jit
def seen_pixels(surface: Surface, camera: Camera, light: Light, projection: bool = False) -> SeenPixels:
    """Depth buffer and weights of a view.

    Args:
        surface: From `shading.trace_surface`.
        camera: The camera that saw it.
        light: A directional light.
        projection: Whether a pixel counts with its projection error cos θ_c/cos θ_l, up to 16, next to 1/cos α of its
            view angle; then the mean is that of all aliasing, else of its perspective part.

    Raises:
        ValueError: If the light is not directional.
    """
    light = light.as_directional("near distances need")
    offset = (surface.points - camera.position).reshape(-1, 3)
    frame = light_frame(-light.direction, camera.forward)
    depth = offset @ camera.forward
    valid = valid_receivers(surface, light).reshape(-1) & (depth >= camera.near) & (depth <= camera.far)
    depth = jnp.where(valid, depth, camera.far)
    # 1/cos α of the view angle, by which a pixel's beam is narrower across itself than on the image plane.
    weight = jnp.where(valid, norm(offset) / depth, 0.0)
    if projection:
        normals = surface.normals.reshape(-1, 3)
        to_camera = jnp.abs(dot(normals, surface.to_camera.reshape(-1, 3)))
        to_light = jnp.abs(normals @ light.direction)
        weight = weight * jnp.minimum(safe_divide(to_camera, to_light, STEEPEST), STEEPEST)
    near = jnp.min(jnp.where(valid, depth, camera.far))
    far = jnp.max(jnp.where(valid, depth, camera.near))
    some = far > near * (1 + 1e-3)
    near, far = jnp.where(some, near, camera.near), jnp.where(some, far, camera.far)
    frustum = light_frustum(camera, light.direction, near, far)
    signs = jnp.asarray([[-1, -1], [1, -1], [1, 1], [-1, 1]], depth.dtype)
    rays = jnp.concatenate([signs * camera.half_size, jnp.ones((4, 1), depth.dtype)], axis=1) @ camera.rotation
    edges = rays @ jnp.stack([frame[2], frame[0]], axis=-1)
    return SeenPixels(frustum, edges, camera.half_size, depth, jnp.where(valid, offset @ frame[2], near), weight)


class Chart(NamedTuple):
    """What a tight perspective warp around the view between two depths covers; fields share a batch shape.

    Attributes:
        lowest: z' of its lowest corner from the eye, world units.
        extent: W.
        along: Offsets of the eight corners above the lowest.
        across: Their distance from the middle of the corners.
        pixel: 4·tan φ_x·tan φ_y, the image plane's area at distance 1.
    """

    lowest: Array
    extent: Array
    along: Array
    across: Array
    pixel: Array


@checked
def chart_between(pixels: SeenPixels, near: Float[Array, "*batch"], far: Float[Array, "*batch"]) -> Chart:
    """The map of every pair of depths."""
    corners = jnp.concatenate([near[..., None, None] * pixels.edges, far[..., None, None] * pixels.edges], axis=-2)
    # Eight corners along the last axis but one: four on each plane, in proportion to its depth.
    along, across = corners[..., 0], corners[..., 1]
    lowest = -largest(-along)
    middle = (largest(across) - largest(-across)) / 2
    along = along - lowest[..., None]
    pixel = 4 * jnp.prod(pixels.half_size) + jnp.zeros_like(lowest)
    return Chart(lowest, largest(along), along, across - middle[..., None], pixel)


@checked
def moments(pixels: SeenPixels) -> Float[Array, "4 pixels"]:
    """w·rise^j/z² of every pixel, j = 0 … 3."""
    # m_x·m_z is (1 + uκ)³/z² but for the map's size, a cubic in κ: four sums hold all pixels.
    base = pixels.weight / pixels.depth**2
    return jnp.stack([base, base * pixels.rise, base * pixels.rise**2, base * pixels.rise**3])


@checked
def widest(chart: Chart, strength: Array) -> tuple[Array, Array]:
    """Which two corners bound a map's width."""
    shrunk = _shrunk(chart, strength)
    return jnp.argmax(shrunk, axis=-1), jnp.argmin(shrunk, axis=-1)


def _shrunk(chart: Chart, strength: Array) -> Array:
    return chart.across / (1 + chart.along * strength[..., None])


@checked
def total_error(
    sums: Float[Array, "4 *batch"], chart: Chart, strength: Array, sides: tuple[Array, Array] | None = None
) -> Array:
    """Σ w·m of pixels with given moments about the eye, through a map of a given strength.

    Args:
        sums: Their moments.
        chart: What the map covers.
        strength: 1/n'.
        sides: The two corners that bound the map's width; those that are farthest apart unless given.
    """
    low = chart.lowest
    # Moments about the chart's lowest line from those about the eye: Σ w(r − low)^j by the binomial theorem.
    about = [
        sums[0],
        sums[1] - low * sums[0],
        sums[2] - low * (2 * sums[1] - low * sums[0]),
        sums[3] - low * (3 * sums[2] - low * (3 * sums[1] - low * sums[0])),
    ]
    # Σ w(1 + uκ)³/z².
    cubic = about[0] + strength * (3 * about[1] + strength * (3 * about[2] + strength * about[3]))
    # Corners projected onto the lowest line: the extremes there bound the trapezium, whose width is w(κ).
    shrunk = _shrunk(chart, strength)
    last, first = widest(chart, strength) if sides is None else sides
    width = (
        jnp.take_along_axis(shrunk, last[..., None], axis=-1) - jnp.take_along_axis(shrunk, first[..., None], axis=-1)
    )[..., 0]
    return width * chart.extent / (1 + chart.extent * strength) / chart.pixel * cubic


@checked
def mean_error(pixels: SeenPixels, near_distance: Annotated[Scalar, MAY_BE_INFINITE]) -> Scalar:
    """Pixels that a texel covers, m_x·m_z at equal resolutions, averaged over the seen pixels by weight.

    Args:
        pixels: The view.
        near_distance: n' of one map around the range that is seen, world units.
    """
    chart = chart_between(pixels, pixels.frustum.near, pixels.frustum.far)
    total = total_error(jnp.sum(moments(pixels), axis=-1), chart, 1 / near_distance)
    return safe_divide(total, jnp.sum(pixels.weight))


__all__ = [
    "STEEPEST",
    "Chart",
    "SeenPixels",
    "chart_between",
    "mean_error",
    "moments",
    "seen_pixels",
    "total_error",
    "widest",
]
