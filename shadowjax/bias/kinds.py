"""Kinds of bias beyond a constant: slope-scaled with a clamp, normal offset, receiver plane, and sums of them."""

import math

import equinox as eqx
import jax.numpy as jnp

from shadowjax._checked import checked
from shadowjax._checks import require, require_choice, require_finite, require_value
from shadowjax._numerics import dot, safe_sqrt
from shadowjax._types import Array, ArrayLike, Bool, Float, Points, Scalar, as_float_array
from shadowjax.bias.rule import MAX_SLOPE, Bias, BiasedReceiver, BiasRule, plane_gradient, texel_size
from shadowjax.bias.units import DepthBuffer
from shadowjax.rays.ray_grid import RayGrid

SLOPES = ("sum", "largest")
OFFSET_UNITS = ("world", "texel")


def _not_negative(value: ArrayLike, name: str) -> Scalar:
    number = require_finite(as_float_array(value), name)
    return require_value(number, number >= 0, f"{name} must not be negative")


def _steepest_axis(grid: RayGrid, points: Points, normals: Points) -> Float[Array, "*points"]:
    """Depth change of each receiver's plane over a texel along the steeper axis of the map, texels."""
    changes = jnp.abs(plane_gradient(grid, points, normals, math.inf))
    return jnp.max(changes, axis=-1) / texel_size(grid, points)


class SlopeScaled(BiasRule):
    """A constant, and a multiple of the receiver's slope, limited: what graphics hardware calls a polygon offset.

    b = min(constant + slope · Δ, limit), where Δ is the depth change of the receiver's plane over one texel. Past the
    limit steep surfaces show acne again; without it light leaks along them.

    Attributes:
        constant: World units.
        slope: Texels of slope; the filter's `reach` frees a plane of acne if Δ is the sum of both axes' changes.
        limit: Largest bias, world units; the largest number for none.
        over: How the changes along both axes make Δ: "sum", which bounds the change over a texel, or "largest", which
            hardware takes and which falls short by up to a factor 2 on diagonal slopes.
        max_slope: Largest change along an axis that counts, texels of depth for each texel, > 0. Where light grazes at
            less than 4° the usual 16 leave acne; `evaluate.slope_limit` says where, and how much more it takes.
    """

    constant: Scalar
    slope: Scalar
    limit: Scalar
    over: str = eqx.field(static=True, default="sum")
    max_slope: float = eqx.field(static=True, default=MAX_SLOPE)

    def __check_init__(self) -> None:
        require(self.max_slope > 0, f"the largest slope must be positive; got {self.max_slope}")

    @classmethod
    def create(
        cls,
        constant: ArrayLike = 0.0,
        slope: ArrayLike = 1.0,
        limit: ArrayLike | None = None,
        over: str = "sum",
        max_slope: float = MAX_SLOPE,
    ) -> "SlopeScaled":
        """Checked constructor.

        Raises:
            ValueError: If a number is negative or not finite, `max_slope` is not positive, or `over` is unknown.
        """
        require_choice(over, "over", SLOPES)
        top = (
            jnp.asarray(jnp.finfo(as_float_array(slope).dtype).max) if limit is None else _not_negative(limit, "limit")
        )
        return cls(_not_negative(constant, "constant"), _not_negative(slope, "slope"), top, over, max_slope)

    def apply(self, grid: RayGrid, points: Points, normals: Points) -> BiasedReceiver:
        """The receivers where they are, and the limited sum."""
        # Change of the receiver's plane over one texel along each axis of the map: hardware's dz/dx and dz/dy.
        wanted = self._wanted(grid, points, normals, self.max_slope)
        return BiasedReceiver(points, jnp.minimum(wanted, self.limit.astype(points.dtype)))

    def _wanted(self, grid: RayGrid, points: Points, normals: Points, max_slope: float) -> Float[Array, "*points"]:
        """The sum before it is limited."""
        changes = jnp.abs(plane_gradient(grid, points, normals, max_slope))
        change = jnp.sum(changes, axis=-1) if self.over == "sum" else jnp.max(changes, axis=-1)
        return self.constant.astype(points.dtype) + self.slope.astype(points.dtype) * change

    @property
    def steepest(self) -> float:
        """`max_slope`."""
        return self.max_slope

    @property
    def limit_text(self) -> str:
        """`max_slope`, and `limit` if there is one."""
        own = super().limit_text
        return own if self._is_open else f"{own} or {float(self.limit):g} world units"

    @property
    def _is_open(self) -> bool:
        return float(self.limit) >= float(jnp.finfo(self.limit.dtype).max)

    def steepness(self, grid: RayGrid, points: Points, normals: Points) -> Float[Array, "*points"]:
        """The depth change over one texel along the steeper axis."""
        slope = _steepest_axis(grid, points, normals)
        return jnp.where(self.slope > 0, slope, jnp.zeros_like(slope))

    def is_limited(self, grid: RayGrid, points: Points, normals: Points) -> Bool[Array, "*points"]:
        """Where `max_slope` or `limit` is reached."""
        capped = self._wanted(grid, points, normals, math.inf) > self.limit.astype(points.dtype)
        return capped | super().is_limited(grid, points, normals)

    def following(self, steepest: float) -> "SlopeScaled":
        """With another `max_slope`, and no `limit`."""
        top = jnp.full_like(self.limit, jnp.finfo(self.limit.dtype).max)
        return SlopeScaled(self.constant, self.slope, top, self.over, steepest)

    @property
    def made_by(self) -> str:
        """The call of `create`."""
        limit = "" if self._is_open else f", limit={float(self.limit):g}"
        numbers = f"{float(self.constant):g}, {float(self.slope):g}{limit}"
        return f'SlopeScaled.create({numbers}, over="{self.over}", max_slope={self.max_slope:g})'


