"""Bijections between a region of a light's plane and the unit square of a map; Box, the affine one; bands of a map."""

from abc import abstractmethod

import equinox as eqx
import jax.numpy as jnp

from shadowjax._checked import Checked, checked
from shadowjax._types import Array, Bool, DType, Float, Scalar, Vector2

PlanePoints = Float[Array, "*points 2"]


class PlaneMap(Checked):
    """A bijection between a region of the plane of a light space and the unit square (s, t)."""

    @abstractmethod
    def forward(self, plane: PlanePoints) -> PlanePoints:
        """(s, t) of plane positions; outside [0, 1]² for positions outside the region, never NaN."""

    @abstractmethod
    def inverse(self, square: PlanePoints) -> PlanePoints:
        """Plane position of each (s, t)."""

    def enlarged(self, factor: float) -> "PlaneMap":
        """A map that covers more, `factor` times in s and in t about its middle; itself where texels differ in size."""
        del factor
        return self

    def regular(self, plane: PlanePoints) -> Bool[Array, "*points"]:
        """Where the (s, t) of three corners bound that of their triangle: here, inside the region.

        A map that goes on without folding outside its region says so, which spares casters a slower test.
        """
        square = self.forward(plane)
        return jnp.all((square >= 0) & (square <= 1), axis=-1)


class Box(PlaneMap):
    """The affine map of a rectangle onto the unit square; a side runs backwards where `lower` exceeds `upper`.

    Attributes:
        lower: Plane position of (s, t) = (0, 0).
        upper: Plane position of (s, t) = (1, 1); differs from `lower` in both coordinates.
    """

    lower: Vector2
    upper: Vector2

    def forward(self, plane: PlanePoints) -> PlanePoints:
        """Shift and scale to the unit square."""
        return (plane - self.lower) / (self.upper - self.lower)

    def inverse(self, square: PlanePoints) -> PlanePoints:
        """Scale and shift back."""
        return self.lower + square * (self.upper - self.lower)


class RowBand(PlaneMap):
    """A band of rows of another map: its unit square is that part of the other's.

    With a power of two for the number of rows, the arithmetic on cell centres is exact, so a band has the very rays of
    the whole grid, whatever the map.

    Attributes:
        whole: The map of the whole grid.
        first_row: Rows of the whole grid before the band: a number, so that all bands share compiled code.
        num_rows: Rows of the band.
        whole_rows: Rows of the whole grid.
    """

    whole: PlaneMap
    first_row: Scalar
    num_rows: int = eqx.field(static=True)
    whole_rows: int = eqx.field(static=True)

    def forward(self, plane: PlanePoints) -> PlanePoints:
        """To the whole square, then to the band."""
        s, t = jnp.moveaxis(self.whole.forward(plane), -1, 0)
        return jnp.stack([s, (t * self.whole_rows - self.first_row) / self.num_rows], axis=-1)

    def inverse(self, square: PlanePoints) -> PlanePoints:
        """Into the whole square, then back."""
        s, t = square[..., 0], square[..., 1]
        return self.whole.inverse(jnp.stack([s, (self.first_row + t * self.num_rows) / self.whole_rows], axis=-1))

    def regular(self, plane: PlanePoints) -> Bool[Array, "*points"]:
        """Where the whole map is."""
        return self.whole.regular(plane)


@checked
def affine_box(plane_map: PlaneMap) -> Box | None:
    """The box that a map is, or that a band of it is, to a rounding; None for a map that is not affine."""
    if isinstance(plane_map, Box):
        return plane_map
    if not isinstance(plane_map, RowBand):
        # Maps that merely wrap a box say so.
        inner = getattr(plane_map, "box", None)
        return inner if isinstance(inner, Box) else None
    if affine_box(plane_map.whole) is None:
        return None
    # A band of an affine map is affine: two corners of its unit square say which box.
    lower, upper = plane_map.inverse(jnp.asarray([[0, 0], [1, 1]], plane_map.first_row.dtype))
    return Box(lower, upper)


@checked
def region_corners(plane_map: PlaneMap, dtype: DType) -> Float[Array, "4 2"]:
    """Plane positions of the corners of the unit square, in order round it."""
    return plane_map.inverse(jnp.asarray([[0, 0], [1, 0], [1, 1], [0, 1]], dtype))


@checked
def region_sides(corners: Float[Array, "4 2"]) -> Float[Array, "4 3"]:
    """Lines (a, b, c) with a u + b v + c ≥ 0 inside a region with straight sides, given its corners; unit (a, b)."""
    middle = jnp.mean(corners, axis=0)
    following = jnp.roll(corners, -1, axis=0)
    a, b = corners[:, 1] - following[:, 1], following[:, 0] - corners[:, 0]
    # Offsets from a corner on the line, not the cross product of two positions, which cancels far from the origin.
    c = -(a * corners[:, 0] + b * corners[:, 1])
    towards = a * (middle[0] - corners[:, 0]) + b * (middle[1] - corners[:, 1])
    length = jnp.sqrt(a * a + b * b)
    # Turned inwards, whichever way the corners run.
    scale = jnp.where(towards < 0, -1.0, 1.0).astype(length.dtype) / jnp.where(length > 0, length, 1.0)
    return jnp.stack([a * scale, b * scale, c * scale], axis=-1)
