"""Phong shading of what a camera sees, with shadows from any technique; the record of its passes."""

from typing import Annotated

import equinox as eqx
import jax.numpy as jnp

from shadowjax._checked import Checked, checked
from shadowjax._checks import NOT_NEGATIVE, POSITIVE, UNIT_INTERVAL, require, require_int, warn, without_tracers
from shadowjax._numerics import dot, faces_light, map_in_chunks, normalize
from shadowjax._types import Array, Bool, Float, Int, Points
from shadowjax.geometry.camera import Camera
from shadowjax.geometry.light import Light
from shadowjax.geometry.mesh import Mesh
from shadowjax.geometry.smoothing import corner_normals
from shadowjax.rays.caster import Caster
from shadowjax.rays.casters import default_caster
from shadowjax.rays.precision import warn_of_coarse_pixels
from shadowjax.rays.ray import surface_points
from shadowjax.rays.ray_grid import camera_grid
from shadowjax.techniques.base import Shadows

# Receivers looked up together: bounds memory, large enough that loops cost nothing.
RECEIVER_CHUNK = 1 << 18
# The same for techniques that take images, which need fewer bytes for each receiver.
IMAGE_CHUNK = 1 << 22


class Surface(Checked):
    """What a camera sees through every pixel (or every sample of it).

    Attributes:
        points: World positions; the camera's position where nothing is seen.
        normals: Unit geometric normals, turned to the camera.
        shading_normals: Unit smooth normals, turned to the camera.
        albedo: Linear reflectance.
        to_camera: Unit direction to the camera.
        depth: Distance from the camera, world units.
        face: Triangle seen, -1 for background.
    """

    points: Float[Array, "rows cols 3"]
    normals: Float[Array, "rows cols 3"]
    shading_normals: Float[Array, "rows cols 3"]
    albedo: Float[Array, "rows cols 3"]
    to_camera: Float[Array, "rows cols 3"]
    depth: Float[Array, "rows cols"]
    face: Int[Array, "rows cols"]

    @property
    def is_seen(self) -> Bool[Array, "rows cols"]:
        """True where a surface is seen."""
        return self.face >= 0


class Material(Checked):
    """How surfaces reflect, and the light that comes from everywhere.

    Attributes:
        ambient: Fraction of the albedo seen without any light, in [0, 1].
        specular: Strength of the highlight, ≥ 0.
        shininess: Phong exponent, > 0.
    """

    ambient: Annotated[float, UNIT_INTERVAL] = 0.22
    specular: Annotated[float, NOT_NEGATIVE] = 0.12
    shininess: Annotated[float, POSITIVE] = 24.0


@checked
def trace_surface(
    mesh: Mesh,
    camera: Camera,
    width: int,
    height: int,
    caster: Caster | None = None,
    smooth_groups: Int[Array, "faces 3"] | None = None,
    samples_per_axis: int = 1,
) -> Surface:
    """Cast the camera's rays and look up what they hit.

    Args:
        mesh: The scene.
        camera: The viewer.
        width: Pixels across, ≥ 1.
        height: Pixels down, ≥ 1.
        caster: Traces the rays; the fastest if None.
        smooth_groups: From `geometry.smoothing.smooth_corner_groups`; flat shading if None.
        samples_per_axis: K; each pixel gets K² samples on a regular grid, ≥ 1.

    Returns:
        The surface, of shape (K·height, K·width).

    Warns:
        SceneWarning: If what is seen lies so far from the origin of coordinates that rounding takes up half a pixel.
    """
    samples = require_int(samples_per_axis, "samples_per_axis", 1)
    sizes = require_int(width, "width", 1) * samples, require_int(height, "height", 1) * samples
    surface = _traced(mesh, camera, *sizes, default_caster() if caster is None else caster, smooth_groups)
    warn_of_coarse_pixels(mesh, camera, height, surface.points, surface.is_seen)
    return surface


