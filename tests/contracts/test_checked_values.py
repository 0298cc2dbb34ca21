"""Within `checked_values` traced numbers are checked when the program runs; outside nothing is added to programs."""

from typing import Annotated

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import shadowjax as sj
from shadowjax._checked import checked
from shadowjax._checks import NOT_NEGATIVE, POSITIVE
from shadowjax._types import Array, Float, Scalar
from shadowjax.filters.prefilter import unit_depth
from shadowjax.rays.plane_map import Box

DEPTH = jnp.linspace(0.0, 1.0, 6, dtype=jnp.float32)
BAD = np.array([0, 0.2, np.inf, 0.6, 0.8, 1], np.float32)


def scaled(depth):
    return unit_depth(depth, jnp.float32(0), jnp.float32(2))


def boxed(depth):
    box = Box(depth[:2], depth[2:4])
    return box.upper - box.lower


@pytest.mark.parametrize("function", [scaled, boxed])
def test_bad_traced_numbers_are_named_and_good_ones_pass(function):
    with sj.checked_values():
        compiled = jax.jit(function)
        np.testing.assert_array_equal(compiled(DEPTH), function(DEPTH))
        with pytest.raises(Exception, match=r"(depth|upper) must be finite"):
            jax.block_until_ready(compiled(BAD))


@pytest.mark.parametrize("within", [POSITIVE, NOT_NEGATIVE])
def test_ranges_of_signatures_are_seen_to(within):
    def root(value: Annotated[Scalar, within], by: Float[Array, "n"]) -> Float[Array, "n"]:
        return jnp.sqrt(value) * by

    root.__annotations__["value"] = Annotated[Scalar, within]
    called = checked(root)
    with sj.checked_values():
        compiled = jax.jit(called)
        np.testing.assert_allclose(compiled(jnp.float32(4), DEPTH), 2 * DEPTH)
        with pytest.raises(Exception, match=f"value must be finite and {within}"):
            jax.block_until_ready(compiled(jnp.float32(-1), DEPTH))


def test_batches_and_derivatives_pass_through():
    with sj.checked_values():
        batched = jax.jit(jax.vmap(scaled))(jnp.stack([DEPTH, DEPTH]))
        slope = jax.jit(jax.grad(lambda depth: jnp.sum(scaled(depth))))(DEPTH)
    np.testing.assert_array_equal(batched[1], scaled(DEPTH))
    np.testing.assert_array_equal(slope, 0.5)


def test_nothing_is_added_outside():
    plain = str(jax.make_jaxpr(scaled)(DEPTH))
    with sj.checked_values():
        watched = str(jax.make_jaxpr(scaled)(DEPTH))
    assert "callback" not in plain
    assert "callback" in watched
    assert str(jax.make_jaxpr(scaled)(DEPTH)) == plain
