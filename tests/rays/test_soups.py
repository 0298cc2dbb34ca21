"""Random scenes of every bad kind: tree and grid casters against brute force, and shadows against 64 bits.

`SHADOWJAX_SCENES=10000` runs as many of each. Two casters may choose differently only where rounding decides, and each
such ray is looked into: the chosen triangles are equally near, one lies at an end of the ray, or the ray passes an
edge, each to 16 roundings of the scene's size. What those do to the depth of a triangle says `plane_depth`.

Where 16 come from: the place of a corner, or of a ray, across the rays takes a difference, a product and two sums. Each
rounds by eps / 2 × the distance from the light, which is up to 2.3 sizes (√3 of the scene and 4.5 units of at least
10). Corner and ray, along two axes, make 13 if all err one way; the rest is for the rounding of the ray itself.
"""

import os
from fractions import Fraction

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from shadowjax import BruteForceCaster, Mesh, Rays
from shadowjax.geometry.light_space import DirectionalSpace, PerspectiveSpace
from shadowjax.rays.bvh.caster import BvhCaster
from shadowjax.rays.caster import shadow_rays
from shadowjax.rays.grid._project import NEAREST
from shadowjax.rays.grid.caster import GridCaster
from shadowjax.rays.plane_map import Box
from shadowjax.rays.ray_grid import RayGrid

NUM_SCENES = int(os.environ.get("SHADOWJAX_SCENES", "40"))
NUM_FACES, SIDE = 60, 16
NUM_RAYS = SIDE * SIDE
NUM_BESIDE = NUM_RAYS // 4
SCENES = settings(
    max_examples=NUM_SCENES, deadline=None, derandomize=True, database=None, suppress_health_check=tuple(HealthCheck)
)
# The grid caster takes long to compile for each kind of rays: few scenes are all of the one that rounds most.
GRID_DTYPES, GRID_PARALLEL = (
    ([jnp.float32, jnp.float64], [False, True]) if NUM_SCENES > 100 else ([jnp.float32], [False])
)
brute = eqx.filter_jit(lambda mesh, rays: BruteForceCaster().closest(mesh, rays))
brute_views = eqx.filter_jit(lambda mesh, grid, points: _views(BruteForceCaster(), mesh, grid, points))
grid_views = eqx.filter_jit(lambda mesh, grid, points: _views(GridCaster(), mesh, grid, points))
# Traced, the tree has the largest size for the number of triangles: all scenes share compiled code.
tree = eqx.filter_jit(lambda mesh, rays: BvhCaster().closest(mesh, rays))


def _views(caster, mesh, grid, points):
    return caster.closest_on_grid(mesh, grid), caster.visible(mesh, grid.space, points)


def soup(rng: np.random.Generator, size: float, sliver: float, lattice: bool) -> np.ndarray:
    """Corners of triangles: some large, some long and thin, some repeated, some without area, some in one plane."""
    middle = rng.uniform(-1, 1, (NUM_FACES, 1, 3))
    corners = middle + size * rng.normal(0, 1, (NUM_FACES, 3, 3)) * 10.0 ** rng.uniform(-2, 0, (NUM_FACES, 1, 1))
    thin = rng.uniform(size=NUM_FACES) < sliver
    along = rng.uniform(-1, 2, (NUM_FACES, 1))
    on_edge = corners[:, 0] + along * (corners[:, 1] - corners[:, 0])
    off = 10.0 ** rng.uniform(-9, -2, (NUM_FACES, 1)) * rng.normal(size=(NUM_FACES, 3))
    corners[thin, 2] = (on_edge + off)[thin]
    flat = rng.uniform(size=NUM_FACES) < 0.1
    corners[flat, :, rng.integers(3)] = 0.25
    corners[rng.integers(NUM_FACES, size=5)] = corners[rng.integers(NUM_FACES, size=5)]
    corners[rng.integers(NUM_FACES, size=3), 1] = corners[rng.integers(NUM_FACES), 0]
    return np.round(8 * corners) / 8 if lattice else corners


