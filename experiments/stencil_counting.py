"""The stages of a frame of stencil shadows in their plainest form: which sides, how often they are crossed, the cap."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from shadowjax._numerics import dot, safe_divide
from shadowjax._types import Array, Bool, Float, Int, Vector3
from shadowjax.geometry.adjacent_edges import AdjacentEdges, find_adjacent_edges

Triangles = Float[Array, "triangles 3 3"]


def generate(
    planes: np.ndarray, polygons: list[np.ndarray], place: np.ndarray
) -> tuple[AdjacentEdges, Bool[np.ndarray, "polygons"]]:
    """First stage, on the host: polygons that face the light, and the sides of their group.

    Args:
        planes: (polygons, 4) plane of each, n·x + d.
        polygons: Corners of each.
        place: Of the light.
    """
    facing = planes[:, :3] @ place + planes[:, 3] > 0
    return find_adjacent_edges([polygons[i] for i in np.flatnonzero(facing)]), facing


@eqx.filter_jit
def count_crossings(
    eye: Vector3,
    points: Float[Array, "points 3"],
    light: Vector3,
    sides: Float[Array, "sides 2 3"],
    times: Int[Array, "sides"],
    num_sides: Int[Array, ""],
) -> tuple[Int[Array, "points"], Int[Array, "points"]]:
    """Rendering stage: shadow sides between the eye and each point, those entered minus those left, and all of them.

    A shadow side reaches from an edge away from the light without end. In barycentric coordinates of its plane about
    the light, X - L = α(a - L) + β(b - L), it is where α and β are not negative and α + β ≥ 1. Seen from the light the
    group that casts lies to the left of a → b, where (a - L) × (b - L) · (X - L) is negative.

    Args:
        eye: Where the lines of sight start.
        points: Where they end, on surfaces.
        light: Place of the light.
        sides: Ends a, b of each edge.
        times: How often a side is drawn: +1 along a → b, -1 along b → a; 0 is left out.
        num_sides: How many of the sides count; the others are not looked at.
    """

    def one(k: Array, totals: tuple[Array, Array]) -> tuple[Array, Array]:
        a, b = sides[k, 0] - light, sides[k, 1] - light
        normal = jnp.cross(a, b)
        at_eye, at_point = dot(normal, eye - light), (points - light) @ normal
        share = safe_divide(at_eye, at_eye - at_point)
        where = eye + share[:, None] * (points - eye) - light
        square = dot(normal, normal)
        alpha, beta = where @ jnp.cross(b, normal), where @ jnp.cross(normal, a)
        met = ((at_eye > 0) != (at_point > 0)) & (alpha >= 0) & (beta >= 0) & (alpha + beta >= square)
        signed = jnp.where(at_eye > 0, times[k], -times[k])
        return totals[0] + jnp.where(met, signed, 0), totals[1] + jnp.where(met, jnp.abs(times[k]), 0)

    zero = jnp.zeros(points.shape[0], jnp.int32)
    return jax.lax.fori_loop(0, num_sides, one, (zero, zero))


@eqx.filter_jit
def volumes_around(place: Vector3, light: Vector3, triangles: Triangles) -> Int[Array, ""]:
    """Capping stage: in how many shadow volumes a place lies, by the triangles facing the light between the two.

    What a cap adds where the near plane cuts the volumes: here the near plane is the eye itself.

    Args:
        place: The eye.
        light: Place of the light.
        triangles: All triangles; those that look away from the light are left out.
    """
    a, b, c = jnp.moveaxis(triangles, 1, 0)
    normal = jnp.cross(b - a, c - a)
    from_light, to_place = dot(normal, a - light), dot(normal, jnp.broadcast_to(place - light, normal.shape))
    share = safe_divide(from_light, to_place)
    where = light + share[:, None] * (place - light)
    inside = [dot(jnp.cross(q - p, where - p), normal) >= 0 for p, q in ((a, b), (b, c), (c, a))]
    between = (from_light < 0) & (share > 0) & (share < 1)
    return jnp.sum(inside[0] & inside[1] & inside[2] & between).astype(jnp.int32)
