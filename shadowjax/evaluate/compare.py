"""Techniques against the exact shadow, one record each: error, tones, memory and time. Nothing is drawn here."""

import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from scipy import ndimage

from shadowjax._checked import Checked, checked
from shadowjax._checks import require, require_int, warn
from shadowjax._numerics import dot, safe_divide, safe_sqrt
from shadowjax._types import Array, Bool, Float
from shadowjax.evaluate import metrics
from shadowjax.evaluate.records import Record, Table
from shadowjax.evaluate.slope_limits import SlopeLimit, slope_limit, told
from shadowjax.geometry.smoothing import smooth_corner_groups
from shadowjax.presets.names import Techniques, as_techniques
from shadowjax.rays.caster import Caster
from shadowjax.rays.casters import default_caster
from shadowjax.scenes.base import Scene
from shadowjax.scenes.loading import Source, as_scene
from shadowjax.shading import Surface, downsample, trace_surface, valid_receivers, visibility_on
from shadowjax.techniques.base import Shadows, Technique
from shadowjax.techniques.exact import Exact
from shadowjax.theory.tones import count_tones

Progress = Callable[[str], None]

# Pixels between the umbra, where light is bleeding, and the exact shadow's edge, where it may be blur.
EDGE_MARGIN = 4


class View(Checked):
    """What a camera sees of a scene, where shadows matter there, and the reference visibility.

    Attributes:
        surface: Every sample of the picture.
        valid: Samples that face the light and lie in its cone.
        exact: Visibility of every sample by shadow rays.
        cosine: Cosine of the light's incidence at every sample, 0 where no shadow counts.
        samples_per_axis: K; each pixel has K² samples.
    """

    surface: Surface
    valid: Bool[Array, "rows cols"]
    exact: Float[Array, "rows cols"]
    cosine: Float[Array, "rows cols"]
    samples_per_axis: int = eqx.field(static=True)

    def per_pixel(self, values: Float[Array, "rows cols"]) -> Float[Array, "height width"]:
        """Mean of a quantity over the valid samples of every pixel; 0 where there are none."""
        weight = self.valid.astype(values.dtype)
        summed = downsample(values * weight, self.samples_per_axis)
        return summed / jnp.maximum(downsample(weight, self.samples_per_axis), jnp.finfo(values.dtype).tiny)

    @property
    def pixel_mask(self) -> Bool[Array, "height width"]:
        """Pixels with at least one valid sample."""
        return downsample(self.valid.astype(self.exact.dtype), self.samples_per_axis) > 0


@checked
@dataclass(frozen=True)
class Comparison:
    """Everything that a comparison made.

    Args:
        scene: What was looked at.
        view: The view, with the exact shadow.
        techniques: By name, in the order asked for.
        records: One for each technique.
        shadows: What each technique built.
        visibilities: Visibility of every sample, one array for each technique.
    """

    scene: Scene
    view: View
    techniques: dict[str, Technique]
    records: tuple[Record, ...]
    shadows: tuple[Shadows, ...]
    visibilities: tuple[Float[Array, "rows cols"], ...]

    @property
    def names(self) -> tuple[str, ...]:
        """Techniques in the order asked for."""
        return tuple(self.techniques)

    @property
    def table(self) -> Table:
        """The records alone."""
        return Table(self.records, self.scene.name)


@checked
def timed(function: Callable[[], Any], repeats: int = 3) -> tuple[Any, float]:
    """Result and warm time of a function: one call to compile, then the median of `repeats` calls.

    Args:
        function: Called without arguments; its arrays are waited for.
        repeats: Calls that are timed, ≥ 1.

    Returns:
        The result of the last call, and milliseconds.
    """
    result = jax.block_until_ready(function())
    times = []
    for _ in range(require_int(repeats, "repeats", 1)):
        start = time.perf_counter()
        result = jax.block_until_ready(function())
        times.append(1e3 * (time.perf_counter() - start))
    return result, statistics.median(times)