def edge_distance(corners: np.ndarray, origin: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """Distance, across the ray, between its line and the nearest edge of each triangle: in 64 bits."""
    start = corners - origin
    start = start - np.sum(start * direction, axis=-1, keepdims=True) * direction
    step = np.roll(start, -1, axis=1) - start
    length = np.maximum(np.sum(step * step, axis=-1, keepdims=True), 1e-300)
    share = np.clip(-np.sum(start * step, axis=-1, keepdims=True) / length, 0, 1)
    return np.linalg.norm(start + share * step, axis=-1).min(axis=1)


def plane_depth(
    corners: np.ndarray, origin: np.ndarray, direction: np.ndarray, unit: float
) -> tuple[np.ndarray, np.ndarray]:
    """Where the ray meets each triangle's plane, and the most that 16 roundings of size `unit` change it.

    A shift of the plane counts by 1 / cos. Weights are differences of products of the triangle's length, divided by
    its area as the ray sees it: in a long thin one a rounding grows by length / width. No caster leaves the range of
    the corners' depths.
    """
    offset = corners - origin
    normal = np.cross(offset[:, 1] - offset[:, 0], offset[:, 2] - offset[:, 0])
    across = normal @ direction
    # Without area, or seen edge-on, a triangle has no such depth; its edges then lie next to the ray.
    solid = across != 0
    safe = np.where(solid, across, 1)
    along = offset @ direction
    low, high = along.min(axis=1), along.max(axis=1)
    depth = np.clip(np.sum(normal * offset[:, 0], axis=1) / safe, low, high)
    growth = np.max(np.sum((np.roll(offset, -1, axis=1) - offset) ** 2, axis=-1), axis=1) / np.abs(safe)
    rounding = np.minimum(16 * unit * growth, high - low) + 16 * unit
    return np.where(solid, depth, np.inf), np.where(solid, rounding, 0)


def assert_explained(found, expected, corners: np.ndarray, rays: Rays, unit: float, t_max: float):
    """Same triangle for each ray, or the difference is one that a rounding of size `unit` makes."""
    assert np.isfinite(found.depth).all()
    for index in np.flatnonzero(np.asarray(found.face != expected.face)):
        chosen = [int(hit.face.reshape(-1)[index]) for hit in (found, expected)]
        seen = corners[[face for face in chosen if face >= 0]].astype(float)
        ray = [np.asarray(a.reshape(-1, 3)[index], float) for a in (rays.origins, rays.directions)]
        depth, rounding = plane_depth(seen, *ray, unit)
        tie = len(seen) == 2 and np.isfinite(depth).all() and np.ptp(depth) <= rounding.max()
        # A ray that starts on a triangle, as on a lattice many do, meets it at 0 or just before.
        at_limit = np.any(np.minimum(np.abs(depth), np.abs(depth - t_max)) <= rounding)
        assert tie or at_limit or edge_distance(seen, *ray).min() <= 16 * unit, (index, chosen, depth, rounding)


@SCENES
@given(
    seed=st.integers(0, 2**32 - 1),
    size=st.sampled_from([0.01, 0.3, 3.0]),
    sliver=st.sampled_from([0.0, 0.5]),
    lattice=st.booleans(),
    far_off=st.sampled_from([0.0, 0.0, 1e3, 1e6]),
    double=st.booleans(),
    at_corners=st.booleans(),
)
def test_the_tree_caster_is_brute_force(seed, size, sliver, lattice, far_off, double, at_corners):
    """Same triangle, or one as near; or the ray passes an edge so closely that rounding decides."""
    dtype = jnp.float64 if double else jnp.float32
    rng = np.random.default_rng(seed)
    corners = np.asarray(soup(rng, size, sliver, lattice) + far_off * np.array([1, -0.7, 0.3]), np.dtype(dtype))
    mesh = Mesh.create(jnp.asarray(corners.reshape(-1, 3)), np.arange(3 * NUM_FACES).reshape(-1, 3))
    origins = np.asarray(rng.uniform(-1.5, 1.5, (NUM_RAYS, 3)) + far_off * np.array([1, -0.7, 0.3]), corners.dtype)
    directions = rng.normal(size=(NUM_RAYS, 3))
    if at_corners:
        directions = corners.reshape(-1, 3)[rng.integers(3 * NUM_FACES, size=NUM_RAYS)] - origins.astype(float)
        directions[np.all(directions == 0, axis=1)] = [0, 0, 1]
    along_axis = rng.uniform(size=NUM_RAYS) < 0.2
    directions[along_axis] = np.eye(3)[rng.integers(3, size=int(along_axis.sum()))]
    rays = Rays.create(jnp.asarray(origins), jnp.asarray(directions, dtype), t_max=50.0)
    # One rounding of the largest offset between a ray and the scene.
    unit = float(jnp.finfo(dtype).eps) * max(10.0, float(np.abs(corners - origins[0]).max()))
    assert_explained(tree(mesh, rays), brute(mesh, rays), corners, rays, unit, 50.0)


def exact_turn(a: np.ndarray, b: np.ndarray, origin: np.ndarray, direction: np.ndarray) -> int:
    """Sign of the volume that a line spans with two points: on which side of it the edge between them passes."""
    first, second, start, along = ([Fraction(float(part)) for part in vector] for vector in (a, b, origin, direction))
    one, two = ([part - base for part, base in zip(corner, start, strict=True)] for corner in (first, second))
    volume = sum((one[i - 2] * two[i - 1] - one[i - 1] * two[i - 2]) * along[i] for i in range(3))
    return (volume > 0) - (volume < 0)


def is_inside(corners: np.ndarray, origin: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """Whether the line passes inside each triangle, strictly and exactly.

    Seen from the ray's start a volume is a difference of products of distances. In 64 bits its rounding shifts an edge
    by eps × distance² / length: far more, for a small triangle, than the eps × distance by which a caster shifts it
    that projects first. A product takes seven roundings at most, of eps / 2: where those could decide, it is exact.
    """
    offset = corners - origin
    following = np.roll(offset, -1, axis=1)
    turn = np.cross(offset, following) @ direction
    size = np.sum(np.abs(offset), axis=-1)
    products = size * np.roll(size, -1, axis=1) * np.sum(np.abs(direction))
    doubtful = np.abs(turn) <= 4 * np.finfo(float).eps * products
    sign = np.where(doubtful, 0, np.sign(turn))
    # One edge on each side, or one without length: not inside, whatever the others are.
    outside = np.ptp(sign, axis=1) == 2
    outside |= np.any(np.all(corners == np.roll(corners, -1, axis=1), axis=-1), axis=1)
    for face, edge in np.argwhere(doubtful & ~outside[:, None]):
        sign[face, edge] = exact_turn(corners[face, edge], corners[face, edge - 2], origin, direction)
    return ~outside & (np.abs(sign.sum(axis=1)) == 3)


def verdict(corners, origin, direction, limit: float, unit: float, unseen: float) -> bool | None:
    """Whether a triangle lies on the ray before its limit, in 64 bits; None where roundings of size `unit` decide, or
    the distance `unseen` from a spot light within which it sees nothing."""
    depth, rounding = plane_depth(corners, origin, direction, unit)
    inside = is_inside(corners, origin, direction)
    close = edge_distance(corners, origin, direction) <= 16 * unit
    at_end = inside & (np.minimum(np.abs(depth), np.abs(depth - limit)) <= rounding)
    at_end |= inside & (depth > limit - unseen) & (depth < limit)
    if np.any(inside & ~close & ~at_end & (depth > 0) & (depth < limit)):
        return True
    return None if np.any(close | at_end) else False


def behind_edges(rng: np.random.Generator, corners, start, towards, parallel: bool) -> np.ndarray:
    """Points whose rays pass an edge, or the line beyond its ends, closely: those that a wrong edge rule gets wrong."""
    face, edge = rng.integers(NUM_FACES, size=NUM_BESIDE), rng.integers(3, size=NUM_BESIDE)
    first, second = corners[face, edge].astype(float), corners[face, edge - 2].astype(float)
    beside = first + rng.uniform(-1, 2, (NUM_BESIDE, 1)) * (second - first)
    off = np.finfo(corners.dtype).eps * 10.0 ** rng.uniform(-2, 5, (NUM_BESIDE, 1))
    beside += off * rng.normal(size=(NUM_BESIDE, 3))
    along = towards if parallel else (beside - start) / np.linalg.norm(beside - start, axis=1, keepdims=True)
    return beside + rng.uniform(0, 2, (NUM_BESIDE, 1)) * along


def among_many(**scene):
    """A scene that is always among them, if there are so many that its kind of rays is compiled anyway."""
    return example(**scene) if NUM_SCENES > 100 else lambda test: test


# A point on a needle 1e-11 wide, seen edge-on: only exact arithmetic shows that its ray passes inside.
@among_many(
    seed=121,
    size=0.01,
    sliver=0.5,
    lattice=False,
    far_off=0.0,
    dtype=jnp.float64,
    parallel=True,
    inside=False,
    along_axes=False,
)
@SCENES
@given(
    seed=st.integers(0, 2**32 - 1),
    size=st.sampled_from([0.01, 0.3, 3.0]),
    sliver=st.sampled_from([0.0, 0.5]),
    lattice=st.booleans(),
    far_off=st.sampled_from([0.0, 0.0, 1e3]),
    dtype=st.sampled_from(GRID_DTYPES),
    parallel=st.sampled_from(GRID_PARALLEL),
    inside=st.booleans(),
    along_axes=st.booleans(),
)
def test_the_grid_caster_is_brute_force_and_its_shadows_are_true(
    seed, size, sliver, lattice, far_off, dtype, parallel, inside, along_axes
):
    """Lights and cameras outside and amid the triangles, which cross the start of the rays; frames on a lattice too."""
    rng = np.random.default_rng(seed)
    shift = far_off * np.array([1, -0.7, 0.3])
    corners = np.asarray(soup(rng, size, sliver, lattice) + shift, np.dtype(dtype))
    mesh = Mesh.create(jnp.asarray(corners.reshape(-1, 3)), np.arange(3 * NUM_FACES).reshape(-1, 3))
    frame = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    frame = np.eye(3) if along_axes else frame * np.sign(np.linalg.det(frame))
    towards = -frame[1] if parallel else frame[2]
    start = np.round(rng.uniform(-0.5, 0.5, 3), 3 if lattice else 9) - (0 if inside else 4) * towards
    space = DirectionalSpace if parallel else PerspectiveSpace
    half = 1.5 if parallel or inside else 0.4
    grid = RayGrid(
        space(jnp.asarray(start + shift, dtype), jnp.asarray(frame, dtype)),
        Box(jnp.full(2, -half, dtype), jnp.full(2, half, dtype)),
        jnp.asarray(50.0, dtype),
        SIDE,
        SIDE,
    )
    # Points on triangles, others anywhere, and some that see the light just next to an edge.
    share = rng.dirichlet([1, 1, 1], NUM_RAYS)
    points = np.einsum("nk,nkd->nd", share, corners[rng.integers(NUM_FACES, size=NUM_RAYS)].astype(float))
    anywhere = rng.uniform(size=NUM_RAYS) < 0.3
    points[anywhere] = rng.uniform(-1.5, 1.5, (int(anywhere.sum()), 3)) + shift
    points[-NUM_BESIDE:] = behind_edges(rng, corners, start + shift, towards, parallel)
    image = jnp.asarray(points.reshape(SIDE, SIDE, 3), dtype)
    found, lit = grid_views(mesh, grid, image)
    expected, brute_lit = brute_views(mesh, grid, image)
    # A parallel ray's origin is rounded in the world, so distance from there counts.
    unit = float(jnp.finfo(dtype).eps) * max(10.0, float(np.abs(corners).max()))
    flat_found, flat_expected = (jax.tree.map(np.ravel, hit) for hit in (found, expected))
    assert_explained(flat_found, flat_expected, corners, grid.rays(), unit, float(grid.far))
    rays, facing = shadow_rays(grid.space, image, None)
    flat = rays.flattened()
    origins, directions, limits = (np.asarray(a, float) for a in (flat.origins, flat.directions, flat.t_max))
    reach = float(grid.space.farthest(*mesh.bounds()))
    asked = np.asarray(facing).reshape(-1) & (limits > 0)
    answers = np.stack([np.ravel(lit), np.ravel(brute_lit)], axis=1)
    for index in np.flatnonzero(asked):
        unseen = 0 if parallel else -1.01 * NEAREST * reach / (directions[index] @ frame[2])
        blocked = verdict(corners.astype(float), origins[index], directions[index], limits[index], unit, unseen)
        assert blocked is None or np.all(answers[index] != blocked), (index, blocked, answers[index])
