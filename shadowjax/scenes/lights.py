"""The registry of lights by name: how each kind is stood over a scene, as bright at its middle as the sun would be."""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from shadowjax._types import DType
from shadowjax.geometry.light import DirectionalLight, Light, PointLight, SpotLight


class LightStand(NamedTuple):
    """Where a light is asked to be, in the coordinates of a scene's mesh.

    Attributes:
        place: Where it stands.
        axis: The way it shines, of any length, towards the middle of the scene unless that was asked otherwise.
        reach: Distance from its place to the middle, world units.
        radius: Of the sphere round the scene, world units.
        color: Linear RGB that gives the brightness of the sun at the middle, were light to fall off with the square of
            distance.
        dtype: Of the scene.
    """

    place: np.ndarray
    axis: np.ndarray
    reach: float
    radius: float
    color: np.ndarray
    dtype: DType


class LightKind(NamedTuple):
    """One line of the registry.

    Attributes:
        make: The light of a stand.
        distance: How far from the middle it stands where no place is given, in radii of the scene; None for lights that
            have no place.
    """

    make: Callable[[LightStand], Light]
    distance: float | None


def _sun(stand: LightStand) -> Light:
    # Without a place there is no falling off.
    return DirectionalLight.create(stand.axis, stand.color / stand.reach**2, stand.dtype)


def _spot(stand: LightStand) -> Light:
    # The cone that just holds the sphere around the scene, and a little more.
    half_angle = math.asin(min(stand.radius / stand.reach, 0.95)) if stand.reach > 0 else 1.0
    return SpotLight.create(stand.place, stand.axis, min(1.08 * half_angle, 1.4), stand.color, stand.dtype)


def _point(stand: LightStand) -> Light:
    return PointLight.create(stand.place, stand.color, stand.dtype)


LIGHTS: dict[str, LightKind] = {
    "directional": LightKind(_sun, None),
    "spot": LightKind(_spot, 3.0),
    "point": LightKind(_point, 1.3),
}

__all__ = ["LIGHTS", "LightKind", "LightStand"]
