"""What of a mesh lies on the rays of a map, and the grid of rays that starts and ends just outside that."""

import jax
import jax.numpy as jnp

from shadowjax._checked import checked
from shadowjax._numerics import dot, map_in_chunks, norm, rotate, safe_divide
from shadowjax._types import Array, Bool, Float, Vector3
from shadowjax.geometry.camera import Camera
from shadowjax.geometry.light import Light
from shadowjax.geometry.light_space import LightSpace
from shadowjax.geometry.mesh import Mesh
from shadowjax.rays.plane_map import PlaneMap, region_corners, region_sides
from shadowjax.rays.ray_grid import RayGrid

# Triangles that are cut at a time.
CHUNK = 1 << 16
# The region is taken this much wider: what touches its border counts, however the border is rounded.
WIDER = 1.01
# How far rounding may put a point of a triangle, in roundings of the triangle's farthest corner.
CUT_ROUNDINGS = 8.0
# A point counts if it lies outside by this share of the numbers that say so.
SLACK = 1e-5

Corners = Float[Array, "faces 3 3"]


@checked
def seen_space(light: Light, mesh: Mesh, camera: Camera) -> LightSpace:
    """The rays of a light, with places on its plane counted from where the camera stands in the scene.

    Numbers keep the most digits near their origin, and what is near the camera needs them. Depth is counted from there
    too, and is negative towards the light; `starting_outside` moves the start of the rays.

    Args:
        light: Any light of the package.
        mesh: Everything that casts or receives.
        camera: The view.
    """
    lower, upper = mesh.bounds()
    # Where places are counted from decides roundings alone: the rays do not move with it, so it has no derivative.
    start = jax.lax.stop_gradient(jnp.clip(camera.position, lower, upper))
    return light.space(camera.forward, lower, upper).counted_from(start)


@checked
def starting_outside(space: LightSpace, plane_map: PlaneMap, mesh: Mesh, resolution: int) -> RayGrid:
    """The grid of a map whose rays start before all that lies on them, and end beyond it.

    Depths are then as small as the scene lets them be: neither a wide ground around the map's region nor the place of
    the scene in the world costs them digits, and filters that map depths to [0, 1] spend that range on them.

    Args:
        space: The light's rays. Those of a directional light get a new start on their own lines.
        plane_map: Where the map lies on the light's plane.
        mesh: Everything that casts or receives.
        resolution: Texels along each side.
    """
    return grid_around(space, plane_map, *part_on_map(space, plane_map, mesh), resolution)


@checked
def grid_around(space: LightSpace, plane_map: PlaneMap, lower: Vector3, upper: Vector3, resolution: int) -> RayGrid:
    """The grid of a map whose rays start before a box and end beyond it; see `starting_outside`.

    Args:
        space: The light's rays. Those of a directional light get a new start on their own lines.
        plane_map: Where the map lies on the light's plane.
        lower: Lower corner of the box, as an offset from the space's `source`, world units.
        upper: Upper corner of the box, likewise.
        resolution: Texels along each side.
    """
    if space.is_parallel:
        # As `DirectionalLight.space` starts the rays of a scene: outside the sphere around it, a hundredth of it
        # away; and by what the rounding of the starts may move them.
        rounding = CUT_ROUNDINGS * jnp.finfo(lower.dtype).eps * jnp.sum(jnp.abs(space.source))
        towards = -space.rows[2]
        # Half the diagonal, and a hundredth of that, before the box's middle.
        ahead = dot(0.5 * (lower + upper), towards) + 0.505 * norm(upper - lower) + rounding
        start = space.source + ahead * towards
        lower, upper = (corner - (start - space.source) for corner in (lower, upper))
        space = space.counted_from(start)
    return RayGrid(space, plane_map, space.beyond(lower, upper), resolution, resolution)


