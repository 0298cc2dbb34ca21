"""Code in the place of code: functions of the package run as a mutant, and caches of the old code are cleared."""

import contextlib
import functools
import gc
import sys
import types
from collections.abc import Callable, Iterator
from typing import Any

from shadowjax.ledger import equation as equation_module
from tests.ledger.mutant_syntax import source


def _pairs(old: types.CodeType, new: types.CodeType) -> Iterator[tuple[types.CodeType, types.CodeType]]:
    """Code objects of two compiled modules that stand in one place and differ."""
    inner_old = [one for one in old.co_consts if isinstance(one, types.CodeType)]
    inner_new = [one for one in new.co_consts if isinstance(one, types.CodeType)]
    for first, second in zip(inner_old, inner_new, strict=True):
        if first != second:
            yield first, second
            yield from _pairs(first, second)


class Patcher:
    """Puts code in the place of code, in every function that runs it, and clears what was compiled from the old."""

    def __init__(self, modules: tuple[str, ...]) -> None:
        self.original: dict[str, types.CodeType] = {}
        for module in modules:
            tree, file = source(module)
            self.original[module] = compile(tree, file, "exec", dont_inherit=True)
        self.functions: dict[types.CodeType, list[types.FunctionType]] = {}
        files = {code.co_filename for code in self.original.values()}
        for one in gc.get_objects():
            if isinstance(one, types.FunctionType) and one.__code__.co_filename in files:
                self.functions.setdefault(one.__code__, []).append(one)
        self.caches = list(_caches())

    @contextlib.contextmanager
    def patched(self, module: str, code: types.CodeType) -> Iterator[None]:
        """Run with a changed module."""
        pairs = list(_pairs(self.original[module], code))
        swapped: list[tuple[types.FunctionType, types.CodeType]] = []
        changed = [function for old, _ in pairs for function in self.functions.get(old, [])]
        names = {function.__name__ for function in changed}
        stale = [clear for clear, reached in self.caches if names & reached]
        try:
            for old, new in pairs:
                for function in self.functions.get(old, []):
                    function.__code__ = new
                    swapped.append((function, old))
            for clear in stale:
                clear()
            yield
        finally:
            for function, old in swapped:
                function.__code__ = old
            for clear in stale:
                clear()


def _names(code: types.CodeType) -> set[str]:
    found = set(code.co_names) | set(code.co_freevars)
    for one in code.co_consts:
        if isinstance(one, types.CodeType):
            found |= _names(one)
    return found


@functools.cache
def _called() -> dict[str, set[str]]:
    """Name of a function or property of the package → names that its code holds."""
    found: dict[str, set[str]] = {}
    for one in gc.get_objects():
        if isinstance(one, types.FunctionType) and (one.__module__ or "").startswith("shadowjax."):
            found.setdefault(one.__name__, set()).update(_names(one.__code__))
    return found


def _reached(name: str) -> set[str]:
    """Names of all functions that a function may reach, by names alone: more than it does, never less."""
    called, found, waiting = _called(), {name}, [name]
    while waiting:
        for other in called.get(waiting.pop(), ()):
            if other in called and other not in found:
                found.add(other)
                waiting.append(other)
    return found


def _caches() -> Iterator[tuple[Callable[[], Any], set[str]]]:
    """Compiled functions and caches of the package's modules: how to clear each, and what it reaches."""
    known: set[int] = set()
    for name, module in list(sys.modules.items()):
        if not name.startswith("shadowjax.") or module is None:
            continue
        for one in list(vars(module).values()):
            clear = getattr(one, "clear_cache", None) or getattr(one, "cache_clear", None)
            if clear is None or id(one) in known or one is equation_module.ledger or isinstance(one, type):
                continue
            known.add(id(one))
            inner = one
            while hasattr(inner, "__wrapped__"):
                inner = inner.__wrapped__
            yield clear, _reached(inner.__name__)
