"""First principles: frusta as 4×4 matrices, beams cut by planes, and the Jacobian of pixels to texels on real surfaces.

Nothing here uses a formula of the warping chapter: its formulas are checked against this.
"""

from typing import Annotated, NamedTuple

import jax
import jax.numpy as jnp

from shadowjax._checked import checked
from shadowjax._checks import MAY_BE_INFINITE
from shadowjax._numerics import dot, norm, normalize, safe_divide, singular_values
from shadowjax._types import Array, Float, Points, Vector3
from shadowjax.geometry.transforms import any_perpendicular
from shadowjax.rays.ray_grid import RayGrid
from shadowjax.theory.aliasing.light_frustum import LightFrustum, VirtualNear

Numbers = Float[Array, "..."]
Matrix4 = Float[Array, "4 4"]


@checked
def frustum_corners(frustum: LightFrustum) -> Float[Array, "8 3"]:
    """Corners of one camera frustum with the camera at 0, looking along z, y up."""
    signs = jnp.asarray([[-1, -1], [1, -1], [1, 1], [-1, 1]], frustum.near.dtype)
    half = signs * jnp.stack([frustum.tan_x, frustum.tan_y])
    plane = jnp.concatenate([half, jnp.ones((4, 1), half.dtype)], axis=1)
    return jnp.concatenate([frustum.near * plane, frustum.far * plane])


@checked
def light_axes(gamma: Float[Array, ""]) -> Float[Array, "3 3"]:
    """Rows x, y, z of light space for a light at the angle γ to the view along (0, 0, 1), leaning down from above.

    x is the camera's right at every γ, also where light and view are parallel and no plane holds both.
    """
    zero = jnp.zeros_like(gamma)
    one = zero + 1
    # the light travels along the view at γ = 0 and straight down at γ = π/2
    travel = jnp.stack([zero, -jnp.sin(gamma), jnp.cos(gamma)])
    right = jnp.stack([one, zero, zero])
    return jnp.stack([right, -travel, jnp.cross(right, -travel)])


@checked
def warp_matrix(
    frustum: LightFrustum,
    near_distance: Annotated[Float[Array, ""], MAY_BE_INFINITE],
    tan_x: Float[Array, ""] | None = None,
) -> Matrix4:
    """World to (s, ·, t) as one homogeneous matrix: light axes, projection centre, frustum matrix, bias to [0, 1].

    The smallest P of the given n' around the 8 corners, by looking at the corners; or one of a given opening tan φ'_x.
    """
    axes = light_axes(frustum.gamma)
    local = frustum_corners(frustum) @ axes.T
    lowest, highest = jnp.min(local[:, 2]), jnp.max(local[:, 2])
    shift = near_distance - lowest
    # z' counts from the projection centre: the lowest corner lies at n', the highest at f'.
    n, f = near_distance, highest + shift
    if tan_x is None:
        tan_x = jnp.max(jnp.abs(local[:, 0]) / (local[:, 2] + shift))
    zero, one = jnp.zeros_like(n), jnp.ones_like(n)
    view = jnp.eye(4, dtype=axes.dtype).at[:3, :3].set(axes).at[2, 3].set(shift)
    # Row t: (f'+n')/(f'−n') − 2f'n'/((f'−n')z'), from −1 at n' to 1 at f'; the last row divides by z'.
    project = jnp.stack(
        [
            jnp.stack([1 / tan_x, zero, zero, zero]),
            jnp.stack([zero, one, zero, zero]),
            jnp.stack([zero, zero, (f + n) / (f - n), -2 * f * n / (f - n)]),
            jnp.stack([zero, zero, one, zero]),
        ]
    )
    half = jnp.asarray([0.5, 0.5, 0.5, 1.0], axes.dtype)
    bias = jnp.diag(half).at[:3, 3].set(0.5)
    return bias @ project @ view


@checked
def warp_point(matrix: Matrix4, points: Points) -> Float[Array, "*points 2"]:
    """(s, t) of world points: homogeneous transform and divide."""
    moved = points @ matrix[:, :3].T + matrix[:, 3]
    return moved[..., :3:2] / moved[..., 3:]


