"""From names and flags to a scene: built-in or loaded, under the light and before the camera asked for."""

import math

from shadowjax import scenes
from shadowjax._checks import require, require_choice, require_memory
from shadowjax.cli.options import PictureOptions, SceneOptions
from shadowjax.scenes import staging
from shadowjax.scenes.base import Scene
from shadowjax.scenes.lights import LIGHTS
from shadowjax.scenes.loading import load_scene

# By `command time -v shadowjax render plate-over-plane --technique hard`: the resident memory grows by 246 bytes a ray
# from 512² to 1024² pixels of 2 × 2 samples, and by 20 bytes a texel from maps of 1024² to 2048². Others take more.
BYTES_PER_RAY, BYTES_PER_TEXEL = 246, 20


def open_scene(name: str, setting: SceneOptions, picture: PictureOptions) -> Scene:
    """The scene that a command works on.

    Args:
        name: A key of the registry of scenes, or a mesh file.
        setting: Light, camera and surroundings.
        picture: Gives the aspect of the camera.

    Raises:
        ValueError: If there is no such scene or file, or an option is out of range or does not apply.
    """
    _check_memory(picture)
    require_choice(setting.light, "--light", LIGHTS)
    direction = _direction(setting)
    is_built_in = name in scenes.SCENES
    if is_built_in:
        require(
            setting.ground and setting.up == "auto",
            f"--no-ground and --up are for mesh files; {name} is a built-in scene with its own ground",
        )
        scene = load_scene(name, num_triangles=setting.num_triangles)
    else:
        up = None if setting.up == "auto" else setting.up
        scene = load_scene(name, up=up, ground=setting.ground, light_direction=direction)
        require(
            setting.num_triangles is None,
            f"--num-triangles is for built-in scenes; {name} has the triangles of its file",
        )
    other = setting.light != "directional" or setting.light_position is not None
    if other or (is_built_in and direction is not None):
        scene = staging.relit(scene, setting.light, direction, setting.light_position)
    return _before_camera(scene, setting, picture)


def _check_memory(picture: PictureOptions) -> None:
    """Refuse at once what cannot fit: sizes are within their limits each, and their product may still be too much."""
    rays = picture.width * picture.height * picture.samples**2
    shown = f"a picture of {picture.width} × {picture.height} pixels with {picture.samples} × {picture.samples} samples"
    require_memory(rays * BYTES_PER_RAY, shown, "a smaller --width, --height or --samples")
    require_memory(picture.resolution**2 * BYTES_PER_TEXEL, f"a map of {picture.resolution}²", "a smaller --resolution")


def _direction(setting: SceneOptions) -> tuple[float, float, float] | None:
    """The way the light travels, as asked for; None where it was not."""
    angles = (setting.light_azimuth_deg, setting.light_elevation_deg)
    if angles == (None, None):
        return setting.light_direction
    require(
        setting.light_direction is None,
        "give the light either by --light-direction or by --light-azimuth-deg and --light-elevation-deg, not by both",
    )
    azimuth = staging.LIGHT_AZIMUTH_DEG if angles[0] is None else angles[0]
    elevation = staging.LIGHT_ELEVATION_DEG if angles[1] is None else angles[1]
    return staging.direction_of(azimuth, elevation)


def _before_camera(scene: Scene, setting: SceneOptions, picture: PictureOptions) -> Scene:
    phi = setting.phi_deg
    return staging.viewed(
        scene,
        picture.width / picture.height,
        position=setting.camera_position,
        target=setting.camera_target,
        phi_y=None if phi is None else math.radians(phi),
        near=setting.near,
        far=setting.far,
    )
