"""Every public signature of the package, and for every annotation the values that it must refuse."""

import dataclasses
import importlib
import inspect
import pkgutil
import types
import typing
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

import shadowjax
from shadowjax._checks import Range

# No library of arrays: readers of files, commands, pages of HTML, rows of the ledger. They check what they read.
OTHER_ROOMS = ("shadowjax.geometry.mesh_files", "shadowjax.cli", "shadowjax.report", "shadowjax.ledger")
# Sizes of which 0 and less make no sense.
SIZES = ("resolution", "width", "height", "kernel_size", "samples_per_axis", "ray_chunk", "num_samples", "num_taps")


class Stranger:
    """An object of a class that no function knows."""


@dataclasses.dataclass(frozen=True)
class Signature:
    """A public function, method or constructor.

    Attributes:
        name: Where it is found.
        call: Calls it with keywords; methods get an object that they must not come to look at.
        hints: The annotation of every argument.
        is_checked: Whether the package's checker reads it.
    """

    name: str
    call: Callable[..., Any]
    hints: Mapping[str, Any]
    is_checked: bool


def public_modules() -> Iterator[types.ModuleType]:
    """Every module without an underscore, but for other rooms."""
    for found in pkgutil.walk_packages(shadowjax.__path__, "shadowjax."):
        hidden = any(part.startswith("_") for part in found.name.split("."))
        if not hidden and not found.name.startswith(OTHER_ROOMS):
            yield importlib.import_module(found.name)


def signatures() -> Iterator[Signature]:
    """Every public function and method, and every constructor of a public class, that takes arguments."""
    for module in public_modules():
        for name, member in vars(module).items():
            if name.startswith("_") or getattr(member, "__module__", None) != module.__name__:
                continue
            path = f"{module.__name__}.{name}"
            if inspect.isclass(member):
                yield from _of_class(path, member)
            elif callable(member) and not isinstance(member, typing.TypeVar):
                yield from _of_function(path, member, member)


def _of_class(path: str, cls: type) -> Iterator[Signature]:
    for name, member in vars(cls).items():
        is_bound = isinstance(member, classmethod)
        function = member.__func__ if isinstance(member, classmethod | staticmethod) else member
        plain = inspect.isfunction(function) or hasattr(function, "__wrapped__")
        if name.startswith("_") or not plain or getattr(function, "__isabstractmethod__", False):
            continue
        bound = getattr(cls, name)
        if not is_bound and not isinstance(member, staticmethod):
            bound = _unbound(function)
        yield from _of_function(f"{path}.{name}", function, bound)
    is_made = dataclasses.is_dataclass(cls) or "__init__" in vars(cls)
    if is_made and not inspect.isabstract(cls) and not issubclass(cls, BaseException):
        yield from _of_function(path, cls.__init__, cls)


def _unbound(function: Callable[..., Any]) -> Callable[..., Any]:
    return lambda **given: function(Stranger(), **given)


def _of_function(path: str, function: Any, call: Callable[..., Any]) -> Iterator[Signature]:
    parameters = inspect.signature(function).parameters.values()
    variable = (inspect.Parameter.VAR_POSITIONAL, inspect.Parameter.VAR_KEYWORD)
    named = [part.name for part in parameters if part.name not in ("self", "cls") and part.kind not in variable]
    if named:
        hints = typing.get_type_hints(function, include_extras=True)
        owner = getattr(call, "__mro__", ())
        is_checked = hasattr(function, "_arguments_") or any(base.__name__ == "Checked" for base in owner)
        yield Signature(path, call, {name: hints.get(name, Any) for name in named}, is_checked)


