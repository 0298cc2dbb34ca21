"""What annotations ask for: a kind accepts, converts or refuses a value and says what to give instead."""

import collections.abc
import inspect
from collections.abc import Mapping
from typing import Any, NoReturn

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from shadowjax._checks import Range, came, num_not_finite, require_dtype, require_int, require_number, watched


class Call:
    """One call while it is checked: who is called, and which sizes its named dimensions have had so far."""

    __slots__ = ("dims", "given", "label", "named", "reads_values")

    def __init__(self, label: str, named: Mapping[str, "Kind"], reads_values: bool, given: tuple[Any, ...] = ()):
        self.label, self.named, self.reads_values, self.given = label, named, reads_values, given
        self.dims: dict[str, tuple[Any, str, bool]] = {}

    def refuse(self, name: str, wanted: str, value: Any, remedy: str = "") -> NoReturn:
        """Say what was wanted, what came and what to do."""
        tail = f". {remedy}" if remedy else ""
        raise ValueError(f"{self.label}: {name} must be {wanted}; got {came(value)}{tail}")

    def float_dtype(self) -> Any:
        """The dtype of the first floating array among the arguments, which plain numbers take; None without one."""
        floating = (
            part for part in self.given if isinstance(part, jax.Array) and jnp.issubdtype(part.dtype, jnp.floating)
        )
        return next((part.dtype for part in floating), None)

    def look_at(self, name: str, value: Any, within: Range | None) -> Any:
        """The value; complain about NaN, infinity and numbers out of range, where they are known or watched."""
        if not self.reads_values:
            return value
        if isinstance(value, Tracer):
            return watched(value, f"{self.label}: {name}", within)
        bad = num_not_finite(value)
        if bad and within is not None and within.has_infinity:
            # What is left is NaN.
            bad = int(np.isnan(np.asarray(value)).sum())
        if bad:
            raise ValueError(
                f"{self.label}: {name} must be finite; {bad} of {np.size(value)} numbers are NaN or infinite"
            )
        if within is not None and not within.holds(np.asarray(value)):
            self.refuse(name, str(within), value)
        return value


class Kind:
    """What one annotation asks for.

    Attributes:
        wanted: In words.
        rank: Its place among the alternatives of a union, however they are written.
        holds_arrays: Whether what fits may be an array, or hold some.
    """

    wanted = "anything"
    rank = 9
    holds_arrays = False

    def is_exactly(self, value: Any) -> bool:
        """Whether the value is accepted and needs no conversion."""
        return self.accepts(value)

    def accepts(self, value: Any) -> bool:
        """Whether the value is meant for this annotation, rather than for another one of a union."""
        del value
        return True

    def numbers(self, value: Any) -> "Kind | None":
        """The kind that alone decides about an array by its dtype and shape; None where there is no such."""
        del value
        return None

    def check(self, value: Any, name: str, call: Call) -> Any:
        """The value, converted where that loses nothing, or a ValueError."""
        if not self.accepts(value):
            call.refuse(name, self.wanted, value, self.remedy(value, name, call))
        return value

    def remedy(self, value: Any, name: str, call: Call) -> str:
        """What to give instead, where that is plain."""
        del value, name, call
        return ""


class Nothing(Kind):
    wanted = "None"
    rank = 0

    def accepts(self, value: Any) -> bool:
        return value is None


class Number(Kind):
    """A real number that is no bool: of Python, of NumPy, or an array of shape ()."""

    rank = 6

    def __init__(self, within: Range | None = None):
        self.within = within
        self.wanted = "a number" if within is None else str(within)

    def accepts(self, value: Any) -> bool:
        if isinstance(value, np.ndarray | jax.Array):
            return value.ndim == 0
        return isinstance(value, int | float | np.number) and not isinstance(value, bool)

    def check(self, value: Any, name: str, call: Call) -> Any:
        if isinstance(value, Tracer) and value.ndim == 0 and value.dtype.kind not in "bc":
            return call.look_at(name, value, self.within)
        if call.reads_values or not isinstance(value, float):
            require_number(value, f"{call.label}: {name}", self.within)
        return value


class Integer(Kind):
    rank = 3

    def __init__(self, minimum: int | None = None, maximum: int | None = None):
        self.minimum, self.maximum = minimum, maximum
        self.wanted = "an integer" if minimum is None else f"an integer of at least {minimum}"

    def accepts(self, value: Any) -> bool:
        return isinstance(value, int | np.integer) and not isinstance(value, bool)

    def check(self, value: Any, name: str, call: Call) -> Any:
        low = -(1 << 63) if self.minimum is None else self.minimum
        high = (1 << 63) - 1 if self.maximum is None else self.maximum
        require_int(value, f"{call.label}: {name}", low, high)
        return value


class Instance(Kind):
    """An object of a class of this package, or of another one."""

    rank = 4

    def __init__(self, wanted: type):
        self.cls = wanted
        name = {"Figure": "matplotlib Figure", "str": "string"}.get(wanted.__name__, wanted.__name__)
        self.wanted = f"a{'n' if name[0] in 'AEIO' else ''} {name}"

    def accepts(self, value: Any) -> bool:
        return isinstance(value, self.cls)

    def remedy(self, value: Any, name: str, call: Call) -> str:
        if isinstance(value, type) and issubclass(value, self.cls):
            return f"Give an object, such as {value.__name__}({'' if _needs_nothing(value) else '…'}), not its class"
        if isinstance(value, list | tuple) and value and all(isinstance(part, self.cls) for part in value):
            return "Give one of them at a time"
        for field, held in getattr(value, "__dict__", {}).items():
            if isinstance(held, self.cls):
                return f"Give its .{field}"
            if isinstance(held, list | tuple) and held and isinstance(held[0], self.cls):
                return f"Give one of its .{field}"
        for other, kind in call.named.items():
            if isinstance(value, eqx.Module) and isinstance(kind, Instance) and other != name and kind.accepts(value):
                return f"It fits {other}: the order is ({', '.join(call.named)})"
        return getattr(self.cls, "_remedy_", "")


