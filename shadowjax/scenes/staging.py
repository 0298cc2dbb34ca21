"""A scene round a bare mesh: ground, light and camera in closed form; and other lights and views for any scene."""

import math
from collections.abc import Sequence

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from shadowjax._checked import checked
from shadowjax._checks import require, require_choice
from shadowjax._types import DType
from shadowjax.geometry.camera import Camera
from shadowjax.geometry.light import DirectionalLight
from shadowjax.geometry.mesh import Mesh
from shadowjax.scenes import palette
from shadowjax.scenes.base import ASPECT, MARGIN, SUNLIGHT, Scene, to_mesh, towards
from shadowjax.scenes.lights import LIGHTS, LightStand
from shadowjax.scenes.primitives import box

LIGHT_AZIMUTH_DEG, LIGHT_ELEVATION_DEG = -50.0, 46.0  # from the front left
VIEW_AZIMUTH_DEG, VIEW_ELEVATION_DEG = 24.0, 24.0
HALF_ANGLE_DEG = 18.0

# Longest shadow that the ground is made for, in heights of the mesh: low light would want an endless plain.
LONGEST_SHADOW = 3.0


@checked
def upright(mesh: Mesh, up: str) -> Mesh:
    """The mesh with its up axis ("y" or "z") turned to y; a turn, so nothing is mirrored."""
    require_choice(up, "up axis", ("y", "z"))
    if up == "y":
        return mesh
    x, y, z = mesh.vertices.T
    east, north, height = mesh.origin
    return Mesh(jnp.stack([x, z, -y], axis=-1), mesh.faces, mesh.face_colors, (east, height, -north))


@checked
def shadow_points(points: np.ndarray, direction: np.ndarray, height: float) -> np.ndarray:
    """Where parallel light carries points onto the horizontal plane at `height`.

    Args:
        points: (points, 3), at or above the plane.
        direction: The way the light travels, any length.
        height: World y of the plane.

    Returns:
        Points on the plane, at most `LONGEST_SHADOW` × the point's height away; light that does not come down casts
        its shadow that far too.
    """
    level = np.hypot(direction[0], direction[2])
    # Flat light is taken as no flatter than 1 in LONGEST_SHADOW.
    drop = max(-direction[1], level / LONGEST_SHADOW, 1e-12)
    fall = (points[:, 1] - height) / drop
    result = points + fall[:, None] * direction
    result[:, 1] = height
    return result


@checked
def stage(
    mesh: Mesh,
    name: str,
    *,
    up: str = "y",
    ground: bool = True,
    light_direction: Sequence[float] | None = None,
) -> Scene:
    """Put a mesh on a ground plane, in light from the front left, before a camera that holds it and its shadow.

    Everything is a multiple of the mesh's own size, so millimetres and kilometres look the same.

    Args:
        mesh: Any mesh with some extent.
        name: For people.
        up: The mesh's up axis, "y" or "z"; the scene's is y.
        ground: Whether to add the plane under the lowest point.
        light_direction: The way the light travels, in the scene's axes; from the front left at 46° if None.

    Raises:
        ValueError: If the mesh is a single point, or the direction is zero.
    """
    mesh = upright(mesh, up)
    vertices = np.asarray(mesh.vertices, float)[np.unique(np.asarray(mesh.faces))]
    lower, upper = vertices.min(axis=0), vertices.max(axis=0)
    size = float(np.linalg.norm(upper - lower))
    require(size > 0, f"{name}: all triangles of the mesh lie in one point; give a mesh with some extent")
    if light_direction is None:
        light_direction = direction_of(LIGHT_AZIMUTH_DEG, LIGHT_ELEVATION_DEG)
    light = DirectionalLight.create(light_direction, SUNLIGHT, dtype=mesh.vertices.dtype)
    # A hair below the mesh, so that faces which lie flat on the ground are not in one plane with it.
    height = float(lower[1]) - 1e-4 * size
    shadow = shadow_points(vertices, np.asarray(light.direction, float), height)
    framed_points = np.concatenate([vertices, shadow]) if ground else vertices
    if ground:
        mesh = Mesh.merge([mesh, _ground(framed_points, height, size, mesh)])
    camera = frame(framed_points, np.asarray(mesh.vertices, float), mesh.vertices.dtype)
    faces = f"{mesh.num_faces - (12 if ground else 0):,} triangles"
    return Scene(mesh, camera, (light,), name, f"{name}: {faces}" + (" on a ground plane" if ground else ""))