class Beams(NamedTuple):
    """Two beams that meet on a line of flatland, the (z, y) plane; lengths in world units.

    Attributes:
        texel: Length of the surface inside the texel's beam.
        pixel: Length of the surface inside the pixel's beam.
        texel_width: Thickness of the texel's beam across the light.
        pixel_width: Thickness of the pixel's beam across the view ray, through the surface point.
        light_cosine: Cosine between the surface normal and the light.
        camera_cosine: Cosine between the surface normal and the view ray.
    """

    texel: Numbers
    pixel: Numbers
    texel_width: Numbers
    pixel_width: Numbers
    light_cosine: Numbers
    camera_cosine: Numbers

    @property
    def aliasing(self) -> Numbers:
        """m = w'_l/w'_c (warping, eq. 11)."""
        return self.texel / self.pixel

    @property
    def perspective(self) -> Numbers:
        """w_l/w_c, the perspective error (warping, eq. 14–15)."""
        return self.texel_width / self.pixel_width

    @property
    def approximation(self) -> Numbers:
        """(w_l/w_c)·(cos θ_c/cos θ_l) with true thicknesses (warping, eq. 12)."""
        return self.texel_width * self.camera_cosine / (self.pixel_width * self.light_cosine)


@checked
def pixel_cut(slope: Numbers, half_pixel: Numbers, depth: Numbers, angle: Numbers) -> Numbers:
    """Length that the two edge rays of a pixel cut from a line.

    Args:
        slope: y/z of the pixel's centre.
        half_pixel: Half its width on the image plane at distance 1.
        depth: Depth z at which the central ray meets the line.
        angle: Angle from the view axis to the line, radians.
    """
    sine, cosine = jnp.sin(angle), jnp.cos(angle)

    def position(edge: Numbers) -> Numbers:
        # (z, y) = (depth + l·cos, depth·slope + l·sin) lies on y = edge·z
        return depth * (edge - slope) / (sine - edge * cosine)

    return jnp.abs(position(slope + half_pixel) - position(slope - half_pixel))


@checked
def beams(
    frustum: LightFrustum,
    near_distance: VirtualNear,
    depth: Numbers,
    slope: Numbers,
    angle: Numbers,
    image_rows: Numbers,
    map_rows: Numbers,
) -> Beams:
    """Cut a line through a point by the beams of the pixel and the texel centred on the point.

    The texel's edges are found on the real map: t of the point from its matrix, ± half a texel, and back through the
    inverse matrix to two planes of constant z'.

    Args:
        frustum: One view and light.
        near_distance: n', world units.
        depth: Depth z of the point, world units.
        slope: y/z of the point, the tangent of its view angle.
        angle: Angle from the view axis to the line, radians.
        image_rows: Rows of the image.
        map_rows: Rows of the map.
    """
    matrix = warp_matrix(frustum, near_distance)
    unbent = jnp.linalg.inv(matrix)
    point = jnp.stack([jnp.zeros_like(depth), depth * slope, depth])
    st = warp_point(matrix, point)

    # z' of a texture coordinate through the inverse matrix: where the texel's edges lie in light space.
    def level(t: Numbers) -> Numbers:
        found = unbent @ jnp.stack([st[0], jnp.zeros_like(t), t, jnp.ones_like(t)])
        return dot(light_axes(frustum.gamma)[2], found[:3] / found[3])

    up = light_axes(frustum.gamma)[2]
    width = jnp.abs(level(st[1] + 0.5 / map_rows) - level(st[1] - 0.5 / map_rows))
    # Direction of the line in (z, y); its share along z' turns the texel's thickness into a length on it.
    sine, cosine = jnp.sin(angle), jnp.cos(angle)
    along = jnp.abs(up[1] * sine + up[2] * cosine)  # change of z' per length of the line
    view_angle = jnp.arctan(slope)
    half_pixel = frustum.tan_y / image_rows
    return Beams(
        texel=width / along,
        pixel=pixel_cut(slope, half_pixel, depth, angle),
        texel_width=width,
        pixel_width=pixel_cut(slope, half_pixel, depth, view_angle + jnp.pi / 2),
        light_cosine=along,
        camera_cosine=jnp.abs(jnp.sin(angle - view_angle)),
    )