def _needs_nothing(cls: type) -> bool:
    """Whether a class can be called without arguments."""
    try:
        parameters = inspect.signature(cls).parameters.values()
    except ValueError:
        return True  # classes of Python's own
    kinds = (inspect.Parameter.VAR_POSITIONAL, inspect.Parameter.VAR_KEYWORD)
    return all(part.default is not inspect.Parameter.empty or part.kind in kinds for part in parameters)


class Choice(Kind):
    rank = 2

    def __init__(self, choices: tuple[Any, ...]):
        self.choices = choices
        self.wanted = f"one of {', '.join(map(repr, choices))}"

    def accepts(self, value: Any) -> bool:
        return isinstance(value, str | int) and value in self.choices


class Flag(Kind):
    wanted = "True or False"
    rank = 1

    def accepts(self, value: Any) -> bool:
        return isinstance(value, bool | np.bool_)


class Function(Kind):
    wanted = "a function"
    rank = 8

    def accepts(self, value: Any) -> bool:
        return callable(value)


class Dtype(Kind):
    wanted = "a floating dtype, such as jnp.float32"

    def check(self, value: Any, name: str, call: Call) -> Any:
        if value is not None:
            require_dtype(value, f"{call.label}: {name}")
        return value


class Items(Kind):
    """Several values in a row; `parts` holds the kind of all of them, or one kind for each."""

    rank = 7

    def __init__(self, container: type, parts: tuple[Kind, ...], is_fixed: bool):
        self.container, self.parts, self.is_fixed = container, parts, is_fixed
        self.holds_arrays = any(part.holds_arrays for part in parts)
        inner = ", ".join(part.wanted for part in parts) if is_fixed else f"each {parts[0].wanted}" if parts else ""
        word = {"tuple": "tuple", "list": "list"}.get(container.__name__, "sequence")
        self.wanted = f"a {word}" + (f" ({inner})" if inner and inner != "each anything" else "")

    def accepts(self, value: Any) -> bool:
        if self.container in (tuple, list):
            return isinstance(value, tuple | list)
        return isinstance(value, collections.abc.Iterable) and not isinstance(
            value, str | bytes | Mapping | type | eqx.Module
        )

    def check(self, value: Any, name: str, call: Call) -> Any:
        super().check(value, name, call)
        if self.is_fixed and len(value) != len(self.parts):
            call.refuse(name, self.wanted, value)
        if not isinstance(value, tuple | list):
            return value
        kinds = self.parts if self.is_fixed else self.parts[:1] * len(value)
        if not kinds:
            return value
        new = [kind.check(part, f"{name}[{i}]", call) for i, (kind, part) in enumerate(zip(kinds, value, strict=True))]
        if self.container is tuple and isinstance(value, list):
            return tuple(new)
        changed = any(one is not other for one, other in zip(new, value, strict=True))
        return type(value)(new) if changed and type(value) in (tuple, list) else value


class Table(Kind):
    wanted = "a mapping"
    rank = 7

    def __init__(self, key: Kind, value: Kind):
        self.key, self.value = key, value
        self.holds_arrays = value.holds_arrays

    def accepts(self, value: Any) -> bool:
        return isinstance(value, Mapping)

    def check(self, value: Any, name: str, call: Call) -> Any:
        super().check(value, name, call)
        for key, part in value.items():
            self.key.check(key, f"a key of {name}", call)
            self.value.check(part, f"{name}[{key!r}]", call)
        return value


class Either(Kind):
    """A union, whose alternatives may be written in any order.

    A value that already is what some alternatives ask for is left to these, else it is given to all that accept it:
    the first by rank that does not refuse it checks it.
    """

    def __init__(self, kinds: tuple[Kind, ...]):
        self.kinds = tuple(sorted(kinds, key=lambda kind: (kind.rank, kind.wanted)))
        self.wanted = " or ".join(dict.fromkeys(kind.wanted for kind in kinds))
        self.holds_arrays = any(kind.holds_arrays for kind in kinds)

    def accepts(self, value: Any) -> bool:
        return any(kind.accepts(value) for kind in self.kinds)

    def is_exactly(self, value: Any) -> bool:
        return any(kind.is_exactly(value) for kind in self.kinds)

    def numbers(self, value: Any) -> Kind | None:
        fitting = [kind for kind in self.kinds if kind.accepts(value)]
        return fitting[0].numbers(value) if len(fitting) == 1 else None

    def check(self, value: Any, name: str, call: Call) -> Any:
        fitting = [kind for kind in self.kinds if kind.is_exactly(value)]
        refusals: list[ValueError] = []
        for kind in fitting or [kind for kind in self.kinds if kind.accepts(value)]:
            dims = call.dims
            call.dims = dict(dims)
            try:
                return kind.check(value, name, call)
            except ValueError as refusal:
                call.dims = dims
                refusals.append(refusal)
        if refusals:
            raise refusals[0]
        return super().check(value, name, call)

    def remedy(self, value: Any, name: str, call: Call) -> str:
        return next(filter(None, (kind.remedy(value, name, call) for kind in self.kinds)), "")
