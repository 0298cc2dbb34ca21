"""Coloured triangle bodies in NumPy: the bricks that scenes are built from."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from shadowjax._checked import checked

Vector = Sequence[float] | np.ndarray  # three numbers, or two in a plane


@checked
@dataclass(frozen=True)
class Part:
    """Triangles with one linear albedo each, counter-clockwise seen from outside.

    Args:
        vertices: (vertices, 3) positions in metres.
        faces: (faces, 3) indices of corners.
        colors: (faces, 3) linear albedo in [0, 1].
    """

    vertices: np.ndarray
    faces: np.ndarray
    colors: np.ndarray

    @property
    def num_faces(self) -> int:
        """How many triangles there are."""
        return len(self.faces)

    def volume(self) -> float:
        """Signed volume in cubic metres: positive for closed bodies that are oriented outwards."""
        a, b, c = np.moveaxis(self.vertices[self.faces], 1, 0)
        return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0)

    def painted(self, color: Vector) -> Part:
        """Copy in one colour (3,) or with one colour a face (faces, 3)."""
        return replace(self, colors=np.broadcast_to(np.asarray(color, float), (self.num_faces, 3)).copy())

    def moved(self, x: float = 0.0, y: float = 0.0, z: float = 0.0) -> Part:
        """Copy shifted by (x, y, z) metres."""
        return replace(self, vertices=self.vertices + np.array([x, y, z]))

    def turned(self, axis: Vector, angle: float) -> Part:
        """Copy turned about `axis` through the origin by `angle` radians, right-handed."""
        return replace(self, vertices=self.vertices @ rotation(axis, angle).T)

    def scaled(self, x: float, y: float | None = None, z: float | None = None) -> Part:
        """Copy scaled by positive factors along the axes; one factor scales all three."""
        factors = np.array([x, x if y is None else y, x if z is None else z])
        return replace(self, vertices=self.vertices * factors)

    def outward(self) -> Part:
        """Copy of a closed body whose faces look outwards."""
        return self if self.volume() >= 0 else replace(self, faces=self.faces[:, ::-1])


@checked
def make_part(vertices: np.ndarray, faces: np.ndarray, color: Vector = (0.75, 0.75, 0.75)) -> Part:
    """A part of one colour from corners and indices."""
    part = Part(np.asarray(vertices, float), np.asarray(faces, np.int64), np.zeros((0, 3)))
    return part.painted(color)


@checked
def join(parts: Iterable[Part]) -> Part:
    """One part that holds the triangles of all; vertices of different parts stay apart."""
    parts = list(parts)
    starts = np.cumsum([0] + [len(part.vertices) for part in parts[:-1]])
    return Part(
        np.concatenate([part.vertices for part in parts]),
        np.concatenate([part.faces + start for part, start in zip(parts, starts, strict=True)]),
        np.concatenate([part.colors for part in parts]),
    )


@checked
def scatter(part: Part, matrices: np.ndarray, offsets: np.ndarray, colors: np.ndarray | None = None) -> Part:
    """Copies of one part, each under its own affine map.

    Args:
        part: The template.
        matrices: (copies, 3, 3) linear maps of positive determinant.
        offsets: (copies, 3) shifts in metres.
        colors: (copies, 3) albedo of each copy; the template's own where None.
    """
    copies, corners = len(offsets), len(part.vertices)
    vertices = np.einsum("nij,vj->nvi", matrices, part.vertices) + offsets[:, None]
    faces = part.faces[None] + corners * np.arange(copies)[:, None, None]
    paint = part.colors[None] if colors is None else np.asarray(colors)[:, None]
    paint = np.broadcast_to(paint, (copies, part.num_faces, 3))
    return Part(vertices.reshape(-1, 3), faces.reshape(-1, 3), paint.reshape(-1, 3).copy())


@checked
def rotation(axis: Vector, angle: np.ndarray | float) -> np.ndarray:
    """(..., 3, 3) rotation matrices about axes (..., 3) by angles in radians (Rodrigues)."""
    vector = np.asarray(axis, float)
    unit = vector / np.linalg.norm(vector, axis=-1, keepdims=True)
    angle = np.asarray(angle, float)
    x, y, z = np.moveaxis(np.broadcast_to(unit, (*np.broadcast_shapes(unit.shape[:-1], angle.shape), 3)), -1, 0)
    zero = np.zeros_like(x)
    skew = np.stack([np.stack([zero, -z, y], -1), np.stack([z, zero, -x], -1), np.stack([-y, x, zero], -1)], -2)
    sine, cosine = np.sin(angle)[..., None, None], np.cos(angle)[..., None, None]
    return np.eye(3) + sine * skew + (1.0 - cosine) * (skew @ skew)


@checked
def random_rotations(rng: np.random.Generator, count: int) -> np.ndarray:
    """(count, 3, 3) rotations spread uniformly over all orientations."""
    # Normalised Gaussian quaternions are uniform on the sphere, so the rotations are uniform too.
    w, x, y, z = (q := rng.normal(size=(count, 4))).T / np.linalg.norm(q, axis=1)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), -1, 0)