class NormalOffset(BiasRule):
    """Reads the map at a point moved along the receiver's normal, with no depth tolerance.

    Moved by h, a point lies h / cos θ in front of its own plane along the light, θ being the incidence. A plane is
    free of acne from h = ρ·(|n·w_s| + |n·w_t|) on, with the filter's reach ρ and the world vectors w of a texel: at
    most ρ·(|w_s| + |w_t|)·sin θ, so it stays bounded as light grazes. The price is sideways: a shadow edge moves by
    h·sin θ across the light.

    Attributes:
        value: Length of the move, in `unit`.
        unit: "world" or "texel".
        by_sine: Whether the length is multiplied by sin θ, which leaves surfaces that face the light where they are.
    """

    value: Scalar
    unit: str = eqx.field(static=True, default="texel")
    by_sine: bool = eqx.field(static=True, default=True)

    @classmethod
    def create(cls, value: ArrayLike, unit: str = "texel", by_sine: bool = True) -> "NormalOffset":
        """Checked constructor.

        Raises:
            ValueError: If the unit is unknown, or the value negative or not finite.
        """
        require_choice(unit, "unit of a normal offset", OFFSET_UNITS)
        return cls(_not_negative(value, "normal offset"), unit, by_sine)

    def apply(self, grid: RayGrid, points: Points, normals: Points) -> BiasedReceiver:
        """The moved receivers, without a depth tolerance."""
        length = jnp.broadcast_to(self.value.astype(points.dtype), points.shape[:-1])
        if self.unit == "texel":
            length = length * texel_size(grid, points)
        if self.by_sine:
            cosine = dot(normals, grid.space.to_source(points))
            # sin θ from the cosine; 0 with a zero gradient where the light is perpendicular.
            length = length * safe_sqrt(1 - cosine**2)
        return BiasedReceiver(points + length[..., None] * normals, jnp.zeros_like(length))

    @property
    def made_by(self) -> str:
        """The call of `create`."""
        return f'NormalOffset.create({float(self.value):g}, "{self.unit}", by_sine={self.by_sine})'


class ReceiverPlane(BiasRule):
    """Tests every tap against the receiver's own plane, continued to the tap's texel.

    On a plane in parallel light under a uniform map no bias is left to choose: the plane is free of acne with none, for
    any kernel. Warps and local lights bend the plane's depth between texels, which is left to `slope`. At creases the
    plane is continued where there is no surface, so the gradient is limited.

    Filters that read maps filtered beforehand have no taps to test and do not take it.

    Attributes:
        constant: Additional depth tolerance, world units.
        slope: Additional depth tolerance, texels of slope. A multi-depth map needs its policy's radius: extra depths
            come from other texels than the one they are kept in.
        limit: Steepest plane that is followed, texels of depth for each texel along an axis, > 0. Where light grazes at
            less than 4° the usual 16 leave acne; `evaluate.slope_limit` says where, and how much more it takes.
    """

    constant: Scalar
    slope: Scalar
    limit: float = eqx.field(static=True, default=MAX_SLOPE)

    def __check_init__(self) -> None:
        require(self.limit > 0, f"the limit of a receiver plane must be positive; got {self.limit}")

    @classmethod
    def create(cls, constant: ArrayLike = 0.0, slope: ArrayLike = 0.0, limit: float = MAX_SLOPE) -> "ReceiverPlane":
        """Checked constructor.

        Raises:
            ValueError: If a number is negative or not finite, or the limit not positive.
        """
        return cls(_not_negative(constant, "constant"), _not_negative(slope, "slope"), limit)

    def apply(self, grid: RayGrid, points: Points, normals: Points) -> BiasedReceiver:
        """The receivers where they are, followed by their planes."""
        besides = self._besides.in_world(grid, points, normals)
        return BiasedReceiver(points, besides + self.constant.astype(points.dtype), True, self.limit)

    @property
    def _besides(self) -> Bias:
        return Bias(self.slope, "slope", self.limit)

    @property
    def steepest(self) -> float:
        """`limit`."""
        return self.limit

    def steepness(self, grid: RayGrid, points: Points, normals: Points) -> Float[Array, "*points"]:
        """The depth change over one texel along the steeper axis; with `slope`, the sum of both."""
        besides = self._besides.steepness(grid, points, normals)
        return jnp.maximum(_steepest_axis(grid, points, normals), besides)

    def following(self, steepest: float) -> "ReceiverPlane":
        """With another `limit`."""
        return ReceiverPlane(self.constant, self.slope, steepest)

    @property
    def made_by(self) -> str:
        """The call of `create`."""
        return f"ReceiverPlane.create({float(self.constant):g}, {float(self.slope):g}, limit={self.limit:g})"


