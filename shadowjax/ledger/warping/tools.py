"""What the warping ledger shares: inputs as frusta in float64, rates of the matrix map, roots and scans."""

import functools
import math
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from scipy.optimize import brentq

from shadowjax._types import Array
from shadowjax.evaluate.measure import Beams, beams, light_axes, warp_matrix, warp_point
from shadowjax.ledger.equation import Equation
from shadowjax.ledger.inputs import Inputs
from shadowjax.theory.aliasing.light_frustum import LightFrustum

Value = Callable[[Inputs], Any]


def in_double(function: Value) -> Value:
    """The function run with 64-bit numbers, whatever the user's setting, and its result as Python numbers."""

    @functools.wraps(function)
    def run(inputs: Inputs) -> Any:
        with jax.enable_x64(True):
            value = function(inputs)
            return value if isinstance(value, str) else np.asarray(value).tolist()

    return run


def equation(
    name: str,
    where: str,
    statement: str,
    closed_form: Value,
    samples: tuple[Any, ...],
    *,
    recomputed: Value | None = None,
    independent: Value | None = None,
    measured: Value | None = None,
    **options: Any,
) -> Equation:
    """An entry `warping.name` whose functions run in float64; it holds unless `verdict` says otherwise."""
    routes = {"recomputed": recomputed, "independent": independent, "measured": measured}
    return Equation(
        id=f"warping.{name}",
        source=f"warping, {where}",
        statement=statement,
        verdict=options.pop("verdict", "holds"),
        closed_form=in_double(closed_form),
        samples=samples,
        **{kind: in_double(route) for kind, route in routes.items() if route is not None},
        **options,
    )


def frustum(i: Inputs, gamma_deg: float | None = None, **values: float) -> LightFrustum:
    """The frustum of a row: n and f (or f_over_n), phi_y_deg (or phi_deg), phi_x_deg, gamma_deg (90 if absent)."""
    near = i.number("n", default=1.0)
    far = i.number("f") if "f" in i else near * i.number("f_over_n")
    phi = i.angle("phi_y_deg", "phi_deg", "phi_x_deg", default=30.0)
    gamma = i.angle("gamma_deg", default=90.0) if gamma_deg is None else math.radians(gamma_deg)
    gamma = values.get("gamma", gamma)
    phi_x = i.angle("phi_x_deg", "phi_deg", "phi_y_deg", default=30.0)
    return LightFrustum.create(near, far, phi, min(gamma, math.pi / 2), phi_x)


def number(i: Inputs, *names: str, default: float | None = None) -> Array:
    """A number of a row as an array."""
    return jnp.asarray(i.number(*names, default=default))


def ratio(i: Inputs, image: str = "res_cy", shadow: str = "res_lt") -> float:
    """Image resolution over map resolution: `res_ratio`, or two numbers, or 1."""
    if image in i and shadow in i:
        return i.number(image) / i.number(shadow)
    return i.number("res_ratio", default=1.0)


@functools.partial(jax.jit, static_argnames="substituted")
def _rates(view: LightFrustum, near_distance: Array, depth: Array, substituted: bool) -> tuple[Array, ...]:
    tan_x = view.far * view.tan_x / (near_distance + view.extent) if substituted else None
    matrix, axes = warp_matrix(view, near_distance, tan_x), light_axes(view.gamma)

    def one(z: Array) -> tuple[Array, Array]:
        zero = jnp.zeros_like(z)
        point = jnp.stack([zero, zero, z])
        # Moves along x and z' of light space and along the view: their derivatives are ds/dx, dt/dz' and dt/dz.
        directions = jnp.stack([axes[0], axes[2], jnp.stack([zero, zero, zero + 1])])
        return warp_point(matrix, point), jax.jacfwd(lambda move: warp_point(matrix, point + move @ directions))(
            point * 0
        )

    st, rate = jax.vmap(one)(depth)
    return st, rate[:, 0, 0], rate[:, 1, 1], rate[:, 1, 2]


