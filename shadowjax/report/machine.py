"""What a run was made on: processor, memory, versions, device and dtype, so that its times mean something."""

import datetime
import importlib.metadata
import os
import platform

import jax

from shadowjax._types import default_dtype

PACKAGES = ("jax", "jaxlib", "equinox", "numpy", "trimesh")


def machine() -> dict[str, str]:
    """Facts about machine and software, name to value, in the order to show them."""
    device = jax.devices()[0]
    facts = {
        "processor": _processor(),
        "cores": str(_cores()),
        "system": f"{platform.system()} {platform.machine()}",
        "device": f"{device.platform} ({device.device_kind})",
        "dtype": str(jax.numpy.dtype(default_dtype())),
        "python": platform.python_version(),
        "shadowjax": _version("shadowjax"),
    }
    facts |= {name: _version(name) for name in PACKAGES}
    facts["date"] = datetime.datetime.now(datetime.UTC).strftime("%Y-%m-%d %H:%M UTC")
    return facts


def _cores() -> int:
    """Processors that this process may use."""
    usable = getattr(os, "sched_getaffinity", None)
    return len(usable(0)) if usable is not None else os.cpu_count() or 1


def _version(package: str) -> str:
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        from shadowjax import __version__

        return __version__ if package == "shadowjax" else "not installed"


def _processor() -> str:
    """The processor's name, where the system reports it."""
    name = platform.processor()
    if platform.system() == "Linux":
        from shadowjax.io import read_lines

        for line in read_lines("/proc/cpuinfo"):
            if line.lower().startswith("model name"):
                return line.split(":", 1)[1].strip()
    return name or platform.machine() or "unknown"