@checked
def part_on_map(space: LightSpace, plane_map: PlaneMap, mesh: Mesh) -> tuple[Vector3, Vector3]:
    """Lower and upper corner of a box around all of a mesh that lies on the rays of a map.

    Triangles are cut to the region of the map, so of a wide ground only what is under the map counts. A map whose rays
    bend lines, and one under which nothing lies, gets the box around the mesh.

    Args:
        space: The light's rays.
        plane_map: Where the map lies on the light's plane.
        mesh: Any mesh.

    Returns:
        Corners as offsets from the space's `source`, world units.
    """
    everything = tuple(corner - space.source for corner in mesh.bounds())
    if not space.is_projective:
        return everything[0], everything[1]
    border = region_corners(plane_map, mesh.vertices.dtype)
    middle = jnp.mean(border, axis=0)
    border = middle + WIDER * (border - middle)
    sides = region_sides(border)

    def bounds(triangles: Corners) -> tuple[Float[Array, "faces 3"], Float[Array, "faces 3"], Bool[Array, "faces"]]:
        return _cut(space, border, sides, triangles)

    lower, upper, some = map_in_chunks(bounds, mesh.triangles(), CHUNK)
    far_off = jnp.finfo(lower.dtype).max
    cut = jnp.min(jnp.where(some[:, None], lower, far_off), 0), jnp.max(jnp.where(some[:, None], upper, -far_off), 0)
    found = jnp.any(some)
    # Rounding does not reach beyond the mesh.
    return (
        jnp.where(found, jnp.maximum(cut[0], everything[0]), everything[0]),
        jnp.where(found, jnp.minimum(cut[1], everything[1]), everything[1]),
    )


def _cut(
    space: LightSpace,
    border: Float[Array, "4 2"],
    sides: Float[Array, "4 3"],
    triangles: Corners,
) -> tuple[Float[Array, "faces 3"], Float[Array, "faces 3"], Bool[Array, "faces"]]:
    """Box of the part of each triangle inside a region, as offsets, and whether there is any.

    The part is a polygon. Its corners are corners of the triangle, places where its edges cross a side of the region,
    and places where rays through the region's corners cross the triangle.
    """
    offset = triangles - space.source
    # (x, y, w) of places at (x/w, y/w) on the plane
    place = rotate(offset, space.rows)
    if space.is_parallel:
        place = place.at[..., 2].set(1.0)

    def inside(place: Float[Array, "*points 3"]) -> Bool[Array, "*points"]:
        # Compared with the sum of magnitudes, of which rounding is a share.
        size = jnp.abs(place) @ jnp.abs(sides).T
        return jnp.all(place @ sides.T >= -SLACK * size, axis=-1)

    # edges on sides: (faces, edge, side, 3)
    # Homogeneous distances a·x + b·y + c·w: positive inside, without dividing by w.
    value = place @ sides.T
    begin, end = value, jnp.roll(value, -1, axis=1)
    share = safe_divide(begin, begin - end)[..., None]
    crosses = ((begin < 0) != (end < 0)) & (share[..., 0] >= 0) & (share[..., 0] <= 1)

    def along(corners: Corners) -> Float[Array, "faces 3 4 3"]:
        return corners[:, :, None] + share * (jnp.roll(corners, -1, axis=1) - corners)[:, :, None]

    crossing = along(offset)
    crosses &= inside(along(place))
    # rays through the region's corners: (faces, corner, 3)
    rays = jnp.concatenate([border, jnp.ones_like(border[:, :1])], axis=-1)
    first, second, third = (place[:, k] for k in range(3))
    # A ray (u, v, 1) meets the triangle where all three tetrahedra that it spans with pairs of corners have the sign of
    # the triangle's own; their shares are barycentrics.
    weights = jnp.stack(
        [jnp.cross(*pair) @ rays.T for pair in ((second, third), (third, first), (first, second))], axis=-1
    )
    volume = dot(first, jnp.cross(second, third))
    weights = weights * jnp.sign(volume)[:, None, None]
    total = jnp.sum(weights, axis=-1)
    meets = (volume != 0)[:, None] & (total > 0) & jnp.all(weights >= -SLACK * total[..., None], axis=-1)
    meeting = safe_divide(jnp.einsum("fck,fkx->fcx", weights, offset), total[..., None])
    rounding = CUT_ROUNDINGS * jnp.finfo(offset.dtype).eps * jnp.max(jnp.abs(offset), axis=(1, 2))[:, None, None]
    faces = len(triangles)
    found = [(offset, inside(place), jnp.zeros_like(rounding))]
    found += [(crossing.reshape(faces, -1, 3), crosses.reshape(faces, -1), rounding), (meeting, meets, rounding)]
    far_off = jnp.finfo(offset.dtype).max
    lower = [jnp.min(jnp.where(is_in[..., None], at - off, far_off), axis=1) for at, is_in, off in found]
    upper = [jnp.max(jnp.where(is_in[..., None], at + off, -far_off), axis=1) for at, is_in, off in found]
    some = jnp.any(jnp.concatenate([is_in for _, is_in, _ in found], axis=1), axis=1)
    return jnp.min(jnp.stack(lower), axis=0), jnp.max(jnp.stack(upper), axis=0), some


__all__ = ["grid_around", "part_on_map", "seen_space", "starting_outside"]
