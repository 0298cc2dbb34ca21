"""shadowjax: a differentiable, analytical reference for shadow maps on JAX."""

import importlib
import importlib.util
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from shadowjax._api import *  # noqa: F403

__version__ = "0.1.0"


def __getattr__(name: str) -> Any:
    """A public name or a module, loaded when it is first asked for.

    A command line must answer `--help`, bad options and signals before JAX is imported, which takes a second.
    """
    if name.startswith("__") and name != "__all__":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    if importlib.util.find_spec(f"{__name__}.{name}") is not None:
        return importlib.import_module(f"{__name__}.{name}")
    names = importlib.import_module(f"{__name__}._api")
    if name != "__all__" and name not in names.__all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    globals()[name] = value = getattr(names, name)
    return value


def __dir__() -> list[str]:
    """The public names, as completion lists them."""
    return [*globals(), *__getattr__("__all__")]
