"""A scene drawn with the shadows of one technique."""

from collections.abc import Callable

from shadowjax._checked import checked
from shadowjax._types import Array, Float
from shadowjax.geometry.smoothing import smooth_corner_groups
from shadowjax.presets.names import as_technique
from shadowjax.rays.caster import Caster
from shadowjax.rays.casters import default_caster
from shadowjax.scenes.base import Scene
from shadowjax.scenes.loading import Source, as_scene
from shadowjax.shading import Material, shade, trace_surface, visibility_on
from shadowjax.techniques.base import Technique


@checked
def render(
    scene: Scene | Source,
    technique: str | Technique = "exact",
    width: int = 480,
    height: int = 360,
    resolution: int = 512,
    samples_per_axis: int = 1,
    caster: Caster | None = None,
    material: Material | None = None,
    progress: Callable[[str], None] | None = None,
) -> Float[Array, "height width 3"]:
    """The picture that the scene's camera sees, in the light of all its lights.

    Args:
        scene: A scene, or a name or a file as `load_scene` takes it.
        technique: Makes the shadows: an object, or any name that `make_technique` takes.
        width: Pixels across, ≥ 1.
        height: Pixels down, ≥ 1.
        resolution: Texels along each side of a map, ≥ 1, of a technique that is given by name.
        samples_per_axis: K ≥ 1; each pixel is the mean of K² samples.
        caster: Traces the picture's rays, and those of a technique that is given by name; the fastest if None.
        material: Reflection; the default Material if None.
        progress: Called with the name of each step as it starts.

    Returns:
        sRGB values in [0, 1], row 0 at the top: `shadowjax.io.write_png` writes them.

    Raises:
        ValueError: If a name is wrong, a file cannot be read, or a size is out of range.
    """
    caster = default_caster() if caster is None else caster
    made, scene = as_technique(technique, resolution, caster), as_scene(scene)
    announce = progress or (lambda step: None)
    announce("camera rays")
    groups = smooth_corner_groups(scene.mesh)
    surface = trace_surface(scene.mesh, scene.camera, width, height, caster, groups, samples_per_axis)
    announce(f"shadows by {technique if isinstance(technique, str) else made.parts}")
    visibilities = tuple(visibility_on(surface, made.build(scene.mesh, one, scene.camera)) for one in scene.lights)
    return shade(surface, scene.lights, visibilities, material, samples_per_axis)


__all__ = ["render"]
