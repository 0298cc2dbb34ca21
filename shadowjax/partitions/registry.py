"""The registry of partitions by name, with their default settings."""

from collections.abc import Callable

from shadowjax._checked import checked
from shadowjax._checks import require_choice
from shadowjax.partitions.base import Partition
from shadowjax.partitions.cube import Cube
from shadowjax.partitions.faces import Faces
from shadowjax.partitions.whole import Whole
from shadowjax.partitions.z_split import ZSplit
from shadowjax.warps.stable import StableFit

PARTITIONS: dict[str, Callable[[], Partition]] = {
    "whole": Whole,
    "z": ZSplit,
    "z-blended": lambda: ZSplit(blend=0.2),
    "z-seen": lambda: ZSplit(rule="seen"),
    "z-stable": lambda: ZSplit(warp=StableFit(), tight=False, choose="depth"),
    "faces": Faces,
    "cube": Cube,
}


@checked
def make_partition(name: str) -> Partition:
    """A partition by its registered name.

    Raises:
        ValueError: If there is none of that name.
    """
    return PARTITIONS[require_choice(name, "partition", PARTITIONS)]()


__all__ = ["PARTITIONS", "make_partition"]
