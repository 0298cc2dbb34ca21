"""What every partition owes with every warp: maps of its own for each region, edges that move by a texel, and fewer
errors for more slices.

A row of plates over a floor, each as large as its distance, so that every octave of depth has edges of one size in the
image. Where the shadow of a plate ends is known in closed form, and what a map answers for a point of the floor is the
exact answer at the floor point of its texel's ray. So no map has to be cast, and resolutions may be large.
"""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from shadowjax import Camera, DirectionalLight, Mesh, PointLight, SpotLight
from shadowjax.evaluate.shimmer import in_view
from shadowjax.partitions.cascades import Cascades
from shadowjax.partitions.faces import FacePartition, faces_that_apply
from shadowjax.partitions.registry import PARTITIONS
from shadowjax.presets.names import make_technique
from shadowjax.warps.registry import WARP_FITS

DEPTHS = 1.6 * 1.6 ** np.arange(9)  # 1.6 to 69 metres
HEIGHTS, HALF = 0.03 * DEPTHS, 0.1 * DEPTHS
CENTRES = np.stack([0.18 * DEPTHS * (-1) ** np.arange(9), -DEPTHS], axis=-1)
CAMERA = Camera.look_at((0.0, 0.7, 0.0), (0.0, 0.45, -3.0), phi_y=0.5, near=0.8, far=80.0, aspect=1.2)
LIGHTS = {
    "sun": DirectionalLight.create((-0.3, -1.0, 0.2)),
    "evening": DirectionalLight.create((0.2, -0.5, -1.0)),
    "spot": SpotLight.create((6.0, 40.0, -25.0), (-0.1, -1.0, 0.05), 0.7),
}
RESOLUTIONS = (4096, 8192, 16384)  # fine enough for one even map to resolve the nearest plate
MOST = 4  # maps of a partition that is measured: fewer are repeated, so that all share one compiled function
ALONG, ACROSS = 40, 48


def deep_scene():
    """The floor and the plates."""
    floor = np.array([[-90, 0, -90], [90, 0, -90], [90, 0, 5], [-90, 0, 5]], float)
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    plates = CENTRES[:, None] + HALF[:, None, None] * corners
    plates = np.stack([plates[..., 0], np.broadcast_to(HEIGHTS[:, None], plates.shape[:2]), plates[..., 1]], axis=-1)
    faces = np.array([[0, 2, 1], [0, 3, 2]])
    every = np.concatenate([faces + 4 * i for i in range(1 + len(DEPTHS))])
    return Mesh.create(np.concatenate([floor, plates.reshape(-1, 3)]), every)


MESH = deep_scene()


def edge_strips():
    """Places next to every plate's edges in its own plane, outward normals there, and distances in [-1, 1]."""
    place = (np.arange(ALONG) + 0.5) / ALONG * 1.6 - 0.8
    away = (np.arange(ACROSS) + 0.5) / ACROSS * 2 - 1
    place, away = (x.reshape(-1) for x in np.meshgrid(place, away, indexing="ij"))
    spots, normals = [], []
    for axis in (0, 1):
        for sign in (-1.0, 1.0):
            spot, normal = np.empty((len(place), 2)), np.zeros(2)
            spot[:, axis], spot[:, 1 - axis], normal[axis] = sign, place, sign
            spots.append(CENTRES[:, None] + HALF[:, None, None] * spot)
            normals.append(np.broadcast_to(normal, spots[-1].shape))
    return jnp.asarray(np.concatenate(spots, 1)), jnp.asarray(np.concatenate(normals, 1)), jnp.asarray(np.tile(away, 4))


SPOTS, NORMALS, AWAY = edge_strips()


def on_floor(space, points):
    """Floor points below points along the rays of a light."""
    return points - space.to_source(points) * (points[..., 1:2] / space.to_source(points)[..., 1:2])


def is_lit(space, points):
    """Exact visibility of floor points: no plate on the way to the light."""
    back = space.to_source(points)
    there = points[..., None, :] + back[..., None, :] * (jnp.asarray(HEIGHTS) / back[..., 1:2])[..., None]
    inside = jnp.max(jnp.abs(there[..., ::2] - CENTRES), axis=-1) < HALF
    return jnp.where(jnp.any(inside, axis=-1), 0.0, 1.0)


