"""Depth maps of ideal occluders (half-planes, strips, one texel), and the texels where a policy sees their edges."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float
from scipy import ndimage

from shadowjax._types import Array
from shadowjax.filters import multi_depth

NEAR, FAR = 1.0, 2.0
MARGIN = 4  # texels along the border that are not judged: there the edge texel repeats

Maps = Float[np.ndarray, "maps rows cols"]
Mask = Bool[np.ndarray, "*maps rows cols"]


@dataclass(frozen=True)
class Policy:
    """A way to choose a texel's extra depths, and where it can see an edge.

    Attributes:
        planes: From a map and a random key to the n planes; the package's own function.
        side: "near": only occluder texels can see a deeper neighbour. "far": only texels behind it can see a nearer
            one. "both": either.
    """

    planes: Callable[[Array, Array], Array]
    side: str = "both"


def _ring(num_depths: int, radius: int = 1) -> Policy:
    return Policy(lambda depth, key: multi_depth.ring(depth, num_depths, radius))


POLICIES: dict[str, Policy] = {
    "fixed": Policy(lambda depth, key: multi_depth.fixed_neighbour(depth, (0, 1))),
    "stochastic": Policy(multi_depth.stochastic_neighbour),
    "2-SM max": Policy(lambda depth, key: multi_depth.max_neighbour(depth), "near"),
    "2-SM min": Policy(lambda depth, key: multi_depth.min_neighbour(depth), "far"),
    "3-SM min/max": Policy(lambda depth, key: multi_depth.min_max_neighbours(depth)),
    "4-SM ring": _ring(4),
    "5-SM ring": _ring(5),
    "6-SM ring": _ring(6),
    "9-SM ring": _ring(9),
    "4-SM ring, radius 2": _ring(4, 2),
}


def occluder_maps(size: int, angle_deg: float, offsets: np.ndarray, strip_width: float | None = None) -> Maps:
    """Texels whose centres lie behind a straight edge (or inside a strip) are NEAR, all others FAR.

    Args:
        size: Texels along each side of the map.
        angle_deg: Direction of the edge, degrees from the rows of the map.
        offsets: How far the edge (or the middle of the strip) lies from the middle of the map, texels.
        strip_width: Texels; None for a half-plane.
    """
    centre = np.arange(size) + 0.5 - size / 2
    y, x = np.meshgrid(centre, centre, indexing="ij")
    # Rounded, so that a texel's centre on an edge along an axis falls to the same side everywhere.
    cosine, sine = np.round([np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg))], 12)
    distance = cosine * y - sine * x - np.reshape(offsets, (-1, 1, 1))
    low, high = (-np.inf, 0.0) if strip_width is None else (-strip_width / 2, strip_width / 2)
    covered = (low <= distance) & (distance < high)
    return np.where(covered, NEAR, FAR).astype(np.float32)


def lone_texel(size: int) -> Maps:
    """One NEAR texel in the middle of a FAR map."""
    result = np.full((1, size, size), FAR, np.float32)
    result[0, size // 2, size // 2] = NEAR
    return result


def edge_texels(maps: Maps, side: str) -> Mask:
    """Texels that have one of the other kind among their 8 neighbours, on one side of the edge or on both."""
    near = maps < (NEAR + FAR) / 2
    differs = differing_share(maps) > 0
    inner, outer = near & differs, ~near & differs
    chosen = {"near": inner, "far": outer, "both": inner | outer}[side].copy()
    for edge in (np.s_[:, :MARGIN], np.s_[:, -MARGIN:], np.s_[:, :, :MARGIN], np.s_[:, :, -MARGIN:]):
        chosen[edge] = False
    return chosen


@partial(jax.jit, static_argnums=0)
def _differ(planes: Callable[[Array, Array], Array], maps: Array, keys: Array) -> Array:
    stacks = jax.vmap(planes)(maps, keys)
    return stacks.max(axis=1) != stacks.min(axis=1)


def detected(policy: Policy, maps: Maps, seed: int = 0) -> Mask:
    """Texels whose n depths are not all equal: where a composite test can give a tone between lit and dark."""
    keys = jax.random.split(jax.random.key(seed), maps.shape[0])
    return np.asarray(_differ(policy.planes, jnp.asarray(maps), keys))


def differing_share(maps: Maps) -> Float[np.ndarray, "maps rows cols"]:
    """Share of each texel's 8 neighbours that are of the other kind."""
    near = (maps < (NEAR + FAR) / 2).astype(float)
    count = ndimage.convolve(near, np.ones((1, 3, 3)), mode="nearest")
    return np.where(near > 0, 9 - count, count) / 8