def rates(view: LightFrustum, near_distance: Any, depth: Any, substituted: bool = False) -> tuple[Array, ...]:
    """(s, t), ds/dx, dt/dz' and dt/dz of the real matrix map on the view axis, by automatic differentiation.

    Args:
        view: One frustum.
        near_distance: n'.
        depth: Depths, one or many.
        substituted: Whether P's opening is f·tan φ_x/f', as the source writes, and not the smallest.
    """
    near_distance = jnp.asarray(near_distance, dtype=view.near.dtype)
    depth = jnp.atleast_1d(jnp.asarray(depth, dtype=view.near.dtype))
    return _rates(view, near_distance, depth, substituted)


@functools.partial(jax.jit, static_argnames="substituted")
def _errors(view: LightFrustum, near_distance: Array, depth: Array, substituted: bool) -> tuple[Array, Array]:
    _, across, along, _ = _rates(view, near_distance, depth, substituted)
    return 1 / across / (2 * depth * view.tan_x), 1 / along / (2 * depth * view.tan_y)


@jax.jit
def _worst(view: LightFrustum, near_distance: Array) -> tuple[Array, Array]:
    inner = view.near * (view.far / view.near) ** jnp.linspace(0, 1, 61)
    errors = _errors(view, near_distance, inner.at[0].set(view.near).at[-1].set(view.far), False)
    return jnp.max(errors[0]), jnp.max(errors[1])


def derived_errors(
    view: LightFrustum, near_distance: Any, depth: Any, substituted: bool = False
) -> tuple[Array, Array]:
    """m_x and m_z on the view axis at each depth, from derivatives of the matrix map, at equal resolutions."""
    depth = jnp.atleast_1d(jnp.asarray(depth, dtype=view.near.dtype))
    return _errors(view, jnp.asarray(near_distance, dtype=view.near.dtype), depth, substituted)


def derived_max(view: LightFrustum, near_distance: Any) -> tuple[float, float]:
    """(M_x, M_z) as maxima over 61 depths of derivatives of the matrix map."""
    worst = _worst(view, jnp.asarray(near_distance, dtype=view.near.dtype))
    return float(worst[0]), float(worst[1])


def derived_storage(view: LightFrustum, near_distance: Any) -> float:
    """M_x·M_z from derivatives of the matrix map."""
    worst = derived_max(view, near_distance)
    return worst[0] * worst[1]


_beams = jax.jit(beams)


def cut(
    view: LightFrustum, near_distance: Any, depth: Any, slope: Any = 0.0, angle: Any = math.pi / 2,
    image_rows: Any = 1e5, map_rows: Any = 1e5,
) -> Beams:  # fmt: skip
    """Beams cut by a line, from plain numbers."""
    rest = (near_distance, depth, slope, angle, image_rows, map_rows)
    return _beams(view, *(jnp.asarray(x, dtype=view.near.dtype) for x in rest))


def root(function: Callable[[float], Any], low: float, high: float) -> float:
    """Root of a continuous function that changes its sign between two numbers."""
    return float(brentq(lambda x: float(function(x)), low, high, xtol=1e-300, rtol=1e-15))  # pyright: ignore[reportArgumentType]


def equal_errors(view: LightFrustum) -> float:
    """The n' at which the matrix map's m_z is equal at both planes, by root finding."""

    ends = jnp.stack([view.near, view.far])

    def difference(log_distance: float) -> float:
        both = derived_errors(view, math.exp(log_distance), ends)[1]
        return math.log(float(both[0]) / float(both[1]))

    return math.exp(root(difference, math.log(1e-9 * float(view.near)), math.log(1e3 * float(view.far))))


__all__ = [
    "cut", "derived_errors", "derived_max", "derived_storage", "equal_errors", "equation", "frustum", "in_double",
    "number", "rates", "ratio", "root",
]  # fmt: skip