def _ground(points: np.ndarray, height: float, size: float, like: Mesh) -> Mesh:
    """A slab under points, with some room round them."""
    margin = 0.22 * size
    low, high = points.min(axis=0) - margin, points.max(axis=0) + margin
    low[1], high[1] = height - 0.02 * size, height
    slab = to_mesh([box(low.tolist(), high.tolist()).painted(palette.SAND)])
    return Mesh.create(slab.vertices, slab.faces, slab.face_colors, like.vertices.dtype, like.origin)


@checked
def frame(points: np.ndarray, everything: np.ndarray, dtype: DType | None = None) -> Camera:
    """Three-quarter view that holds `points` as large as they go, near and far close round `everything`.

    Args:
        points: (points, 3) to hold in the image.
        everything: (points, 3) that may also be seen.
        dtype: Floating dtype of the camera.
    """
    back = towards(VIEW_AZIMUTH_DEG, VIEW_ELEVATION_DEG)
    right = np.array([back[2], 0.0, -back[0]]) / np.hypot(back[0], back[2])
    axes = np.stack([right, np.cross(back, right), -back], axis=-1)
    x, y, z = (points @ axes).T
    tangent_y = math.tan(math.radians(HALF_ANGLE_DEG)) * (1 - MARGIN)
    tangent_x = tangent_y * ASPECT
    # A point is inside the right edge where x − c ≤ tan·(z + d): each pair of edges gives a shift and a distance.
    edges = [np.max(sign * w - t * z) for w, t in ((x, tangent_x), (y, tangent_y)) for sign in (1.0, -1.0)]
    distance = max((edges[0] + edges[1]) / (2 * tangent_x), (edges[2] + edges[3]) / (2 * tangent_y))
    position = 0.5 * (edges[0] - edges[1]) * axes[:, 0] + 0.5 * (edges[2] - edges[3]) * axes[:, 1] + distance * back
    near, far = _depth_range(everything, position, -back)
    return Camera.look_at(
        position, position - back, phi_y=math.radians(HALF_ANGLE_DEG), aspect=ASPECT, near=near, far=far,
        dtype=dtype,
    )  # fmt: skip


def _depth_range(points: np.ndarray, position: np.ndarray, forward: np.ndarray) -> tuple[float, float]:
    """Near and far a little outside all points in front of a viewer."""
    depth = (points - position) @ forward
    size = float(np.linalg.norm(points.max(axis=0) - points.min(axis=0)))
    far = max(1.02 * float(depth.max()), 1e-3 * size)
    return max(0.98 * float(depth.min()), 0.02 * min(far, size)), far


@checked
def direction_of(azimuth_deg: float, elevation_deg: float) -> tuple[float, float, float]:
    """The way light travels that stands at an azimuth (degrees from +z to +x) and elevation (degrees)."""
    x, y, z = (-towards(azimuth_deg, elevation_deg)).tolist()
    return x, y, z


