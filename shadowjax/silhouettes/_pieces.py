"""What lies on both sides of every piece of a line, and where along the piece that changes; no gradient."""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import lax

from shadowjax._types import Array, Float, Int
from shadowjax.silhouettes._cells import BESIDE, Crossings, map_present, places_beside

# Parts of a piece that are looked at separately: a part that changes and changes back is not noticed.
PARTS = 3
# How close to its ends a piece is looked at, in distances of the places next to it.
INSET = 4.0
# Halvings that find where a piece changes.
HALVINGS = 20
# One piece in this many may change on its way; where there are more, the rest change in their middle.
CHANGING = 8
# Pieces looked at together, a third of them all if that is no whole part: bounds memory.
CHUNK = 1024

# Grid positions left and right of a line, which places count, and the line → a number for each case (0: it separates
# nothing), and what is found there.
Probe = Callable[[Array, Array, Array, Array], tuple[Array, Any]]


class Pieces(NamedTuple):
    """Parts of lines within one cell, with the same surfaces next to them all along.

    Attributes:
        segment: Index of the line.
        cell: Index of the cell.
        first, last: Ends, as parts of the line.
        case: From the probe; 0 where the piece parts nothing or is none.
        found: From the probe.
    """

    segment: Int[Array, "n"]
    cell: Int[Array, "n"]
    first: Float[Array, "n"]
    last: Float[Array, "n"]
    case: Int[Array, "n"]
    found: Any


def settle(
    pairs: Crossings, start: Float[Array, "segments 2"], end: Float[Array, "segments 2"], probe: Probe
) -> Pieces:
    """Look at both ends of every part of a piece; where they differ, halve it until the place of the change is known.

    Lines end behind others, or pass from one surface to the next, anywhere within a cell.

    Args:
        pairs: Lines and the cells they cross.
        start, end: Of all lines.
        probe: Tells what lies next to a line.
    """
    pairs = _in_parts(pairs)
    capacity = pairs.segment.shape[0]
    # Room asked for by the caller need not be a multiple of the chunk.
    chunk = CHUNK if capacity % CHUNK == 0 else capacity // PARTS
    pairs, ends = lax.optimization_barrier((pairs, (start[pairs.segment], end[pairs.segment])))
    length = jnp.sqrt(jnp.sum((ends[1] - ends[0]) ** 2, axis=-1))
    away = INSET * BESIDE * float(jnp.finfo(length.dtype).eps) ** 0.5
    # A little inside both ends, where corners of other lines do not disturb, but never past the middle of the piece.
    inset = jnp.minimum(away / jnp.where(length > 0, length, 1.0), 0.25 * (pairs.last - pairs.first))

    def look(part: tuple) -> Any:
        exists, segment, start, end, at = part
        case, found = probe(*places_beside(start, end, at), exists, segment)
        return jnp.where(exists, case, 0), found

    # One loop for all looks, so that what casts rays is compiled once: first ends, last ends, then halvings.
    lines = (pairs.present, pairs.segment, *ends)
    shapes = jax.eval_shape(look, (*lines, inset))
    nothing = jax.tree.map(lambda x: jnp.zeros(x.shape, x.dtype), shapes)
    listed = jnp.arange(capacity, dtype=jnp.int32)
    state = (jnp.int32(0), nothing, nothing, listed, pairs.num, pairs.first + inset, pairs.last - inset)

    def go_on(state: tuple) -> Array:
        step, *_, count, _, _ = state
        return (step < 2) | ((step < 2 + HALVINGS) & (count > 0))

    def turn(state: tuple) -> tuple:
        step, one, other, listed, count, low, high = state
        at = jnp.where(step == 0, low, jnp.where(step == 1, high, 0.5 * (low + high)))
        here = jax.tree.map(lambda x: x[listed], lines)
        seen = map_present(look, (*here, at), count, chunk)

        def keep_one() -> tuple:
            return seen, other, listed, count, low, high

        def keep_other() -> tuple:
            # Only pieces whose two ends saw different cases are halved further.
            differs = one[0] != seen[0]
            index = jnp.nonzero(differs, size=capacity, fill_value=0)[0].astype(jnp.int32)
            return one, seen, index, jnp.sum(differs, dtype=jnp.int32), low[index], high[index]

        def halve() -> tuple:
            # The change lies beyond a place that looks like the low end, before one that does not.
            same = seen[0] == one[0][listed]
            return one, other, listed, count, jnp.where(same, at, low), jnp.where(same, high, at)

        return step + 1, *lax.switch(jnp.minimum(step, 2), (keep_one, keep_other, halve))

    _, (case, found), (other_case, other_found), index, many, low, high = lax.while_loop(go_on, turn, state)
    spare = max(min(CHUNK, capacity), capacity // CHANGING)
    index, valid = index[:spare], jnp.arange(spare, dtype=jnp.int32) < many
    # Pieces that change are cut in two: the first keeps its place, the rest follows in spare rows.
    change = 0.5 * (low + high)[:spare]
    # Those beyond the room change in their middle.
    last = jnp.where(case == other_case, pairs.last, 0.5 * (pairs.first + pairs.last))
    last = last.at[jnp.where(valid, index, capacity)].set(change, mode="drop")
    kept = (pairs.segment, pairs.cell, pairs.first, last, case)
    rest = (pairs.segment[index], pairs.cell[index], change, pairs.last[index], jnp.where(valid, other_case[index], 0))
    segment, cell, first, last, case = (jnp.concatenate(both) for both in zip(kept, rest, strict=True))
    found = jax.tree.map(lambda a, b: jnp.concatenate([a, b[index]]), found, other_found)
    return Pieces(segment, cell, first, last, case, found)


def _in_parts(pairs: Crossings) -> Crossings:
    """Every piece cut into equal parts, in order."""
    segment, cell, first, last, present = (jnp.repeat(part, PARTS) for part in pairs[:5])
    # Equal parts of every piece, numbered piece by piece.
    at = jnp.arange(PARTS + 1, dtype=first.dtype) / PARTS
    low = jnp.tile(at[:-1], first.shape[0] // PARTS)
    high = jnp.tile(at[1:], first.shape[0] // PARTS)
    return Crossings(
        segment, cell, first + low * (last - first), first + high * (last - first), present, PARTS * pairs.num
    )