def bad_values(hint: Any, name: str) -> dict[str, Any] | None:
    """What an argument of this annotation must refuse, by what is wrong with it; None where anything goes."""
    parts = typing.get_args(hint)
    if typing.get_origin(hint) is typing.Annotated:
        bad = bad_values(parts[0], "")
        for part in parts[1:]:
            if bad is not None and isinstance(part, Range):
                # Numbers that a function reads itself are tried with good ones beside them, by the front door.
                good = {"infinity"} if part.has_infinity else set() if part.is_read else {"infinity", "NaN"}
                bad = {kind: value for kind, value in bad.items() if not any(word in kind for word in good)}
        return bad
    if typing.get_origin(hint) in (typing.Union, types.UnionType):
        return _bad_for_all(parts, name)
    if name == "dtype":
        return {"a class": int, "a word": "word", "a number": 3, "complex": complex}
    if hint in (Any, object) or isinstance(hint, typing.TypeVar):
        return None
    bad = {"None": None, "bytes": b"bytes", "complex": 1j, "a stranger": Stranger(), "a class": Stranger}
    if hint is not str:
        bad["a word"] = "word"
    if hint is bytes:
        del bad["bytes"]
    if _is_called(hint):
        del bad["a class"]  # it can be called
    return {**bad, **_bad_by_kind(hint, name)}


def _is_called(hint: Any) -> bool:
    return hint is Callable or "Callable" in str(typing.get_origin(hint))


def _bad_for_all(parts: tuple[Any, ...], name: str) -> dict[str, Any] | None:
    """Bad for a union is what is bad for all its alternatives."""
    if complex in parts and jax.Array in parts:
        bad: dict[str, Any] = {
            "bytes": b"bytes", "complex": 1j, "a stranger": Stranger(), "a class": Stranger, "NaN": np.nan,
            "infinity": np.inf, "truth": True, "ragged": [[1.0, 2.0], [3.0]], "complex array": np.asarray([1j]),
            "NaN inside": [0.0, np.nan], "words": ["a", "b"],
        }  # fmt: skip
        bad |= {} if str in parts else {"a word": "word"}
        return bad | ({} if types.NoneType in parts else {"None": None})
    each = [bad_values(part, name) for part in parts if part is not types.NoneType]
    if any(one is None for one in each):
        return None
    shared = {key: each[0][key] for key in each[0] if all(key in one for one in each)}
    if types.NoneType in parts:
        shared.pop("None", None)
    return shared


def _bad_by_kind(hint: Any, name: str) -> dict[str, Any]:
    origin = typing.get_origin(hint)
    if hasattr(hint, "dim_str"):
        return _bad_arrays(hint.dtype.__name__, hint.dim_str.split())
    if hint in (jax.Array, np.ndarray):
        return {"ragged": [[1.0, 2.0], [3.0]], "words": np.asarray(["a"])}
    if hint is float:
        return {"truth": True, "NaN": np.nan, "infinity": -np.inf, "several": [1.0, 2.0], "array": jnp.zeros(2)}
    if hint is int:
        bad = {"truth": True, "fraction": 2.5, "whole fraction": 2.0, "huge": 10**30, "array": jnp.zeros(2)}
        return bad | ({"zero": 0, "negative": -1} if name in SIZES else {})
    if hint is bool:
        return {"one": 1, "number": 0.5}
    if hint is bytes:
        return {"number": 0.5, "itself": bytes}
    if hint is str or hint is Path:
        return {"number": 0.5, "list": ["word"]}
    if origin is typing.Literal:
        return {"number": 0.5, "other word": "no such choice"}
    if isinstance(origin, type) and (issubclass(origin, Mapping) or origin is type):
        return {"number": 0.5, "list": [0.5]}
    if _is_called(hint):
        return {"number": 0.5, "list": [0.5]}
    if isinstance(origin, type):
        return {"number": 0.5}
    return {"number": 0.5, "itself": hint, "list": [0.5], "array": jnp.zeros(2), "truth": True}


