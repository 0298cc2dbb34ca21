"""Storage of depth slices measured without the source's formulas: the worst errors of each slice's own matrix."""

from typing import Any

import jax.numpy as jnp
import numpy as np

from experiments.warped_views import measured_errors, views

ROWS = 2**20
LARGEST = 1e8  # n' over f of the matrix that stands for the uniform map


def measured_storage(near: Any, far: Any, phi_deg: float, near_distance: Any, num_depths: int = 33) -> np.ndarray:
    """M_x·M_z of slices with the light overhead, from errors at many depths of each.

    Args:
        near: Near planes, world units.
        far: Far planes, world units.
        phi_deg: Half the angle of view, degrees.
        near_distance: n' of each slice, world units; ∞ is the uniform map.
        num_depths: Depths of equal ratio from plane to plane.
    """
    near, far = (np.asarray(x, float)[..., None] for x in (near, far))
    depth = near * (far / near) ** np.linspace(0, 1, num_depths)
    depth[..., -1] = far[..., 0]
    at = np.minimum(np.asarray(near_distance, float)[..., None], LARGEST * far)
    across, along = measured_errors(views(near, far, phi_deg), jnp.asarray(at), depth, ROWS)
    return across.max(axis=-1) * along.max(axis=-1)


def equal_planes(near: float, far: float, num_partitions: int) -> np.ndarray:
    """k + 1 planes of equal ratio (warping, eq. 50)."""
    return near * (far / near) ** (np.arange(num_partitions + 1) / num_partitions)
