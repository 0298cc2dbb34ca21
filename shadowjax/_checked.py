"""Signatures that check themselves: decorators that read the annotations of functions and classes."""

import collections.abc
import functools
import inspect
import threading
import types
import typing
from collections.abc import Callable, Iterator, Mapping
from typing import Any, ClassVar, Literal, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from shadowjax._array_kinds import ArrayKind, Numbers
from shadowjax._checks import Range, watches
from shadowjax._kinds import (
    Call,
    Choice,
    Dtype,
    Either,
    Flag,
    Function,
    Instance,
    Integer,
    Items,
    Kind,
    Nothing,
    Number,
    Table,
)

_Target = TypeVar("_Target", bound=Callable[..., Any])


# Arguments of these names mean one thing everywhere: sizes, which are at least 1 and no larger than a device can hold.
_SIDES = frozenset({"resolution", "width", "height", "num_rows", "num_cols", "rows", "cols"})
_COUNTS = frozenset({
    "blur_size", "columns", "kernel_size", "max_anisotropy", "num_bins", "num_depths", "num_lights", "num_partitions",
    "num_placements", "num_samples", "num_taps", "num_terms", "ray_chunk", "repeats", "samples_per_axis", "tile_size",
})  # fmt: skip
LARGEST_COUNT = (1 << 31) - 1
LARGEST_SIDE = 1 << 16


# Sets of dtypes and shapes that are kept for each function.
_MOST_LAYOUTS = 256


class _State(threading.local):
    """Whether a checked function runs: what it calls in its turn is no entry point, so values are not read again."""

    inside = False


_STATE = _State()


@functools.cache
def _holds_numbers(cls: type) -> bool:
    """Whether a class is one of arrays that are known; traced ones are met once, while a function is compiled."""
    return issubclass(cls, np.ndarray | jax.Array) and not issubclass(cls, Tracer)


def kind_of(hint: Any, name: str, within: Range | None = None) -> Kind:
    """The kind that an annotation stands for."""
    origin, parts = typing.get_origin(hint), typing.get_args(hint)
    if origin is typing.Annotated:
        return kind_of(parts[0], name, next((part for part in parts[1:] if isinstance(part, Range)), None))
    if origin in (typing.Union, types.UnionType):
        return _union(parts, name, within)
    if name == "dtype":
        return Dtype()
    if hasattr(hint, "dim_str"):
        return ArrayKind(hint.dtype.__name__, hint.dim_str, hint.array_type is np.ndarray, within)
    if hint is Any or hint is object:
        return Kind()
    if hint is jax.Array:
        return ArrayKind("Shaped", "...", False)
    if hint is np.ndarray:
        return ArrayKind("Shaped", "...", True)
    if origin is Literal:
        return Choice(parts)
    if hint is None or hint is types.NoneType:
        return Nothing()
    if origin is not None and isinstance(origin, type):
        return _container(origin, parts, name)
    if hint is float:
        return Number(within)
    if hint is int:
        return _integer(name, within)
    if hint is bool:
        return Flag()
    if isinstance(hint, type):
        return Instance(hint)
    return Function() if hint is Callable else Kind()


def _integer(name: str, within: Range | None) -> "Integer":
    """Sizes are known by their names."""
    if within is not None:
        low, high = within.low, within.high
        return Integer(None if low is None else int(low), LARGEST_COUNT if high is None else int(high))
    if name in _SIDES or name in _COUNTS:
        return Integer(1, LARGEST_SIDE if name in _SIDES else LARGEST_COUNT)
    return Integer()


def _union(parts: tuple[Any, ...], name: str, within: Range | None) -> Kind:
    """ArrayLike is a union of its own; of the others, each alternative is a kind."""
    kinds: list[Kind] = []
    if jax.Array in parts and np.ndarray in parts and complex in parts:
        kinds.append(Numbers(within))
        parts = tuple(part for part in parts if part in (types.NoneType, str))
    kinds += [kind_of(part, name, within) for part in parts]
    return kinds[0] if len(kinds) == 1 else Either(tuple(kinds))


def _container(origin: type, parts: tuple[Any, ...], name: str) -> Kind:
    if origin is collections.abc.Callable:
        return Function()
    if origin is type:
        return Instance(type)
    if issubclass(origin, Mapping):
        return Table(*(kind_of(part, "") for part in parts))
    if issubclass(origin, collections.abc.Iterable) and not issubclass(origin, Iterator):
        is_fixed = origin is tuple and Ellipsis not in parts
        return Items(origin, tuple(kind_of(part, "") for part in parts if part is not Ellipsis), is_fixed)
    return Instance(origin)


