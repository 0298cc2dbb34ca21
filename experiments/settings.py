"""Configs from TOML: where the files lie, their [quick] tables, and errors that name the key and the file."""

import types
from dataclasses import fields
from pathlib import Path
from typing import Any, TypeVar, get_args, get_origin, get_type_hints

from shadowjax._checks import require
from shadowjax.io import read_toml

FOLDER = Path(__file__).resolve().parent.parent / "configs"

_Config = TypeVar("_Config")


def default_path(name: str) -> Path:
    """The file with an experiment's own settings."""
    return FOLDER / f"{name}.toml"


def read_config(config_type: type[_Config], path: str | Path, quick: bool = False) -> _Config:
    """A config from a TOML file.

    Args:
        config_type: Frozen dataclass; keys of the file are its fields, and its `__post_init__` checks the values.
        path: The file. Its table [quick] holds the values for quick runs; both are checked in any case.
        quick: Whether [quick] replaces the values above it.

    Returns:
        The config; fields that the file leaves out keep their defaults.

    Raises:
        ValueError: If the file cannot be read, or a key or value is wrong; the message names file and key.
    """
    table = read_toml(path)
    faster = table.pop("quick", {})
    require(isinstance(faster, dict), f"{path}: quick must be a table, [quick]; got {faster!r}")
    usual = _make(config_type, table, f"{path}")
    quicker = _make(config_type, {**table, **faster}, f"{path} [quick]")
    return quicker if quick else usual


def _make(config_type: type[_Config], table: dict[str, Any], where: str) -> _Config:
    hints = get_type_hints(config_type)
    known = [field.name for field in fields(config_type)]  # pyright: ignore[reportArgumentType]
    for key in table:
        require(key in known, f"{where}: unknown key {key!r}; the keys are {', '.join(known)}")
    values = {key: _value(value, hints[key], f"{where}: {key}") for key, value in table.items()}
    try:
        return config_type(**values)
    except ValueError as error:
        raise ValueError(f"{where}: {error}") from error


def _value(value: Any, hint: Any, where: str) -> Any:
    """`value` in the type that a field asks for, or a ValueError; int, float, str, bool and tuples of them."""
    if get_origin(hint) is tuple:
        require(isinstance(value, list), f"{where} must be a list; got {value!r}")
        inner = get_args(hint)
        if inner[-1] is Ellipsis:
            return tuple(_value(entry, inner[0], where) for entry in value)
        require(len(value) == len(inner), f"{where} must hold {len(inner)} values; got {value!r}")
        return tuple(_value(entry, kind, where) for entry, kind in zip(value, inner, strict=True))
    require(isinstance(hint, type) and not isinstance(hint, types.GenericAlias), f"{where} has an unsupported type")
    fits = isinstance(value, hint) and (hint is bool or not isinstance(value, bool))
    if hint is float and isinstance(value, int) and not isinstance(value, bool):
        return float(value)
    require(fits, f"{where} must be {_NAMES.get(hint, hint.__name__)}; got {value!r}")
    return value


_NAMES = {int: "a whole number", float: "a number", str: "a string", bool: "true or false"}
