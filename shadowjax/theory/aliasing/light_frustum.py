"""The camera frustum as the light sees it: offsets, extents and half widths in the warping chapter's light space."""

import math
from collections.abc import Callable
from typing import Annotated, Literal, TypeVar

import jax
import jax.numpy as jnp

from shadowjax._checked import Checked, checked
from shadowjax._checks import MAY_BE_INFINITE, require_choice, require_finite, require_value
from shadowjax._numerics import larger
from shadowjax._types import Array, ArrayLike, DType, Float, as_float_array

Section = Literal["axis", "whole"]
SECTIONS: tuple[Section, ...] = ("axis", "whole")
# A near distance n' of infinity is the uniform map.
VirtualNear = Annotated[Float[Array, "..."], MAY_BE_INFINITE]


_Result = TypeVar("_Result")


class LightFrustum(Checked):
    """A camera frustum under a directional light, in light space (warping, figure 21).

    Light space has y against the light and z' in the plane of y and the view direction. z' is measured here from the
    frustum's lowest point; the warping frustum P puts that point at z' = n'. A camera point at height y and depth z
    lies at y·cos γ + z·sin γ − lowest. All fields broadcast against each other.

    Args:
        near: Depth n of the near plane, world units, > 0.
        far: Depth f of the far plane, world units, > near.
        phi_y: Half the vertical angle of view, radians, in (0, π/2).
        phi_x: Half the horizontal angle of view, radians, in (0, π/2).
        gamma: Angle between light and view directions, radians, in [0, π/2].
    """

    near: Float[Array, "..."]
    far: Float[Array, "..."]
    phi_y: Float[Array, "..."]
    phi_x: Float[Array, "..."]
    gamma: Float[Array, "..."]

    @classmethod
    def create(
        cls,
        near: ArrayLike,
        far: ArrayLike,
        phi_y: ArrayLike,
        gamma: ArrayLike = math.pi / 2,
        phi_x: ArrayLike | None = None,
    ) -> "LightFrustum":
        """A checked frustum; phi_x is phi_y unless given.

        Raises:
            ValueError: If not 0 < near < far, an angle of view is outside (0, π/2), or gamma is outside [0, π/2].
        """
        dtype = jnp.result_type(*(as_float_array(x) for x in (near, far, phi_y, gamma)))
        phi_x = phi_y if phi_x is None else phi_x
        near, far, phi_y, phi_x, gamma = (jnp.asarray(x, dtype=dtype) for x in (near, far, phi_y, phi_x, gamma))
        near = require_value(require_finite(near, "near"), near > 0, "near must be positive")
        far = require_value(require_finite(far, "far"), far > near, "far must be greater than near")
        right_angle = jnp.asarray(math.pi / 2, dtype=dtype)
        for name, angle in (("phi_y", phi_y), ("phi_x", phi_x)):
            inside = (angle > 0) & (angle < right_angle)
            require_value(
                angle, inside, f"{name}, half an angle of view in radians, must lie strictly between 0 and π/2"
            )
        inside = (gamma >= 0) & (gamma <= right_angle)
        gamma = require_value(gamma, inside, "gamma must be in radians and lie in [0, π/2]")
        return cls(near, far, phi_y, phi_x, gamma)

    @property
    def tan_y(self) -> Float[Array, "..."]:
        """Tangent of half the vertical angle of view."""
        return jnp.tan(self.phi_y)

    @property
    def tan_x(self) -> Float[Array, "..."]:
        """Tangent of half the horizontal angle of view."""
        return jnp.tan(self.phi_x)

    @property
    def sine(self) -> Float[Array, "..."]:
        """sin γ: how far z' moves for a unit of depth on the view axis."""
        return jnp.sin(self.gamma)

    @property
    def tilt(self) -> Float[Array, "..."]:
        """tan φ_y · cos γ: how far z' moves for a unit of depth from the view axis to the frustum's top edge."""
        return self.tan_y * jnp.cos(self.gamma)

    @property
    def low_slope(self) -> Float[Array, "..."]:
        """sin γ − tan φ_y·cos γ: how far z' moves for a unit of depth along the frustum's lower edge.

        From the angles, sin(γ − φ_y)/cos φ_y: near γ = φ_y the two terms lose all their digits to each other.
        """
        return jnp.sin(self.gamma - self.phi_y) / jnp.cos(self.phi_y)

    @property
    def low_near(self) -> Float[Array, "..."]:
        """Offset of the near plane's lowest edge above the frustum's lowest point; 0 unless γ < φ_y."""
        # The lower edge falls along z' where its slope is negative; then the far plane holds the lowest point.
        return (self.far - self.near) * larger(-self.low_slope, 0.0)

    @property
    def low_far(self) -> Float[Array, "..."]:
        """Offset of the far plane's lowest edge above the frustum's lowest point; 0 unless γ > φ_y."""
        return (self.far - self.near) * larger(self.low_slope, 0.0)

    @property
    def extent(self) -> Float[Array, "..."]:
        """W = f' − n', the frustum's length along z' (warping, eq. 36)."""
        # The top of the far plane is the highest point for every γ in [0, π/2]: the far plane's own range 2f·tan
        # φ_y·cos γ lies on top of its lowest edge.
        return self.low_far + 2 * self.far * self.tilt

    def each(self, function: Callable[["LightFrustum"], _Result]) -> _Result:
        """What a function of one frustum, whose fields are numbers, gives for every view, along its first axes."""
        shape = jnp.broadcast_shapes(*(x.shape for x in jax.tree.leaves(self)))
        if not shape:
            return function(self)
        flat = jax.tree.map(lambda x: jnp.broadcast_to(x, shape).reshape(-1), self)
        return jax.tree.map(lambda x: x.reshape(*shape, *x.shape[1:]), jax.vmap(function)(flat))

    @property
    def gamma_limit(self) -> Float[Array, "..."]:
        """The γ at which the z' ranges of near and far plane touch (warping, eq. 40); always above φ_y."""
        return jnp.arctan(self.tan_y * (self.far + self.near) / (self.far - self.near))

    @property
    def uniform_near_distance(self) -> Float[Array, "..."]:
        """A finite n' that stands for n' = ∞: the uniform map to the last bit."""
        extent = self.extent
        return extent * (4 / float(jnp.finfo(extent.dtype).eps))  # W/n' is a quarter of an ulp of 1

    def bounded(self, near_distance: VirtualNear) -> Float[Array, "..."]:
        """A near distance kept at or below the one that stands for ∞; infinite ones become it."""
        uniform = self.uniform_near_distance
        # Also turns a NaN into the uniform map, since every comparison with NaN is false.
        return jnp.where(near_distance < uniform, near_distance, uniform)

    def ratio(self, numerator: Float[Array, "..."], denominator: Float[Array, "..."]) -> Float[Array, "..."]:
        """numerator/denominator for a numerator ≥ 0; the uniform map where the denominator is not positive."""
        tiny = float(jnp.finfo(denominator.dtype).tiny) ** 0.5  # 0/0 would be no number, and its gradient neither
        return numerator / larger(denominator, larger(numerator, tiny) / self.uniform_near_distance)

    def offset(self, depth: Float[Array, "..."], height: Float[Array, "..."] | float = 0.0) -> Float[Array, "..."]:
        """z' − n' of camera points.

        Args:
            depth: Depth z along the view direction, world units.
            height: Height y above the view axis, world units.

        Source: warping, eq. 35 (height 0).
        """
        # y·cos γ + z·sin γ counted from the near plane's axis point, whose offset is low_near + n·tan φ_y·cos γ: sums
        # of terms ≥ 0 at height 0.
        rise = (depth - self.near) * self.sine + height * jnp.cos(self.gamma)
        return self.low_near + self.near * self.tilt + rise

    def worst_line(self, section: Section = "axis") -> tuple[Float[Array, "..."], Float[Array, "..."]]:
        """Where the z' error is largest at each depth: offset at the near plane and its slope along depth.

        Args:
            section: "axis" looks at the view axis only, as the source does; "whole" at the whole vertical section,
                whose worst points lie on its top edge, because the error grows with z'.

        Returns:
            E and g such that the line's offset is E + g·(z − n).
        """
        require_choice(section, "section", SECTIONS)
        if section == "axis":
            return self.low_near + self.near * self.tilt, self.sine
        return self.low_near + 2 * self.near * self.tilt, self.sine + self.tilt

    def slack(self, section: Section = "axis") -> Float[Array, "..."]:
        """W − 2E of a section's worst line, summed so that it keeps its digits as γ → 0."""
        require_choice(section, "section", SECTIONS)
        # W − 2E = low_far − 2·low_near + 2(f − n)·tilt, with the sign of the lower edge's slope put in.
        axis = (self.far - self.near) * (self.sine + jnp.where(self.low_slope > 0, self.tilt, self.sine))
        return axis if section == "axis" else axis - 2 * self.near * self.tilt

    def half_width(self, strength: Float[Array, "..."]) -> Float[Array, "..."]:
        """Half width, at z' = n', of the smallest P that encloses all 8 corners, world units.

        Args:
            strength: 1/n', per world unit; 0 is the uniform map.

        Source: n'·tan φ'_x of warping, eq. 20, with the true opening instead of f·tan φ_x/f'.
        """
        # The widest corners of each plane relative to P are its lowest ones, where P is narrowest.
        near, far = self.near / (1 + strength * self.low_near), self.far / (1 + strength * self.low_far)
        return self.tan_x * larger(near, far)


@checked
def strength_of(
    near_distance: Annotated[ArrayLike, MAY_BE_INFINITE], dtype: DType | None = None
) -> Float[Array, "..."]:
    """1/n', the number by which a perspective warp bends; 0 is the uniform map.

    Raises:
        ValueError: If n' is not positive.
    """
    near_distance = as_float_array(near_distance, dtype)
    return 1 / require_value(near_distance, near_distance > 0, "the virtual near distance n' must be positive")


__all__ = ["SECTIONS", "LightFrustum", "Section", "strength_of"]
