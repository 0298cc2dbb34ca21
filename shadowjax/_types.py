"""Shaped aliases, and the one converter that turns numbers into arrays of one dtype."""

from collections.abc import Sequence
from typing import Any, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import jaxtyping
import numpy as np
from jaxtyping import Array, Bool, Float, Int, PyTree, UInt

# What users give where an array is wanted.
ArrayLike = jaxtyping.ArrayLike | Sequence[Any]

# What users give as a dtype: jnp.float32, a NumPy dtype, or its name.
DType = str | type | np.dtype

Scalar = Float[Array, ""]
# A number of Python, or one that may be traced.
ScalarLike = float | Scalar
Vector2 = Float[Array, "2"]
Vector3 = Float[Array, "3"]
Points = Float[Array, "*points 3"]

_Tree = TypeVar("_Tree")


def default_dtype() -> DType:
    """The floating dtype that JAX gives a Python float: float64 only where the user enabled it."""
    return jnp.result_type(float)


def floating_dtype(dtype: DType | None) -> DType:
    """A floating dtype, or ValueError."""
    try:
        is_floating = dtype is not None and jnp.issubdtype(jnp.dtype(dtype), jnp.floating)
    except (TypeError, ValueError):
        is_floating = False
    if not is_floating:
        raise ValueError(f"dtype must be a floating dtype, such as jnp.float32; got {dtype!r}")
    assert dtype is not None
    return dtype


def as_float_array(value: ArrayLike, dtype: DType | None = None) -> Float[Array, "..."]:
    """Turn a number, list or array into a strongly typed floating array.

    A floating array keeps its dtype (NumPy float64 becomes the default dtype, since it is what Python numbers are);
    everything else takes `dtype`, or the default. Strong types keep `jit` from retracing and promotion from surprising.
    """
    if dtype is None:
        keeps = isinstance(value, jax.Array) and jnp.issubdtype(value.dtype, jnp.floating)
        dtype = value.dtype if keeps else default_dtype()  # pyright: ignore[reportAttributeAccessIssue]
    return jnp.asarray(value, dtype=dtype)


def astype(tree: _Tree, dtype: DType) -> _Tree:
    """Copy of any object of this package with every floating array in `dtype`.

    Raises:
        ValueError: If `dtype` is not a floating dtype.
    """
    dtype = floating_dtype(dtype)
    return jax.tree.map(
        lambda leaf: leaf.astype(dtype) if eqx.is_inexact_array(leaf) else leaf,
        tree,
    )


__all__ = [
    "Array",
    "ArrayLike",
    "Bool",
    "DType",
    "Float",
    "Int",
    "Points",
    "PyTree",
    "Scalar",
    "ScalarLike",
    "UInt",
    "Vector2",
    "Vector3",
    "as_float_array",
    "astype",
    "default_dtype",
    "floating_dtype",
]  # fmt: skip
