"""A box on a wide ground, and its shadow by a ray and a slab in 64-bit NumPy that shares nothing with casters."""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from shadowjax import Camera, DirectionalLight, Mesh, PointLight, SpotLight
from shadowjax.geometry.light import Light

WIDTH, HEIGHT = 40, 30
HALF_ANGLE, FORWARD_FROM = 0.35, np.array([3.0, 4.0, 5.0])
TARGET = np.array([0.25, 0.25, 0.375])
SUN = np.array([0.5, -1.0, 0.75])
LAMP = np.array([-1.0, 3.0, -1.5])
FACES = np.array([[0, 2, 1], [0, 3, 2]])


class Stage(NamedTuple):
    """A scene under a motion, with what it is in 64 bits."""

    mesh: Mesh
    camera: Camera
    light: Light


def box_corners() -> tuple[np.ndarray, np.ndarray]:
    """A box of 1 m standing at the origin: corners, and faces counter-clockwise seen from outside."""
    signs = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], float)
    quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    faces = [[q[0], q[i], q[i + 1]] for q in quads for i in (1, 2)]
    return signs - [0.5, 0, 0.5], np.array(faces)


def stage(
    dtype, half: float = 5.0, shift=(0.0, 0.0, 0.0), scale: float = 1.0, turn=None, kind: str = "directional"
) -> Stage:
    """The box on its ground, its camera and its light, moved rigidly and scaled.

    Args:
        dtype: Of everything.
        half: Half a side of the ground, metres.
        shift: Added to all places, metres.
        scale: Factor on everything about the origin, applied first.
        turn: A rotation matrix, applied before the shift; none if None.
        kind: "directional", "spot" or "point".
    """
    turn = np.eye(3) if turn is None else turn

    def put(points):
        return scale * np.asarray(points) @ turn.T + np.asarray(shift)

    box, faces = box_corners()
    ground = half * np.array([[-1, 0, -1], [1, 0, -1], [1, 0, 1], [-1, 0, 1]], float)
    vertices = put(np.concatenate([ground, box]))
    mesh = Mesh.create(vertices, np.concatenate([FACES, faces + 4]), dtype=dtype)
    camera = Camera.look_at(
        put(FORWARD_FROM), put(TARGET), turn @ [0.0, 1.0, 0.0], phi_y=HALF_ANGLE, aspect=WIDTH / HEIGHT,
        near=scale, far=20 * scale, dtype=dtype,
    )  # fmt: skip
    light = {
        "directional": lambda: DirectionalLight.create(turn @ SUN, dtype=dtype),
        "spot": lambda: SpotLight.create(put(LAMP), turn @ -LAMP, 0.9, dtype=dtype),
        "point": lambda: PointLight.create(put(LAMP), dtype=dtype),
    }[kind]()
    return Stage(mesh, camera, light)


def camera_directions() -> np.ndarray:
    """Unit directions of the camera's rays through pixel centres, unmoved: (rows, cols, 3)."""
    forward = TARGET - FORWARD_FROM
    forward = forward / np.linalg.norm(forward)
    right = np.cross(forward, [0.0, 1.0, 0.0])
    right = right / np.linalg.norm(right)
    up = np.cross(right, forward)
    tangent = np.tan(HALF_ANGLE)
    x = ((np.arange(WIDTH) + 0.5) / WIDTH * 2 - 1) * tangent * WIDTH / HEIGHT
    y = (1 - (np.arange(HEIGHT) + 0.5) / HEIGHT * 2) * tangent
    directions = forward + x[None, :, None] * right + y[:, None, None] * up
    return directions / np.linalg.norm(directions, axis=-1, keepdims=True)


def slab(start: np.ndarray, direction: np.ndarray, swell: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Where rays enter and leave the box, grown by `swell` on all sides but its foot; entry beyond exit: never."""
    low, high = np.array([-0.5, 0.0, -0.5]) - swell * np.array([1, 0, 1]), np.array([0.5, 1.0, 0.5]) + swell
    with np.errstate(divide="ignore", invalid="ignore"):
        first, second = (low - start) / direction, (high - start) / direction
    return np.minimum(first, second).max(axis=-1), np.maximum(first, second).min(axis=-1)


def ground_shadow(kind: str = "directional", swell: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Pixels that see the ground, and those of them that the box keeps from the light; unmoved, in closed form."""
    directions = camera_directions()
    entry, leave = slab(FORWARD_FROM, directions)
    hits_box = (entry <= leave) & (leave > 0)
    with np.errstate(divide="ignore"):
        along = -FORWARD_FROM[1] / directions[..., 1]
    points = FORWARD_FROM + along[..., None] * directions
    on_ground = (along > 0) & ~hits_box & (np.abs(points) <= 5).all(axis=-1)
    to_light = -SUN if kind == "directional" else LAMP - points
    entry, leave = slab(points, np.broadcast_to(to_light, points.shape), swell)
    return on_ground, on_ground & (entry <= leave) & (leave > 0)


def undecided(kind: str = "directional", by: float = 1e-3) -> np.ndarray:
    """Pixels whose answer hangs on a part `by` of a metre, unmoved."""
    inner, outer = ground_shadow(kind, -by)[1], ground_shadow(kind, by)[1]
    seen = camera_directions()
    borders = [slab(FORWARD_FROM, seen, grown) for grown in (-by, by)]
    boxes = [(entry <= leave) & (leave > 0) for entry, leave in borders]
    return (inner != outer) | (boxes[0] != boxes[1])


def as_numpy(values) -> np.ndarray:
    """A picture as 64-bit numbers."""
    return np.asarray(jnp.asarray(values), float)
