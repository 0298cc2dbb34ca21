"""All cores of a processor: JAX shows one device for it unless it is told otherwise before it starts."""

import os

import jax

from shadowjax._checked import checked
from shadowjax._checks import require, require_int


@checked
def use_all_cores(num_cores: int | None = None) -> int:
    """Show a device for each core, for what is dealt over devices: call it once, before anything is computed.

    `rays.closest_on_grids`, `cast_over_bands` and their like, and `optimize.sweep`, then take every core; answers of
    bands of a power of two of rows stay the same bit by bit. A single map is not dealt by itself.

    Args:
        num_cores: Devices to show, ≥ 1; None for the cores that this process may use.

    Returns:
        The number of devices.

    Raises:
        ValueError: If JAX has started with another number of devices.
    """
    allowed = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    wanted = allowed if num_cores is None else require_int(num_cores, "num_cores", 1)
    try:
        jax.config.update("jax_num_cpu_devices", wanted)
    except RuntimeError:
        shown = len(jax.local_devices(backend="cpu"))
        require(
            shown == wanted,
            f"use_all_cores(num_cores={num_cores}) came too late: JAX has started with {shown} of {wanted} devices; "
            "call it at the start of the program, before the first array",
        )
    return wanted


__all__ = ["use_all_cores"]
