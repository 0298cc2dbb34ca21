"""What the experiments on warps share: views in 64-bit numbers, and errors measured without the source's formulas."""

import functools
import math
from collections.abc import Callable
from typing import Any, TypeVar

import jax
import jax.numpy as jnp
import numpy as np

from shadowjax._checks import require, require_int
from shadowjax._types import Array
from shadowjax.evaluate.measure import beams, light_axes, warp_matrix, warp_point
from shadowjax.theory.aliasing.light_frustum import LightFrustum

_Result = TypeVar("_Result")


def in_double(run: Callable[[Any], _Result]) -> Callable[[Any], _Result]:
    """An experiment's `run` with 64-bit numbers, whatever the user's setting."""

    @functools.wraps(run)
    def running(config: Any) -> _Result:
        with jax.enable_x64(True):
            return run(config)

    return running


def check_view(near: float, far: float, phi_deg: float) -> None:
    """ValueError unless 0 < near < far and half the angle of view is an angle."""
    require(0 < near < far, f"near and far must satisfy 0 < near < far; got {near} and {far}")
    require(0 < phi_deg < 90, f"phi_deg, half the angle of view, must lie strictly between 0 and 90; got {phi_deg}")


def check_gamma(gamma_deg: float) -> None:
    """ValueError unless the angle between light and view lies in [0, 90] degrees."""
    require(0 <= gamma_deg <= 90, f"gamma_deg, the angle between light and view, must lie in [0, 90]; got {gamma_deg}")


def check_count(value: int, name: str, least: int) -> None:
    """ValueError unless a number of samples is a whole number of at least `least`."""
    require_int(value, name, least)


def views(near: Any, far: Any, phi_deg: Any, gamma_deg: Any = 90.0) -> LightFrustum:
    """Frusta of equal angles of view across and up, fields broadcast to one shape; inside `in_double` only.

    Args:
        near: n, world units.
        far: f, world units.
        phi_deg: Half the angle of view, degrees.
        gamma_deg: Angle between light and view, degrees.
    """
    fields = np.broadcast_arrays(*(np.asarray(x, float) for x in (near, far, np.radians(phi_deg))))
    shape = np.broadcast_shapes(fields[0].shape, np.shape(gamma_deg))
    near, far, phi = (np.broadcast_to(x, shape) for x in fields)
    gamma = np.broadcast_to(np.minimum(np.radians(np.asarray(gamma_deg, float)), math.pi / 2), shape)
    return LightFrustum.create(near, far, phi, gamma)


def log_range(low: float, high: float, count: int) -> np.ndarray:
    """Numbers of equal ratio with both ends exact."""
    steps = low * (high / low) ** np.linspace(0.0, 1.0, count)
    steps[0], steps[-1] = low, high
    return steps


def refined_largest(
    values: Callable[[np.ndarray], np.ndarray], low: float, high: float, rounds: int = 6, points: int = 65
) -> tuple[float, float]:
    """Where a function is largest and its value there, by refining an even grid around its largest sample.

    Args:
        values: The function, elementwise; with one maximum around its largest sample.
        low: Least argument.
        high: Largest argument.
        rounds: Times the grid is refined; each narrows it `(points − 1)/2` times.
        points: Of the grid.
    """
    best = low, -np.inf
    for _ in range(rounds):
        grid = np.linspace(low, high, points)
        found = values(grid)
        at = int(found.argmax())
        best = float(grid[at]), float(found[at])
        low, high = grid[max(at - 1, 0)], grid[min(at + 1, points - 1)]
    return best


@jax.jit
def _measured(view: LightFrustum, near_distance: Array, depth: Array, rows: Array) -> tuple[Array, Array]:
    def one(view: LightFrustum, near_distance: Array, depth: Array) -> tuple[Array, Array]:
        zero = jnp.zeros_like(depth)
        cut = beams(view, near_distance, depth, zero, zero + jnp.pi / 2, rows, rows)
        matrix, across = warp_matrix(view, near_distance), light_axes(view.gamma)[0]
        point = jnp.stack([zero, zero, depth])
        rate = jax.jvp(lambda moved: warp_point(matrix, moved), (point,), (across,))[1][0]
        return 1 / (rate * 2 * depth * view.tan_x), cut.perspective

    return jax.vmap(one)(view, near_distance, depth)


def measured_errors(view: LightFrustum, near_distance: Any, depth: Any, rows: int) -> tuple[np.ndarray, np.ndarray]:
    """m_x and m_z on the view axis from the 4 × 4 matrix of the warp: a derivative across, cut beams along.

    Args:
        view: Frusta.
        near_distance: n' of each, world units; broadcasts with frusta and depths.
        depth: Depths z, world units.
        rows: Rows of image and map; a beam's thickness is that of a whole texel, so m_z has an error of O(1/rows²).
    """
    near_distance, depth = (jnp.asarray(x, view.near.dtype) for x in (near_distance, depth))
    shape = jnp.broadcast_shapes(view.near.shape, near_distance.shape, depth.shape)
    flat = [jnp.broadcast_to(x, shape).ravel() for x in (*jax.tree.leaves(view), near_distance, depth)]
    across, along = _measured(LightFrustum(*flat[:5]), flat[5], flat[6], jnp.asarray(float(rows)))
    return np.asarray(across).reshape(shape), np.asarray(along).reshape(shape)
