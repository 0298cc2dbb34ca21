"""Walls behind the origin, each with a lamp before it: shadow pictures of a mesh, their slopes, and counted shadows."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection

from shadowjax import Mesh, MeshEdges, PointLight, RayGrid, Receiver, plane_receiver, shadow_picture
from shadowjax._types import Array
from shadowjax.rays.brute import BruteForceCaster

LAMP, WALL, HALF = 6.0, -1.5, 1.5  # metres: lamps from the middle, walls behind it, half a picture's side
FINE = 8  # samples along a side of a pixel


@dataclass(frozen=True)
class Wall:
    """A wall with its lamp; rows of `axes` are u and v in the wall and the direction to the lamp."""

    receiver: Receiver
    view: RayGrid
    light: PointLight
    axes: np.ndarray

    @classmethod
    def create(cls, towards: Sequence[float], resolution: int) -> "Wall":
        """A wall behind the origin.

        Args:
            towards: Direction to the lamp; v is upright, or along z if the lamp is nearly overhead.
            resolution: Pixels along a side.
        """
        facing = np.asarray(towards, float) / np.linalg.norm(towards)
        up = np.array([0.0, 0.0, 1.0] if abs(facing[1]) > 0.9 else [0.0, 1.0, 0.0])
        up = up - (up @ facing) * facing
        up /= np.linalg.norm(up)
        frame = np.array([np.cross(facing, up), up, facing])
        corner = jnp.asarray([HALF, HALF], jnp.float64)
        receiver, view = plane_receiver(
            jnp.asarray(WALL * frame[2]), jnp.asarray(frame[0]), jnp.asarray(frame[1]), -corner, corner,
            (resolution, resolution),
        )  # fmt: skip
        return cls(receiver, view, PointLight.create(LAMP * frame[2], dtype=jnp.float64), frame)

    def shadow_of(self, vertices: np.ndarray) -> np.ndarray:
        """(u, v) on the wall of the vertices' shadows."""
        u, v, w = self.axes @ vertices.T
        return np.stack([u, v], axis=-1) * ((LAMP - WALL) / (LAMP - w))[:, None]

    def difference(
        self, target: np.ndarray, vertices: np.ndarray, mesh: Mesh, edges: MeshEdges
    ) -> tuple[float, np.ndarray, np.ndarray]:
        """Mean squared difference between the shadow picture of moved vertices and a target; picture; slope."""

        def loss(vertices: Array, position: Array) -> tuple[Array, Array]:
            moved, lamp = Mesh(vertices, mesh.faces, mesh.face_colors), PointLight(position, self.light.color)
            picture = shadow_picture(moved, edges, lamp, self.view, BruteForceCaster(), self.receiver)
            return jnp.mean((picture - target) ** 2), picture

        # The slope in the lamp is not used: with it the program is the one that other experiments compile.
        (value, picture), (slope, _) = jax.value_and_grad(loss, (0, 1), has_aux=True)(
            jnp.asarray(vertices), self.light.position
        )
        return float(value), np.asarray(picture), np.asarray(slope)


def on_walls(
    walls: Sequence[Wall], targets: Any, vertices: np.ndarray, mesh: Mesh, edges: MeshEdges
) -> tuple[float, np.ndarray, np.ndarray]:
    """Mean of all walls' differences, their pictures, and the slope."""
    found = [wall.difference(target, vertices, mesh, edges) for wall, target in zip(walls, targets, strict=True)]
    losses, pictures, slopes = zip(*found, strict=True)
    return sum(losses) / len(walls), np.stack(pictures), np.stack(slopes).sum(0) / len(walls)


def spots(resolution: int) -> tuple[np.ndarray, np.ndarray]:
    """(u, v) of the samples of a picture."""
    side = ((np.arange(resolution * FINE) + 0.5) / (resolution * FINE) * 2 - 1) * HALF
    u, v = np.meshgrid(side, side)
    return u, v


def in_pixels(inside: np.ndarray, resolution: int) -> np.ndarray:
    """Visibility of pixels of which samples lie in the shadow."""
    return 1 - inside.reshape(resolution, FINE, resolution, FINE).mean((1, 3))


def behind(triangles: np.ndarray, u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Whether places lie in at least one of the triangles (triangles × 3 × 2)."""
    inside = np.zeros(u.shape, bool)
    for corners in triangles:
        signs = []
        for (au, av), (bu, bv) in zip(corners, np.roll(corners, -1, axis=0), strict=True):
            signs.append((bu - au) * (v - av) - (bv - av) * (u - au))
        inside |= np.all([s >= 0 for s in signs], axis=0) | np.all([s <= 0 for s in signs], axis=0)
    return inside


def show_mesh(axes: Axes, vertices: np.ndarray, faces: np.ndarray) -> None:
    """The mesh, seen from between the lamps and above, far triangles first."""
    towards = np.array([1.0, 0.7, 1.0]) / math.sqrt(2.49)
    right = np.cross([0.0, 1.0, 0.0], towards)
    right /= np.linalg.norm(right)
    corners = vertices[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True) + 1e-12
    order = np.argsort(corners.mean(1) @ towards)
    tone = 0.35 + 0.6 * np.abs(normals @ (np.array([0.3, 0.8, 0.5]) / math.sqrt(0.98)))
    color = np.clip(tone[:, None] * np.array([0.90, 0.72, 0.55]), 0, 1)
    flat = np.stack([corners @ right, corners @ np.cross(towards, right)], axis=-1)
    axes.add_collection(
        PolyCollection(list(flat[order]), facecolors=color[order], edgecolors="#00000030", linewidths=0.3)
    )
    axes.set(xlim=(-1.15, 1.15), ylim=(-1.15, 1.15), aspect="equal", xticks=[], yticks=[])
    axes.grid(False)
    for side in axes.spines.values():
        side.set_visible(False)
