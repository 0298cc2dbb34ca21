"""Soft shadows: a technique accumulated over several places of its light."""

import dataclasses
from typing import Annotated

import equinox as eqx
import jax
import jax.numpy as jnp

from shadowjax._checks import (
    NOT_NEGATIVE,
    require,
    require_finite,
    require_int,
    require_value,
)
from shadowjax._types import Array, ArrayLike, Float, Points, Scalar, as_float_array
from shadowjax.geometry.camera import Camera
from shadowjax.geometry.light import Light
from shadowjax.geometry.mesh import Mesh
from shadowjax.maps.shadow_map import ShadowMap
from shadowjax.techniques.base import Shadows, Technique
from shadowjax.volumes.jitter import jittered


class JitteredLights(Technique):
    """Soft shadows: another technique's answers for several places of the light, accumulated.

    Attributes:
        technique: Runs once for every place.
        radius: Of the disc of places, world units; for a directional light the tangent of its angular radius. ≥ 0.
        num_lights: Places, ≥ 1: one tone more than that.

    Source: stencil, section 5.1.
    """

    technique: Technique
    radius: Annotated[Scalar, NOT_NEGATIVE]
    num_lights: int = eqx.field(static=True)

    @classmethod
    def create(cls, technique: Technique, radius: ArrayLike, num_lights: int = 16) -> "JitteredLights":
        """Accumulate `technique` over `num_lights` places of the light.

        Raises:
            ValueError: If the radius is negative or not finite, or there is no light.
        """
        size = require_finite(as_float_array(radius), "radius")
        size = require_value(size, size >= 0, "radius of a light must not be negative")
        return cls(technique, size, require_int(num_lights, "num_lights", 1))

    def build(self, mesh: Mesh, light: Light, camera: Camera) -> "AccumulatedShadows":
        """Build the technique for every place of the light."""
        lower, upper = mesh.bounds()
        radius = self.radius.astype(lower.dtype)
        lights = jittered(light, radius, self.num_lights, 0.5 * (lower + upper))
        return AccumulatedShadows(tuple(self.technique.build(mesh, one, camera) for one in lights))

    @property
    def num_tones(self) -> int | None:
        """One more than lights, if each gives two."""
        each = self.technique.num_tones
        return None if each is None else self.num_lights * (each - 1) + 1

    @property
    def num_planes(self) -> int | None:
        """The technique's: one place after the other."""
        return self.technique.num_planes

    @property
    def num_fetches(self) -> int | None:
        """The technique's, for every place."""
        each = self.technique.num_fetches
        return None if each is None else self.num_lights * each

    @property
    def num_maps(self) -> int | None:
        """The technique's, for every place."""
        each = self.technique.num_maps
        return None if each is None else self.num_lights * each

    @property
    def map_resolution(self) -> int | None:
        """The technique's."""
        return self.technique.map_resolution

    def resized(self, factor: float) -> "JitteredLights":
        """With the technique resized."""
        return dataclasses.replace(self, technique=self.technique.resized(factor))

    @property
    def parts(self) -> str:
        """Its own name and the technique's parts."""
        return f"{type(self).__name__}+{self.technique.parts}"


class AccumulatedShadows(Shadows):
    """The mean of several shadows.

    Attributes:
        shadows: One for each place of the light.
    """

    shadows: tuple[Shadows, ...]

    def __check_init__(self) -> None:
        require(len(self.shadows) > 0, "accumulated shadows need at least one light; got none")

    def visibility(self, points: Points, normals: Points) -> Float[Array, "*points"]:
        """Share of the places from which each point is lit."""
        # One after the other in a loop, so that many places are compiled as quickly as one.
        parts = [eqx.partition(one, eqx.is_array) for one in self.shadows]
        rest = parts[0][1]
        stacked = jax.tree.map(lambda *leaves: jnp.stack(leaves), *(arrays for arrays, _ in parts))
        values = jax.lax.map(lambda arrays: eqx.combine(arrays, rest).visibility(points, normals), stacked)
        return jnp.mean(values, axis=0)

    @property
    def map_bytes(self) -> int:
        """Bytes for one place after the other: the most that any needs."""
        return max(one.map_bytes for one in self.shadows)

    @property
    def texture_bytes(self) -> int:
        """As `map_bytes`."""
        return max(one.texture_bytes for one in self.shadows)

    @property
    def cast_maps(self) -> tuple[ShadowMap, ...]:
        """Those of every place."""
        return tuple(shadow_map for one in self.shadows for shadow_map in one.cast_maps)

    def volume_bytes(self, num_samples: int) -> int:
        """As `map_bytes`: every place clears the buffer."""
        return max(one.volume_bytes(num_samples) for one in self.shadows)

    @property
    def prefers_images(self) -> bool:
        """As the technique does."""
        return any(one.prefers_images for one in self.shadows)
