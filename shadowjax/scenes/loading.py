"""Scenes by name or from files: a mesh on a ground, before a camera, in a sun, each of which can be another one."""

import os
from collections.abc import Sequence
from pathlib import Path

import equinox as eqx

from shadowjax._checked import checked
from shadowjax._checks import require
from shadowjax._printable import printable
from shadowjax.geometry.camera import Camera
from shadowjax.geometry.light import Light
from shadowjax.geometry.mesh import Mesh
from shadowjax.geometry.mesh_files import load
from shadowjax.scenes import staging
from shadowjax.scenes.base import Scene
from shadowjax.scenes.registry import SCENES, family, make_scene

Source = str | os.PathLike[str] | Mesh


@checked
def load_scene(
    source: Source,
    *,
    up: str | None = None,
    ground: bool | None = None,
    light: Light | Sequence[Light] | None = None,
    light_direction: Sequence[float] | None = None,
    camera: Camera | None = None,
    num_triangles: int | None = None,
) -> Scene:
    """A scene from a mesh file, a mesh, or the name of a built-in scene.

    A mesh gets a ground plane under its lowest point, a sun from the front left, and a camera that holds it and its
    shadow; everything is a multiple of the mesh's own size. Each can be replaced here, or later by
    `dataclasses.replace(scene, camera=…)`.

    Args:
        source: OBJ, PLY, STL, GLB or another mesh file; a mesh; or a key of `SCENES`, which a file of that name does
            not hide.
        up: The mesh's up axis, "y" or "z"; None takes z for STL and y for the rest. Not for built-in scenes.
        ground: Whether a mesh gets its plane (None: it does). Not for built-in scenes.
        light: One light or several in place of the scene's, in the mesh's own coordinates (`Mesh.origin`).
        light_direction: The way a sun travels, in the scene's axes, any length > 0, in place of the scene's light.
        camera: In place of the scene's, in the mesh's own coordinates.
        num_triangles: About how many triangles a built-in scene gets. Not for meshes.

    Raises:
        ValueError: If there is no such file or scene, the file holds no mesh that can be read, or an argument does not
            apply.
    """
    require(
        light is None or light_direction is None, "give the light either as light or as light_direction, not as both"
    )
    name = None if isinstance(source, Mesh) else os.fspath(source)
    if name is not None and name in SCENES:
        require(up is None and ground is None, f"up and ground are for meshes; {name} is a built-in scene with its own")
        scene = make_scene(name, num_triangles)
        if light_direction is not None:
            scene = staging.relit(scene, "directional", light_direction)
    else:
        scene = _staged(source, up, ground is not False, light_direction, num_triangles)
    if light is not None:
        lights = (light,) if isinstance(light, Light) else tuple(light)
        require(len(lights) > 0, "a scene needs at least one light; got none")
        scene = eqx.tree_at(lambda s: s.lights, scene, lights)
    return scene if camera is None else eqx.tree_at(lambda s: s.camera, scene, camera)


def _staged(
    source: Source, up: str | None, ground: bool, light_direction: Sequence[float] | None, num_triangles: int | None
) -> Scene:
    """A scene round a mesh, from a file or not."""
    if isinstance(source, Mesh):
        mesh, name, turned = source, "mesh", "y"
    else:
        path = Path(source)
        if not path.exists() and not path.suffix and path.name == os.fspath(source):
            try:
                family(path.name)
            except ValueError as error:
                raise ValueError(f"{error}; nor is there a mesh file of that name") from None
        mesh, name, turned = load(path), printable(path.name), "z" if path.suffix.lower() == ".stl" else "y"
    require(num_triangles is None, f"num_triangles is for built-in scenes; {name} has the triangles of its own")
    return staging.stage(mesh, name, up=turned if up is None else up, ground=ground, light_direction=light_direction)


@checked
def as_scene(scene: Scene | Source) -> Scene:
    """A scene that is given as one, or as `load_scene` takes it.

    Raises:
        ValueError: As `load_scene`.
    """
    return scene if isinstance(scene, Scene) else load_scene(scene)


__all__ = ["Source", "as_scene", "load_scene"]