def beside(space, reach):
    """Floor points whose ray to the light passes next to the edges of a plate at up to `reach` of it (plates,)."""
    spots = SPOTS + reach[:, None, None] * AWAY[:, None] * NORMALS
    heights = jnp.broadcast_to(jnp.asarray(HEIGHTS)[:, None], spots.shape[:2])
    return on_floor(space, jnp.stack([spots[..., 0], heights, spots[..., 1]], axis=-1))


@eqx.filter_jit
def place(partition, camera, light, resolution):
    """The grids of a partition and the partition placed."""
    placed = partition.fit(MESH, light, camera)
    return placed, placed.grids(MESH, light, camera, resolution)


@eqx.filter_jit
def shares_at(placed, grids, camera, points):
    return jnp.stack(placed.shares(grids, camera, points))


def snapped(grid, points, resolution):
    """Floor points of the rays through the centres of the texels that hold points; and whether the map holds them."""
    square = grid.plane_map.forward(grid.space.project(points)[0])
    centre = (jnp.floor(square * resolution) + 0.5) / resolution
    origin, direction = grid.space.ray(grid.plane_map.inverse(jnp.clip(centre, 0, 1)))
    hit = origin - direction * (origin[..., 1:2] / direction[..., 1:2])
    return hit, jnp.all((square >= 0) & (square <= 1), axis=-1)


@eqx.filter_jit
def displacement(grids, shares, camera, light, points, reach, resolution):
    """Mean distance by which a map moves the edges of plates, over their sizes: what it gets wrong of the strips."""
    space = grids.space if not hasattr(grids.space, "frame") else jax.tree.map(lambda leaf: leaf[0], grids.space)
    exact = is_lit(space, points)

    def answer(grid):
        hit, held = snapped(grid, points, resolution)
        return jnp.where(held, is_lit(space, hit), 1.0)

    answers = jax.lax.map(answer, grids)
    seen = in_view(camera, points) & (light.covers(points) > 0)
    wrong = jnp.abs(jnp.sum(answers * shares, axis=0) - exact) * 2 * (reach / jnp.asarray(HALF))[:, None]
    return jnp.mean(wrong, where=seen)


@eqx.filter_jit
def reaches(grids, shares, points, resolution):
    """For every plate the largest distance between its edge points and the floor points of their texels."""

    def moved(grid):
        return jnp.sqrt(jnp.sum((snapped(grid, points, resolution)[0] - points) ** 2, axis=-1))

    return 1.2 * jnp.max(jnp.sum(jax.lax.map(moved, grids) * shares, axis=0), axis=1)


def stacked(grids):
    """Up to `MOST` grids as one tree; the last is repeated."""
    return jax.tree.map(lambda *leaves: jnp.stack(leaves), *(*grids, *[grids[-1]] * (MOST - len(grids))))


def measured(partition, light, resolution):
    """The displacement of edges under a partition."""
    placed, grids = place(partition, CAMERA, light, 64)
    space = grids[0].space

    def shares(points):
        found = shares_at(placed, grids, CAMERA, points)
        return jnp.concatenate([found, jnp.zeros((MOST - len(grids), *found.shape[1:]))])

    together = stacked(grids)
    size = jnp.asarray(float(resolution))
    edges = beside(space, jnp.zeros(len(DEPTHS)))
    reach = jnp.minimum(reaches(together, shares(edges), edges, size), jnp.asarray(HALF))
    points = beside(space, reach)
    return float(displacement(together, shares(points), CAMERA, light, points, reach, size))


def fits_light(partition, light):
    """Whether a partition has maps for a light; what it has none for it must refuse with a reason."""
    try:
        place(partition, CAMERA, LIGHTS[light], 64)
    except ValueError as error:
        refusal = str(error)
    else:
        return True
    assert "needs a directional light; got SpotLight" in refusal
    return False


