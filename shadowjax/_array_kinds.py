"""Kinds of numbers and arrays: dtype, rank, and named dimensions that agree among the arguments of one call."""

import functools
from typing import Any, ClassVar

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from shadowjax._checks import Range
from shadowjax._kinds import Call, Kind
from shadowjax._types import default_dtype


class Numbers(Kind):
    """What can be made an array of numbers: a number, an array, or nested lists. The function makes the array."""

    rank = 5
    holds_arrays = True

    def __init__(self, within: Range | None = None):
        self.within = within
        self.wanted = "a number or an array of numbers" + _in_words(within)

    def accepts(self, value: Any) -> bool:
        known = isinstance(value, jax.Array | np.ndarray | np.number | int | float | list | tuple)
        return known and not isinstance(value, bool)

    def is_exactly(self, value: Any) -> bool:
        return isinstance(value, jax.Array | np.ndarray)

    def numbers(self, value: Any) -> Kind | None:
        return self if self.is_exactly(value) else None

    def reads(self, dtype: Any) -> bool:
        """Whether numbers of a dtype are looked at: they may be NaN or infinite, or out of range."""
        has_range = self.within is not None and self.within.is_bounded
        return has_range or (_kind_of_dtype(dtype) == "f" and (self.within is None or self.within.is_read))

    def check(self, value: Any, name: str, call: Call) -> Any:
        array = value if isinstance(value, jax.Array) else as_numbers(value) if self.accepts(value) else None
        # Masks and binary pictures are arrays of truths.
        if array is None or _kind_of_dtype(array.dtype) not in "fiub":
            call.refuse(name, self.wanted, value, self.remedy(value, name, call))
        if self.reads(array.dtype):
            call.look_at(name, array, self.within)
        return value

    def remedy(self, value: Any, name: str, call: Call) -> str:
        del call
        return f"Make all rows of {name} equally long, of numbers only" if isinstance(value, list | tuple) else ""


