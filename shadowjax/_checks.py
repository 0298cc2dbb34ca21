"""Checks of what users give: ValueError for structure, eqx.error_if for values. Constructors and entry points only."""

import os
from collections.abc import Iterable
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from shadowjax._types import Array


def concrete(value: Any) -> np.ndarray | None:
    """The NumPy value of an array, or None while it is traced."""
    return None if isinstance(value, Tracer) else np.asarray(value)


def require(condition: bool, message: str) -> None:
    """Raise ValueError with `message` unless `condition` holds; for facts known when Python runs."""
    if not condition:
        raise ValueError(message)


def require_int(value: Any, name: str, minimum: int) -> int:
    """An int that is at least `minimum`, or a ValueError that names it."""
    is_int = isinstance(value, int | np.integer) and not isinstance(value, bool)
    require(bool(is_int and value >= minimum), f"{name} must be an integer of at least {minimum}; got {value!r}")
    return int(value)


def require_choice(value: Any, name: str, choices: Iterable[Any]) -> Any:
    """`value` if it is one of `choices`, or a ValueError that lists them."""
    known = tuple(choices)
    require(value in known, f"{name} must be one of {', '.join(map(repr, known))}; got {value!r}")
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


def require_finite(array: Array, name: str) -> Array:
    """Return `array`; complain if it holds NaN or infinity."""
    known = concrete(array)
    if known is not None:
        if not np.isfinite(known).all():
            bad = int((~np.isfinite(known)).sum())
            raise ValueError(f"{name} must be finite; {bad} of {known.size} numbers are NaN or infinite")
        return array
    return eqx.error_if(array, jnp.logical_not(jnp.all(jnp.isfinite(array))), f"{name} must be finite")


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
