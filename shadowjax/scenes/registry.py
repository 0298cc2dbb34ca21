"""The registry of built-in scenes: one small file a family."""

import difflib

from shadowjax._checked import checked
from shadowjax._checks import require, require_int
from shadowjax._types import DType, astype
from shadowjax.scenes import (
    avenue,
    cad_assembly,
    colonnade,
    comb,
    cubes,
    curved_bodies,
    fence,
    geodesic_sphere,
    plant,
    plate_over_plane,
    recursive_tetrahedron,
    rubble,
    smooth_and_abrupt,
    solids,
    sphere_over_plane,
    terrain,
    two_plates,
)
from shadowjax.scenes.base import Scene, SceneFamily

_FAMILIES = [
    smooth_and_abrupt.FAMILY, plant.FAMILY, rubble.FAMILY, fence.FAMILY, curved_bodies.FAMILY,
    cad_assembly.FAMILY, colonnade.FAMILY, avenue.FAMILY, terrain.FAMILY,
    geodesic_sphere.FAMILY, solids.FAMILY, recursive_tetrahedron.FAMILY, cubes.FAMILY,
    plate_over_plane.FAMILY, two_plates.FAMILY, comb.FAMILY, sphere_over_plane.FAMILY,
]  # fmt: skip
SCENES: dict[str, SceneFamily] = {family.name: family for family in _FAMILIES}


@checked
def family(name: str) -> SceneFamily:
    """The family of that name.

    Raises:
        ValueError: If there is none; the message names the nearest ones.
    """
    if name not in SCENES:
        near = difflib.get_close_matches(str(name), SCENES, n=3, cutoff=0.4)
        hint = f"did you mean {' or '.join(near)}?" if near else f"the scenes are {', '.join(SCENES)}"
        raise ValueError(f"no scene is called {name!r}; {hint}")
    return SCENES[name]


@checked
def make_scene(name: str, num_triangles: int | None = None, dtype: DType | None = None) -> Scene:
    """Build a scene of the registry; the same arguments always give the same scene.

    Args:
        name: A key of `SCENES`.
        num_triangles: About how many triangles to make; the family's default if None. The result lies within a factor
            2 of the wish.
        dtype: Floating dtype of every array; JAX's default if None.

    Returns:
        Mesh, camera and lights, in metres with y up.

    Raises:
        ValueError: If the name is unknown, or the number lies outside the family's range.
    """
    chosen = family(name)
    wish = chosen.default_triangles if num_triangles is None else require_int(num_triangles, "num_triangles", 1)
    low, high = chosen.min_triangles, chosen.max_triangles
    allowed = f"between {low} and {high}" if chosen.scales else f"left out or {low}: this scene has one size"
    require(low <= wish <= high, f"num_triangles of scene {name!r} must be {allowed}; got {wish}")
    mesh, camera, lights = chosen.build(wish)
    scene = Scene(mesh, camera, lights, chosen.name, chosen.description)
    return scene if dtype is None else astype(scene, dtype)


__all__ = ["SCENES", "Scene", "SceneFamily", "family", "make_scene"]