class BufferBias(BiasRule):
    """A bias in depth-buffer (NDC) units, as engines take it: how many metres it is depends on the light's range.

    Attributes:
        value: Depth-buffer units, ≥ 0.
        buffer: The light's depth buffer; None takes a linear one from 0 to the map's own farthest depth.
    """

    value: Scalar
    buffer: DepthBuffer | None = None

    @classmethod
    def create(cls, value: ArrayLike, buffer: DepthBuffer | None = None) -> "BufferBias":
        """Checked constructor.

        Raises:
            ValueError: If the value is negative or not finite.
        """
        return cls(_not_negative(value, "depth-buffer bias"), buffer)

    def apply(self, grid: RayGrid, points: Points, normals: Points) -> BiasedReceiver:
        """The receivers where they are, and the value divided by the buffer's rate at their distance."""
        buffer = DepthBuffer(jnp.zeros_like(grid.far), grid.far) if self.buffer is None else self.buffer
        _, distance = grid.locate(points)
        return BiasedReceiver(points, self.value.astype(points.dtype) / buffer.rate(distance).astype(points.dtype))

    @property
    def made_by(self) -> str:
        """The call of `create`; the buffer by name."""
        return f"BufferBias.create({float(self.value):g}{'' if self.buffer is None else ', buffer'})"


class BiasSum(BiasRule):
    """Several rules at once, as engines combine a constant with a normal offset: depths add, moves add.

    Attributes:
        parts: At least one rule.
    """

    parts: tuple[BiasRule, ...]

    def __check_init__(self) -> None:
        require(len(self.parts) > 0, "a sum of biases needs at least one part")

    def apply(self, grid: RayGrid, points: Points, normals: Points) -> BiasedReceiver:
        """The sum of what the parts do."""
        each = [part.apply(grid, points, normals) for part in self.parts]
        # Moves relative to the receiver add; each part has worked from the unmoved receiver.
        moved = points + sum((one.points - points for one in each), start=jnp.zeros_like(points))
        depth = sum((one.depth for one in each), start=jnp.zeros_like(points[..., 0]))
        limit = max(one.plane_limit for one in each)
        return BiasedReceiver(moved, depth, any(one.follows_plane for one in each), limit)

    @property
    def steepest(self) -> float:
        """The least of the parts'."""
        return min(part.steepest for part in self.parts)

    @property
    def limit_text(self) -> str:
        """That of the part that stops first."""
        return min(self.parts, key=lambda part: part.steepest).limit_text

    def steepness(self, grid: RayGrid, points: Points, normals: Points) -> Float[Array, "*points"]:
        """The largest of the parts'."""
        each = [part.steepness(grid, points, normals) for part in self.parts]
        return jnp.max(jnp.stack(each), axis=0)

    def is_limited(self, grid: RayGrid, points: Points, normals: Points) -> Bool[Array, "*points"]:
        """Where any part is."""
        each = [part.is_limited(grid, points, normals) for part in self.parts]
        return jnp.any(jnp.stack(each), axis=0)

    def following(self, steepest: float) -> "BiasSum":
        """Of parts with another limit."""
        return BiasSum(tuple(part.following(steepest) for part in self.parts))

    @property
    def made_by(self) -> str:
        """The call that makes it."""
        return f"BiasSum(({', '.join(part.made_by for part in self.parts)},))"


@checked
def acne_free_offset(grid: RayGrid, points: Points, normals: Points, reach: float) -> Float[Array, "*points"]:
    """Smallest length of a `NormalOffset` that frees each receiver's plane of acne, world units.

    Args:
        grid: The light rays of the map.
        points: Receivers.
        normals: Their unit normals.
        reach: The filter's reach, texels.

    Returns:
        ρ·(|n·w_s| + |n·w_t|), one for each receiver.
    """
    across, down = grid.cell_vectors(points)
    return reach * (jnp.abs(dot(normals, across)) + jnp.abs(dot(normals, down)))


__all__ = [
    "OFFSET_UNITS",
    "SLOPES",
    "BiasSum",
    "BufferBias",
    "NormalOffset",
    "ReceiverPlane",
    "SlopeScaled",
    "acne_free_offset",
]
