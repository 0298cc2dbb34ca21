"""The registry of ray casters, and the one that commands and reports use."""

from collections.abc import Callable

from shadowjax._checked import checked
from shadowjax._checks import require_choice
from shadowjax.rays.brute import BruteForceCaster
from shadowjax.rays.bvh.caster import BvhCaster
from shadowjax.rays.caster import Caster
from shadowjax.rays.grid.caster import GridCaster

CASTERS: dict[str, Callable[[], Caster]] = {
    "brute": BruteForceCaster,
    "grid": GridCaster,
    "bvh": BvhCaster,
}
DEFAULT_CASTER = "grid"


def default_caster() -> Caster:
    """The fastest caster that serves every scene and light."""
    return make_caster(DEFAULT_CASTER)


@checked
def make_caster(name: str) -> Caster:
    """A caster by its registered name.

    Raises:
        ValueError: If there is none of that name.
    """
    return CASTERS[require_choice(name, "caster", CASTERS)]()
