"""Stencil counts in whole numbers against an oracle that knows no shadow volume: no tolerance anywhere."""

from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from shadowjax import Mesh
from shadowjax.volumes.extrude import CASTERS, VolumeEdges, volume_edges
from shadowjax.volumes.regions import boundary
from shadowjax.volumes.stencil import Stencil, eye_counts, near_plane_counts

TRIALS = 750
REACH = 1000  # coordinates; products of three differences stay far below 2^63

# Faces over vertices: apart; a closed body; an open fan of three on one edge, wound both ways; a strip with a twist.
MESHES = {
    "apart": [[0, 1, 2], [3, 4, 5], [6, 7, 8], [9, 10, 11]],
    "closed": [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]],
    "fan": [[0, 1, 2], [1, 0, 3], [0, 1, 4], [5, 2, 5]],
    "strip": [[0, 1, 2], [1, 3, 2], [2, 3, 4], [3, 5, 4]],
}


def topology(faces) -> VolumeEdges:
    """Edges of faces whose vertices all differ; filled up to twelve, so that all meshes share one program."""
    spots = np.arange(12 * 3, dtype=float).reshape(12, 3)
    edges = volume_edges(Mesh.create(spots, faces, dtype=jnp.float64))
    return eqx.tree_at(lambda e: e.ends, edges, jnp.pad(edges.ends, [(0, 12 - edges.ends.shape[0]), (0, 0)]))


@eqx.filter_jit
def counted(edges, faces, vertices, light, eye, point, between):
    """Totals by z-pass, by z-fail, by z-pass with caps on a plane through `between`, and an 8-bit buffer's value."""

    def one(vertices, light, eye, point, between):
        all_cast, seen_cast = (boundary(vertices, faces, edges, light, eye, casters) for casters in CASTERS)
        points = (point - eye)[None]
        passed = eye_counts(all_cast, points, "z-pass")
        # The walls alone, cut at a place between the eye and the point: right if no face lies between eye and point.
        capped = near_plane_counts(all_cast, points, (between - eye)[None])
        others = eye_counts(all_cast, points, "z-fail"), eye_counts(seen_cast, points, "z-pass"), capped
        return passed.total[0], *(other.total[0] for other in others), Stencil().value(*passed)[0]

    return jax.vmap(one)(vertices, light, eye, point, between)


def det(a, b, c):
    return np.sum(a * np.cross(b, c), axis=-1)


def pierced(start, w, stop, triangles):
    """Signs of a segment's crossings with triangles, by Cramer's rule: 1 where it enters by the side that faces it.

    `start` is a place (w = 1) or a direction to infinity (w = 0); everything is a whole number. Also whether a
    degenerate configuration, a zero, was met.
    """
    along = (w * stop - start)[:, None]  # the way the segment runs
    a, b, c = (triangles[:, :, k] for k in range(3))
    p = stop[:, None]
    normal = det(b - a, c - a, along)
    volumes = [det(b - p, c - p, along), det(c - p, a - p, along), det(a - p, b - p, along)]
    beyond = np.sum(np.cross(b - a, c - a) * (p - a), -1)  # has the sign of `normal` if the face lies before the point
    behind = -normal if w == 0 else np.sum(np.cross(b - a, c - a) * (start[:, None] - a), -1)
    hit = np.all([np.sign(v) == np.sign(normal) for v in volumes], axis=0)
    hit &= (np.sign(beyond) == np.sign(normal)) & (np.sign(behind) == -np.sign(normal)) & (normal != 0)
    solid = np.any(a != b, -1) & np.any(b != c, -1) & np.any(a != c, -1)
    tied = solid & np.any([x == 0 for x in (*volumes, normal, beyond, behind)], axis=0)
    return np.where(hit, -np.sign(normal), 0).astype(int), tied.any(-1)


@pytest.mark.parametrize("w", [1, 0], ids=["point", "directional"])
@pytest.mark.parametrize("name", MESHES)
def test_counts_are_exact(name, w):
    """z-pass, z-fail and capped z-pass give the number of casting faces between light and point; 6 000 in all."""
    generator = np.random.default_rng([len(name), w])
    whole = partial(generator.integers, -REACH, REACH + 1)
    vertices, light, eye = whole((TRIALS, 12, 3)), whole((TRIALS, 3)), whole((TRIALS, 3)) // 2
    step = whole((TRIALS, 3)) // 8
    point, between = eye + 4 * step, eye + step
    faces = np.asarray(MESHES[name])
    triangles = vertices[:, faces]
    crossed, tied = pierced(light, w, point, triangles)
    # The light sees the outer side of a face: its normal runs against the way the light travels.
    unobstructed = pierced(eye, 1, point, triangles)[0] == 0
    homogeneous = np.concatenate([light, np.full((TRIALS, 1), w)], axis=-1)
    given = [jnp.asarray(part) for part in (vertices, homogeneous, eye, point, between)]
    passed, failed, facing, capped, stencil = map(np.asarray, counted(topology(faces), jnp.asarray(faces), *given))
    assert tied.mean() < 0.01
    assert (crossed != 0).any(-1).mean() > 0.1
    expected = np.abs(crossed).sum(-1)
    np.testing.assert_array_equal(passed[~tied], expected[~tied])
    np.testing.assert_array_equal(failed[~tied], expected[~tied])
    # Eight wrapping bits hold every one of these counts.
    np.testing.assert_array_equal(stencil[~tied], expected[~tied])
    np.testing.assert_array_equal(facing[~tied], np.maximum(crossed, 0).sum(-1)[~tied])
    free = unobstructed.all(-1) & ~tied
    np.testing.assert_array_equal(capped[free], expected[free])
    assert free.sum() > TRIALS / 4
