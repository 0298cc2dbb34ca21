"""Reading maps: nearest and bilinear, with explicit behaviour outside the map."""

from collections.abc import Callable

import jax.numpy as jnp

from shadowjax._checked import checked
from shadowjax._checks import require_choice
from shadowjax._numerics import far_away
from shadowjax._types import Array, Bool, Float, Int

BORDERS = ("lit", "clamp", "octahedral")


@checked
def read_texels(
    planes: Float[Array, "n rows cols"],
    col: Int[Array, "*points"],
    row: Int[Array, "*points"],
    border: str = "lit",
) -> list[Float[Array, "*points"]]:
    """The value of every plane at integer texels.

    Args:
        planes: One or more maps of the same size.
        col: Column of each read; may lie outside the map.
        row: Row of each read; may lie outside the map.
        border: What lies outside: "lit" reads a depth beyond everything, "clamp" repeats the edge, "octahedral"
            continues across the folds of an omnidirectional map.

    Returns:
        One array for each plane. Planes stay apart: reading small vectors is several times slower.

    Raises:
        ValueError: If `border` is unknown.
    """
    require_choice(border, "border", BORDERS)
    num_rows, num_cols = planes.shape[-2:]
    outside = (col < 0) | (col >= num_cols) | (row < 0) | (row >= num_rows)
    if border == "octahedral":
        col, row = fold(col, row, num_cols, num_rows)
    # Clamped first, so that every index is valid; what lies outside is replaced afterwards.
    flat = jnp.clip(row, 0, num_rows - 1) * num_cols + jnp.clip(col, 0, num_cols - 1)
    values = [plane.reshape(-1)[flat] for plane in planes]
    if border == "lit":
        values = [jnp.where(outside, far_away(planes.dtype), value) for value in values]
    return values


@checked
def fold(col: Array, row: Array, num_cols: int | Array, num_rows: int | Array) -> tuple[Array, Array]:
    """Texel inside an octahedral map that continues a texel just outside: beyond an edge the square is turned over."""
    # Beyond a side, the texel at the same distance within it, at the row mirrored about the middle of the edge; then
    # the same across the ends.
    over_side = (col < 0) | (col >= num_cols)
    row = jnp.where(over_side, num_rows - 1 - row, row)
    col = jnp.where(col < 0, -1 - col, jnp.where(col >= num_cols, 2 * num_cols - 1 - col, col))
    over_end = (row < 0) | (row >= num_rows)
    col = jnp.where(over_end, num_cols - 1 - col, col)
    row = jnp.where(row < 0, -1 - row, jnp.where(row >= num_rows, 2 * num_rows - 1 - row, row))
    return col, row


@checked
def texel_index(position: Float[Array, "*points"]) -> Int[Array, "*points"]:
    """Index of the texel that a position (in texels, centres at +½) lies in; far positions stay finite integers."""
    return jnp.floor(jnp.clip(position, -1e9, 1e9)).astype(jnp.int32)


@checked
def read_nearest(
    planes: Float[Array, "n rows cols"], position: Float[Array, "*points 2"], border: str = "lit"
) -> Float[Array, "n *points"]:
    """The texel each position lies in.

    Args:
        planes: Maps of one size.
        position: (x, y) in texels, centres at +½.
        border: See `read_texels`.
    """
    col, row = texel_index(position[..., 0]), texel_index(position[..., 1])
    return jnp.stack(read_texels(planes, col, row, border))


@checked
def bilinear_weights(
    position: Float[Array, "*points 2"],
) -> tuple[Int[Array, "*points"], Int[Array, "*points"], Float[Array, "*points"], Float[Array, "*points"]]:
    """Lower-left texel of the four whose centres surround each position, and the fractions towards the others.

    Source: filtering, eq. 2.2, with texel centres at i + ½ (the source puts them at integers).
    """
    shifted = jnp.clip(position - 0.5, -1e9, 1e9)
    base = jnp.floor(shifted)
    fraction = shifted - base
    index = base.astype(jnp.int32)
    return index[..., 0], index[..., 1], fraction[..., 0], fraction[..., 1]


@checked
def read_bilinear(
    planes: Float[Array, "n rows cols"], position: Float[Array, "*points 2"], border: str = "clamp"
) -> Float[Array, "n *points"]:
    """Mean of the four surrounding texels, weighted by nearness.

    Args:
        planes: Maps of one size.
        position: (x, y) in texels, centres at +½.
        border: See `read_texels`; "clamp" by default, since a mean with the depth beyond everything has no meaning.
    """
    return jnp.stack(read_bilinear_apart(planes, position, border))


@checked
def read_bilinear_apart(
    planes: Float[Array, "n rows cols"],
    position: Float[Array, "*points 2"],
    border: str = "clamp",
    each: Callable[[Array], Array] | None = None,
) -> list[Float[Array, "*points"]]:
    """As `read_bilinear`, one array for each plane: nothing has to be copied together.

    Args:
        planes: Maps of one size.
        position: (x, y) in texels, centres at +½.
        border: See `read_texels`.
        each: Applied to every texel read, before the mean; None for no change.
    """
    col, row, right, down = bilinear_weights(position)
    results = [jnp.zeros(position.shape[:-1], planes.dtype) for _ in planes]
    for d_row, row_weight in ((0, 1 - down), (1, down)):
        for d_col, col_weight in ((0, 1 - right), (1, right)):
            weight = row_weight * col_weight
            values = read_texels(planes, col + d_col, row + d_row, border)
            values = values if each is None else [each(value) for value in values]
            results = [result + value * weight for result, value in zip(results, values, strict=True)]
    return results


@checked
def is_outside(position: Float[Array, "*points 2"], num_rows: int, num_cols: int) -> Bool[Array, "*points"]:
    """Whether a position (in texels) lies beyond the map."""
    x, y = position[..., 0], position[..., 1]
    return (x < 0) | (x > num_cols) | (y < 0) | (y > num_rows)
