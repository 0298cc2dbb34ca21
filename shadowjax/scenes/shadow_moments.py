"""Area and centroid of shadows on a plane in closed form: oracles for gradients that see shadows' edges."""

from typing import NamedTuple

import jax.numpy as jnp

from shadowjax._checked import checked
from shadowjax._numerics import safe_divide
from shadowjax._types import Array, Float, Scalar, Vector2, Vector3
from shadowjax.geometry.light import Light
from shadowjax.scenes.closed_forms import Points2, Polygon, ReceivingPlane, project, sphere_shadow
from shadowjax.scenes.polygons import outer_pieces


class ShadowMoments(NamedTuple):
    """Size and place of a shadow.

    Attributes:
        area: Square metres.
        centroid: (u, v) on the plane.
    """

    area: Scalar
    centroid: Vector2


@checked
def border_moments(start: Points2, along: Points2) -> ShadowMoments:
    """Of the region that pieces of its border enclose, counter-clockwise and in any order; by Green's theorem.

    Args:
        start: Where each straight piece begins.
        along: From there to its end.
    """
    end = start + along
    area = 0.5 * jnp.sum(start[:, 0] * end[:, 1] - start[:, 1] * end[:, 0])
    # ∫u dA = ½∮u² dv, and over a straight piece ∫u² dv = Δv(u₀² + u₀u₁ + u₁²)/3; for v with the other sign.
    squares = start * start + start * end + end * end
    first = jnp.stack([jnp.sum(along[:, 1] * squares[:, 0]), -jnp.sum(along[:, 0] * squares[:, 1])]) / 6
    return ShadowMoments(area, safe_divide(first, jnp.stack([area, area])))


@checked
def polygon_moments(polygon: Polygon) -> ShadowMoments:
    """Of a simple polygon, whichever way it turns."""
    found = border_moments(polygon, jnp.roll(polygon, -1, axis=0) - polygon)
    return ShadowMoments(jnp.abs(found.area), found.centroid)


@checked
def union_moments(polygons: Float[Array, "shapes corners 2"]) -> ShadowMoments:
    """Of the union of convex polygons, no two of which share a stretch of an edge."""
    start, along, present = outer_pieces(polygons)
    along = jnp.where(present[:, None], along, jnp.zeros_like(along))
    return border_moments(jnp.where(present[:, None], start, jnp.zeros_like(start)), along)


@checked
def convex_moments(corners: Float[Array, "faces 3 2"]) -> ShadowMoments:
    """Of the image of a closed convex surface: each point of it lies in the images of two triangles.

    So half the sum over the triangles is the integral over the image, and it need not be known which edges bound it.

    Args:
        corners: (u, v) of the corners of every triangle.
    """
    one, two = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    areas = 0.5 * jnp.abs(one[:, 0] * two[:, 1] - one[:, 1] * two[:, 0])
    total = jnp.sum(areas)
    # Area times its middle for each triangle; the halves cancel in the centroid.
    first = jnp.sum(areas[:, None] * jnp.mean(corners, axis=1), axis=0)
    return ShadowMoments(0.5 * total, safe_divide(first, jnp.stack([total, total])))


@checked
def convex_shadow_moments(triangles: Float[Array, "faces 3 3"], light: Light, plane: ReceivingPlane) -> ShadowMoments:
    """Of the shadow of a closed convex body: a tetrahedron, a box, a faceted sphere.

    Args:
        triangles: World positions of the corners, between the light and the plane.
        light: On the lit side of the plane.
        plane: Receiver.
    """
    return convex_moments(project(triangles, light, plane))


@checked
def sphere_shadow_moments(centre: Vector3, radius: Scalar, light: Light, plane: ReceivingPlane) -> ShadowMoments:
    """Of a sphere's shadow, an ellipse; see `closed_forms.sphere_shadow`."""
    ellipse = sphere_shadow(centre, radius, light, plane)
    return ShadowMoments(ellipse.area, ellipse.centre)
