"""Depth where rays graze triangles, in 32 bits: against planes in 64 bits, and with the triangles that Embree chooses.

The reference takes vertices and rays exactly as they are in 32 bits, and shares no formula with the package.
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
import trimesh

from shadowjax import DirectionalLight, Hit, Mesh, Rays, SpotLight, intersect
from shadowjax.rays.casters import CASTERS, make_caster
from shadowjax.rays.plane_map import Box
from shadowjax.rays.ray_grid import RayGrid

SIDE, SHARE = 256, 16
cast_rays = eqx.filter_jit(lambda caster, mesh, rays: caster.closest(mesh, rays))
cast_grid = eqx.filter_jit(lambda caster, mesh, grid: caster.closest_on_grid(mesh, grid))
drawn = eqx.filter_jit(lambda caster, mesh, grid: caster.depth_on_grid(mesh, grid))


def on_planes(corners: np.ndarray, origins: np.ndarray, directions: np.ndarray) -> tuple[np.ndarray, ...]:
    """Depth of the plane of each ray's triangle, cosine between ray and plane's normal, least barycentric: 64 bits."""
    corners, origins, directions = (np.asarray(x, np.float64) for x in (corners, origins, directions))
    a, one, two = corners[:, 0], corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    normal = np.cross(one, two)
    depth = np.sum(normal * (a - origins), axis=1) / np.sum(normal * directions, axis=1)
    cosine = np.abs(np.sum(normal * directions, axis=1)) / np.linalg.norm(normal, axis=1)
    point = origins + depth[:, None] * directions
    turns = [
        np.sum(np.cross(corners[:, k - 2] - corners[:, k], point - corners[:, k]) * normal, axis=1) for k in range(3)
    ]
    return depth, cosine, np.min(turns, axis=0) / np.sum(normal * normal, axis=1)


def test_needles_at_grazing_incidence():
    """Triangles to a thousandth as thin as long, met at a thousandth to a tenth of a right angle."""
    rng = np.random.default_rng(3)
    num = 4000
    start, along = rng.uniform(-1, 1, (num, 3)), rng.normal(size=(num, 3))
    across = np.cross(along, rng.normal(size=(num, 3)))
    width = 10 ** rng.uniform(-3, 0, (num, 1))
    third = start + rng.uniform(0, 1, (num, 1)) * along + width * across / np.linalg.norm(across, axis=1, keepdims=True)
    corners = np.stack([start, start + along, third], axis=1).astype(np.float32)
    inside = np.einsum("nk,nkd->nd", 0.1 + 0.7 * rng.dirichlet([1, 1, 1], num), corners.astype(float))
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]).astype(float)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    flat = np.cross(normal, rng.normal(size=(num, 3)))
    direction = flat / np.linalg.norm(flat, axis=1, keepdims=True) + 10 ** rng.uniform(-3, -1, (num, 1)) * normal
    origins = inside - rng.uniform(1, 3, (num, 1)) * direction
    rays = Rays.create(jnp.asarray(origins, jnp.float32), jnp.asarray(direction, jnp.float32))
    mesh = Mesh.create(corners.reshape(-1, 3), np.arange(3 * num).reshape(-1, 3), dtype=jnp.float32)
    hit = intersect(mesh, rays, jnp.arange(num, dtype=jnp.int32))
    depth, cosine, least = on_planes(corners, rays.origins, rays.directions)
    # In 32 bits a ray may pass next to a needle that it was aimed at.
    counts = least > 0
    assert counts.mean() > 0.7
    assert np.quantile(cosine[counts], 0.5) < 0.02
    error = np.abs(np.asarray(hit.depth, float) - depth)[counts] / float(mesh.extent)
    print(f"needles: {counts.sum()} rays, most {error.max():.1e} of the extent")
    assert error.max() <= 1e-6


def machined(teeth: int = 40) -> Mesh:
    """A gear with a bore over the ground, cut as CAD programs do: long thin triangles from rim to bore."""
    angle = np.linspace(0, 2 * np.pi, 4 * teeth, endpoint=False)
    radius = np.where(np.arange(4 * teeth) % 4 < 2, 1.0, 0.85)
    ring = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    profile = np.concatenate([radius[:, None] * ring, 0.2 * ring])
    count = len(angle)
    corners = np.concatenate([np.insert(profile, 1, height, axis=1) for height in (0.0, 0.15)])
    here, after = np.arange(count), (np.arange(count) + 1) % count
    rim, bore, up = 0, count, 2 * count
    walls = [(here + part, after + part, here + part + up, after + part + up) for part in (rim, bore)]
    lids = [(here + rim + level, after + rim + level, here + bore + level, after + bore + level) for level in (0, up)]
    faces = [np.stack(pick, axis=1) for a, b, c, d in walls + lids for pick in ((a, b, c), (b, d, c))]
    ground = np.array([[-3, -0.01, -3], [3, -0.01, -3], [3, -0.01, 3], [-3, -0.01, 3]])
    faces.append(len(corners) + np.array([[0, 2, 1], [0, 3, 2]]))
    return Mesh.create(np.concatenate([corners, ground]), np.concatenate(faces), dtype=jnp.float32)


def view(mesh: Mesh, kind: str, elevation: float) -> RayGrid:
    """Rays of a low sun, or of a low lamp, at the gear."""
    towards = np.array([np.cos(0.4) * np.cos(elevation), np.sin(elevation), np.sin(0.4) * np.cos(elevation)])
    light = DirectionalLight.create(-towards, dtype=jnp.float32)
    if kind == "spot":
        light = SpotLight.create(3 * towards, -towards, 0.7, 20.0, dtype=jnp.float32)
    lower, upper = mesh.bounds()
    space = light.space(jnp.asarray([0.0, 1.0, 0.0], jnp.float32), lower, upper)
    middle = space.project(jnp.zeros(3, jnp.float32))[0]
    # What a low sun sees is flat.
    size = jnp.asarray([1.2, 0.16] if kind == "directional" else [0.06, 0.06], jnp.float32)
    return RayGrid(space, Box(middle - size, middle + size), space.farthest(lower, upper), SIDE, SIDE)


@pytest.mark.parametrize("kind", ["directional", "spot"])
def test_faces_of_a_machined_part_under_a_low_light(kind):
    """Every caster has the depth of the plane of its triangle, and Embree's where the triangle is the same one.

    So has the grid where it draws depth itself, though it knows the triangles' planes in 32 bits alone.
    """
    mesh = machined()
    corners, extent = np.asarray(mesh.triangles(), float), float(mesh.extent)
    body = trimesh.Trimesh(np.asarray(mesh.vertices, float), np.asarray(mesh.faces), process=False)
    grid = view(mesh, kind, 0.03)
    hit = cast_grid(make_caster("grid"), mesh, grid)
    rays = grid.rays().flattened()
    some = Rays(rays.origins[::SHARE], rays.directions[::SHARE], rays.t_min[::SHARE], rays.t_max[::SHARE])
    found = {name: (cast_rays(make_caster(name), mesh, some), some) for name in CASTERS}
    found["map"] = hit, rays
    found["drawn map"] = Hit(drawn(make_caster("grid"), mesh, grid), hit.face, hit.barycentrics), rays
    for name, (hits, given) in found.items():
        face, depth = np.asarray(hits.face).reshape(-1), np.asarray(hits.depth, float).reshape(-1)
        origins, directions = (np.asarray(x, float).reshape(-1, 3) for x in (given.origins, given.directions))
        plane, cosine, least = on_planes(corners[face], origins, directions)
        counts = (face >= 0) & (least >= 0)
        assert np.sum(counts & (cosine < 0.05)) > 200, np.quantile(cosine[counts], [0, 0.1, 0.5])
        error = np.abs(depth - plane)[counts] / extent
        print(f"{name}, {kind}: {counts.sum()} rays, most {error.max():.1e} of the extent")
        assert error.max() <= 1e-6
        same = counts & (body.ray.intersects_first(origins, directions) == face)
        assert same.mean() > 0.99 * counts.mean()
