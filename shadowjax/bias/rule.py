"""Shadow bias with explicit units: depth tolerance in world units, texels, or slope-scaled texels."""

import math
from abc import abstractmethod
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp

from shadowjax._checked import Checked, checked
from shadowjax._checks import require, require_choice, require_finite
from shadowjax._numerics import dot, norm
from shadowjax._types import Array, ArrayLike, Bool, Float, Points, Scalar, as_float_array
from shadowjax.rays.plane_map import Box
from shadowjax.rays.ray_grid import RayGrid

UNITS = ("world", "texel", "slope")

# Light that grazes at less than 4° leaves a surface nearly dark; a larger bias would let light through at creases.
MAX_SLOPE = 16.0


class BiasedReceiver(Checked):
    """What a bias does to receivers before they are tested.

    Attributes:
        points: Where the map is read; the receivers themselves unless they are offset.
        depth: Depth tolerance, world units.
        follows_plane: Whether every tap is tested against the receiver's own plane instead of its depth.
        plane_limit: Steepest plane that taps are tested against, texels of depth for each texel along an axis.
    """

    points: Points
    depth: Float[Array, "*points"]
    follows_plane: bool = eqx.field(static=True, default=False)
    plane_limit: float = eqx.field(static=True, default=MAX_SLOPE)


class BiasRule(Checked):
    """A way to keep surfaces from shadowing themselves; it belongs to the test, never to the stored depth."""

    _remedy_: ClassVar = 'Give Bias.create(0.01, unit) with the unit "world", "texel" or "slope"'

    @abstractmethod
    def apply(self, grid: RayGrid, points: Points, normals: Points) -> BiasedReceiver:
        """The bias at each receiver.

        Args:
            grid: The light rays of the map.
            points: Receivers.
            normals: Their unit normals.
        """

    @property
    def steepest(self) -> float:
        """Largest slope that the rule follows, texels of depth for each texel; infinite where it follows none."""
        return math.inf

    @property
    def limit_text(self) -> str:
        """What limits the rule on steep planes, in words."""
        return f"{self.steepest:g} texels of slope"

    def steepness(self, grid: RayGrid, points: Points, normals: Points) -> Float[Array, "*points"]:
        """Slope of each receiver's plane as `steepest` counts it, texels of depth for each texel; 0 if none counts."""
        del grid, normals
        return jnp.zeros_like(points[..., 0])

    def is_limited(self, grid: RayGrid, points: Points, normals: Points) -> Bool[Array, "*points"]:
        """Where the rule forgives less than a receiver's plane asks for, because that is steeper than its limit."""
        return self.steepness(grid, points, normals) > self.steepest

    def following(self, steepest: float) -> "BiasRule":
        """The rule with another limit, texels of depth for each texel; itself where it follows no slope."""
        del steepest
        return self

    @property
    def made_by(self) -> str:
        """The call that makes the rule; its numbers must be known."""
        return repr(self)


class Bias(BiasRule):
    """Depth tolerance of the shadow test; it belongs to the test, never to the stored depth.

    Attributes:
        value: Amount in `unit`.
        unit: "world": world units. "texel": multiples of a texel's world size at the receiver. "slope": the depth by
            which the receiver's own plane changes over this many texels along both axes (`depth_change`); with the
            filter's `reach` it is the smallest bias that frees a plane of acne.
        limit: Largest bias in "slope" units, texels of depth for each texel of slope, > 0. Where light grazes at less
            than 4° the usual 16 leave acne; `evaluate.slope_limit` says where, and how much more it takes.
    """

    value: Scalar
    unit: str = eqx.field(static=True, default="slope")
    limit: float = eqx.field(static=True, default=MAX_SLOPE)

    def __check_init__(self) -> None:
        require_choice(self.unit, "bias unit", UNITS)
        require(self.limit > 0, f"the bias limit must be positive; got {self.limit}")

    @classmethod
    def create(cls, value: ArrayLike, unit: str = "slope", limit: float = MAX_SLOPE) -> "Bias":
        """Checked constructor.

        Raises:
            ValueError: If the unit is unknown, the value not finite, or the limit not positive.
        """
        return cls(require_finite(as_float_array(value), "bias value"), unit, limit)

    def in_world(
        self, grid: RayGrid, points: Points, normals: Points, texel: Float[Array, "*points"] | None = None
    ) -> Float[Array, "*points"]:
        """The bias at each receiver as a distance along its light ray, world units.

        Args:
            grid: The light rays of the map.
            points: Receivers.
            normals: Their unit normals.
            texel: Side of the texel that answers for each receiver, in cells of the grid; 1 if None.
        """
        value = jnp.broadcast_to(self.value.astype(points.dtype), points.shape[:-1])
        if self.unit == "world":
            return value
        value = value if texel is None else value * texel
        if self.unit == "texel":
            return value * texel_size(grid, points)
        return depth_change(grid, points, normals, value, self.limit)

    def apply(self, grid: RayGrid, points: Points, normals: Points) -> BiasedReceiver:
        """The receivers where they are, and `in_world`."""
        limit = self.limit if self.unit == "slope" else MAX_SLOPE
        return BiasedReceiver(points, self.in_world(grid, points, normals), False, limit)

    @property
    def steepest(self) -> float:
        """`limit`, for a bias in texels of slope."""
        return self.limit if self.unit == "slope" else math.inf

    def steepness(self, grid: RayGrid, points: Points, normals: Points) -> Float[Array, "*points"]:
        """The sum of the depth changes over one texel along both axes."""
        slope = depth_slope(grid, points, normals, math.inf) / texel_size(grid, points)
        return jnp.where((self.unit == "slope") & (self.value > 0), slope, jnp.zeros_like(slope))

    def following(self, steepest: float) -> "Bias":
        """With another `limit`, for a bias in texels of slope."""
        return Bias(self.value, self.unit, steepest) if self.unit == "slope" else self

    @property
    def made_by(self) -> str:
        """The call of `create`."""
        limit = "" if self.limit == MAX_SLOPE else f", limit={self.limit:g}"
        return f'Bias.create({float(self.value):g}, "{self.unit}"{limit})'


