"""The registry of partitions by name, with their default settings."""

from collections.abc import Callable

from shadowjax._checked import checked
from shadowjax._checks import require_choice
from shadowjax.partitions.base import Partition
from shadowjax.partitions.cascades import Cascades
from shadowjax.partitions.cube import CubeMap
from shadowjax.partitions.faces import FacePartition
from shadowjax.partitions.single import SingleMap
from shadowjax.warps.stable import StableFit

PARTITIONS: dict[str, Callable[[], Partition]] = {
    "whole": SingleMap,
    "z": Cascades,
    "z-blended": lambda: Cascades(blend=0.2),
    "z-seen": lambda: Cascades(rule="seen"),
    "z-stable": lambda: Cascades(warp=StableFit(), tight=False, choose="depth"),
    "faces": FacePartition,
    "cube": CubeMap,
}


@checked
def make_partition(name: str) -> Partition:
    """A partition by its registered name.

    Raises:
        ValueError: If there is none of that name.
    """
    return PARTITIONS[require_choice(name, "partition", PARTITIONS)]()


__all__ = ["PARTITIONS", "make_partition"]