def assert_falls(partition_of, light, resolutions):
    """Error falls as 1/resolution at every k, and with k at every resolution."""
    error = np.array([[measured(partition_of(k), LIGHTS[light], size) for size in resolutions] for k in (1, 2, 4)])
    slopes = np.diff(np.log(error), axis=1) / np.diff(np.log(resolutions))
    mean = np.polyfit(np.log(resolutions), np.log(error).T, 1)[0]
    assert (np.abs(mean + 1) < 0.15).all(), (error, slopes)
    assert (error[1:] < 0.85 * error[:-1]).all(), error


def assert_maps_differ(partition, light):
    """No two regions that answer for points have the same rays."""
    _, grids = place(partition, CAMERA, LIGHTS[light], 64)
    used = range(len(grids))
    if isinstance(partition, FacePartition):
        used = np.flatnonzero(faces_that_apply(CAMERA, LIGHTS[light]))
    square = jnp.asarray([[0.0, 0.0], [1.0, 0.0], [0.5, 0.5], [0.0, 1.0]])
    rays = [grids[i].rays_at(square) for i in used]
    for i, one in enumerate(rays):
        for other in rays[:i]:
            apart = jnp.max(jnp.abs(one.origins - other.origins)), jnp.max(jnp.abs(one.directions - other.directions))
            assert float(max(apart)) > 0.01


CHEAP = [("uniform", "sun"), ("uniform", "spot")]


@pytest.mark.parametrize(("warp", "light"), CHEAP)
def test_slices_have_maps_of_their_own_and_more_of_them_err_less(warp, light):
    """With copies of one map, the error would not fall with their number at all."""
    assert_falls(lambda k: Cascades(k, warp=WARP_FITS[warp]()), light, RESOLUTIONS[::2])
    assert_maps_differ(Cascades(4, warp=WARP_FITS[warp]()), light)


@pytest.mark.long
@pytest.mark.parametrize("light", LIGHTS)
@pytest.mark.parametrize("warp", WARP_FITS)
def test_every_warp_under_slices(warp, light):
    if fits_light(Cascades(4, warp=WARP_FITS[warp]()), light):
        assert_falls(lambda k: Cascades(k, warp=WARP_FITS[warp]()), light, RESOLUTIONS)
        assert_maps_differ(Cascades(4, warp=WARP_FITS[warp]()), light)


@pytest.mark.long
@pytest.mark.parametrize("light", LIGHTS)
@pytest.mark.parametrize("name", [*PARTITIONS, "z4+stable"])
def test_every_registered_partition(name, light):
    """Those with slices fall with their number too; the others move edges by a texel."""
    partition = make_technique(name).partition
    if name == "z4-seen":  # rows fine enough to see the floor at 70 m, a hundredth of a radian below the horizon
        partition = dataclasses.replace(partition, num_rows=512)
    if name == "cube" and light != "spot":
        assert len(place(partition, CAMERA, LIGHTS[light], 64)[1]) == 1  # parallel rays need one face
        return
    if name == "cube" or not fits_light(partition, light):
        return  # six faces look away from each other by construction; tests/partitions/test_cube.py
    if isinstance(partition, Cascades):
        assert_falls(lambda k: dataclasses.replace(partition, num_partitions=k), light, RESOLUTIONS)
    else:
        error = np.array([measured(partition, LIGHTS[light], size) for size in RESOLUTIONS])
        assert abs(np.polyfit(np.log(RESOLUTIONS), np.log(error), 1)[0] + 1) < 0.15, error
    assert_maps_differ(partition, light)


def test_a_point_light_gets_one_map_and_slices_of_it_are_no_copies():
    light = PointLight.create((0.0, 30.0, -20.0))
    partition, grids = place(Cascades(4, warp=WARP_FITS["uniform"]()), CAMERA, light, 16)
    assert len(grids) == 1
    points = beside(LIGHTS["sun"].space(CAMERA.forward, *MESH.bounds()), jnp.ones(len(DEPTHS)))
    assert float(jnp.min(shares_at(partition, grids, CAMERA, points))) == 1
    with pytest.raises(ValueError, match="directional or a spot light; got OctahedralSpace"):
        place(Cascades(4), CAMERA, light, 16)
