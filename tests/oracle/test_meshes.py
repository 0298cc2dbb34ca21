"""Depth maps of whole meshes against trimesh's Embree: the same face, or the same depth.

The meshes are made here; `SHADOWJAX_MESHES=FOLDER` adds every mesh file of a folder.
"""

import os
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest
import trimesh

from shadowjax import BruteForceCaster, Camera, Mesh, camera_grid, intersect, load

MADE = {
    "torus": lambda: trimesh.creation.torus(1.0, 0.35),
    "annulus": lambda: trimesh.creation.annulus(0.5, 1.0, 0.4),
    "capsule": lambda: trimesh.creation.capsule(1.0, 0.5),
}
FOLDER = os.environ.get("SHADOWJAX_MESHES")
FILES = sorted(path for path in Path(FOLDER).iterdir() if path.suffix.lower() != ".md") if FOLDER else []


def _mesh(source) -> Mesh:
    if isinstance(source, Path):
        return load(source, dtype=jnp.float32)
    body = MADE[source]()
    return Mesh.create(body.vertices, body.faces, dtype=jnp.float32)


@pytest.mark.parametrize("source", [*MADE, *FILES], ids=str)
def test_depth_map_agrees_with_embree(source):
    """On at least 99.99 % of rays the same face, or a depth within 1e-5 of the extent; the rest lie on edges."""
    mesh = _mesh(source)
    lower, upper = mesh.bounds()
    middle, extent = 0.5 * (lower + upper), mesh.extent
    camera = Camera.look_at(
        middle + extent * jnp.asarray([0.6, 0.5, 1.0], jnp.float32),
        middle,
        phi_y=jnp.asarray(0.35, jnp.float32),
        near=0.1 * extent,
        far=4 * extent,
    )
    grid = camera_grid(camera, 128, 128)
    rays = grid.rays().flattened()
    hit = BruteForceCaster().closest(mesh, rays)
    body = trimesh.Trimesh(np.asarray(mesh.vertices, float), np.asarray(mesh.faces), process=False)
    origins, directions = np.asarray(rays.origins, float), np.asarray(rays.directions, float)
    place, index, face = body.ray.intersects_location(origins, directions, multiple_hits=False)
    found = np.full(len(origins), -1)
    found[index] = face
    depth = np.full(len(origins), float(grid.far))
    depth[index] = np.linalg.norm(place - origins[index], axis=1)
    near = np.abs(np.asarray(hit.depth) - depth) <= 1e-5 * float(extent)
    differ = ~near & (np.asarray(hit.face) != found)
    print(f"{source}: {mesh.num_faces} triangles, {hit.is_hit.mean():.1%} hits, {differ.mean():.4%} differ")
    assert 0.02 < float(hit.is_hit.mean()) < 0.98
    assert differ.mean() <= 1e-4
    # A ray on which the two casters differ passes within a thousandth of a triangle's edge.
    for i in np.flatnonzero(differ):
        ray = type(rays)(rays.origins[i], rays.directions[i], rays.t_min[i], rays.t_max[i])
        candidates = [f for f in (int(hit.face[i]), int(found[i])) if f >= 0]
        assert min(float(intersect(mesh, ray, jnp.int32(f)).barycentrics.min()) for f in candidates) < 1e-3
