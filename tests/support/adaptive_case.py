"""One adaptive map that tests share, so that they share its compiled functions."""

import jax.numpy as jnp
import numpy as np
from shapes import above, lights, plate_over_plane

from shadowjax import BruteForceCaster, Mesh
from shadowjax.techniques.adaptive import AdaptiveShadowMapping

SETTINGS = {"tile_size": 8, "num_rows": 64, "max_level": 7, "texels_per_pixel": 4.0, "caster": BruteForceCaster()}


def technique(budget_bytes: int = 1 << 15, **options) -> AdaptiveShadowMapping:
    """Small tiles, few pixels."""
    return AdaptiveShadowMapping(budget_bytes=budget_bytes, **{**SETTINGS, **options})


def scene(dtype=jnp.float32):
    """Plate over floor under the directional light, turned so that no edge runs along the texels."""
    mesh = plate_over_plane(dtype)
    x, y, z = np.asarray(mesh.vertices).T
    turned = np.stack([x * np.cos(0.6) - z * np.sin(0.6), y, x * np.sin(0.6) + z * np.cos(0.6)], axis=-1)
    return Mesh(jnp.asarray(turned, dtype), mesh.faces, mesh.face_colors), lights(dtype)["directional"], above(dtype)
