"""Checks of what users give: ValueError for structure, eqx.error_if for values. Constructors and entry points only."""

import os
import sys
import warnings
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from shadowjax._types import Array, floating_dtype


class SceneWarning(UserWarning):
    """Something makes a scene's shadows worthless, though every number is in range; the message says the remedy."""


def warn(message: str) -> None:
    """Say, at the line of the caller outside this package, what is wrong with a scene; only where values are known."""
    level, frame, inside = 2, sys._getframe(1), os.path.dirname(__file__)
    while frame.f_back is not None and frame.f_code.co_filename.startswith(inside):
        level, frame = level + 1, frame.f_back
    warnings.warn(message, SceneWarning, stacklevel=level - 1)


def concrete(value: Any) -> np.ndarray | None:
    """The NumPy value of an array, or None while it is traced."""
    return None if isinstance(value, Tracer) else np.asarray(value)


def without_tracers(tree: Any) -> Any | None:
    """The same with every array a known value, also while `grad` differentiates it; None under `jit` and `vmap`."""
    fixed = jax.lax.stop_gradient(tree)
    return None if any(concrete(leaf) is None for leaf in jax.tree.leaves(fixed)) else fixed


def require(condition: bool, message: str) -> None:
    """Raise ValueError with `message` unless `condition` holds; for facts known when Python runs."""
    if not condition:
        raise ValueError(message)


@dataclass(frozen=True)
class Range:
    """Where a number has to lie; in an annotation, `Annotated[float, POSITIVE]`, checked signatures see to it.

    Attributes:
        low: Least value; None for no bound.
        high: Largest value; None for no bound.
        is_open: Whether `low` itself is left out.
        has_infinity: Whether infinity is a number too, as that n' of a uniform map.
        is_read: Whether a checked signature reads the numbers; a function that converts them first reads the result.
    """

    low: float | None = None
    high: float | None = None
    is_open: bool = False
    has_infinity: bool = False
    is_read: bool = True

    @property
    def is_bounded(self) -> bool:
        """Whether some finite numbers lie outside."""
        return self.low is not None or self.high is not None

    def holds(self, value: Any) -> bool:
        """Whether all numbers lie inside."""
        above = self.low is None or (value > self.low if self.is_open else value >= self.low)
        return bool(np.all(above) and (self.high is None or np.all(value <= self.high)))

    def __str__(self) -> str:
        """In words."""
        if self.low is None:
            return f"at most {self.high:g}" if self.high is not None else "any number"
        above = "positive" if self.low == 0 else f"above {self.low:g}"
        text = above if self.is_open else f"at least {self.low:g}"
        return text if self.high is None else f"{text} and at most {self.high:g}"


POSITIVE = Range(0.0, is_open=True)
NOT_NEGATIVE = Range(0.0)
UNIT_INTERVAL = Range(0.0, 1.0)
AT_LEAST_ONE = Range(1)
MAY_BE_INFINITE = Range(has_infinity=True)
READ_INSIDE = Range(is_read=False)


def came(value: Any) -> str:
    """What a user gave, in a few words: kind, and shape or value."""
    if isinstance(value, type):
        return f"the class {value.__name__}"
    if isinstance(value, Tracer | jax.Array | np.ndarray):
        shown = "" if isinstance(value, Tracer) or value.size != 1 or value.ndim else f" ({value})"
        return f"an array of shape {tuple(value.shape)} and dtype {value.dtype}{shown}"
    if isinstance(value, list | tuple):
        kinds = dict.fromkeys(type(part).__name__ for part in value)
        return f"a {type(value).__name__} of {len(value)}" + (f" ({', '.join(list(kinds)[:3])})" if kinds else "")
    if value is None or isinstance(value, str | bytes | bool | int | float | complex | np.generic):
        # Python refuses to write integers of thousands of digits.
        num_bits = value.bit_length() if isinstance(value, int) else 0
        huge = num_bits > 256
        text = f"an integer of {num_bits} bits" if huge else repr(value)
        text = text if len(text) <= 60 else f"{text[:57]}…"
        return text if value is None or huge else f"{text} ({type(value).__name__})"
    if callable(value) and hasattr(value, "__name__"):
        return f"the function {value.__name__}"
    return f"a{'n' if type(value).__name__[0] in 'AEIOU' else ''} {type(value).__name__}"


def require_int(value: Any, name: str, minimum: int, maximum: int = (1 << 63) - 1) -> int:
    """An int that is at least `minimum` and at most `maximum`, or a ValueError that names it."""
    is_int = isinstance(value, int | np.integer) and not isinstance(value, bool)
    least = "" if minimum <= -(1 << 63) else f" of at least {minimum}"
    require(bool(is_int and value >= minimum), f"{name} must be an integer{least}; got {came(value)}")
    require(bool(value <= maximum), f"{name} must be at most {maximum}; got {came(value)}")
    return int(value)


def require_number(value: Any, name: str, within: Range | None = None) -> Any:
    """A finite real number, of Python or an array of shape (), that is no bool; else a ValueError that names it."""
    wanted = "a number" if within is None else f"a number, {within}"
    is_array = isinstance(value, np.ndarray | np.generic | jax.Array)
    good = bool(value.ndim == 0 and value.dtype.kind in "fiu") if is_array else isinstance(value, int | float)
    require(good and not isinstance(value, bool), f"{name} must be {wanted}; got {came(value)}")
    try:
        number = float(value)
    except OverflowError:
        number = np.inf
    require(bool(np.isfinite(number)), f"{name} must be finite; got {came(value)}")
    require(within is None or within.holds(number), f"{name} must be {wanted}; got {came(value)}")
    return value


