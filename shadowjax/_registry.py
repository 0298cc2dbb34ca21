"""Registries of parts by name: plain names, and families of names that hold a number, such as pcf-KxK."""

import functools
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

Part = TypeVar("Part")


@dataclass(frozen=True)
class Entry(Generic[Part]):
    """One line of a registry.

    Attributes:
        make: Makes the part; a family's maker takes its number first.
        summary: A few words for listings.
        usual: Numbers of a family whose names listings and contract tests show.
        most: Largest number of a family.
        least: Smallest number of a family.
    """

    make: Callable[..., Part]
    summary: str
    usual: tuple[int, ...] = ()
    most: int = 255
    least: int = 1


class Registry(Mapping[str, Callable[..., Part]]):
    """Makers of parts by name.

    A capital letter in a key stands for a whole number, the same wherever the letter stands again: "pcf-KxK" answers to
    pcf-3x3. Iteration gives names that can be made: of a family, those of its usual numbers.

    Attributes:
        kind: What is registered, for messages.
        entries: By key.
    """

    def __init__(self, kind: str, entries: Mapping[str, Entry[Part]]) -> None:
        self.kind, self.entries = kind, dict(entries)
        self._patterns = {key: _pattern(key) for key in self.entries if _is_family(key)}

    def key_of(self, name: str) -> str | None:
        """The key that a name belongs to; None if it is of another registry."""
        if name in self.entries and not _is_family(name):
            return name
        return next((key for key, pattern in self._patterns.items() if pattern.fullmatch(name)), None)

    def names_of(self, key: str) -> tuple[str, ...]:
        """The key itself, or names of its usual numbers."""
        if not _is_family(key):
            return (key,)
        return tuple(re.sub("[A-Z]", str(number), key) for number in self.entries[key].usual)

    def summary_of(self, name: str) -> str:
        """A few words about a name, with its number."""
        key = self.key_of(name)
        if key is None:
            raise KeyError(name)
        numbers = self._patterns[key].fullmatch(name) if key in self._patterns else None
        summary = self.entries[key].summary
        return summary if numbers is None else re.sub(r"\b[A-Z]\b", numbers[1], summary)

    def __getitem__(self, name: str) -> Callable[..., Part]:
        """The maker of a name.

        Raises:
            KeyError: If there is none.
            ValueError: If the number in the name is too small or too large.
        """
        key = self.key_of(name)
        if key is None:
            raise KeyError(name)
        entry = self.entries[key]
        if not _is_family(key):
            return entry.make
        match = self._patterns[key].fullmatch(name)
        assert match is not None
        number, letter = int(match[1]), re.findall("[A-Z]", key)[0]
        if not entry.least <= number <= entry.most:
            raise ValueError(f"{letter} of {self.kind} {key} must lie in {entry.least} … {entry.most}; got {name!r}")
        return functools.partial(entry.make, number)

    def __contains__(self, name: Any) -> bool:
        return isinstance(name, str) and self.key_of(name) is not None

    def __iter__(self) -> Iterator[str]:
        return (name for key in self.entries for name in self.names_of(key))

    def __len__(self) -> int:
        return sum(1 for _ in self)


def _is_family(key: str) -> bool:
    return key != key.lower()


def _pattern(key: str) -> re.Pattern[str]:
    """Of all names of a family."""
    letter = re.findall("[A-Z]", key)[0]
    first, *rest = key.split(letter)
    # A number of more than nine digits is no size of anything, and one of thousands no integer that Python reads.
    return re.compile(re.escape(first) + r"(0|[1-9]\d{0,8})" + r"\1".join(map(re.escape, rest)), re.ASCII)


__all__ = ["Entry", "Registry"]