@checked
def reference_view(
    scene: Scene, width: int, height: int, caster: Caster | None = None, samples_per_axis: int = 1
) -> View:
    """Trace the camera's rays and find the exact shadow of the scene's first light.

    Args:
        scene: Mesh, camera and lights.
        width: Pixels across, ≥ 1.
        height: Pixels down, ≥ 1.
        caster: Traces all rays; the default caster if None.
        samples_per_axis: K ≥ 1; each pixel gets K² samples.

    Raises:
        ValueError: If no surface in view faces the light.
    """
    caster = default_caster() if caster is None else caster
    light = scene.lights[0]
    groups = smooth_corner_groups(scene.mesh)
    surface = trace_surface(scene.mesh, scene.camera, width, height, caster, groups, samples_per_axis)
    valid = valid_receivers(surface, light)
    require(
        bool(jnp.any(valid)),
        "no surface in the picture faces the light, so there is no shadow to compare; turn the camera or the light",
    )
    exact = Exact(caster).build(scene.mesh, light, scene.camera)
    cosine = jnp.where(valid, dot(surface.normals, light.to_light(surface.points)[0]), 0)
    return View(surface, valid, visibility_on(surface, exact), cosine, samples_per_axis)


@checked
def measure(
    scene: Scene | Source,
    techniques: Techniques,
    width: int = 480,
    height: int = 360,
    resolution: int = 512,
    samples_per_axis: int = 1,
    caster: Caster | None = None,
    repeats: int = 3,
    progress: Progress | None = None,
    view: View | None = None,
) -> Comparison:
    """Run techniques on the scene's first light and measure each against shadow rays.

    Errors are those of pixels: the mean visibility of a pixel's valid samples against the exact mean. Tones are counted
    among samples, before they are averaged.

    Args:
        scene: A scene, or a name or a file as `load_scene` takes it.
        techniques: Names, objects, or a mapping from names of one's own to either, each once (`as_techniques`).
        width: Pixels across, ≥ 1.
        height: Pixels down, ≥ 1.
        resolution: Texels along each side of a map, ≥ 1, of techniques that are given by name; objects have their own.
        samples_per_axis: K ≥ 1; each pixel gets K² samples.
        caster: Traces the picture's rays, and those of techniques that are given by name; the default caster if None.
        repeats: Timed calls of each step, ≥ 1.
        progress: Called with the name of each step as it starts.
        view: From `reference_view` with the same scene, if it is at hand; sizes and samples are then the view's.

    Raises:
        ValueError: If a name is wrong or given twice, a size is out of range, or nothing in view faces the light.
    """
    caster = default_caster() if caster is None else caster
    chosen, scene = as_techniques(techniques, resolution, caster), as_scene(scene)
    announce = progress or (lambda step: None)
    if view is None:
        announce("exact shadow")
        view = reference_view(scene, width, height, caster, samples_per_axis)
    records, built, visibilities = [], [], []
    for name, technique in chosen.items():
        announce(name)
        shadows, build_ms = timed(lambda t=technique: t.build(scene.mesh, scene.lights[0], scene.camera), repeats)
        visibility, visibility_ms = timed(lambda s=shadows: visibility_on(view.surface, s), repeats)
        records.append(record(name, technique, shadows, visibility, view, build_ms, visibility_ms))
        built.append(shadows)
        visibilities.append(visibility)
    return Comparison(scene, view, chosen, tuple(records), tuple(built), tuple(visibilities))


@checked
def compare(scene: Scene | Source, techniques: Techniques, **options: Any) -> Table:
    """A table with one record for each technique, against the exact shadow of every pixel.

    Args:
        scene: A scene, or a name or a file as `load_scene` takes it.
        techniques: Names, objects, or a mapping from names of one's own to either, each once.
        options: Further arguments of `measure`: width, height, resolution, samples_per_axis, caster, repeats,
            progress, view.

    Raises:
        ValueError: As `measure`.

    Warns:
        SceneWarning: Where the limit of the slope bias leaves acne, with the remedy.
    """
    table = measure(scene, techniques, **options).table
    said = told([(one.technique, one.slope_limit) for one in table])
    if said is not None:
        warn(said)
    return table