@eqx.filter_jit
def _traced(
    mesh: Mesh, camera: Camera, width: int, height: int, caster: Caster, smooth_groups: Int[Array, "faces 3"] | None
) -> Surface:
    grid = camera_grid(camera, width, height)
    hit = caster.closest_on_grid(mesh, grid)
    rays = grid.rays()
    seen = hit.is_hit
    index = jnp.where(seen, hit.face, 0)
    to_camera = -rays.directions

    def turned(normals: Points) -> Points:
        away = dot(normals, geometric) < 0
        return jnp.where(away[..., None], -normals, normals)

    geometric = mesh.face_normals()[index]
    geometric = jnp.where((dot(geometric, to_camera) < 0)[..., None], -geometric, geometric)
    if smooth_groups is None:
        shading = geometric
    else:
        corners = corner_normals(mesh, smooth_groups)[index]
        shading = turned(normalize(jnp.sum(hit.barycentrics[..., None] * corners, axis=-2)))
    points = surface_points(mesh, rays, hit)
    return Surface(points, geometric, shading, mesh.face_colors[index], to_camera, hit.depth, hit.face)


@checked
@eqx.filter_jit
def visibility_on(surface: Surface, shadows: Shadows) -> Float[Array, "rows cols"]:
    """Visibility of every sample of a surface; background counts as lit.

    Works in chunks, so that memory stays bounded for large images: bands of rows for techniques that prefer images,
    else lists.
    """
    receivers = (surface.points, surface.normals, surface.face)
    if shadows.prefers_images:
        rows = max(1, IMAGE_CHUNK // max(1, surface.face.shape[1]))
        value = map_in_chunks(lambda band: shadows.visibility_of(*band), receivers, rows)
        return jnp.where(surface.is_seen, value, 1.0)
    flat = (surface.points.reshape(-1, 3), surface.normals.reshape(-1, 3), surface.face.reshape(-1))
    value = map_in_chunks(lambda chunk: shadows.visibility_of(*chunk), flat, RECEIVER_CHUNK)
    return jnp.where(surface.is_seen, value.reshape(surface.face.shape), 1.0)


@checked
def valid_receivers(surface: Surface, light: Light) -> Bool[Array, "rows cols"]:
    """Where visibility matters: a surface is seen, faces the light by more than rounding, and lies in its cone."""
    to_light, _ = light.to_light(surface.points)
    return surface.is_seen & faces_light(surface.normals, to_light) & (light.covers(surface.points) > 0)


@checked
def phong(
    surface: Surface, light: Light, visibility: Float[Array, "rows cols"], material: Material
) -> Float[Array, "rows cols 3"]:
    """Diffuse and specular light of one source that leaves the surface towards the camera, linear RGB.

    The highlight takes the mirror direction of the classical Phong model and vanishes with the diffuse term, also where
    that is no more than rounding.
    """
    to_light, _ = light.to_light(surface.points)
    cosine = jnp.maximum(dot(surface.shading_normals, to_light), 0.0)
    # The direction to the light mirrored at the normal: 2(n·l)n − l.
    mirrored = 2 * cosine[..., None] * surface.shading_normals - to_light
    highlight = jnp.maximum(dot(mirrored, surface.to_camera), 0.0) ** material.shininess
    highlight = (
        jnp.where(faces_light(surface.shading_normals, to_light), highlight, jnp.zeros_like(highlight))
        * material.specular
    )
    arriving = light.radiance(surface.points) * visibility[..., None]
    return arriving * (surface.albedo * cosine[..., None] + highlight[..., None])


UNLIT = (
    "no surface that is seen faces the light, so all of it is dark and no number has a gradient: "
    "DirectionalLight.create takes the direction in which light travels; give the direction to the sun as towards=, or "
    "turn the receiver round"
)


@checked
def warn_where_unlit(surface: Surface, light: Light) -> None:
    """Warn (`SceneWarning`) where nothing that is seen can be lit, under `grad` too; silent under `jit` and `vmap`."""
    known = without_tracers((surface, light))
    if known is not None:
        seen, faces = _seen_and_facing(*known)
        if seen and not faces:
            warn(UNLIT)


@eqx.filter_jit
def _seen_and_facing(surface: Surface, light: Light) -> tuple[Bool[Array, ""], Bool[Array, ""]]:
    to_light, _ = light.to_light(surface.points)
    return jnp.any(surface.is_seen), jnp.any(surface.is_seen & faces_light(surface.normals, to_light))


@checked
def shade(
    surface: Surface,
    lights: tuple[Light, ...],
    visibilities: tuple[Float[Array, "rows cols"], ...],
    material: Material | None = None,
    samples_per_axis: int = 1,
) -> Float[Array, "height width 3"]:
    """The picture: ambient light and every source's Phong term over a sky gradient, averaged over samples, in sRGB.

    Args:
        surface: From `trace_surface`.
        lights: The sources.
        visibilities: One for each light, of the surface's shape.
        material: Reflection; the default Material if None.
        samples_per_axis: As given to `trace_surface`.

    Returns:
        sRGB values in [0, 1], row 0 at the top.

    Raises:
        ValueError: If lights and visibilities do not match.

    Warns:
        SceneWarning: If no surface that is seen faces a light.
    """
    require(
        len(lights) == len(visibilities),
        f"shade needs one of visibilities for each of lights; got {len(visibilities)} for {len(lights)} lights",
    )
    for light in lights:
        warn_where_unlit(surface, light)
    return _shaded(surface, lights, visibilities, Material() if material is None else material, samples_per_axis)


@eqx.filter_jit
def _shaded(
    surface: Surface,
    lights: tuple[Light, ...],
    visibilities: tuple[Float[Array, "rows cols"], ...],
    material: Material,
    samples_per_axis: int,
) -> Float[Array, "height width 3"]:
    dtype = surface.albedo.dtype
    # A sky-lit scene: upward normals see a cool sky, downward ones the warm ground.
    skyward = (0.5 + 0.5 * surface.shading_normals[..., 1])[..., None]
    sky, earth = jnp.asarray([0.93, 0.97, 1.06], dtype), jnp.asarray([0.86, 0.80, 0.74], dtype)
    color = surface.albedo * material.ambient * (skyward * sky + (1 - skyward) * earth)
    for light, visibility in zip(lights, visibilities, strict=True):
        color = color + phong(surface, light, visibility, material)
    rows = jnp.linspace(0.0, 1.0, surface.face.shape[0], dtype=dtype)[:, None, None]
    top, bottom = jnp.asarray([0.60, 0.69, 0.80], dtype), jnp.asarray([0.90, 0.91, 0.91], dtype)
    color = jnp.where(surface.is_seen[..., None], color, top + (bottom - top) * rows)
    return to_srgb(downsample(color, samples_per_axis))


@checked
def downsample(image: Float[Array, "rows cols *rest"], samples_per_axis: int) -> Float[Array, "height width *rest"]:
    """Mean over blocks of K × K samples."""
    if samples_per_axis == 1:
        return image
    rows, cols = image.shape[0] // samples_per_axis, image.shape[1] // samples_per_axis
    blocks = image.reshape(rows, samples_per_axis, cols, samples_per_axis, *image.shape[2:])
    return jnp.mean(blocks, axis=(1, 3))


@checked
def to_srgb(linear: Float[Array, "*shape"]) -> Float[Array, "*shape"]:
    """Linear light to sRGB code values in [0, 1], with a soft shoulder above 0.8 instead of clipping.

    Source: IEC 61966-2-1 for the transfer curve.
    """
    knee = 0.8
    over = jnp.maximum(linear - knee, 0.0)
    # Beyond the knee x ↦ knee + r·x/(x + r) with r = 1 − knee: slope 1 at the knee, value 1 at infinity.
    soft = jnp.where(linear > knee, knee + (1 - knee) * over / (over + (1 - knee)), jnp.maximum(linear, 0.0))
    safe = jnp.maximum(soft, 0.0031308)
    return jnp.where(soft <= 0.0031308, 12.92 * soft, 1.055 * safe ** (1 / 2.4) - 0.055)
