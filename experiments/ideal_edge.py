"""How far a filter reaches from a straight edge and what it leaves of small lit spots, measured on ideal maps."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np

from experiments.edge_maps import FAR, NEAR, occluder_maps
from shadowjax._types import Array
from shadowjax.filters.base import Filter, Lookup

SIZE = 24  # texels along each side of the map: more than twice what the filters reach
STEPS = 64  # receivers a texel


def edge_reach(filter_: Filter) -> float:
    """Largest distance from an edge along an axis of the map at which visibility differs from the hard test's, texels.

    Receivers stand every 1/64 texel on a line across the edge; the edge lies on a border of texels. The larger of both
    sides counts.
    """
    depth = occluder_maps(SIZE, 90.0, np.zeros(1))[0]
    x = (np.arange(SIZE * STEPS) + 0.5) / STEPS
    position = np.stack([x, np.full_like(x, SIZE / 2 + 0.25)], -1)
    values = np.asarray(_visibility(filter_, jnp.asarray(depth), jnp.asarray(position, jnp.float32)))
    away = np.abs(x - SIZE / 2)
    lit = depth[SIZE // 2, np.floor(x).astype(int)] > (NEAR + FAR) / 2
    inside = away < SIZE / 4
    return float(away[inside & (np.abs(values - lit) > 1e-4)].max(initial=0.0) + 0.5 / STEPS)


def spot_visibility(filter_: Filter, side: int) -> float:
    """Mean visibility over a square lit spot of `side` texels inside a shadow."""
    depth = np.full((SIZE, SIZE), NEAR, np.float32)
    first = (SIZE - side) // 2
    depth[first : first + side, first : first + side] = FAR
    # One grid of receivers, 4 × 4 a texel, for every side.
    line = (np.arange(SIZE * 4) + 0.5) / 4
    position = np.stack(np.meshgrid(line, line), -1)
    values = _visibility(filter_, jnp.asarray(depth), jnp.asarray(position, jnp.float32))
    spot = np.kron(depth > (NEAR + FAR) / 2, np.ones((4, 4), bool))
    return float(np.asarray(values)[spot].mean())


@partial(jax.jit, static_argnums=0)
def _visibility(filter_: Filter, depth: Array, position: Array) -> Array:
    one = jnp.ones((), jnp.float32)
    receiver = jnp.full(position.shape[:-1], (NEAR + FAR) / 2, jnp.float32)
    return filter_.visibility(filter_.prepare(depth), Lookup(position, receiver, jnp.zeros_like(one), one, "clamp"))
