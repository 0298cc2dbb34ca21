"""The reference caster: every ray against every triangle, in chunks that bound memory."""

from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp

from shadowjax._types import Array, Bool, Float, Int
from shadowjax.geometry.mesh import Mesh
from shadowjax.rays.caster import Caster, search_in_chunks
from shadowjax.rays.ray import (
    MISS,
    Hit,
    Rays,
    corners_in_order,
    depth_rounding,
    edge_test,
    intersect,
    orthonormal_frame,
)

# Triangles tested per loop iteration: enough to hide the loop, few enough to compile quickly.
UNROLL = 4


class BruteForceCaster(Caster):
    """Tests all pairs. Slow, simple, and what the other casters are checked against.

    Memory beyond inputs and outputs is about 100 numbers for each ray of a chunk, whatever rays × triangles.

    Attributes:
        ray_chunk: Rays worked on together.
    """

    ray_chunk: int = eqx.field(static=True, default=16384)

    def closest(self, mesh: Mesh, rays: Rays) -> Hit:
        """First hit of each ray; ties go to the lowest triangle index."""
        search = partial(_search, _padded(mesh), False)
        return intersect(mesh, rays, search_in_chunks(search, jax.lax.stop_gradient(rays), self.ray_chunk))

    def blocked(self, mesh: Mesh, rays: Rays) -> Bool[Array, "*points"]:
        """Whether a triangle lies on each ray, farther from both ends than its own rounding."""
        search = partial(_search, _padded(mesh), True)
        return search_in_chunks(search, jax.lax.stop_gradient(rays), self.ray_chunk) >= 0


def _padded(mesh: Mesh) -> Float[Array, "faces 3 3"]:
    """Triangles, and some with three equal corners, which the edge rule always misses, up to a multiple of `UNROLL`."""
    triangles = corners_in_order(jax.lax.stop_gradient(mesh.triangles()))
    padding = -triangles.shape[0] % UNROLL
    return jnp.concatenate([triangles, jnp.zeros((padding, 3, 3), triangles.dtype)])


@eqx.filter_jit
def _search(triangles: Float[Array, "faces 3 3"], between: bool, rays: Rays) -> Int[Array, "rays"]:
    """Index of the nearest triangle of every ray of one chunk; or of any that lies `between` the ray's ends."""
    # Rays as rows of coordinates, triangles as scalars: each loop step is one fused pass over contiguous rays.
    origin, direction = rays.origins.T, rays.directions.T
    # The ray's own frame: it runs along z through the origin of (x, y), as the edge rule needs.
    across, upward = (axis.T for axis in orthonormal_frame(rays.directions))

    def step(block: Int[Array, ""], best: tuple[Array, Array]) -> tuple[Array, Array]:
        nearest, face = best
        for k in range(UNROLL):
            index = block * UNROLL + k
            corners = triangles[index]
            x, y, z = [], [], []
            for corner in corners:
                offset = [corner[axis] - origin[axis] for axis in range(3)]
                for coordinate, unit in ((x, across), (y, upward), (z, direction)):
                    coordinate.append(offset[0] * unit[0] + offset[1] * unit[1] + offset[2] * unit[2])
            inside, depth = edge_test(tuple(x), tuple(y), tuple(z))
            if between:
                doubt = depth_rounding(tuple(x), tuple(y), tuple(z))
                better = inside & (depth - doubt > rays.t_min) & (depth + doubt < rays.t_max)
            else:
                # `>` on the current best keeps the lowest index among equals; NaN never compares true.
                better = inside & (depth >= rays.t_min) & (nearest > depth)
                nearest = jnp.where(better, depth, nearest)
            face = jnp.where(better, index, face)
        return nearest, face

    # A hit exactly at t_max counts: start one rounding beyond it.
    limit = jnp.nextafter(rays.t_max, jnp.full_like(rays.t_max, jnp.inf))
    none = jnp.full(rays.t_max.shape, MISS, jnp.int32)
    blocks = jnp.int32(triangles.shape[0] // UNROLL)
    return jax.lax.fori_loop(jnp.int32(0), blocks, step, (limit, none))[1]
