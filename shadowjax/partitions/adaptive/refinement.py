"""What to refine first: benefit in pixels against cost in texels, cell by cell; host-side."""

from typing import NamedTuple

import numpy as np

from shadowjax._checked import checked
from shadowjax._types import Float, Int
from shadowjax.partitions.adaptive.tile_tree import MAX_LEVEL, deinterleaved


class Wishes(NamedTuple):
    """Tiles that would serve a frame, the best first.

    Attributes:
        keys: Level, x and y.
        benefit: Pixels that each would serve.
        cell: Slot of the tile that each would refine.
        required: Texels that refining that cell takes, N_required.
        ratio: Benefit over cost of refining that cell.
    """

    keys: Int[np.ndarray, "tiles 3"]
    benefit: Int[np.ndarray, "tiles"]
    cell: Int[np.ndarray, "tiles"]
    required: Int[np.ndarray, "tiles"]
    ratio: Float[np.ndarray, "tiles"]


@checked
def refinement_cost(num_required: np.ndarray | int, per_texel: float, fixed: float) -> np.ndarray | float:
    """a·N_required + b: the cost of refining a cell.

    Args:
        num_required: Texels to be cast for the cell.
        per_texel: a, cost of a texel.
        fixed: b, cost that every refinement has.

    Source: asm, cost and benefit.
    """
    cost = per_texel * num_required + fixed
    return cost if isinstance(cost, np.ndarray) else float(cost)


@checked
def wishes(
    place: Int[np.ndarray, "pixels"],
    cell: Int[np.ndarray, "pixels"],
    level: Int[np.ndarray, "pixels"],
    needed: Int[np.ndarray, "pixels"],
    step: int,
    tile_texels: int,
    per_texel: float,
    fixed: float,
) -> Wishes:
    """The tiles that pixels at discontinuities ask for.

    The benefit of a tile is the number of such pixels in it that need more than they have (the source counts all pixels
    of a cell with a discontinuity, also those that could not use a finer map). A cell is refined where its pixels
    are: N_required counts only the tiles that some pixel asks for.

    Args:
        place: Place of each pixel on the Z-order curve; only pixels at discontinuities.
        cell: Slot of the tile that answers for it.
        level: Level of that tile.
        needed: Level that the pixel's footprint asks for.
        step: Most levels that one refinement goes down, ≥ 1.
        tile_texels: Texels of a tile.
        per_texel: a.
        fixed: b.

    Source: asm, cost and benefit.
    """
    lacking = needed > level
    place, cell, level, needed = (part[lacking] for part in (place, cell, level, needed))
    target = np.minimum(needed, level + step).astype(np.int64)
    # The leading bits of a place on the curve name the tile of a level; level and name make one sortable number.
    prefix = place.astype(np.int64) >> (2 * (MAX_LEVEL - target))
    name, first, benefit = np.unique((target << 32) | prefix, return_index=True, return_counts=True)
    x, y = deinterleaved((name & 0xFFFFFFFF).astype(np.int32))
    keys = np.stack([(name >> 32).astype(np.int32), x, y], axis=-1)
    slots, index = np.unique(cell[first], return_inverse=True)
    required = np.bincount(index, minlength=len(slots)) * tile_texels
    ratio = np.bincount(index, benefit, len(slots)) / refinement_cost(required, per_texel, fixed)
    # By the cell's ratio, then cell by cell, then by benefit: the last key of `lexsort` counts first.
    order = np.lexsort((-benefit, cell[first], -ratio[index]))
    parts = (keys, benefit.astype(np.int32), cell[first], required[index], ratio[index])
    return Wishes(*(part[order] for part in parts))


__all__ = ["Wishes", "refinement_cost", "wishes"]
