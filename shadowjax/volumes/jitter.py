"""A light of some size as several lights without any: positions spread over a disc that faces the scene."""

import math

import jax.numpy as jnp

from shadowjax._checked import checked
from shadowjax._checks import require_int
from shadowjax._types import Array, Float, Scalar, Vector3
from shadowjax.geometry.light import Light

GOLDEN_ANGLE = math.pi * (3 - math.sqrt(5))


@checked
def disc(num: int) -> Float[Array, "num 2"]:
    """Points spread evenly over the unit disc, each standing for an equal part of its area (Vogel's spiral)."""
    index = jnp.arange(require_int(num, "num_lights", 1), dtype=float)
    # Radius √(i/n) gives rings of equal area; the golden angle never aligns neighbours.
    radius, angle = jnp.sqrt((index + 0.5) / num), index * GOLDEN_ANGLE
    return jnp.stack([radius * jnp.cos(angle), radius * jnp.sin(angle)], axis=-1)


@checked
def jittered(light: Light, radius: Scalar, num: int, towards: Vector3) -> tuple[Light, ...]:
    """Lights that together stand for one of some size.

    Args:
        light: The light in the middle.
        radius: Of the disc: world units; for a directional light the tangent of the angle it spans from its middle.
        num: Lights, ≥ 1.
        towards: World point that the disc faces.

    Source: stencil, section 5.1, which moves the light a little for every picture that it accumulates.
    """
    return light.moved(disc(num).astype(towards.dtype) * radius, towards)
