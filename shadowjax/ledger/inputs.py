"""Named inputs of equations read as exact numbers, and the comparison of values of every kind."""

import math
from collections.abc import Iterator, Mapping
from fractions import Fraction
from typing import Any

import numpy as np

from shadowjax._checked import checked

LARGEST_ERROR = 1e300  # stands for "not comparable": errors stay finite, so that they are valid JSON


class Unavailable(ValueError):
    """A value that cannot be recomputed from its inputs; the message says why."""


class Estimate(Fraction):
    """A share of random configurations: exact for those drawn here, and another one for others."""


@checked
class Inputs(Mapping[str, Any]):
    """Named inputs of one evaluation, read as numbers whatever their spelling (number, decimal string, fraction).

    Args:
        values: Name to value, as in a row of a values file; angles in degrees end in `_deg`.
        label: Text between the brackets of the row's id; some families name a case only there.
    """

    def __init__(self, values: Mapping[str, Any] | None = None, label: str = "") -> None:
        self._values = dict(values or {})
        self.label = label

    def __getitem__(self, name: str) -> Any:
        if name not in self._values:
            raise Unavailable(f"input {name!r} is missing; got {', '.join(self._values) or 'none'}")
        return self._values[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._values)

    def __len__(self) -> int:
        return len(self._values)

    def __contains__(self, name: object) -> bool:
        return name in self._values

    def get(self, name: str, default: Any = None) -> Any:
        """An input as it came, or `default`."""
        return self._values.get(name, default)

    def _lookup(self, names: tuple[str, ...]) -> Any:
        for name in names:
            if name in self._values:
                return self._values[name]
        return self[names[0]]

    def number(self, *names: str, default: float | None = None) -> float:
        """The first of `names` that is present, as a float."""
        if default is not None and not any(name in self for name in names):
            return default
        return float(exact(self._lookup(names)))

    def fraction(self, *names: str) -> Fraction:
        """The first of `names` that is present, as an exact fraction of its decimal spelling."""
        return exact(self._lookup(names))

    def integer(self, *names: str, default: int | None = None) -> int:
        """The first of `names` that is present, as an int; Unavailable if it is not whole."""
        if default is not None and not any(name in self for name in names):
            return default
        value = exact(self._lookup(names))
        if value.denominator != 1:
            raise Unavailable(f"input {names[0]!r} must be whole; got {value}")
        return value.numerator

    def angle(self, *names: str, default: float | None = None) -> float:
        """The first of `names` that is present, a number of degrees, in radians; `default` is in degrees too."""
        return math.radians(self.number(*names, default=default))

    def numbers(self, name: str) -> list[float]:
        """A list of numbers."""
        return [float(exact(value)) for value in self[name]]

    def text(self, name: str, default: str | None = None) -> str:
        """A string."""
        return str(default if default is not None and name not in self else self[name])

    def merged(self, values: Mapping[str, Any]) -> "Inputs":
        """These inputs, with `values` where a name is missing here."""
        return Inputs({**values, **self._values}, self.label)


@checked
def exact(value: Any) -> Fraction:
    """A number, decimal string or `p/q` string as the fraction that its decimal spelling means; Unavailable if none."""
    try:
        return Fraction(str(value)) if isinstance(value, float) else Fraction(value)
    except (TypeError, ValueError, ZeroDivisionError, OverflowError) as error:
        raise Unavailable(f"not a number: {value!r}") from error


@checked
def relative_error(value: Any, expected: Any) -> float:
    """Largest relative error of nested numbers (absolute where 0 is expected); text and shapes must be equal.

    Strings that spell numbers are numbers. What cannot be compared gives LARGEST_ERROR.
    """
    if _is_sequence(expected) or _is_sequence(value):
        if not (_is_sequence(expected) and _is_sequence(value)) or len(value) != len(expected):
            return LARGEST_ERROR
        return max((relative_error(a, b) for a, b in zip(value, expected, strict=True)), default=0.0)
    if isinstance(expected, bool | np.bool_) or isinstance(value, bool | np.bool_):
        return 0.0 if bool(value) == bool(expected) else LARGEST_ERROR
    try:
        got, want = _finite_exact(value), _finite_exact(expected)
    except Unavailable:
        return 0.0 if str(value) == str(expected) else LARGEST_ERROR
    difference = abs(got - want) / (abs(want) if want else 1)
    return min(float(difference), LARGEST_ERROR) if difference < 10**299 else LARGEST_ERROR


def _is_sequence(value: Any) -> bool:
    return isinstance(value, list | tuple) or (isinstance(value, np.ndarray) and value.ndim > 0)


def _finite_exact(value: Any) -> Fraction:
    """The exact value of a number; a float means its binary value here."""
    if isinstance(value, str | int | Fraction):
        return exact(value)
    if isinstance(value, np.integer):
        return Fraction(int(value))
    try:
        return Fraction(float(value))
    except (TypeError, ValueError, OverflowError) as error:
        raise Unavailable(f"not a finite number: {value!r}") from error


@checked
def plain(value: Any) -> Any:
    """A value made of what JSON knows; fractions become `p/q`, arrays lists, and what is not finite its name."""
    if isinstance(value, Mapping):
        return {str(k): plain(v) for k, v in value.items()}
    if isinstance(value, list | tuple | np.ndarray):
        return [plain(v) for v in value]
    if value is None or isinstance(value, str | bool | int):
        return value
    if isinstance(value, Fraction):
        return value.numerator if value.denominator == 1 else f"{value.numerator}/{value.denominator}"
    if isinstance(value, np.bool_ | np.integer):
        return value.item()
    number = float(value)
    return number if math.isfinite(number) else str(number)