class _Arguments:
    """The kinds of all arguments of a function, found at its first call: annotations may name what comes later."""

    def __init__(self, function: Callable[..., Any], label: str):
        self.function, self.label = function, label
        # By names, dtypes and shapes of arrays that fit: for each whether its numbers are read, and their range.
        self.known: dict[Any, tuple[tuple[bool, Range | None], ...]] = {}

    @functools.cached_property
    def signature(self) -> inspect.Signature:
        """Parameters without `self` and `cls`."""
        signature = inspect.signature(self.function)
        named = [part for part in signature.parameters.values() if part.name not in ("self", "cls")]
        return signature.replace(parameters=named)

    @functools.cached_property
    def named(self) -> dict[str, Kind]:
        """The kind of every argument."""
        hints = typing.get_type_hints(self.function, include_extras=True)
        variable = (inspect.Parameter.VAR_KEYWORD,)
        return {
            name: kind_of(hints.get(name, Any), name)
            for name, part in self.signature.parameters.items()
            if part.kind not in variable
        }

    @functools.cached_property
    def in_order(self) -> tuple[tuple[str, Kind, Any], ...]:
        """Name, kind and default of every argument that may be given by its place."""
        parts = self.signature.parameters
        fixed = (inspect.Parameter.POSITIONAL_ONLY, inspect.Parameter.POSITIONAL_OR_KEYWORD)
        return tuple((name, self.named[name], part.default) for name, part in parts.items() if part.kind in fixed)

    @functools.cached_property
    def stored(self) -> tuple[tuple[str, ArrayKind], ...]:
        """What a class stores as arrays."""
        return tuple((name, kind) for name, kind in self.named.items() if isinstance(kind, ArrayKind))

    @functools.cached_property
    def defaults(self) -> dict[str, Any]:
        """What an argument is where it is not given; always good."""
        return {name: part.default for name, part in self.signature.parameters.items()}

    @functools.cached_property
    def num_bound(self) -> int:
        """1 where an object or a class comes before the arguments."""
        return int(next(iter(inspect.signature(self.function).parameters), "") in ("self", "cls"))

    def call(self, *given: Any) -> Call:
        """A call to check."""
        return Call(self.label, self.named, not _STATE.inside, given)

    def check(self, args: tuple[Any, ...], kwargs: dict[str, Any]) -> list[Any]:
        """The arguments, converted where that loses nothing (`kwargs` in place); ValueError for the first misfit.

        What dtypes and shapes decide is decided once for each set of them; later calls read only the numbers.
        """
        call = self.call(*args, *kwargs.values())
        new: list[Any] = list(args)
        arrays: list[tuple[int | str, str, Kind, Any]] = []
        for place, (value, (name, kind, default)) in enumerate(zip(args, self.in_order, strict=False)):
            if value is not default:
                if kind.holds_arrays:
                    arrays.append((place, name, kind, value))
                else:
                    new[place] = kind.check(value, name, call)
        for name, value in kwargs.items():
            kind = self.named.get(name)
            if kind is not None and value is not self.defaults[name]:
                if kind.holds_arrays:
                    arrays.append((name, name, kind, value))
                else:
                    kwargs[name] = kind.check(value, name, call)
        if not arrays:
            return new
        is_plain = all(_holds_numbers(type(value)) for *_, value in arrays)
        layout = (
            tuple((name, type(value), value.dtype, value.shape) for _, name, _, value in arrays) if is_plain else None
        )
        deciding = self.known.get(layout)
        if deciding is not None:
            if call.reads_values:
                for (_, name, _, value), (reads, within) in zip(arrays, deciding, strict=True):
                    if reads:
                        call.look_at(name, value, within)
            return new
        same = is_plain
        for place, name, kind, value in arrays:
            found = kind.check(value, name, call)
            same = same and found is value
            if isinstance(place, int):
                new[place] = found
            else:
                kwargs[place] = found
        if same:
            self._remember(layout, arrays)
        return new

    def _remember(self, layout: Any, arrays: list[tuple[Any, str, Kind, Any]]) -> None:
        """Keep that arrays of some dtypes and shapes fit, and which of them have numbers to be read."""
        deciding = [kind.numbers(value) for *_, kind, value in arrays]
        if all(isinstance(kind, Numbers) for kind in deciding):
            if len(self.known) >= _MOST_LAYOUTS:
                self.known.clear()
            self.known[layout] = tuple(
                (kind.reads(value.dtype), kind.within)
                for kind, (*_, value) in zip(deciding, arrays, strict=True)
                if isinstance(kind, Numbers)
            )


