"""Bijections between a region of a light's plane and the unit square of a map; Box, the affine one."""

from abc import abstractmethod

import equinox as eqx
import jax.numpy as jnp

from shadowjax._types import Array, Bool, Float, Vector2

PlanePoints = Float[Array, "*points 2"]


class PlaneMap(eqx.Module):
    """A bijection between a region of the plane of a light space and the unit square (s, t)."""

    @abstractmethod
    def forward(self, plane: PlanePoints) -> PlanePoints:
        """(s, t) of plane positions; outside [0, 1]² for positions outside the region, never NaN."""

    @abstractmethod
    def inverse(self, square: PlanePoints) -> PlanePoints:
        """Plane position of each (s, t)."""

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