@checked
def texel_size(grid: RayGrid, points: Points) -> Float[Array, "*points"]:
    """World length of the longer side of the texel that each point falls into, across the light ray."""
    across, down = grid.cell_vectors(points)
    return jnp.maximum(norm(across), norm(down))


@checked
def plane_gradient(
    grid: RayGrid, points: Points, normals: Points, limit: float = MAX_SLOPE
) -> Float[Array, "*points 2"]:
    """Depth change of the receiver's plane over one texel along x and along y of the map, signed, world units.

    Moving by one cell shifts a point by c at constant depth; staying on the plane with normal n then takes
    δ = −n·c / n·d along the light direction d.

    Args:
        grid: The light rays of the map.
        points: Receivers.
        normals: Their unit normals.
        limit: Largest change along an axis, texels; 16 is an incidence of 86°.

    Returns:
        Finite numbers, also where the surface is parallel to the light.
    """
    cells = grid.cell_vectors(points)
    cosine = dot(normals, grid.space.to_source(points))
    least = jnp.finfo(points.dtype).eps
    # A grazing light has δ → ∞: the divisor is kept from 0 and the quotient from more than `limit` texels.
    safe = jnp.where(jnp.abs(cosine) < least, least, cosine)
    largest = limit * jnp.maximum(norm(cells[0]), norm(cells[1]))
    changes = [jnp.clip(dot(normals, cell) / safe, -largest, largest) for cell in cells]
    return jnp.stack(changes, axis=-1)


@checked
def depth_slope(grid: RayGrid, points: Points, normals: Points, limit: float = MAX_SLOPE) -> Float[Array, "*points"]:
    """Depth change of the receiver's plane over one texel along both axes of the map, world units.

    Moving by one cell shifts a point by c at constant depth; staying on the plane with normal n then takes
    δ = −n·c / n·d along the light direction d. The sum of both axes' |δ| bounds the change over a texel.

    Args:
        grid: The light rays of the map.
        points: Receivers.
        normals: Their unit normals.
        limit: Largest change, texels.

    Returns:
        Non-negative depth, at most `limit` texels (16: an incidence of 86°), also where a surface is parallel to light.
    """
    across, down = grid.cell_vectors(points)
    cosine = jnp.abs(dot(normals, grid.space.to_source(points)))
    # |n·c| of both axes over the cosine; the sum bounds the change to any place within the texel's reach.
    rise = jnp.abs(dot(normals, across)) + jnp.abs(dot(normals, down))
    largest = limit * jnp.maximum(norm(across), norm(down))
    safe = jnp.maximum(cosine, jnp.finfo(points.dtype).eps)
    return jnp.minimum(rise / safe, largest)


@checked
def depth_change(
    grid: RayGrid, points: Points, normals: Points, reach: ArrayLike, limit: float = MAX_SLOPE
) -> Float[Array, "*points"]:
    """How far the receiver's plane comes nearer to the light within `reach` texels along both axes, world units.

    Over a map with texels of one size this is `reach · depth_slope`. Warps and local lights bend the plane's depth
    between texels, so there it is also followed to the four corners of the reach, c from the receiver at constant
    depth, where it is nearer by −n·c / n·s, s being the unit vector to the light at the corner; the larger counts.
    Parallel light through a map that keeps lines straight has its extremes at corners. The distance to a lamp is a
    convex function over a plane, whose derivative bounds how much nearer it comes.

    Args:
        grid: The light rays of the map.
        points: Receivers.
        normals: Their unit normals.
        reach: Texels, one number or one for each point; a negative number gives a negative change.
        limit: Largest change, texels of depth for each texel of reach.

    Returns:
        At most `limit · reach` texels, also where the surface is parallel to the light.
    """
    reach = jnp.broadcast_to(jnp.asarray(reach, points.dtype), points.shape[:-1])
    if grid.space.is_parallel and isinstance(grid.plane_map, Box):
        return reach * depth_slope(grid, points, normals, limit)
    position, depth = grid.locate(points)
    behind = dot(normals, grid.space.to_source(points)) < 0
    # Turned to the light, so that the cosine below is positive; the quotient does not depend on the normal's sign.
    facing = jnp.where(behind[..., None], -normals, normals)
    largest = limit * jnp.abs(reach) * texel_size(grid, points)
    change = reach * depth_slope(grid, points, normals, limit)
    # What rounding makes of the difference of two places; where nothing bends, the derivative's answer stands.
    farthest = grid.far if grid.space.is_parallel else jnp.minimum(depth, grid.far)
    rounding = 2 * jnp.finfo(points.dtype).eps * farthest
    # To each corner of the reach at the receiver's depth, and from there along the corner's own ray onto the plane.
    for corner in ((-1.0, -1.0), (-1.0, 1.0), (1.0, -1.0), (1.0, 1.0)):
        moved = grid.point(position + jnp.abs(reach)[..., None] * jnp.asarray(corner, points.dtype), depth)
        cosine = dot(facing, grid.space.to_source(moved))
        nearer = (dot(facing, points - moved) - rounding) / jnp.maximum(cosine, jnp.finfo(points.dtype).eps)
        change = jnp.where(reach < 0, jnp.minimum(change, -nearer), jnp.maximum(change, nearer))
    return jnp.clip(change, -largest, largest)