def checked(target: _Target) -> _Target:
    """A function, or a dataclass, whose arguments are checked against their annotations: ValueError says what came.

    Outermost of all decorators. Kinds and shapes are compared in every call, traced or not; numbers are read (for NaN,
    infinity and the ranges of `Annotated[…, Range]`) only where they are known and the call comes from outside: what a
    checked function calls in its turn is not read again. Traced numbers are read at run time within `checked_values`.
    """
    if isinstance(target, type):
        return _checked_class(target)
    arguments = _Arguments(target, getattr(target, "__qualname__", str(target)))

    def call(*args: Any, **kwargs: Any) -> Any:
        __tracebackhide__ = True
        bound = arguments.num_bound
        args = (*args[:bound], *arguments.check(args[bound:], kwargs))
        if _STATE.inside:
            return target(*args, **kwargs)
        _STATE.inside = True
        try:
            return target(*args, **kwargs)
        finally:
            _STATE.inside = False

    functools.update_wrapper(call, target, updated=())
    call._arguments_ = arguments  # pyright: ignore[reportFunctionMemberAccess]
    if hasattr(target, "lower"):
        call.lower = target.lower  # pyright: ignore[reportFunctionMemberAccess]
    return call  # pyright: ignore[reportReturnType]


def _checked_class(cls: Any) -> Any:
    """A dataclass of which the constructor and the public methods are checked."""
    arguments, init = _Arguments(cls.__init__, cls.__name__), cls.__init__

    def __init__(self: Any, *args: Any, **kwargs: Any) -> None:
        __tracebackhide__ = True
        init(self, *arguments.check(args, kwargs), **kwargs)

    functools.update_wrapper(__init__, init, updated=())
    __init__._arguments_ = arguments  # pyright: ignore[reportFunctionMemberAccess]
    cls.__init__ = __init__
    _check_methods(cls)
    return cls


def _check_methods(cls: type) -> None:
    """Check the arguments of the public methods that a class itself defines."""
    for name, member in list(vars(cls).items()):
        if name.startswith("_") or isinstance(member, type) or getattr(member, "__isabstractmethod__", False):
            continue
        if isinstance(member, classmethod | staticmethod):
            setattr(cls, name, type(member)(checked(member.__func__)))
        elif inspect.isfunction(member) or (callable(member) and hasattr(member, "__wrapped__")):
            setattr(cls, name, checked(member))


@functools.cache
def constructor_arguments(cls: type) -> _Arguments:
    """The arguments of a class."""
    return _Arguments(cls.__init__, cls.__name__)


class Checked(eqx.Module):
    """A module of which the constructor and the public methods are checked against their annotations.

    Rebuilding from leaves, as `jit`, `vmap`, `grad` and `tree_map` do, calls no constructor and is not checked: there
    leaves may have axes in front, or be no arrays at all.
    """

    # What to give where an object of this class is wanted and something else comes.
    _remedy_: ClassVar[str] = ""

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        _check_methods(cls)

    def __new__(cls, *args: Any, **kwargs: Any) -> Any:
        """Before `__init__`, so that converters and `__check_init__` meet only what fits."""
        __tracebackhide__ = True
        constructor_arguments(cls).check(args, kwargs)
        return super().__new__(cls)

    def __check_init__(self) -> None:
        """Numbers, lists and NumPy arrays become arrays where arrays are stored; traced ones may be watched."""
        arguments, held = constructor_arguments(type(self)), vars(self)
        for name, kind in arguments.stored:
            value = held.get(name)
            if isinstance(value, Tracer) and watches():
                object.__setattr__(self, name, kind.check(value, name, arguments.call(*held.values())))
            if value is not None and not (_holds_numbers(type(value)) or isinstance(value, jax.Array)):
                array = kind.check(value, name, arguments.call(*held.values()))
                # Of a strong type: `jit` compiles anew for weak ones.
                object.__setattr__(self, name, jnp.asarray(array, array.dtype))

    @classmethod
    def _trusted(cls, **fields: Any) -> Any:
        """An object of all its fields, unchecked and unconverted: for functions that have done both."""
        made = object.__new__(cls)
        for name, value in fields.items():
            object.__setattr__(made, name, value)
        return made