@checked
def record(
    name: str,
    technique: Technique,
    shadows: Shadows,
    visibility: Float[Array, "rows cols"],
    view: View,
    build_ms: float,
    visibility_ms: float,
) -> Record:
    """The record of visibilities that a technique gave for a view.

    Args:
        name: Of the technique.
        technique: Gives the bound on tones.
        shadows: Gives the bytes.
        visibility: Of every sample.
        view: With the reference visibility.
        build_ms: Measured elsewhere.
        visibility_ms: Measured elsewhere.
    """
    # Leaks and acne are counted away from edges of the reference, where no filter's blur reaches.
    far = _away_from_edges(np.asarray(view.per_pixel(view.exact)), np.asarray(view.pixel_mask))
    # Light that arrives at pixels: by the technique, by the reference, and without any shadow.
    arriving = [downsample(view.cosine * value, view.samples_per_axis) for value in (visibility, view.exact, 1.0)]
    wrong, power = jnp.sum((arriving[0] - arriving[1]) ** 2), jnp.sum(arriving[2] ** 2)
    test, truth, mask = view.per_pixel(visibility), view.per_pixel(view.exact), view.pixel_mask
    return Record(
        technique=name,
        rmse=float(metrics.rmse(test, truth, mask)),
        mean_abs_error=float(metrics.mean_abs_error(test, truth, mask)),
        false_lit=float(metrics.false_lit(test, truth, mask)),
        false_shadow=float(metrics.false_shadow(test, truth, mask)),
        tones=count_tones(np.asarray(visibility), np.asarray(view.valid)),
        tones_bound=technique.num_tones,
        map_bytes=shadows.map_bytes,
        build_ms=build_ms,
        visibility_ms=visibility_ms,
        psnr=float(metrics.psnr(test, truth, mask)),
        ssim=float(metrics.ssim(test, truth, mask)) if min(test.shape) >= metrics.SSIM_WIDTH else None,
        edge_distance=metrics.edge_distance(np.asarray(test), np.asarray(truth), np.asarray(mask)).mean,
        light_rmse=float(safe_sqrt(safe_divide(wrong, power))),
        bleed=_mean_where(np.asarray(test), far & (np.asarray(truth) <= 0)),
        acne=_mean_where(1 - np.asarray(test), far & (np.asarray(truth) >= 1)),
        flip=metrics.flip(jnp.where(mask, test, 1), jnp.where(mask, truth, 1)),
        texture_bytes=shadows.texture_bytes,
        volume_bytes=shadows.volume_bytes(view.exact.size),
        slope_limit=_slope_limit(shadows, view),
    )


def _slope_limit(shadows: Shadows, view: View) -> SlopeLimit | None:
    surface = view.surface
    points, normals = surface.points.reshape(-1, 3), surface.normals.reshape(-1, 3)
    flags = ((view.exact > 0).reshape(-1), view.valid.reshape(-1))
    return slope_limit(shadows, points, normals, surface.face.reshape(-1), *flags)


def _away_from_edges(truth: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """Valid pixels with no pixel of another answer, and no border of the mask, within `EDGE_MARGIN`."""
    same = np.ones_like(mask)
    for extreme in (ndimage.minimum_filter, ndimage.maximum_filter):
        same &= extreme(np.where(mask, truth, -1.0), 2 * EDGE_MARGIN + 1, mode="nearest") == truth
    return same & mask


def _mean_where(values: np.ndarray, where: np.ndarray) -> float:
    return float(values[where].mean()) if where.any() else 0.0
