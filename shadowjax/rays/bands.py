"""Depth maps larger than memory would hold: a grid cast band by band of rows."""

from collections.abc import Iterator

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from shadowjax._checked import checked
from shadowjax._checks import require, require_int, require_memory
from shadowjax._types import Array, Float, Int
from shadowjax.geometry.mesh import Mesh
from shadowjax.rays.caster import Caster
from shadowjax.rays.plane_map import RowBand
from shadowjax.rays.ray_grid import RayGrid

DEFAULT_ROWS = 256


@checked
def row_band(grid: RayGrid, first_row: int, num_rows: int) -> RayGrid:
    """Some rows of a grid as a grid of their own; for a power of two of rows its rays are exactly those of the whole.

    Args:
        grid: The whole grid.
        first_row: First row of the band, ≥ 0.
        num_rows: Rows of the band, ≥ 1.

    Raises:
        ValueError: If the band does not lie inside the grid.
    """
    require_int(first_row, "the first row", 0)
    require_int(num_rows, "the number of rows", 1)
    require(
        first_row + num_rows <= grid.num_rows,
        f"rows {first_row} to {first_row + num_rows} do not fit a grid of {grid.num_rows} rows",
    )
    return band_from(grid, jnp.asarray(first_row), num_rows)


@checked
def band_from(grid: RayGrid, first_row: Int[Array, ""], num_rows: int) -> RayGrid:
    """As `row_band`, from a row that only the running program knows; it is not checked."""
    band = RowBand(grid.plane_map, first_row.astype(grid.far.dtype), num_rows, grid.num_rows)
    return RayGrid(grid.space, band, grid.far, num_rows, grid.num_cols, grid.seen)


@checked
def depth_bands(
    caster: Caster, mesh: Mesh, grid: RayGrid, rows: int = DEFAULT_ROWS
) -> Iterator[tuple[int, Float[np.ndarray, "rows cols"]]]:
    """Cast a grid band by band, in order of rows; memory stays that of one band, whatever the size of the grid.

    Args:
        caster: Casts each band.
        mesh: The triangles.
        grid: The whole grid.
        rows: Rows cast together: a power of two.

    Yields:
        The number of the first row and the depths from there on, world units. The last band may be shorter; it is cast
        as the last `rows` rows, so that all bands share one shape.

    Raises:
        ValueError: If `rows` is no power of two, or mesh and one band cannot fit the memory that is left.
    """
    require_int(rows, "the rows of a band", 1)
    require(rows & (rows - 1) == 0, f"the rows of a band must be a power of two: rays are exact then; got {rows}")
    while rows > grid.num_rows:
        rows //= 2
    # A ray, its hit and the tables of the casters take about forty numbers.
    size = 40 * grid.far.dtype.itemsize * rows * grid.num_cols
    require_memory(size, f"a band of {rows} rows of {grid.num_cols} rays", "fewer rows in a band")
    for start in range(0, grid.num_rows, rows):
        # The last band starts early, so that one compiled program serves all.
        first = min(start, grid.num_rows - rows)
        band = np.asarray(_depth(caster, mesh, row_band(grid, first, rows)))
        yield start, band[start - first :]


@checked
def depth_by_bands(
    caster: Caster,
    mesh: Mesh,
    grid: RayGrid,
    out: Float[np.ndarray, "rows cols"] | None = None,
    rows: int = DEFAULT_ROWS,
) -> Float[np.ndarray, "rows cols"]:
    """Depth of every ray of a large grid on the host, cast band by band.

    Args:
        caster: Casts each band.
        mesh: The triangles.
        grid: The whole grid.
        out: Array to fill, for example `np.lib.format.open_memmap(path, "w+", dtype, shape)` for a map on disk; a new
            array if None.
        rows: Rows cast together: a power of two.

    Returns:
        `out`, world units; the grid's `far` for misses.

    Raises:
        ValueError: If `out` has another shape, or a new array would not fit the memory that is left.
    """
    shape, dtype = (grid.num_rows, grid.num_cols), np.dtype(grid.far.dtype)
    if out is None:
        size = dtype.itemsize * grid.num_rows * grid.num_cols
        require_memory(size, f"a depth map of {grid.num_rows} × {grid.num_cols}", "a memory-mapped `out`")
        out = np.empty(shape, dtype)
    require(out.shape == shape, f"out must have the shape of the grid, {shape}; got {out.shape}")
    for start, band in depth_bands(caster, mesh, grid, rows):
        out[start : start + len(band)] = band
    return out


@eqx.filter_jit
def _depth(caster: Caster, mesh: Mesh, grid: RayGrid) -> Float[Array, "rows cols"]:
    return caster.depth_on_grid(mesh, grid)