@checked
def footprint(
    grid: RayGrid, positions: Float[Array, "*cells 2"], points: Points, normals: Points
) -> Float[Array, "*cells"]:
    """Area that the four corner rays of a grid cell cut from the plane through a point.

    Args:
        grid: The grid of a camera or of a map.
        positions: Cell centres, in cells.
        points: A world point of each plane.
        normals: Unit normals of the planes.

    Source: warping, w' of eq. 11.
    """
    offsets = jnp.asarray([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]], points.dtype)
    square = (positions[..., None, :] + offsets) / grid.resolution
    rays = grid.rays_at(square)
    facing = jnp.broadcast_to(normals[..., None, :], (*square.shape[:-1], 3))
    # Distance along each corner ray to the receiver's plane.
    reach = safe_divide(dot(points[..., None, :] - rays.origins, facing), dot(rays.directions, facing))
    corner = rays.origins + reach[..., None] * rays.directions
    # Half the cross product of the diagonals is the area of a flat quadrilateral.
    diagonals = corner[..., 2, :] - corner[..., 0, :], corner[..., 3, :] - corner[..., 1, :]
    return 0.5 * norm(jnp.cross(*diagonals))


class AliasingMap(NamedTuple):
    """Aliasing at points of surfaces, pixels per texel.

    Attributes:
        total: m by areas (eq. 11 in the limit of small beams): pixels that one texel decides.
        major: Pixels that a texel spans along its longest direction in the image.
        minor: Pixels that it spans along its shortest.
        projection: cos θ_c/cos θ_l, the share of `total` that comes from the surface's slope.
        perspective: total/projection, the share of warp and resolution.
    """

    total: Numbers
    major: Numbers
    minor: Numbers
    projection: Numbers
    perspective: Numbers


@checked
def aliasing_map(camera: RayGrid, shadow_map: RayGrid, points: Points, normals: Points) -> AliasingMap:
    """Aliasing of a real map at real surface points, by differentiating the two projections along the surface.

    Args:
        camera: Grid of the image.
        shadow_map: Grid of the map.
        points: World points on surfaces.
        normals: Unit normals there.
    """
    flat, facing = points.reshape(-1, 3), normals.reshape(-1, 3)

    def spans(point: Vector3, normal: Vector3) -> tuple[Array, Array]:
        # Two tangents span the surface; both projections are differentiated along them at once.
        first = any_perpendicular(normal)
        tangents = jnp.stack([first, jnp.cross(normal, first)])

        def places(move: Float[Array, "2"]) -> tuple[Array, Array]:
            moved = point + move @ tangents
            return camera.locate(moved)[0], shadow_map.locate(moved)[0]

        return jax.jacfwd(places)(jnp.zeros(2, point.dtype))

    pixels, texels = jax.vmap(spans)(flat, facing)
    area_pixel, area_texel = _det(pixels), _det(texels)
    total = safe_divide(jnp.abs(area_pixel), jnp.abs(area_texel))
    # Surface → texels inverted, then surface → pixels: the Jacobian from texels to pixels.
    inverse = safe_divide(_adjugate(texels), area_texel[:, None, None])
    turned = pixels @ inverse  # pixels per texel, as a matrix
    longest, shortest = singular_values(turned)
    to_eye, to_light = camera.space.to_source(flat), shadow_map.space.to_source(flat)
    cosines = jnp.abs(dot(normalize(to_eye), facing)), jnp.abs(dot(to_light, facing))
    projection = safe_divide(*cosines)
    perspective = safe_divide(total, projection)
    out = (total, longest, shortest, projection, perspective)
    return AliasingMap(*(x.reshape(points.shape[:-1]) for x in out))


def _det(matrix: Float[Array, "*batch 2 2"]) -> Float[Array, "*batch"]:
    return matrix[..., 0, 0] * matrix[..., 1, 1] - matrix[..., 0, 1] * matrix[..., 1, 0]


def _adjugate(matrix: Float[Array, "*batch 2 2"]) -> Float[Array, "*batch 2 2"]:
    (a, b), (c, d) = (matrix[..., 0, 0], matrix[..., 0, 1]), (matrix[..., 1, 0], matrix[..., 1, 1])
    return jnp.stack([jnp.stack([d, -b], axis=-1), jnp.stack([-c, a], axis=-1)], axis=-2)


__all__ = [
    "AliasingMap", "Beams", "aliasing_map", "beams", "footprint", "frustum_corners", "light_axes", "pixel_cut",
    "warp_matrix", "warp_point",
]  # fmt: skip
