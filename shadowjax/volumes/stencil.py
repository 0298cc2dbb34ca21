"""The stencil buffer: its arithmetic, and the counts of z-pass, near-plane capping and z-fail."""

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Num

from shadowjax._checked import Checked, checked
from shadowjax._checks import require, require_choice, require_int
from shadowjax._types import Array, Bool, Int
from shadowjax.volumes.regions import Boundary, Regions, count_regions, up_and_down

METHODS = ("z-pass", "z-fail")


class Stencil(Checked):
    """Counters of a few bits.

    A pass adds all increments, then a pass takes all decrements away, as the source draws them. Wrapping counters
    forget how often they went round, and are right modulo 2^bits whatever the order. Saturating ones stop at 0 and at
    2^bits − 1, and lose what was taken away below 0.

    Attributes:
        bits: Of each counter, 1 to 16.
        wraps: Whether counters wrap rather than saturate.

    Source: stencil, section 4.
    """

    bits: int = eqx.field(static=True, default=8)
    wraps: bool = eqx.field(static=True, default=True)

    def __check_init__(self) -> None:
        require_int(self.bits, "bits", 1)
        require(self.bits <= 16, f"bits of a stencil buffer must lie between 1 and 16; got {self.bits}")

    def value(
        self, start: Int[Array, "*#points"], up: Int[Array, "*points"], down: Int[Array, "*points"]
    ) -> Int[Array, "*points"]:
        """What the counters hold after the cap, all increments and all decrements.

        Args:
            start: Drawn first: cap polygons; may be negative, for caps that decrement.
            up: Increments, ≥ 0.
            down: Decrements, ≥ 0.

        Returns:
            Values from 0 to 2^bits − 1. Light belongs where they are 0.
        """
        # Increments in one pass, decrements in the next: saturation acts at the top first, then at 0.
        size = 1 << self.bits
        if self.wraps:
            return (start + up - down) % size
        value = jnp.clip(jnp.clip(start, 0, size - 1) + up, 0, size - 1)
        return jnp.clip(value - down, 0, size - 1)


class Counts(NamedTuple):
    """What is drawn into the stencil buffer at each point.

    Attributes:
        start: Volumes around the place where counting begins: what cap polygons add.
        up: Walls that increment.
        down: Walls that decrement.
    """

    start: Int[Array, "*#points"]
    up: Int[Array, "*points"]
    down: Int[Array, "*points"]

    @property
    def total(self) -> Int[Array, "*points"]:
        """Volumes around each point, in whole numbers."""
        return self.start + self.up - self.down


@checked
def method_regions(boundary: Boundary, method: str, with_caps: bool = True) -> Regions:
    """Everything that a method draws.

    z-pass draws what lies before a point: walls, and light caps where points need not be visible from the eye. z-fail
    draws what lies behind it: walls, light caps and the caps at infinity; it needs no start.

    Args:
        boundary: Relative to the eye.
        method: "z-pass" or "z-fail".
        with_caps: For z-pass: whether light caps are drawn. No ray to a visible point crosses one.
    """
    if require_choice(method, "method", METHODS) == "z-fail":
        return boundary.wall_regions(True) + boundary.cap_regions(True) + boundary.far_regions()
    walls = boundary.wall_regions(False)
    return walls + boundary.cap_regions(False) if with_caps else walls


@checked
def start_count(boundary: Boundary, method: str) -> Int[Array, ""]:
    """Volumes around the eye, where z-pass begins; 0 for z-fail, which begins at infinity outside all caps."""
    if method == "z-fail":
        return jnp.zeros((), jnp.int32)
    return count_regions(boundary.volumes(), jnp.zeros((1, 3), boundary.corners.dtype))[0]


@checked
@eqx.filter_jit
def eye_counts(
    boundary: Boundary, points: Num[Array, "*points 3"], method: str = "z-pass", with_caps: bool = True
) -> Counts:
    """Counts of the segment from the eye to each point: right wherever eye and points are.

    Args:
        boundary: Relative to the eye.
        points: Relative to the eye.
        method: "z-pass" or "z-fail".
        with_caps: As in `method_regions`.
    """
    up, down = up_and_down(method_regions(boundary, method, with_caps), points)
    return Counts(start_count(boundary, method), up, down)


@checked
@eqx.filter_jit
def near_plane_counts(boundary: Boundary, points: Num[Array, "*points 3"], near: Num[Array, "*points 3"]) -> Counts:
    """z-pass as the source draws it: walls cut off at the near plane, and the cap polygons that repair the cut.

    Args:
        boundary: Relative to the eye.
        points: Visible points relative to the eye.
        near: Where the segment to each point crosses the near plane, relative to the eye.

    Returns:
        Counts whose `start` is the number of cap polygons over each pixel. Without it (0 in its place) parity is lost
        wherever a volume reaches through the near plane.

    Source: stencil, section 7. Its caps decrement; with its own normals, which point into the shadow, they must
    increment.
    """
    walls = boundary.wall_regions(False)
    # Walls between near plane and point: all on the way less those before the near plane.
    up, down = up_and_down(walls, points)
    cut_up, cut_down = up_and_down(walls, near)
    return Counts(count_regions(boundary.volumes(), near), up - cut_up, down - cut_down)


@checked
def is_lit(value: Int[Array, "*points"]) -> Bool[Array, "*points"]:
    """Light belongs where the stencil buffer holds 0.

    asm prints the opposite, to add light where it holds more than 0; those are the shadows.
    """
    return value == 0
