"""The ellipse as a quadratic form: membership, axes, edge and signed distance, all differentiable."""

import jax
import jax.numpy as jnp

from shadowjax._checked import Checked
from shadowjax._numerics import dot, norm, safe_sqrt
from shadowjax._types import Array, Bool, Float, Scalar
from shadowjax.scenes.polygons import Points2

_BRACKETS = 64  # arcs of the edge that are searched for the nearest point
_BISECTIONS = 48


class Ellipse(Checked):
    """All (u, v) with (u, v, 1) M (u, v, 1)ᵀ ≤ 0.

    Attributes:
        matrix: Symmetric M, positive definite in (u, v).
    """

    matrix: Float[Array, "3 3"]

    def form(self, positions: Points2) -> Float[Array, "*points"]:
        """The quadratic form: negative inside, 0 on the edge, square metres times a constant."""
        full = jnp.concatenate([positions, jnp.ones_like(positions[..., :1])], axis=-1)
        return dot(full @ self.matrix, full)

    def contains(self, positions: Points2) -> Bool[Array, "*points"]:
        """Whether positions lie in the ellipse, its edge included."""
        return self.form(positions) <= 0

    @property
    def _determinant(self) -> Scalar:
        m = self.matrix
        return m[0, 0] * m[1, 1] - m[0, 1] * m[1, 0]

    @property
    def centre(self) -> Float[Array, "2"]:
        """Middle of the ellipse."""
        m = self.matrix
        # The gradient vanishes there: A·c = −b, by Cramer's rule, with A and b the blocks of M.
        u = m[0, 1] * m[1, 2] - m[1, 1] * m[0, 2]
        v = m[0, 1] * m[0, 2] - m[0, 0] * m[1, 2]
        return jnp.stack([u, v]) / self._determinant

    @property
    def area(self) -> Scalar:
        """Area in square metres."""
        # About the centre the form is xᵀA·x + F(centre): an ellipse of the area π·(−F)/√det A.
        return -jnp.pi * self.form(self.centre) / safe_sqrt(self._determinant)

    @property
    def semi_axes(self) -> Float[Array, "2"]:
        """Half the longest and half the shortest diameter in metres."""
        m = self.matrix
        # Eigenvalues of A are mean ± spread, semi-axes √(−F/λ).
        mean, half = 0.5 * (m[0, 0] + m[1, 1]), 0.5 * (m[0, 0] - m[1, 1])
        spread = safe_sqrt(half**2 + m[0, 1] ** 2)
        return safe_sqrt(-self.form(self.centre) / jnp.stack([mean - spread, mean + spread]))

    def boundary(self, angle: Float[Array, "*points"]) -> Points2:
        """Point of the edge at a parameter in radians, 2π for once around."""
        m = self.matrix
        size = safe_sqrt(-self.form(self.centre))
        first = safe_sqrt(m[0, 0])
        second = safe_sqrt(self._determinant) / first  # Cholesky factor [[first, 0], [m01 / first, second]]
        v = jnp.sin(angle) / second
        # x = √(−F)·L⁻ᵀ(cos, sin), solved from the last row up, for A = L·Lᵀ.
        u = (jnp.cos(angle) - m[0, 1] / first * v) / first
        return self.centre + size * jnp.stack([u, v], axis=-1)

    def signed_distance(self, positions: Points2) -> Float[Array, "*points"]:
        """Distance to the edge in metres, negative inside.

        The nearest point is found by search and then held fixed: as the distance is stationary there, the gradient with
        respect to ellipse and position is exact all the same.
        """
        ellipse, fixed = jax.lax.stop_gradient((self, positions))
        step = 2 * jnp.pi / _BRACKETS
        grid = step * jnp.arange(_BRACKETS, dtype=positions.dtype)
        around = norm(ellipse.boundary(grid) - fixed[..., None, :])
        best = jnp.take(grid, jnp.argmin(around, axis=-1))

        # Half the derivative of the squared distance; it changes sign at the nearest point.
        def slope(angle: Array) -> Array:
            point, velocity = jax.jvp(ellipse.boundary, (angle,), (jnp.ones_like(angle),))
            return dot(point - fixed, velocity)

        def halve(_: object, bracket: tuple[Array, Array]) -> tuple[Array, Array]:
            low, high = bracket
            middle = 0.5 * (low + high)
            falling = slope(middle) < 0
            return jnp.where(falling, middle, low), jnp.where(falling, high, middle)

        low, high = jax.lax.fori_loop(0, _BISECTIONS, halve, (best - step, best + step))
        distance = norm(positions - self.boundary(0.5 * (low + high)))
        return jnp.where(self.contains(positions), -distance, distance)
