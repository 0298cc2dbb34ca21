"""How far rounding can move the error of a warp: running error analysis of the sums and products that give it."""

import jax.numpy as jnp

from shadowjax._checked import Checked, checked
from shadowjax._types import Array, Float
from shadowjax.theory.aliasing.light_frustum import LightFrustum, Section, VirtualNear

TRIG = 4.0  # roundings of a sine, cosine or tangent, of which the libraries promise fewer


class Running(Checked):
    """A computed number and a bound on its distance from the exact one, both carried through each operation.

    Every operation adds one rounding of its result to what its operands bring along; a difference of nearly equal
    numbers keeps their errors and loses their size, so the bound sees it. Source: Higham, Accuracy and Stability of
    Numerical Algorithms, section 3.3.
    """

    value: Array
    error: Array

    @classmethod
    def exact(cls, value: Array) -> "Running":
        """A number as it was given."""
        return cls(value, jnp.zeros_like(value))

    def _rounded(self, num: float = 1.0) -> "Running":
        return Running(self.value, self.error + num * float(jnp.finfo(self.value.dtype).eps) * jnp.abs(self.value))

    def __add__(self, other: "Running") -> "Running":
        return Running(self.value + other.value, self.error + other.error)._rounded()

    def __sub__(self, other: "Running") -> "Running":
        return Running(self.value - other.value, self.error + other.error)._rounded()

    def __mul__(self, other: "Running") -> "Running":
        # |xy − x̂ŷ| ≤ (|x̂| + δx)·δy + |ŷ|·δx.
        crossed = (jnp.abs(self.value) + self.error) * other.error + jnp.abs(other.value) * self.error
        return Running(self.value * other.value, crossed)._rounded()

    def __truediv__(self, other: "Running") -> "Running":
        value = self.value / other.value
        # The smallest that the exact divisor can be; `tiny` stands for a divisor that may be 0.
        left = jnp.maximum(jnp.abs(other.value) - other.error, float(jnp.finfo(value.dtype).tiny))
        return Running(value, (self.error + jnp.abs(value) * other.error) / left)._rounded()

    def sin(self) -> "Running":
        """Sine; its slope is at most 1."""
        return Running(jnp.sin(self.value), self.error)._rounded(TRIG)

    def cos(self) -> "Running":
        """Cosine; its slope is at most 1."""
        return Running(jnp.cos(self.value), self.error)._rounded(TRIG)

    def tan(self) -> "Running":
        """Tangent of a number as it was given."""
        return Running(jnp.tan(self.value), self.error)._rounded(TRIG)

    @property
    def relative(self) -> Array:
        """Bound on the relative error."""
        return self.error / jnp.maximum(jnp.abs(self.value) - self.error, float(jnp.finfo(self.value.dtype).tiny))


@checked
def larger(first: Running, second: Running) -> Running:
    """The larger of two, as far off as it is itself where it is surely larger, else as the worse of them."""
    sure = jnp.abs(first.value - second.value) > first.error + second.error
    error = jnp.where(first.value > second.value, first.error, second.error)
    worse = jnp.maximum(first.error, second.error)
    return Running(jnp.maximum(first.value, second.value), jnp.where(sure, error, worse))


@checked
def rounding_bound(
    frustum: LightFrustum, near_distance: VirtualNear, objective: str, section: Section
) -> Float[Array, "..."]:
    """Bound on the relative rounding error of M_z, S or max(M_x, M_z) of a frustum and an n', taken as they are given.

    Args:
        frustum: View and light.
        near_distance: n', world units.
        objective: "z", "storage" or "both".
        section: "axis" or "whole" vertical section.
    """
    # The operations of `LightFrustum` and of M_x and M_z repeated with bounds: lower edge, extent, worst line, errors.
    # tan φ_x cancels between half width and pixel and is left out.
    exact = Running.exact
    near, far, tan_y = exact(frustum.near), exact(frustum.far), exact(frustum.phi_y).tan()
    gamma, phi = exact(frustum.gamma), exact(frustum.phi_y)
    one = exact(jnp.ones_like(near_distance))
    zero, strength, length = exact(jnp.zeros_like(near_distance)), one / exact(near_distance), far - near
    sine, tilt = gamma.sin(), tan_y * gamma.cos()
    # `low_slope`, `low_near`, `low_far` and `extent`.
    edge = (gamma - phi).sin() / phi.cos()
    low_near, low_far = length * larger(zero - edge, zero), length * larger(edge, zero)
    extent = low_far + (far + far) * tilt
    shift = near * tilt
    # `worst_line`: E at the near plane and its slope g along depth.
    first, slope = low_near + shift, sine
    if section == "whole":
        first, slope = first + shift, slope + tilt
    stretches = one + first * strength, one + (first + slope * length) * strength
    # M_x: half the map's width, on its lowest line, times the largest (1 + uκ)/z. M_z: W/(1 + Wκ) times the largest
    # (1 + uκ)²/z over 2·tan φ_y. Both are largest at an end of the worst line.
    wide = larger(near / (one + low_near * strength), far / (one + low_far * strength))
    error_x = wide * larger(stretches[0] / near, stretches[1] / far)
    squares = stretches[0] * stretches[0] / near, stretches[1] * stretches[1] / far
    error_z = extent / (one + extent * strength) * larger(*squares) / (tan_y + tan_y)
    return {"z": error_z, "storage": error_x * error_z, "both": larger(error_x, error_z)}[objective].relative


__all__ = ["Running", "larger", "rounding_bound"]
