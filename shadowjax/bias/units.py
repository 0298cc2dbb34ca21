"""Conversion of a bias between world, texel, slope, normal-offset and depth-buffer (NDC) units."""

from collections.abc import Sequence

import equinox as eqx
import jax.numpy as jnp

from shadowjax._checked import Checked, checked
from shadowjax._checks import require_choice, require_finite, require_value
from shadowjax._numerics import dot
from shadowjax._types import Array, ArrayLike, Float, Points, Scalar, as_float_array
from shadowjax.bias.rule import depth_slope, texel_size
from shadowjax.rays.ray_grid import RayGrid

UNITS = ("world", "texel", "slope", "normal", "normal-texel", "ndc")
ENCODINGS = ("linear", "reciprocal")


class DepthBuffer(Checked):
    """How a depth buffer of one light or cascade encodes distance.

    Attributes:
        near: Distance of its near plane, world units; > 0 for the reciprocal encoding.
        far: Distance of its far plane, world units, > near.
        encoding: "linear" (parallel light) or "reciprocal" (the z/w of a perspective projection). Reversed buffers
            have the same sizes with the other sign.
        span: What near to far covers: 1 for [0, 1], 2 for OpenGL's [−1, 1].
    """

    near: Scalar
    far: Scalar
    encoding: str = eqx.field(static=True, default="linear")
    span: float = eqx.field(static=True, default=1.0)

    @classmethod
    def create(cls, near: ArrayLike, far: ArrayLike, encoding: str = "linear", span: float = 1.0) -> "DepthBuffer":
        """Checked constructor.

        Raises:
            ValueError: If the range is empty, the encoding unknown, or near not positive where it must be.
        """
        require_choice(encoding, "depth encoding", ENCODINGS)
        require_choice(span, "span of the depth buffer", (1.0, 2.0))
        near, far = require_finite(as_float_array(near), "near"), require_finite(as_float_array(far), "far")
        if encoding == "reciprocal":
            near = require_value(near, near > 0, "near must be positive where depth is stored as z/w")
        far = require_value(far, far > near, "far must exceed near")
        return cls(near, far, encoding, span)

    def encode(self, distance: Float[Array, "*points"]) -> Float[Array, "*points"]:
        """Depth-buffer value of a distance: 0 (or −1) at near, 1 at far."""
        share = (distance - self.near) / (self.far - self.near)
        if self.encoding == "reciprocal":
            # z/w of a perspective projection: f(d − n)/(d(f − n)), whose derivative n·f/(d²(f − n)) `rate` gives.
            share = share * self.far / distance
        return self.span * share + (1.0 - self.span)

    def rate(self, distance: Float[Array, "*points"]) -> Float[Array, "*points"]:
        """Change of the depth-buffer value per world unit, at a distance: the derivative of `encode`."""
        # Rate of the linear encoding, and what the reciprocal one multiplies it by.
        even = self.span / (self.far - self.near)
        if self.encoding == "linear":
            return jnp.broadcast_to(even, jnp.shape(distance))
        return even * self.near * self.far / distance**2


