"""Where the zero of local positions lies in the world, in 64 bits, and world positions brought there."""

import math
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from shadowjax._array_kinds import as_numbers
from shadowjax._checked import checked
from shadowjax._checks import came, concrete, require
from shadowjax._types import ArrayLike

Origin = tuple[float, float, float]
ZERO: Origin = (0.0, 0.0, 0.0)


@checked
def as_origin(value: Any) -> Origin:
    """Three Python floats, which have 64 bits whatever JAX's settings are.

    Raises:
        ValueError: If the value is not three finite numbers.
    """
    if type(value) is tuple and len(value) == 3 and all(type(x) is float and math.isfinite(x) for x in value):
        return value
    numbers = as_numbers(value)
    known = numbers is not None and numbers.shape == (3,) and numbers.dtype.kind in "fiu"
    require(known, f"origin must be three numbers; got {came(value)}")
    x, y, z = np.asarray(numbers, np.float64).tolist()
    require(all(map(math.isfinite, (x, y, z))), f"origin must be finite; got {x}, {y}, {z}")
    return x, y, z


@checked
def to_local(points: ArrayLike, origin: Any) -> ArrayLike:
    """World positions about an origin: subtracted in float64, before they become smaller floats.

    Args:
        points: (..., 3) world units. An array of JAX keeps its dtype, and has lost already what that cannot hold.
        origin: Three numbers, as `Mesh.origin`.

    Returns:
        The points themselves where the origin is zero.
    """
    origin = as_origin(origin)
    if not any(origin):
        return points
    known = concrete(points)
    if known is None:
        traced = jnp.asarray(points)
        return traced - jnp.asarray(origin, traced.dtype)
    shifted = known.astype(np.float64) - np.asarray(origin)
    return jnp.asarray(shifted, points.dtype) if isinstance(points, jax.Array) else shifted
