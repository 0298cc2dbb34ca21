"""Shadow volumes of random triangles, counted along view rays: what each printed or corrected counting rule gives.

A triangle's volume is convex: the points behind it inside the cone from the light. A segment from the eye to a receiver
crosses it in one interval, so entering and leaving follow from clipping, with no picture and no stencil buffer.
"""

import functools
from dataclasses import dataclass
from fractions import Fraction
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
        # A side's plane holds the light and an edge; its normal is turned to the triangle's own middle.
        normal = np.cross(p - light, q - light)
        sides.append(normal * np.sign(np.sum((centroid - light) * normal, -1, keepdims=True)))
    # The triangle's plane, turned away from the light: behind it lies the shadow.
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
    # Cyrus–Beck clip against four half-spaces: last entry and first exit. A plane with both ends outside is never
    # entered, so its entry is ∞.
    first = np.max(np.where(start < 0, np.where(stop > 0, at, np.inf), 0), -1)
    last = np.min(np.where(stop < 0, np.where(start > 0, at, -np.inf), 1), -1)
    met = (first < last) & exists
    return Crossings(
        eye_inside=np.all(start > 0, -1) & exists,
        entered=met & (first > 0),
        left=met & (last < 1),
        receiver_inside=np.all(stop > 0, -1) & exists,
    )


@dataclass(frozen=True)
class Rule:
    """How volumes are counted.

    Attributes:
        inward: Normals point into the shadow: entering increments and leaving decrements; outward: the reverse.
        cap: What the cap adds where the eye is inside a volume: 1, −1 or 0 (no cap).
        arithmetic: `wrap8`, `saturating8` or `1-bit parity`.
        order: `cap first` or `cap last` with a pass of increments and one of decrements between, or `mixed`, every
            fragment in any order.
        lit_where_zero: Whether light is added where the stencil is 0, or where it is not.
    """

    inward: bool = True
    cap: int = 1
    arithmetic: str = "saturating8"
    order: str = "cap first"
    lit_where_zero: bool = True

    @property
    def counts_volumes(self) -> bool:
        """Whether the value is ± the number of volumes around the receiver, whatever few volumes there are."""
        if self.cap != (1 if self.inward else -1) or self.arithmetic == "1-bit parity":
            return False
        return self.arithmetic == "wrap8" or (self.inward and self.order == "cap first")


ORDERS = ("cap first", "cap last", "mixed")


def _counts(found: Crossings, rule: Rule) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Caps, increments and decrements of each configuration."""
    entered, left, start = (part.sum(-1) for part in (found.entered, found.left, found.eye_inside))
    return (rule.cap * start, entered, left) if rule.inward else (rule.cap * start, left, entered)


def chance_of_zero(found: Crossings, rule: Rule) -> list[Fraction]:
    """Probability that the stencil ends at 0, from the numbers of fragments alone.

    With passes it is 0 or 1. Saturating counters that take a increments and b decrements in any order end at 0 iff the
    last of their sums, unclipped, is the least: of all orders (b − a + 1)/(b + 1) by the ballot theorem, none if a > b.
    """
    caps, up, down = _counts(found, rule)
    if rule.arithmetic != "saturating8":
        size = {"wrap8": 256, "1-bit parity": 2}[rule.arithmetic]
        return [Fraction(int(value == 0)) for value in (caps + up - down) % size]
    if rule.order == "mixed":
        up, down = up + np.maximum(caps, 0), down + np.maximum(-caps, 0)
        # The ballot theorem's share of orders in which the last partial sum is the least.
        pairs = zip(up.tolist(), down.tolist(), strict=True)
        return [Fraction(b - a + 1, b + 1) if b >= a else Fraction(0) for a, b in pairs]
    if rule.order == "cap first":
        value = np.maximum(np.maximum(caps, 0) + up - down, 0)
    else:
        value = np.maximum(np.maximum(up - down, 0) + caps, 0)
    return [Fraction(int(zero)) for zero in value == 0]


def right_by_counts(trials: int, rule: Rule) -> Fraction:
    """Expected share of configurations in which a rule finds the receiver's shadow, from `chance_of_zero`."""
    found = crossings(trials)
    lit = np.logical_not(np.any(found.receiver_inside, axis=-1)).tolist()
    chances = [
        zero if is_lit == rule.lit_where_zero else 1 - zero
        for zero, is_lit in zip(chance_of_zero(found, rule), lit, strict=True)
    ]
    return sum(chances, Fraction(0)) / trials


def stencil(found: Crossings, rule: Rule, seed: int = 0) -> Int[np.ndarray, "trials"]:
    """Stencil values after every fragment has been drawn, one after another; those of a pass come in random order."""
    sign = 1 if rule.inward else -1
    parts = (found.eye_inside, rule.cap), (found.entered, sign), (found.left, -sign)
    drawn = np.concatenate([np.where(there, step, 0) for there, step in parts], axis=1)
    passes = np.where(drawn > 0, 1, 2)
    passes[:, : found.eye_inside.shape[1]] = {"cap first": 0, "cap last": 3, "mixed": 0}[rule.order]
    if rule.order == "mixed":
        passes[:] = 0
    # Pass number plus a random fraction: passes in order, fragments of one pass shuffled.
    order = np.argsort(passes + np.random.default_rng(seed).random(drawn.shape), axis=1)
    value = np.zeros(drawn.shape[0], int)
    for step in np.take_along_axis(drawn, order, axis=1).T:
        value = value + step
        size = {"wrap8": 256, "saturating8": 256, "1-bit parity": 2}[rule.arithmetic]
        value = np.clip(value, 0, size - 1) if rule.arithmetic == "saturating8" else value % size
    return value


def right_by_drawing(trials: int, rule: Rule, num_orders: int = 1) -> Fraction:
    """Share of configurations, and of random orders of their fragments, in which a rule finds the receiver's shadow.

    A receiver in any volume is in shadow.
    """
    found, right = crossings(trials), 0
    for seed in range(num_orders):
        lit = (stencil(found, rule, seed) == 0) == rule.lit_where_zero
        right += int(np.sum(lit != found.receiver_inside.any(-1)))
    return Fraction(right, trials * num_orders)
