"""The registry of partitions by name; a maker takes the warp of the maps, or None for the partition's own."""

from typing import Any

from shadowjax._checked import checked
from shadowjax._checks import require, require_choice
from shadowjax._registry import Entry, Registry
from shadowjax.partitions.base import Partition
from shadowjax.partitions.cascades import Cascades
from shadowjax.partitions.cube import CubeMap
from shadowjax.partitions.faces import FacePartition
from shadowjax.partitions.single import SingleMap
from shadowjax.warps.base import WarpFit
from shadowjax.warps.uniform import UniformFit

MOST_SLICES = 64


def _single(warp: WarpFit | None = None) -> Partition:
    return SingleMap() if warp is None else SingleMap(warp)


def _slices(num_partitions: int, warp: WarpFit | None = None, **options: Any) -> Partition:
    if warp is None:
        return Cascades(num_partitions, **options)
    if warp.holds_still:
        # Cuts that follow what is in view would move the maps that should not, and choice by map their seams.
        options = {"tight": False, "choose": "depth", **options}
    return Cascades(num_partitions, warp=warp, **options)


def _blended(num_partitions: int, warp: WarpFit | None = None) -> Partition:
    return _slices(num_partitions, warp, blend=0.2)


def _seen(num_partitions: int, warp: WarpFit | None = None) -> Partition:
    require(
        warp is None or not warp.holds_still,
        "slices at the depths that are seen move with the camera, so no map of theirs is stable: take zN with stable",
    )
    return _slices(num_partitions, warp, rule="seen")


def _faces(warp: WarpFit | None = None) -> Partition:
    require(warp is None, "every face has a warp of its own, of the best n' along it: leave the warp out, or take zN")
    return FacePartition()


def _cube(warp: WarpFit | None = None) -> Partition:
    require(
        warp is None or warp == UniformFit(),
        "the maps of a cube see a quarter turn each, wherever the view looks, so they are uniform: leave the warp out",
    )
    return CubeMap()


PARTITIONS: Registry[Partition] = Registry("partition", {
    "single": Entry(_single, "one map"),
    "zN": Entry(_slices, "N slices of the view in depth (cascades)", (4,), MOST_SLICES),
    "zN-blended": Entry(_blended, "slices that fade into each other", (4,), MOST_SLICES),
    "zN-seen": Entry(_seen, "slices cut by the depths that are seen", (4,), MOST_SLICES),
    "faces": Entry(_faces, "one map for each side of the view; parallel light"),
    "cube": Entry(_cube, "six maps around a point light; one for parallel light"),
})  # fmt: skip


@checked
def make_partition(name: str, warp: WarpFit | None = None) -> Partition:
    """A partition by its registered name.

    Args:
        name: A key of `PARTITIONS`; zN stands for any number N of slices.
        warp: How texels are spread over each map; the partition's own if None.

    Raises:
        ValueError: If there is none of that name, or it does not take that warp.
    """
    return PARTITIONS[require_choice(name, "partition", PARTITIONS)](warp=warp)


__all__ = ["PARTITIONS", "make_partition"]
