"""Safe divide, norm and root (double-where, so that gradients stay finite), chunked maps and small helpers."""

import functools
import math
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jax.core import eval_jaxpr
from jax.custom_batching import sequential_vmap

from shadowjax._types import Array, Bool, DType, Float


def safe_divide(
    numerator: Float[Array, "..."], denominator: Float[Array, "..."], otherwise: float = 0.0
) -> Float[Array, "..."]:
    """numerator / denominator; `otherwise`, with zero gradient, where the denominator is 0."""
    zero = denominator == 0
    return jnp.where(zero, otherwise, numerator / jnp.where(zero, jnp.ones_like(denominator), denominator))


def safe_sqrt(value: Float[Array, "..."]) -> Float[Array, "..."]:
    """Square root; 0, with zero gradient, where the value is not positive."""
    positive = value > 0
    return jnp.where(positive, jnp.sqrt(jnp.where(positive, value, jnp.ones_like(value))), jnp.zeros_like(value))


def larger(a: Float[Array, "..."], b: Float[Array, "..."] | float) -> Float[Array, "..."]:
    """The larger of two, with the whole gradient of the one taken, of the first where they are equal.

    Where two formulas are equal by design, the gradient of `jnp.maximum` is at the mercy of rounding: it compares each
    with a result that a compiler may have worked out in another way, and neither may then be equal to it.
    """
    return jnp.where(a >= b, a, b)


def largest(values: Float[Array, "*batch n"]) -> Float[Array, "*batch"]:
    """The largest over the last axis, with the whole gradient of the first that is; see `larger`."""
    return jnp.take_along_axis(values, jnp.argmax(values, axis=-1)[..., None], axis=-1)[..., 0]


def norm(vector: Float[Array, "*batch d"], keepdims: bool = False) -> Float[Array, "..."]:
    """Euclidean length over the last axis; its gradient at the zero vector is 0."""
    length = safe_sqrt(dot(vector, vector))
    return length[..., None] if keepdims else length


def normalize(vector: Float[Array, "*batch d"]) -> Float[Array, "*batch d"]:
    """Unit vector along the last axis; the zero vector stays zero."""
    return safe_divide(vector, norm(vector, keepdims=True))


def dot(a: Float[Array, "*batch d"], b: Float[Array, "*batch d"]) -> Float[Array, "*batch"]:
    """Inner product over the last axis."""
    if a.shape[-1] != b.shape[-1] or not 1 <= a.shape[-1] <= 4:
        return jnp.sum(a * b, axis=-1)
    # Written out, the components fuse with what is around them; a reduction over so short an axis is ten times slower.
    total = a[..., 0] * b[..., 0]
    for axis in range(1, a.shape[-1]):
        total = total + a[..., axis] * b[..., axis]
    return total


# A face along the light has the cosine 0 but for rounding. With u = eps/2 a cross product of two sides at the angle α
# turns by 5u/sin α, a direction by 1.5u, and their product is off by 3u: at most 16u down to sin α = 0.43.
FACING_ROUNDINGS = 8.0


def faces_light(normals: Float[Array, "*batch 3"], towards: Float[Array, "*batch 3"]) -> Bool[Array, "*batch"]:
    """Whether surfaces face where they are lit from, by more than rounding: cosine > 8 eps of the dtype.

    Args:
        normals: Unit vectors.
        towards: Unit vectors to the light.
    """
    return dot(normals, towards) > FACING_ROUNDINGS * float(jnp.finfo(normals.dtype).eps)


def singular_values(matrix: Float[Array, "*batch 2 2"]) -> tuple[Float[Array, "*batch"], Float[Array, "*batch"]]:
    """Larger and smaller singular value of 2 × 2 matrices, from norm and determinant; finite gradients."""
    # σ₁² + σ₂² = ‖M‖² and σ₁σ₂ = |det M|, so (σ₁ ± σ₂)² = ‖M‖² ± 2|det M|.
    square = jnp.sum(matrix * matrix, axis=(-1, -2))
    twice = 2 * jnp.abs(matrix[..., 0, 0] * matrix[..., 1, 1] - matrix[..., 0, 1] * matrix[..., 1, 0])
    wide, narrow = safe_sqrt(square + twice), safe_sqrt(square - twice)
    # The product of both is the determinant: dividing by the larger keeps digits that a difference would lose.
    larger = (wide + narrow) / 2
    return larger, twice / 2 / jnp.where(larger > 0, larger, jnp.ones_like(larger))


def rotate(points: Float[Array, "*points 3"], frame: Float[Array, "3 3"]) -> Float[Array, "*points 3"]:
    """Components of vectors along the rows of a frame; written out for the same reason as `dot`."""
    x, y, z = points[..., 0], points[..., 1], points[..., 2]
    return jnp.stack([x * row[0] + y * row[1] + z * row[2] for row in frame], axis=-1)


def map_in_chunks(function: Callable[[Any], Any], xs: Any, chunk: int) -> Any:
    """Apply `function` to slices of at most `chunk` rows of every array of `xs` and join the results.

    Memory stays that of one chunk. Rows are padded with copies of row 0 up to a whole number of chunks, so `function`
    must treat rows independently.
    """
    length = jax.tree.leaves(xs)[0].shape[0]
    if length <= chunk:
        return function(xs)
    num_chunks = math.ceil(length / chunk)
    padding = num_chunks * chunk - length

    def split(x: Array) -> Array:
        padded = jnp.concatenate([x, jnp.broadcast_to(x[:1], (padding, *x.shape[1:]))]) if padding else x
        return padded.reshape(num_chunks, chunk, *x.shape[1:])

    out = jax.lax.map(function, jax.tree.map(split, xs))
    return jax.tree.map(lambda y: y.reshape(num_chunks * chunk, *y.shape[2:])[:length], out)


def one_by_one(function: Callable[..., Any]) -> Callable[..., Any]:
    """The function of arrays, which `vmap` calls for one element of a batch after the other.

    As `jax.custom_batching.sequential_vmap`, and also where that stops at an assertion: in a branch that a batched
    predicate chooses, everything is batched, constants that the function makes while it is traced too. Here they are
    arguments like all others.
    """

    @functools.wraps(function)
    def call(*args: Any) -> Any:
        traced, shapes = jax.make_jaxpr(function, return_shape=True)(*args)

        @sequential_vmap
        def flat(consts: list[Any], leaves: list[Any]) -> list[Any]:
            return eval_jaxpr(traced.jaxpr, consts, *leaves)

        return jax.tree.unflatten(jax.tree.structure(shapes), flat(traced.consts, jax.tree.leaves(args)))

    return call


def far_away(dtype: DType) -> float:
    """The finite stand-in for infinity: its square is still finite, so moments of depth stay finite too."""
    return float(jnp.finfo(dtype).max) ** 0.5
