"""What lies on both sides of every piece of a line, and where along the piece that changes; no gradient."""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import lax

from shadowjax._types import Array, Float, Int
from shadowjax.rays._edge_cells import BESIDE, Crossings, map_present, places_beside, room

# How close to its ends a piece is looked at, in distances of the places beside it.
INSET = 4.0
# Halvings that find where a piece changes.
HALVINGS = 20
# One piece in so many may change on its way; where there are more, the rest change in their middle.
CHANGING = 8
# Pieces halved together.
CHUNK = 512

# Grid positions left and right of a line, which places count, and the line → a number that tells cases apart (0: it
# parts nothing), and what is found there.
Probe = Callable[[Array, Array, Array, Array], tuple[Array, Any]]


class Pieces(NamedTuple):
    """Parts of lines within one cell, with the same surfaces beside them all along.

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
    pairs: Crossings, start: Float[Array, "segments 2"], end: Float[Array, "segments 2"], probe: Probe, chunk: int
) -> Pieces:
    """Look at both ends of every piece; where they differ, halve it until the place of the change is known.

    Lines end behind others, or pass from one surface to the next, anywhere within a cell.

    Args:
        pairs: Lines and the cells they cross.
        start, end: Of all lines.
        probe: Tells what lies beside a line.
        chunk: Pairs looked at together.
    """
    start, end = start[pairs.segment], end[pairs.segment]

    def look(lines: tuple, ats: list[Array]) -> list[tuple[Array, Any]]:
        exists, segment, start, end = lines
        beside = [places_beside(start, end, at) for at in ats]
        left, right = (jnp.concatenate(side) for side in zip(*beside, strict=True))
        case, found = probe(left, right, jnp.tile(exists, len(ats)), jnp.tile(segment, len(ats)))
        parts = jax.tree.map(lambda x: jnp.split(x, len(ats)), (case, found), is_leaf=lambda x: isinstance(x, Array))
        return [jax.tree.map(lambda x: x[k], parts, is_leaf=lambda x: isinstance(x, list)) for k in range(len(ats))]

    def both_ends(part: tuple) -> Any:
        *lines, first, last = part
        length = jnp.sqrt(jnp.sum((lines[3] - lines[2]) ** 2, axis=-1))
        away = INSET * BESIDE * float(jnp.finfo(length.dtype).eps) ** 0.5
        inset = jnp.minimum(away / jnp.where(length > 0, length, 1.0), 0.25 * (last - first))
        return look(tuple(lines), [first + inset, last - inset])

    lines = (pairs.present, pairs.segment, start, end)
    (case, found), (other_case, other_found) = map_present(
        both_ends, (*lines, pairs.first, pairs.last), pairs.count, chunk
    )
    case, other_case = (jnp.where(pairs.present, x, 0) for x in (case, other_case))
    differs = case != other_case
    spare, size = room(max(CHUNK, case.shape[0] // CHANGING), CHUNK)
    many = jnp.sum(differs, dtype=jnp.int32)
    index = jnp.nonzero(differs, size=spare, fill_value=0)[0].astype(jnp.int32)
    valid = jnp.arange(spare, dtype=jnp.int32) < many

    def halve(part: tuple) -> Array:
        *lines, low, high, case = part

        def step(_: Array, bounds: tuple[Array, Array]) -> tuple[Array, Array]:
            low, high = bounds
            middle = 0.5 * (low + high)
            ((found_case, _),) = look(tuple(lines), [middle])
            same = found_case == case
            return jnp.where(same, middle, low), jnp.where(same, high, middle)

        low, high = lax.fori_loop(0, HALVINGS, step, (low, high))
        return 0.5 * (low + high)

    listed = jax.tree.map(lambda x: x[index], (*lines, pairs.first, pairs.last, case))
    change = map_present(halve, (listed[0] & valid, *listed[1:]), jnp.minimum(many, spare), size)
    middle = 0.5 * (pairs.first + pairs.last)
    # Those beyond the room change nowhere near: their first half is taken for the whole.
    last = jnp.where(differs, middle, pairs.last)
    last = last.at[jnp.where(valid, index, case.shape[0])].set(change, mode="drop")
    rest = (pairs.segment[index], pairs.cell[index], change, pairs.last[index], jnp.where(valid, other_case[index], 0))
    return Pieces(
        *(
            jnp.concatenate(pair)
            for pair in zip((pairs.segment, pairs.cell, pairs.first, last, case), rest, strict=True)
        ),
        jax.tree.map(lambda a, b: jnp.concatenate([a, b[index]]), found, other_found),
    )
