"""Where to cut the view in depth from the depths that the camera sees: tight range, equal pixels, gaps left out."""

import jax
import jax.numpy as jnp

from shadowjax._checked import checked
from shadowjax._checks import require_choice, require_int
from shadowjax._types import Array, Bool, Float, Scalar
from shadowjax.geometry.camera import Camera
from shadowjax.geometry.mesh import Mesh
from shadowjax.rays.caster import Caster
from shadowjax.rays.ray_grid import camera_grid

SEEN_RULES = ("seen", "quantile", "histogram")
NUM_BINS = 256  # of the histogram, equal in ln z


@checked
def seen_depths(
    mesh: Mesh, camera: Camera, caster: Caster, num_rows: int
) -> tuple[Float[Array, "rows cols"], Bool[Array, "rows cols"]]:
    """The camera's depth buffer, z along the view direction, and where it sees a surface between its planes.

    Args:
        mesh: The scene.
        camera: The view.
        caster: Traces the camera's rays.
        num_rows: Rows of the image; columns follow from the least that keep pixels no wider than high at aspect 2.

    Returns:
        Depths in world units, clipped to [near, far], and the mask of pixels that see something there.
    """
    grid = camera_grid(camera, 2 * num_rows, num_rows)
    hit = caster.closest_on_grid(mesh, grid)
    depth = camera.to_view(grid.rays().at(jnp.where(hit.is_hit, hit.depth, jnp.zeros_like(hit.depth))))[..., 2]
    seen = hit.is_hit & (depth >= camera.near) & (depth <= camera.far)
    return jax.lax.stop_gradient(jnp.clip(depth, camera.near, camera.far)), seen


@checked
def seen_range(
    depth: Float[Array, "..."], seen: Bool[Array, "..."], near: Scalar, far: Scalar, margin: float = 0.0
) -> tuple[Scalar, Scalar]:
    """Smallest and largest depth that is seen, or the whole range where nothing is.

    Args:
        depth: z of every pixel, world units.
        seen: Pixels that count.
        near: Depth of the camera's near plane, the least that comes back.
        far: Depth of its far plane.
        margin: Factor − 1 by which the range is widened at both ends: what a coarse depth buffer may have missed.
    """
    low = jnp.min(jnp.where(seen, depth, far)) / (1 + margin)
    high = jnp.max(jnp.where(seen, depth, near)) * (1 + margin)
    # The margin must not leave the camera's range. A single depth is no range: slices of it would have no length.
    low, high = jnp.maximum(low, near), jnp.minimum(high, far)
    some = jnp.any(seen) & (high > low * (1 + 1e-3))
    return jnp.where(some, low, near), jnp.where(some, high, far)


@checked
def seen_splits(
    depth: Float[Array, "..."],
    seen: Bool[Array, "..."],
    near: Scalar,
    far: Scalar,
    num_partitions: int,
    rule: str = "seen",
    margin: float = 0.0,
) -> Float[Array, "planes"]:
    """Planes between k slices of the range of depths that a camera sees.

    Cuts are chosen from a histogram of ln z and are static: they carry no gradient. A slice keeps at least a fifth of
    its equal share of ln z, so planes always rise and no map is squeezed to nothing.

    Args:
        depth: z of every pixel, world units.
        seen: Pixels that count.
        near: Depth of the camera's near plane, world units.
        far: Depth of its far plane.
        num_partitions: k ≥ 1.
        rule: "seen", equal ratios over the tight range; "quantile", equally many pixels a slice; "histogram", equally
            many occupied bins of ln z a slice, so equal ratios that leave out depths at which nothing is seen.
        margin: Widening of the range, see `seen_range`.

    Returns:
        k + 1 planes.

    Raises:
        ValueError: If k or the rule is not one of those.

    Source: the tight range and cuts of sample distribution shadow maps; warping, eq. 50, over that range.
    """
    k = require_int(num_partitions, "the number of partitions k", 1)
    require_choice(rule, "rule", SEEN_RULES)
    low, high = seen_range(depth, seen, near, far, margin)
    span = jnp.log(high / low)
    equal = jnp.arange(k + 1, dtype=span.dtype) / k
    if rule == "seen" or k == 1:
        return _planes(equal, low, high, span)
    # Histogram over equal steps of ln z, and its running sum from 0 to 1.
    place = jnp.log(depth / low) / span
    index = jnp.clip((place * NUM_BINS).astype(jnp.int32), 0, NUM_BINS - 1).reshape(-1)
    count = jnp.zeros(NUM_BINS, span.dtype).at[index].add(seen.reshape(-1).astype(span.dtype))
    weight = count if rule == "quantile" else (count > 0).astype(span.dtype)
    filled = jnp.concatenate([jnp.zeros(1, span.dtype), jnp.cumsum(weight)])
    filled = jnp.where(filled[-1] > 0, filled / jnp.maximum(filled[-1], 1), jnp.linspace(0, 1, NUM_BINS + 1))
    # an infinitesimal slope where nothing is seen makes the inverse of the cumulative share unique
    filled = (filled + 1e-6 * jnp.linspace(0, 1, NUM_BINS + 1, dtype=span.dtype)) / (1 + 1e-6)
    # The inverse of the cumulative share at i/k: equal weight between neighbouring cuts.
    cuts = jnp.interp(equal, filled, jnp.linspace(0, 1, NUM_BINS + 1, dtype=span.dtype))
    return _planes(jax.lax.stop_gradient(_spread(cuts, 0.2 / k)), low, high, span)


def _spread(cuts: Float[Array, "planes"], least: float) -> Float[Array, "planes"]:
    """Cuts of [0, 1] mixed with equal ones just enough that every share is at least `least`."""
    k = cuts.shape[0] - 1
    smallest = jnp.min(jnp.diff(cuts))
    # (1 − m)·smallest + m/k = least, solved for m: the least mixing that keeps every share.
    mix = jnp.clip((least - smallest) / jnp.maximum(1 / k - smallest, 1e-9), 0, 1)
    return cuts + mix * (jnp.arange(k + 1, dtype=cuts.dtype) / k - cuts)


def _planes(shares: Float[Array, "planes"], low: Scalar, high: Scalar, span: Scalar) -> Float[Array, "planes"]:
    return (low * jnp.exp(span * shares)).at[0].set(low).at[-1].set(high)


__all__ = ["NUM_BINS", "SEEN_RULES", "seen_depths", "seen_range", "seen_splits"]
