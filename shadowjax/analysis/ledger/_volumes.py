"""Shadow volumes of random triangles, counted along view rays: what each printed or corrected counting rule gives.

A triangle's volume is convex: the points behind it inside the cone from the light. A segment from the eye to a receiver
crosses it in one interval, so entering and leaving follow from clipping, with no picture and no stencil buffer.
"""

import functools
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

SEED = 5


class Crossings(NamedTuple):
    """For each configuration and triangle: eye inside, faces entered, faces left, receiver inside, triangle exists."""

    eye_inside: Bool[np.ndarray, "trials triangles"]
    entered: Bool[np.ndarray, "trials triangles"]
    left: Bool[np.ndarray, "trials triangles"]
    receiver_inside: Bool[np.ndarray, "trials triangles"]


def _half_spaces(
    light: Float[np.ndarray, "trials 1 3"], triangles: Float[np.ndarray, "trials t 3 3"]
) -> tuple[Float[np.ndarray, "trials t 4 3"], Float[np.ndarray, "trials t 4 3"]]:
    """Normals and points of the four planes of each volume; inside is where (x − point)·normal > 0 for all."""
    a, b, c = (triangles[:, :, i] for i in range(3))
    centroid = triangles.mean(axis=2)
    sides = []
    for p, q in ((a, b), (b, c), (c, a)):
        normal = np.cross(p - light, q - light)
        sides.append(normal * np.sign(np.sum((centroid - light) * normal, -1, keepdims=True)))
    cap = np.cross(b - a, c - a)
    sides.append(cap * np.sign(np.sum((a - light) * cap, -1, keepdims=True)))
    points = [np.broadcast_to(light, a.shape)] * 3 + [a]
    return np.stack(sides, 2), np.stack(points, 2)


@functools.cache
def crossings(trials: int, most: int = 4) -> Crossings:
    """Crossings of random configurations: light, eye, receiver and 1 to `most` triangles in a cube."""
    generator = np.random.default_rng(SEED)
    light, eye, receiver = (generator.uniform(-1, 1, (trials, 1, 3)) for _ in range(3))
    triangles = generator.uniform(-1, 1, (trials, most, 3, 3))
    exists = np.arange(most) < generator.integers(1, most + 1, (trials, 1))
    normals, points = _half_spaces(light, triangles)
    start = np.sum((eye[:, :, None] - points) * normals, -1)
    stop = np.sum((receiver[:, :, None] - points) * normals, -1)
    at = start / (start - stop)  # where the segment meets each plane
    first = np.max(np.where(start < 0, np.where(stop > 0, at, np.inf), 0), -1)
    last = np.min(np.where(stop < 0, np.where(start > 0, at, -np.inf), 1), -1)
    met = (first < last) & exists
    return Crossings(
        eye_inside=np.all(start > 0, -1) & exists,
        entered=met & (first > 0),
        left=met & (last < 1),
        receiver_inside=np.all(stop > 0, -1) & exists,
    )


def _wrapped(count: Int[np.ndarray, "trials"], arithmetic: str) -> Int[np.ndarray, "trials"]:
    return count % {"wrap8": 256, "1-bit parity": 2}[arithmetic]


def stencil(found: Crossings, inward: bool, cap: int, arithmetic: str) -> Int[np.ndarray, "trials"]:
    """Stencil values: the cap first, then all increments, then all decrements, as the source's passes run.

    Args:
        found: Crossings to count.
        inward: Normals point into the shadow: entering increments and leaving decrements; outward: the reverse.
        cap: What the cap adds where the eye is inside a volume: 1, −1 or 0 (no cap).
        arithmetic: `wrap8`, `saturating8` or `1-bit parity`.
    """
    entered, left, start = (part.sum(-1) for part in (found.entered, found.left, found.eye_inside))
    up, down = (entered, left) if inward else (left, entered)
    if arithmetic != "saturating8":
        return _wrapped(cap * start + up - down, arithmetic)
    value = np.clip(cap * start, 0, 255)
    return np.clip(np.clip(value + up, 0, 255) - down, 0, 255)


def count_right(trials: int, inward: bool, cap: int, arithmetic: str, lit_where_zero: bool = True) -> int:
    """Configurations in which the rule finds the receiver's shadow; a receiver in any volume is in shadow."""
    found = crossings(trials)
    shadowed = stencil(found, inward, cap, arithmetic) != 0
    return int(np.sum((shadowed == lit_where_zero) == found.receiver_inside.any(-1)))