def _bad_arrays(family: str, tokens: list[str]) -> dict[str, Any]:
    """Wrong dtypes, ranks, layouts and last axes."""
    dtype = {"Float": np.float32, "Int": np.int32, "UInt": np.uint32, "Bool": bool}.get(family, np.float32)
    variadic = any("*" in token or token == "..." for token in tokens)
    sizes = [int(token) if token.isdigit() else 5 for token in tokens if "*" not in token and token != "..."]
    good = np.zeros(sizes, dtype)
    bad: dict[str, Any] = {
        "complex array": np.zeros(sizes, complex), "words": np.full(sizes, "a"), "objects": np.full(sizes, None),
    }  # fmt: skip
    if sizes:
        bad["ragged"] = [[1.0, 2.0], [3.0]]
    if family != "Bool":
        bad["truths"] = np.zeros(sizes, bool)
    if family in ("Int", "UInt", "Bool"):
        bad["fractions"] = np.zeros(sizes, np.float32)
    if family in ("Float", "Num"):
        bad |= {
            "NaN inside": np.full(sizes, np.nan, np.float32),
            "infinity inside": np.full(sizes, -np.inf, np.float32),
        }
    if not variadic:
        bad["one rank more"] = good[None]
        if sizes:
            bad["one rank less"] = good[0]
    elif sizes:
        bad["too low a rank"] = np.zeros((), dtype)
    if tokens and tokens[-1].isdigit() and int(tokens[-1]) > 1:
        bad["a longer last axis"] = np.zeros((*sizes[:-1], sizes[-1] + 1), dtype)
        bad["transposed"] = np.zeros((sizes[-1], sizes[-1] + 4), dtype)
    return bad


def refusal(signature: Signature, name: str, value: Any) -> str:
    """Why the call with one bad argument is not refused as it should be; empty if it is."""
    try:
        signature.call(**{name: value})
    except ValueError as error:
        said = str(error)
        if name not in said:
            return f"does not name it: {said[:150]}"
        return "" if "got " in said or "finite" in said else f"does not say what came: {said[:150]}"
    except Exception as error:
        return f"{type(error).__name__}: {str(error)[:150]}"
    return "accepted"


def everything_bad(good: Any) -> dict[str, Any]:
    """What users give by mistake in place of a good value, whatever its kind."""
    bad: dict[str, Any] = {
        "None": None, "a word": "word", "bytes": b"bytes", "complex": 1j, "a stranger": Stranger(), "a class": Stranger,
        "NaN": np.nan, "infinity": np.inf, "truth": True, "fraction": 2.5, "zero": 0, "negative": -1, "huge": 10**30,
        "empty": [], "ragged": [[1.0, 2.0], [3.0]], "NaN inside": [0.0, np.nan, 1.0], "a square": np.zeros((2, 2)),
        "no rows": np.zeros((0, 3)), "many axes": np.zeros((1, 2, 1, 2, 1)),
    }  # fmt: skip
    if isinstance(good, eqx.Module):
        bad["its class"] = type(good)
        bad["a list of it"] = [good, good]
    if isinstance(good, jax.Array | np.ndarray):
        array = np.asarray(good)
        bad["whole numbers"], bad["truths"] = np.ones(array.shape, np.int32), np.ones(array.shape, bool)
        bad["complex array"], bad["words"] = np.ones(array.shape, complex), np.full(array.shape, "a")
        bad["one axis more"] = array[None]
        if array.ndim:
            bad["one axis less"], bad["longer"] = array[0], np.concatenate([array, array])
            bad["turned"] = array.T
            bad["NaN in it"] = np.where(np.arange(array.size).reshape(array.shape) == 0, np.nan, array)
    return bad


def outcome(call: Callable[..., Any], good: Mapping[str, Any], name: str, value: Any, only_checks: bool = False) -> str:
    """Empty where a bad argument among good ones is refused by name; "finite" where it has a finite result after all.

    With `only_checks` nothing is computed: "finite" stands for what the signature lets through.
    """
    given = {**good, name: value}
    try:
        if only_checks:
            getattr(call, "__func__", call)._arguments_.check((), given)
            return "finite, perhaps"
        result = call(**given)
    except ValueError as error:
        said = str(error)
        is_named = name in said or (isinstance(value, str) and value in said)
        says_what = any(word in said for word in ("got ", "finite", str(value)[:20]))
        return "" if is_named and says_what else f"does not name it, or not what came: {said[:200]}"
    except Exception as error:
        return f"{type(error).__name__}: {str(error)[:200]}"
    leaves = [np.asarray(leaf) for leaf in jax.tree.leaves(result) if isinstance(leaf, jax.Array | np.ndarray | float)]
    finite = all(np.isfinite(leaf).all() for leaf in leaves if leaf.dtype.kind == "f")
    return "finite" if finite else "NaN or infinity comes out"