def require_dtype(value: Any, name: str) -> Any:
    """A floating dtype, or a ValueError that names it."""
    try:
        return floating_dtype(value)
    except ValueError as error:
        message = f"{name} must be a floating dtype, such as jnp.float32; got {came(value)}"
        raise ValueError(message) from error


def require_choice(value: Any, name: str, choices: Iterable[Any]) -> Any:
    """`value` if it is one of `choices`, or a ValueError that lists them."""
    known = tuple(choices)
    is_plain = value is None or isinstance(value, str | int | float)
    require(
        bool(is_plain and value in known), f"{name} must be one of {', '.join(map(repr, known))}; got {came(value)}"
    )
    return value


def require_value(array: Array, holds: Any, message: str) -> Array:
    """Return `array`; complain where `holds` (a boolean array made from it) is false.

    Outside `jit` this is a ValueError with the value; while traced it becomes a run-time check through `eqx.error_if`.
    """
    known, verdict = concrete(array), concrete(holds)
    if known is not None and verdict is not None:
        if not verdict.all():
            shown = np.array2string(known, threshold=8, precision=6)
            raise ValueError(f"{message}; got {shown}")
        return array
    return eqx.error_if(array, jnp.logical_not(jnp.all(holds)), message)


# Part of the key under which JAX keeps what it traced, so that nothing is taken over from outside or inside.
_WATCH = jax.make_user_context(False)


@contextmanager
def checked_values() -> Iterator[None]:
    """Within it, what is traced checks its numbers at run time: NaN, infinity and the ranges that signatures name.

    Numbers that are known are always checked. Traced ones are unknown until the compiled program runs, and a check of
    them (`eqx.error_if`) calls back from it, which keeps it out of JAX's persistent cache of compiled programs; so they
    are checked only on demand, such as once while a model is put together. Functions compiled inside are compiled anew
    outside, without the checks, and the other way round.

    Example: `with sj.checked_values(): jax.jit(loss)(parameters)`.
    """
    with _WATCH(True):
        yield


def watches() -> bool:
    """Whether traced numbers are checked at run time."""
    return bool(_WATCH.value)


def watched(value: Array, name: str, within: Range | None) -> Array:
    """A traced value, which complains at run time if its numbers are bad and `checked_values` is on."""
    if not watches() or not jnp.issubdtype(value.dtype, jnp.inexact):
        return value
    infinite = within is not None and within.has_infinity
    bad = jnp.isnan(value) if infinite else ~jnp.isfinite(value)
    wanted = "a number" if infinite else "finite"
    if within is not None and within.is_bounded:
        low = value.dtype.type(-jnp.inf if within.low is None else within.low)
        bad |= (value <= low) if within.is_open else (value < low)
        bad |= value > value.dtype.type(jnp.inf if within.high is None else within.high)
        wanted += f" and {within}"
    return eqx.error_if(value, jnp.any(bad), f"{name} must be {wanted}")


def require_finite(array: Array, name: str) -> Array:
    """Return `array`; complain if it holds NaN or infinity."""
    if isinstance(array, Tracer):
        return eqx.error_if(array, jnp.logical_not(jnp.all(jnp.isfinite(array))), f"{name} must be finite")
    bad = num_not_finite(array)
    require(bad == 0, f"{name} must be finite; {bad} of {np.size(array)} numbers are NaN or infinite")
    return array


# From here on a sum is faster than a test of every number.
_FEW = 4096


@jax.jit
def _all_finite(array: Array) -> Array:
    return jnp.all(jnp.isfinite(array))


def num_not_finite(array: Any) -> int:
    """How many numbers of a known array are NaN or infinite; good ones are known by one sum, or on their device."""
    if isinstance(array, jax.Array) and jax.default_backend() != "cpu" and jnp.issubdtype(array.dtype, jnp.inexact):
        return 0 if bool(_all_finite(array)) else int(jnp.sum(~jnp.isfinite(array)))
    known = np.asarray(array)
    if known.dtype.kind in "iub":
        return 0
    if known.size > _FEW:
        # A sum is finite only where every number is; it may overflow where all are, so then they are counted.
        with np.errstate(all="ignore"):
            if np.isfinite(known.sum()):
                return 0
    finite = np.isfinite(known)
    return 0 if finite.all() else int(finite.size - finite.sum())


def require_untraced(name: str, *trees: Any) -> None:
    """Raise ValueError where a search that runs on the host is given traced numbers: it has no derivative to give."""
    traced = any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves(trees))
    require(
        not traced,
        f"{name} searches on the host, and what it chooses has no derivative; call it outside jit, vmap and grad",
    )


def undifferentiable(tree: Any, message: str) -> Any:
    """The same arrays, whose derivative is refused with a ValueError: for numbers that only choose."""

    @jax.custom_jvp
    def same(x: Array) -> Array:
        return x

    @same.defjvp
    def _(primals: Any, tangents: Any) -> Any:
        raise ValueError(message)

    return jax.tree.map(lambda x: same(x) if eqx.is_inexact_array(x) else x, tree)


def available_memory() -> int | None:
    """Bytes of the host's memory that programs can still take, or None where the system does not say."""
    try:
        with open("/proc/meminfo") as lines:
            sizes = {name: int(rest.split()[0]) for name, rest in (line.split(":", 1) for line in lines)}
        return 1024 * sizes["MemAvailable"]
    except (OSError, KeyError, ValueError):
        pass
    try:
        return os.sysconf("SC_AVPHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    except (AttributeError, OSError, ValueError):
        return None


def require_memory(num_bytes: int, what: str, remedy: str) -> None:
    """Raise ValueError before something is allocated that cannot fit: clearer than being ended by the system."""
    left = available_memory()
    require(
        left is None or num_bytes <= left,
        f"{what} needs about {num_bytes / 2**30:.1f} GiB, and {(left or 0) / 2**30:.1f} GiB are left; use {remedy}",
    )