class ArrayKind(Numbers):
    """A jaxtyping annotation: dtype, rank, and named dimensions that agree among the arguments of a call."""

    FAMILIES: ClassVar = {
        "Float": ("floating", "fiu"), "Int": ("integer", "iu"), "UInt": ("integer", "iu"), "Bool": ("boolean", "b"),
        "Num": ("numeric", "fiu"),
    }  # fmt: skip

    def __init__(self, family: str, dims: str, is_numpy: bool, within: Range | None = None):
        super().__init__(within)
        self.family, self.is_numpy, self.tokens = family, is_numpy, tuple(dims.split())
        self.variadic = next((i for i, token in enumerate(self.tokens) if token == "..." or "*" in token), None)
        self.literal = [(place, int(token)) for place, token in enumerate(self.tokens) if token.isdigit()]
        keys = [token.replace("#", "") for token in self.tokens]
        is_name = [key.lstrip("*").isidentifier() and key.lstrip("*")[0] != "_" for key in keys]
        self.bound = [(i, keys[i], "#" in token) for i, token in enumerate(self.tokens) if is_name[i]]
        shown = ", ".join("…" if token == "..." else token.replace("#", "") for token in self.tokens)
        self.shape = f"({shown},)" if len(self.tokens) == 1 and self.variadic is None else f"({shown})"
        word, self.kinds = self.FAMILIES.get(family, ("", "fiubcVO"))
        self.wanted = f"a{'n' if word[:1] == 'i' else ''} {word} array".replace("  ", " ")
        if not self.tokens:
            self.wanted = "a number" if word == "floating" else f"one {word} number"
        elif self.tokens != ("...",):
            self.wanted += f" of shape {self.shape}"
        self.wanted += _in_words(within)

    def is_exactly(self, value: Any) -> bool:
        return isinstance(value, np.ndarray if self.is_numpy else jax.Array)

    def reads(self, dtype: Any) -> bool:
        return self.family != "Shaped" and _kind_of_dtype(dtype) == "f" and super().reads(dtype)

    def accepts(self, value: Any) -> bool:
        return super().accepts(value) or (self.family == "Bool" and isinstance(value, bool | np.bool_))

    def check(self, value: Any, name: str, call: Call) -> Any:
        array = self._converted(value, name, call)
        if not self._fits(array.shape, call, name):
            call.refuse(name, self.wanted, value, self._layout(array.shape, name))
        if self.reads(array.dtype):
            return call.look_at(name, array, self.within)
        return array

    def _converted(self, value: Any, name: str, call: Call) -> Any:
        fits = isinstance(value, np.ndarray if self.is_numpy else jax.Array)
        array = value if fits else as_numbers(value) if self.accepts(value) else None
        if array is None:
            call.refuse(name, self.wanted, value, self.remedy(value, name, call))
        kind = _kind_of_dtype(array.dtype)
        if kind not in self.kinds:
            call.refuse(name, self.wanted, value)
        if fits and not (self.family == "Float" and kind in "iu"):
            return value
        if self.is_numpy:
            return array.astype(float) if self.family == "Float" and kind in "iu" else array
        if self.family == "Float" or kind == "f":
            # Numbers take the dtype of the arrays next to them; a NumPy array of floats keeps its own.
            keeps = isinstance(value, np.ndarray) and kind == "f"
            is_weak = isinstance(value, int | float)
            dtype = None if keeps else call.float_dtype() or (None if is_weak else default_dtype())
            return jnp.asarray(float(value) if is_weak and self.family == "Float" else array, dtype)
        return jnp.asarray(array)

    def _fits(self, shape: tuple[int, ...], call: Call, name: str) -> bool:
        first, num = self.variadic, len(self.tokens)
        if len(shape) != num if first is None else len(shape) < num - 1:
            return False
        if self.tokens[-2:] == ("rows", "cols") and (0 in shape[-2:] or (num == 3 and _planes_last(shape))):
            return False
        if first is not None:
            # The run of dimensions in the middle is one size among the others.
            last = len(shape) - (num - first - 1)
            shape = (*shape[:first], shape[first:last], *shape[last:])  # pyright: ignore[reportAssignmentType]
        if any(shape[place] != size for place, size in self.literal):
            return False
        for place, key, is_loose in self.bound:
            self._bind(key, shape[place], is_loose, name, call)
        return True

    def _bind(self, key: str, size: Any, is_loose: bool, name: str, call: Call) -> None:
        """Compare a named dimension, or a run of several, with those of the arguments before; loose ones broadcast."""
        known, other, known_loose = call.dims.setdefault(key, (size, name, is_loose))
        if known == size:
            return
        both = [part if isinstance(part, tuple) else (part,) for part in (known, size)]
        joined = _broadcast(*both) if is_loose or known_loose else None
        exact = [part for part, loose in zip(both, (known_loose, is_loose), strict=True) if not loose]
        if joined is None or any(part != joined for part in exact):
            raise ValueError(
                f"{call.label}: {name} must have shape {self.shape} with {key} = {_shown(known)}, as {other} has it; "
                f"got {key} = {_shown(size)}"
            )
        call.dims[key] = (joined if isinstance(size, tuple) else joined[0], other, is_loose and known_loose)

    def _layout(self, shape: tuple[int, ...], name: str) -> str:
        """What would give the array the layout that was asked for, where that is plain."""

        def fits(moved: tuple[int, ...]) -> bool:
            return len(moved) == len(self.tokens) and all(
                not token.isdigit() or int(token) == size for token, size in zip(self.tokens, moved, strict=True)
            )

        last = self.tokens[-1] if self.tokens else ""
        if self.tokens[1:] == ("rows", "cols") and len(shape) == 3:
            return f"Planes come first: give jnp.moveaxis({name}, -1, 0)"
        if self.variadic is None and len(shape) + 1 == len(self.tokens) and fits((1, *shape)):
            return f"Give {name}[None] where {self.tokens[0]} is 1"
        if self.variadic is None and shape[:1] == (1,) and fits(shape[1:]):
            return f"Give {name}[0]"
        if len(shape) > 1 and last.isdigit() and shape[0] == int(last):
            return f"The axis of {last} comes last: give jnp.moveaxis({name}, 0, -1)"
        return ""


def _in_words(within: Range | None) -> str:
    return f", {within}" if within is not None and within.is_bounded else ""


def _planes_last(shape: tuple[int, ...]) -> bool:
    """Whether a square map seems to come with its planes in the last axis: no map has many planes of a few columns."""
    return len(shape) == 3 and shape[0] == shape[1] > shape[2] > 0


@functools.cache
def _kind_of_dtype(dtype: Any) -> str:
    """NumPy's letter; "f" for the small floating types of accelerators too."""
    return "f" if jnp.issubdtype(dtype, jnp.floating) else np.dtype(dtype).kind if not _is_key(dtype) else "V"


def _is_key(dtype: Any) -> bool:
    return jnp.issubdtype(dtype, jax.dtypes.extended)


def _shown(size: Any) -> str:
    return str(size) if not isinstance(size, tuple) else f"({', '.join(map(str, size))}{',' * (len(size) == 1)})"


def _broadcast(*shapes: tuple[int, ...]) -> tuple[int, ...] | None:
    try:
        return np.broadcast_shapes(*shapes)
    except ValueError:
        return None


def as_numbers(value: Any) -> Any:
    """Numbers and nested lists of them as an array; None where they are ragged or are no numbers."""
    traced = isinstance(value, list | tuple) and any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves(value))
    try:
        array = jnp.asarray(value) if traced else np.asarray(value)
    except (ValueError, TypeError, OverflowError):
        return None
    return array if array.dtype.kind in "fiubcV" else None