@checked
def relit(
    scene: Scene,
    kind: str = "directional",
    direction: Sequence[float] | None = None,
    position: Sequence[float] | None = None,
) -> Scene:
    """The scene under one light of another kind or direction.

    Args:
        scene: Any scene.
        kind: Key of `LIGHTS`.
        direction: The way the light travels, towards the middle of the scene; that of the first light if None.
        position: Where a spot or point light stands in the world; against the direction, outside the scene, if None.
            The origin of the scene's mesh is subtracted before the position is rounded to the mesh's dtype.

    Raises:
        ValueError: If the kind is unknown, the direction is zero, or a directional light is given a position.
    """
    chosen = LIGHTS[require_choice(kind, "light", LIGHTS)]
    placed = [name for name, one in LIGHTS.items() if one.distance is not None]
    require(
        chosen.distance is not None or position is None,
        f"a {kind} light has no position; choose light {' or '.join(placed)}, or give a direction",
    )
    dtype = scene.mesh.vertices.dtype
    place = None if position is None else np.asarray(scene.mesh.to_local(np.asarray(position, float)))
    lower, upper = (np.asarray(corner, float) for corner in scene.mesh.bounds())
    centre, radius = 0.5 * (lower + upper), 0.5 * float(np.linalg.norm(upper - lower))
    if direction is not None:
        travel = np.asarray(direction, float)
    elif place is not None:
        travel = centre - place
    else:
        travel = -np.asarray(scene.lights[0].to_light(scene.mesh.vertices.mean(axis=0))[0], float)
    sun = DirectionalLight.create(travel, SUNLIGHT, dtype)
    if chosen.distance is None:
        # Nothing is rounded on the way: the sun is the light itself.
        stand = LightStand(centre, np.asarray(travel), 1.0, radius, np.asarray(SUNLIGHT), dtype)
    else:
        axis = np.asarray(sun.direction, float)
        place = centre - chosen.distance * radius * axis if place is None else place
        reach = max(float(np.linalg.norm(centre - place)), 1e-6 * radius)
        stand = LightStand(place, axis, reach, radius, np.asarray(SUNLIGHT) * reach**2, dtype)
    light = chosen.make(stand)
    return eqx.tree_at(lambda s: s.lights, scene, (light,))


@checked
def viewed(
    scene: Scene,
    aspect: float,
    *,
    position: Sequence[float] | None = None,
    target: Sequence[float] | None = None,
    phi_y: float | None = None,
    near: float | None = None,
    far: float | None = None,
) -> Scene:
    """The scene before another camera.

    Args:
        scene: Any scene.
        aspect: Width over height of the picture; a narrower picture keeps the width of the view.
        position: Where the camera stands in the world; as it is if None. The origin of the scene's mesh is subtracted
            before the position is rounded to the mesh's dtype.
        target: What it looks at, likewise; as it is if None, or the middle of the scene if only the position is given.
        phi_y: Half the vertical angle of view, radians, in (0, π/2); as it is if None.
        near: Near distance, world units; close before the scene if None and the camera moves.
        far: Far distance, world units; close behind the scene if None and the camera moves.

    Raises:
        ValueError: If a number lies outside its range.
    """
    camera, vertices = scene.camera, np.asarray(scene.mesh.vertices, float)
    moved = position is not None or target is not None
    place = np.asarray(camera.position if position is None else scene.mesh.to_local(np.asarray(position)), float)
    if target is None:
        middle = 0.5 * (vertices.min(axis=0) + vertices.max(axis=0))
        aim = middle if position is not None else place + np.asarray(camera.forward, float)
    else:
        aim = np.asarray(scene.mesh.to_local(np.asarray(target)), float)
    if phi_y is None:
        widened = math.tan(float(camera.phi_y)) * max(float(camera.aspect) / aspect, 1.0)
        phi_y = math.atan(widened)
    forward = aim - place
    length = float(np.linalg.norm(forward))
    fitted = _depth_range(vertices, place, forward / length) if moved and length > 0 else None
    near = near if near is not None else fitted[0] if fitted else float(camera.near)
    far = far if far is not None else fitted[1] if fitted else float(camera.far)
    made = Camera.look_at(place, aim, phi_y=phi_y, aspect=aspect, near=near, far=far, dtype=scene.mesh.vertices.dtype)
    return eqx.tree_at(lambda s: s.camera, scene, made)
