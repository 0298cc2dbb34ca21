"""Random scenes of every bad kind against brute force; `SHADOWJAX_SCENES=10000` runs as many."""

import os

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from shadowjax import BruteForce, Mesh, Rays
from shadowjax.rays.bvh import BoundingVolumeHierarchy

NUM_SCENES = int(os.environ.get("SHADOWJAX_SCENES", "40"))
NUM_FACES, NUM_RAYS = 60, 256
brute = eqx.filter_jit(lambda mesh, rays: BruteForce().closest(mesh, rays))
# Traced, the tree has the largest size for the number of triangles: all scenes share compiled code.
tree = eqx.filter_jit(lambda mesh, rays: BoundingVolumeHierarchy().closest(mesh, rays))


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


def plane_depth(corners: np.ndarray, origin: np.ndarray, direction: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Where the ray meets each triangle's plane, and how much a shift of the plane shifts that: 1 / cos."""
    offset = corners - origin
    normal = np.cross(offset[:, 1] - offset[:, 0], offset[:, 2] - offset[:, 0])
    across = normal @ direction
    # Without area, or seen edge-on, a triangle has no such depth; its edges then lie beside the ray.
    solid = across != 0
    safe = np.where(solid, across, 1)
    depth = np.where(solid, np.sum(normal * offset[:, 0], axis=1) / safe, np.inf)
    return depth, np.where(solid, np.linalg.norm(normal, axis=1) / np.abs(safe), 0)


@settings(
    max_examples=NUM_SCENES, deadline=None, derandomize=True, database=None, suppress_health_check=list(HealthCheck)
)
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
    found, expected = tree(mesh, rays), brute(mesh, rays)
    assert np.isfinite(found.depth).all()
    # One rounding of the largest offset between a ray and the scene.
    unit = float(jnp.finfo(dtype).eps) * max(10.0, float(np.abs(corners - origins[0]).max()))
    for index in np.flatnonzero(np.asarray(found.face != expected.face)):
        chosen = np.array([int(hit.face[index]) for hit in (found, expected) if int(hit.face[index]) >= 0])
        ray = [np.asarray(a[index], float) for a in (rays.origins, rays.directions)]
        depth, slack = plane_depth(corners[chosen].astype(float), *ray)
        rounding = 16 * unit * slack
        tie = len(chosen) == 2 and np.isfinite(depth).all() and np.ptp(depth) <= rounding.max()
        # A ray that starts on a triangle, as on a lattice many do, meets it at 0 or just before.
        at_limit = np.any(np.minimum(np.abs(depth), np.abs(depth - 50)) <= rounding)
        assert tie or at_limit or edge_distance(corners[chosen].astype(float), *ray).min() <= 16 * unit
