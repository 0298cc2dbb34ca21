"""The checker of annotations: unions in any order, and calls of a known layout that read numbers all the same."""

import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from shadowjax._array_kinds import ArrayKind, Numbers
from shadowjax._checked import checked
from shadowjax._checks import MAY_BE_INFINITE, NOT_NEGATIVE, POSITIVE
from shadowjax._kinds import Call, Choice, Either, Flag, Function, Instance, Integer, Items, Nothing, Number
from shadowjax._types import Array, Float

KINDS = {
    "None": Nothing(), "number": Number(), "positive": Number(POSITIVE), "integer": Integer(1), "truth": Flag(),
    "choice": Choice(("a", "b")), "word": Instance(str), "function": Function(), "like": Numbers(NOT_NEGATIVE),
    "array": ArrayKind("Float", "points 3", False), "scalar": ArrayKind("Float", "", False),
    "numpy": ArrayKind("Float", "rows cols", True), "pair": Items(tuple, (Number(), Number()), True),
}  # fmt: skip
VALUES = (
    None, 1, 0, -2.5, 0.5, np.nan, True, "a", "c", len, (1.0, 2.0), [1.0, 2.0], [[1.0, 2.0, 3.0]], [[1.0], [2.0, 3.0]],
    np.zeros(()), np.ones((2, 3)), np.full((2, 3), -1.0), np.arange(3), np.float32(3), np.int64(2), 1j, b"x",
    np.ones((2, 3), np.float32), {"a": 1}, object,
)  # fmt: skip


def outcome(kinds, value):
    """What a union makes of a value: its class, dtype and value, or that it refuses."""
    call = Call("f", {}, True, (value,))
    call.dims["points"] = (2, "others", False)
    try:
        found = Either(kinds).check(value, "x", call)
    except ValueError as refusal:
        return "refused", str(refusal).split("; got")[1:]
    array = getattr(found, "dtype", None)
    return type(found), array, repr(found), sorted(call.dims)


@pytest.fixture(autouse=True)
def bad_numbers():
    """Arrays of NaN are made here on purpose."""
    with jax.debug_nans(False):
        yield


@pytest.mark.parametrize("size", [2, 3])
def test_the_order_of_a_union_does_not_matter(size):
    values = (*VALUES, *(jnp.asarray(v) for v in (0.5, [[1.0, 2.0, 3.0]] * 2, [True])))
    accepted = 0
    for names in list(itertools.combinations(KINDS, size))[:: 1 if size == 2 else 9]:
        kinds = [KINDS[name] for name in names]
        for value in values[:: size - 1]:
            found = [outcome(tuple(order), value) for order in itertools.permutations(kinds)]
            assert all(one == found[0] for one in found), (names, value, found)
            accepted += found[0][0] != "refused"
            # what one alternative takes as it is, or can convert where none takes it so, the union does not refuse
            meant = [kind for kind in kinds if kind.is_exactly(value)] or kinds
            taken = any(outcome((kind,), value)[0] != "refused" for kind in meant)
            assert taken == (found[0][0] != "refused"), (names, value)
    assert accepted > 150


@checked
def shifted(
    points: Float[Array, "points 3"], weights: Float[Array, "points"] | None = None, by: float | np.ndarray = 0.0
) -> Float[Array, "points 3"]:
    """A function of two arrays with one dimension in common."""
    return points + by if weights is None else points * weights[:, None] + by


@checked
def kept(points: Float[Array, "points 3"]) -> Float[Array, "points 3"]:
    """A function that computes nothing."""
    return points


def test_a_layout_that_fitted_is_checked_no_further_but_for_its_numbers():
    good, weights = jnp.ones((4, 3)), jnp.ones(4)
    known = shifted._arguments_.known
    known.clear()
    for _ in range(2):
        shifted(good, weights)
        shifted(good, weights=weights)
        shifted(good)
    assert len(known) == 2  # by place or by name, an array is the same argument
    for bad in (jnp.full((4, 3), jnp.nan), good.at[2, 1].set(jnp.inf)):
        with pytest.raises(ValueError, match="points must be finite"):
            shifted(bad, weights)
    with pytest.raises(ValueError, match="weights must have shape"):
        shifted(good, jnp.ones(5))
    with pytest.raises(ValueError, match="by must be finite"):
        shifted(good, weights, np.nan)
    assert shifted(good, weights, np.ones(3)).shape == (4, 3)
    assert jax.jit(shifted)(good, weights).shape == (4, 3)
    known = kept._arguments_.known
    for count in range(300):
        kept(jax.device_put(np.ones((count + 1, 3))))
    assert 0 < len(known) <= 256


def test_a_range_says_whether_infinity_is_a_number():
    kind = ArrayKind("Float", "...", False, MAY_BE_INFINITE)
    infinite = jnp.asarray([1.0, jnp.inf])
    assert kind.check(infinite, "x", Call("f", {}, True)) is infinite
    with pytest.raises(ValueError, match="1 of 2 numbers are NaN"):
        kind.check(jnp.asarray([jnp.nan, jnp.inf]), "x", Call("f", {}, True))
