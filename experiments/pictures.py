"""What the picture experiments share: a scene with one depth map, close-ups of it, and every filter over that map."""

from collections.abc import Sequence
from dataclasses import dataclass

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from shadowjax import scenes
from shadowjax._checks import require, require_int
from shadowjax.evaluate.metrics import rmse
from shadowjax.filters.base import Filter
from shadowjax.filters.hard import Hard
from shadowjax.geometry.camera import Camera
from shadowjax.geometry.smoothing import smooth_corner_groups
from shadowjax.rays.casters import default_caster
from shadowjax.shading import Surface, shade, trace_surface, valid_receivers, visibility_on
from shadowjax.techniques.base import Shadows
from shadowjax.techniques.exact import Exact
from shadowjax.techniques.shadow_mapping import ShadowMapping
from shadowjax.theory.tones import count_tones

Image = Float[np.ndarray, "rows cols"]
Mask = Bool[np.ndarray, "rows cols"]


@dataclass(frozen=True)
class CloseUp:
    """A part of the picture, seen again with more pixels.

    Attributes:
        x: Its middle, as a share of the picture's width from the left, in [0, 1].
        y: Its middle, as a share of the picture's height from the top, in [0, 1].
        size: Its height as a share of the picture's, in (0, 1].
    """

    x: float
    y: float
    size: float


@dataclass(frozen=True)
class View:
    """What one camera sees: the surface, where visibility matters, and the exact answer."""

    surface: Surface
    valid: Mask
    exact: Image


class Stage:
    """A scene, its depth map, and the views and filters asked for; the map is cast once."""

    def __init__(self, name: str, num_triangles: int, resolution: int):
        scene = scenes.make_scene(name, num_triangles, jnp.float32)
        self.mesh, self.camera, self.light = scene.mesh, scene.camera, scene.lights[0]
        self.caster = default_caster()
        self.smooth = smooth_corner_groups(scene.mesh)
        self.exact = Exact(self.caster).build(self.mesh, self.light, self.camera)
        self.hard = ShadowMapping(Hard(), resolution, caster=self.caster).build(self.mesh, self.light, self.camera)

    def view(self, width: int, height: int, part: CloseUp | None = None) -> View:
        """The whole picture, or a close-up of it, with its exact shadows."""
        camera = self.camera if part is None else close_up(self.camera, part)
        surface = trace_surface(self.mesh, camera, width, height, self.caster, self.smooth)
        valid = np.asarray(_valid(surface, self.light))
        return View(surface, valid, np.asarray(visibility_on(surface, self.exact)))

    def shadows(self, filter_: Filter) -> Shadows:
        """A filter over the one map, with the bias that frees a plane of acne for it, as `ShadowMapping` takes."""
        return self.hard.with_filter(filter_)

    def visibility(self, filter_: Filter, view: View) -> Image:
        """Visibility of every pixel of a view."""
        return np.asarray(visibility_on(view.surface, self.shadows(filter_)))

    def shaded(self, view: View, visibility: Image) -> Float[np.ndarray, "rows cols 3"]:
        """The picture with these shadows, sRGB."""
        return np.asarray(shade(view.surface, (self.light,), (jnp.asarray(visibility),)))


# Compiled as wholes; step by step they would be dozens of small programs.
_valid = eqx.filter_jit(valid_receivers)
_rmse = eqx.filter_jit(rmse)


def close_up(camera: Camera, part: CloseUp) -> Camera:
    """A camera in the same place that looks at a part of the picture only."""
    across, up = camera.half_size * jnp.asarray([2 * part.x - 1, 1 - 2 * part.y], camera.near.dtype)
    direction = across * camera.right + up * camera.up + camera.forward
    return Camera.look_at(
        camera.position, camera.position + direction, camera.up, phi_y=jnp.arctan(jnp.tan(camera.phi_y) * part.size),
        aspect=camera.aspect, near=camera.near, far=camera.far, dtype=jnp.float32,
    )  # fmt: skip


def difference(a: Image, b: Image, valid: Mask) -> float:
    """Root mean square difference of two visibilities over valid receivers."""
    return float(_rmse(a, b, valid))


def tone_count(visibility: Image, valid: Mask) -> int:
    """Distinct visibilities of valid receivers."""
    return count_tones(visibility, valid)


def soft_share(visibility: Image, valid: Mask) -> float:
    """Share of valid receivers with a tone between lit and dark."""
    between = (visibility > 1e-4) & (visibility < 1 - 1e-4)
    return float((between & valid).sum() / max(valid.sum(), 1))


def lit_steps(visibility: Image, filter_: Filter) -> bool:
    """Whether every visibility is a whole number of lit tests over nk."""
    num_tests = (filter_.num_tones or 1) - 1
    scaled = np.asarray(visibility, float) * num_tests
    return bool(np.abs(scaled - np.round(scaled)).max() < 1e-4)


def check_pictures(
    scene: str,
    num_triangles: int,
    resolution: int,
    width: int,
    height: int,
    detail_width: int,
    *details: Sequence[float],
) -> None:
    """ValueError unless scene, sizes and details of a picture experiment make sense."""
    low, high = scenes.family(scene).min_triangles, scenes.family(scene).max_triangles
    require(low <= num_triangles <= high, f"num_triangles must lie between {low} and {high}; got {num_triangles}")
    require_int(resolution, "resolution", 1)
    require_int(width, "width", 16)
    require_int(height, "height", 12)
    require_int(detail_width, "detail_width", 16)
    for x, y, size in details:
        inside = 0 <= x <= 1 and 0 <= y <= 1 and 0 < size <= 1
        require(inside, f"a detail is [x, y, height], shares of the picture in [0, 1]; got {[x, y, size]}")