class BiasScale(Checked):
    """World units of depth that one of each unit means, at one receiver or many.

    Attributes:
        texel: World size of a texel at the receiver, across the light.
        slope: Depth change of the receiver's plane over one texel along both axes, world units.
        cosine: Cosine of the incidence θ, in (0, 1]: moving by h along the normal frees h / cos θ of depth.
        ndc: Depth-buffer units per world unit (`DepthBuffer.rate`); 0 where no buffer is given.
    """

    texel: Float[Array, "*points"]
    slope: Float[Array, "*points"]
    cosine: Float[Array, "*points"]
    ndc: Float[Array, "*points"]

    @classmethod
    def of_plane(
        cls,
        texel: ArrayLike,
        incidence: ArrayLike,
        azimuth: ArrayLike = 0.0,
        depth: DepthBuffer | None = None,
        distance: ArrayLike = 0.0,
    ) -> "BiasScale":
        """The scale of a plane in parallel light under square texels, in closed form.

        Args:
            texel: World size of a texel, > 0.
            incidence: θ, angle between the light and the plane's normal, radians, in [0, π/2).
            azimuth: Direction of the plane's descent in the map, radians; 0 is along an axis, π/4 the worst case.
            depth: The light's depth buffer, if NDC units are wanted.
            distance: Distance of the receiver from the light's near reference, for a reciprocal buffer.

        Raises:
            ValueError: If the incidence is out of range or the texel not positive.
        """
        texel, incidence = as_float_array(texel), as_float_array(incidence)
        texel = require_value(texel, texel > 0, "texel size must be positive")
        in_range = (incidence >= 0) & (incidence < jnp.pi / 2)
        incidence = require_value(incidence, in_range, "incidence must lie in [0, π/2) radians")
        azimuth = jnp.asarray(azimuth, texel.dtype)
        # A plane that descends by tan θ along the azimuth changes by |cos| and |sin| of it along the axes, which add
        # up.
        spread = jnp.abs(jnp.cos(azimuth)) + jnp.abs(jnp.sin(azimuth))
        slope = texel * jnp.tan(incidence.astype(texel.dtype)) * spread
        distance = jnp.asarray(distance, texel.dtype)
        rate = jnp.zeros_like(texel) if depth is None else depth.rate(distance).astype(texel.dtype)
        return cls(*jnp.broadcast_arrays(texel, slope, jnp.cos(incidence.astype(texel.dtype)), rate))

    @classmethod
    def at(cls, grid: RayGrid, points: Points, normals: Points, depth: DepthBuffer | None = None) -> "BiasScale":
        """The scale at receivers of any map: warped, perspective or not.

        Args:
            grid: The light rays of the map.
            points: Receivers.
            normals: Their unit normals.
            depth: The light's depth buffer, if NDC units are wanted; it measures distances as the map does.
        """
        cosine = jnp.abs(dot(normals, grid.space.to_source(points)))
        safe = jnp.maximum(cosine, jnp.finfo(points.dtype).eps)
        _, distance = grid.locate(points)
        rate = jnp.zeros_like(distance) if depth is None else depth.rate(distance).astype(points.dtype)
        return cls(texel_size(grid, points), depth_slope(grid, points, normals), safe, rate)

    def world_per(self, unit: str) -> Float[Array, "*points"]:
        """World units of depth that one `unit` means.

        Raises:
            ValueError: If the unit is unknown, or NDC is asked for without a depth buffer.
        """
        require_choice(unit, "bias unit", UNITS)
        if unit == "ndc":
            return 1.0 / require_value(self.ndc, self.ndc > 0, "NDC units need a depth buffer: give a DepthBuffer")
        one = jnp.ones_like(self.texel)
        # A move by h along the normal frees h/cos θ of depth.
        sizes = {
            "world": one, "texel": self.texel, "slope": self.slope,
            "normal": one / self.cosine, "normal-texel": self.texel / self.cosine,
        }  # fmt: skip
        return sizes[unit]

    def convert(self, value: ArrayLike, unit: str, to: str) -> Float[Array, "*points"]:
        """A bias in another unit.

        Args:
            value: In `unit`.
            unit: "world", "texel", "slope", "normal" (offset along the normal, world units), "normal-texel" (the same
                in texels) or "ndc".
            to: Another of these. A plane that faces the light has no slope, so nothing there is finite in "slope".

        Raises:
            ValueError: If a unit is unknown or has no size here.
        """
        target = self.world_per(to)
        target = require_value(target, target > 0, f"a bias has no size in {to!r} units here: the plane has no slope")
        return jnp.asarray(value, target.dtype) * self.world_per(unit) / target


@checked
def cascade_scales(
    grids: Sequence[RayGrid], points: Points, normals: Points, depths: Sequence[DepthBuffer] | None = None
) -> tuple[BiasScale, ...]:
    """The scale of the same receivers in each map of a partition: what one number means from cascade to cascade.

    Args:
        grids: The maps, one a cascade.
        points: Receivers.
        normals: Their unit normals.
        depths: The depth buffer of each cascade, if NDC units are wanted.
    """
    ranges = [None] * len(grids) if depths is None else list(depths)
    return tuple(BiasScale.at(grid, points, normals, depth) for grid, depth in zip(grids, ranges, strict=True))


__all__ = ["ENCODINGS", "UNITS", "BiasScale", "DepthBuffer", "cascade_scales"]
