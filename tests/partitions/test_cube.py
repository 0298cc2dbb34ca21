"""Cube maps: every direction in one face, no seam across any edge, filters over the edges, shadows that converge."""

import itertools

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from shapes import above, lights, plate_over_plane

from shadowjax import (
    Exact,
    Mesh,
    PointLight,
    ShadowMapping,
    SpotLight,
    Variance,
    make_partition,
    make_technique,
)
from shadowjax.partitions.cube import CubeMap, face_frames, face_of
from shadowjax.scenes.parts import rotation

PLACE = np.array([0.13, -0.07, 0.05])
TURN = np.asarray(rotation((1.0, 2.0, -1.5), 0.9))
CUBE = make_technique("cube+pcf-3x3", 96)
visibility = eqx.filter_jit(lambda shadows, points, normals: shadows.visibility(points, normals))
read = eqx.filter_jit(lambda shadows, face, points, normals: shadows.read(face, points, normals))
# The twelve edges of a cube: two axes with signs, and the third to walk along.
EDGES = [(a, b, sa, sb) for a, b in ((0, 1), (1, 2), (2, 0)) for sa in (-1.0, 1.0) for sb in (-1.0, 1.0)]


def room(size=4.0):
    """Walls of a box around the light, seen from inside; turned, so that the cube's edges cross the walls' middles."""
    corners = size * np.array(list(itertools.product((-1.0, 1.0), repeat=3))) @ TURN
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = [tri for a, b, c, d in quads for tri in ((a, c, b), (a, d, c))]
    return corners, np.array(faces)


def room_with_plates(size=0.35):
    """In front of the middle of every edge of the cube around the light, a plate that lies across it.

    Of size 0 the plates have no area: an empty room of the same shape, so that programs are shared.
    """
    corners, faces = room()
    for a, b, sign_a, sign_b in EDGES:
        out, along = np.zeros(3), np.eye(3)[3 - a - b]
        out[a], out[b] = sign_a, sign_b
        across = np.cross(out, along) / np.sqrt(2)
        plate = PLACE + out + size * np.array([-across - along, across - along, across + along, -across + along])
        faces = np.concatenate([faces, len(corners) + np.array([[0, 1, 2], [0, 2, 3]])])
        corners = np.concatenate([corners, plate])
    return Mesh.create(corners, faces)


def wall_points(directions, size=4.0):
    """Where rays from the light meet the walls, and the walls' normals."""
    place, turned = PLACE @ TURN.T, directions @ TURN.T
    reach = (np.sign(turned) * size - place) / turned
    axis = reach.argmin(axis=1)
    normals = -np.eye(3)[axis] * np.sign(np.take_along_axis(turned, axis[:, None], 1))
    return jnp.asarray(PLACE + reach.min(axis=1)[:, None] * directions), jnp.asarray(normals @ TURN)


def away_from_corners(directions, size=4.0, margin=0.6):
    """Whether rays meet a wall that far from where it meets another: there a filter sees the other wall, rightly."""
    points, _ = wall_points(directions)
    return np.sort(np.abs(np.asarray(points) @ TURN.T), axis=1)[:, 1] < size - margin


def walk_across_edges(steps=31, lines=9):
    """Directions that cross every edge of the cube at many places along it, corners nearly included."""
    turn = np.linspace(np.pi / 4 - 0.12, np.pi / 4 + 0.12, steps)
    walks = []
    for a, b, sign_a, sign_b in EDGES:
        for height in np.linspace(-0.98, 0.98, lines):
            direction = np.zeros((steps, 3))
            direction[:, a], direction[:, b] = sign_a * np.cos(turn), sign_b * np.sin(turn)
            direction[:, 3 - a - b] = height * np.maximum(np.cos(turn), np.sin(turn))
            walks.append(direction)
    return np.concatenate(walks)


def rim_distance_at_least(directions, angle, exact):
    """Whether the truth stays the same on two rings of directions around each, up to an angle."""
    unit = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    side = np.cross(unit, [0.48, 0.6, 0.64])
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    truth = np.asarray(visibility(exact, *wall_points(directions)))
    same = np.ones(len(directions), bool)
    for turn in np.linspace(0, 2 * np.pi, 8, endpoint=False):
        for share in (0.5, 1.0):
            off = unit + share * angle * (np.cos(turn) * side + np.sin(turn) * np.cross(unit, side))
            same &= np.asarray(visibility(exact, *wall_points(off))) == truth
    return truth, same


@eqx.filter_jit
def placed_in_faces(light, camera, points):
    cube = CubeMap(0)
    grids = cube.grids(plate_over_plane(points.dtype), light, camera, 64)
    face = cube.select(grids, camera, points)
    place = jnp.stack([grid.locate(points)[0] for grid in grids])
    return face, jnp.take_along_axis(place, face[None, :, None], axis=0)[0]


def test_every_direction_points_through_one_face_and_into_its_map(dtype):
    directions = np.random.default_rng(0).normal(size=(4000, 3))
    corners = [d for d in itertools.product((-1, 0, 1), repeat=3) if any(d)]
    directions = np.concatenate([directions, walk_across_edges(), corners])
    light = PointLight.create(PLACE, dtype=dtype)
    face, place = placed_in_faces(light, above(dtype), jnp.asarray(PLACE + directions, dtype))
    slack = 64 * 8 * np.finfo(dtype).eps
    assert float(place.min()) >= -slack
    assert float(place.max()) <= 64 + slack
    assert set(np.asarray(face).tolist()) == set(range(6))
    for index, frame in enumerate(face_frames(dtype)):
        np.testing.assert_allclose(np.linalg.det(frame), 1.0)
        assert face_of(frame[2]) == index


def test_a_lit_room_has_no_seam_at_any_edge_or_corner():
    """No shadow, so any answer but 1 on a walk across the edges is a seam: at a border, or by acne there."""
    shadows = CUBE.build(room_with_plates(0.0), PointLight.create(PLACE), above())
    assert len(shadows.maps) == 6
    directions = walk_across_edges()
    plain = away_from_corners(directions)
    assert plain.mean() > 0.4
    assert np.asarray(visibility(shadows, *wall_points(directions)))[plain].min() == 1


class _WithoutMargin(CubeMap):
    def with_margin(self, texels):
        return CubeMap(0)


def test_shadows_run_over_every_edge():
    """Walks through shadows of plates that lie across the edges: wrong only as near to a rim as the filter reaches.

    A cube without margins fails at the edges, in the middle of the shadows.
    """
    mesh, light, directions = room_with_plates(), PointLight.create(PLACE), walk_across_edges()
    shadows = CUBE.build(mesh, light, above())
    angle = 1.5 * (CUBE.filter.reach + 0.5) * 2 / (CUBE.resolution - 2 * shadows.partition.margin)
    truth, far = rim_distance_at_least(directions, angle, Exact().build(mesh, light, above()))
    far &= away_from_corners(directions)
    value = np.asarray(visibility(shadows, *wall_points(directions)))
    np.testing.assert_array_equal(value[far], truth[far])
    second, first = np.sort(np.abs(directions), axis=1).T[1:]
    inside = far & (truth == 0) & (first - second < 0.05)
    assert inside.sum() > 50
    bare = eqx.tree_at(lambda t: t.partition, CUBE, _WithoutMargin()).build(mesh, light, above())
    cut = np.asarray(visibility(bare, *wall_points(directions)))
    assert np.sum(cut[inside] > 0) > 20


def test_two_faces_answer_alike_along_their_common_edge():
    """Directions exactly on an edge, read from both maps: their texels have the same coordinate along it."""
    shadows = CUBE.build(room_with_plates(), PointLight.create(PLACE), above())
    for a, b, sign_a, sign_b in EDGES[::5]:
        directions = np.zeros((200, 3))
        directions[:, a], directions[:, b] = sign_a, sign_b
        directions[:, 3 - a - b] = np.linspace(-0.97, 0.97, 200)
        faces = [2 * axis + int(sign < 0) for axis, sign in ((a, sign_a), (b, sign_b))]
        one, two = (np.asarray(read(shadows, face, *wall_points(directions))) for face in faces)
        # A tap beyond the edge meets a rim at another place in either map, at a few directions by each rim.
        assert np.mean(np.abs(one - two) > 1e-12) < 0.1
        assert one.min() == two.min() == 0


def test_errors_fall_with_the_texel():
    mesh, light = room_with_plates(), PointLight.create(PLACE)
    directions = np.random.default_rng(0).normal(size=(len(walk_across_edges()), 3))
    points, normals = wall_points(directions)
    truth = visibility(Exact().build(mesh, light, above()), points, normals)
    coarse = make_technique("cube+pcf-3x3", 24)
    plain = away_from_corners(directions)
    errors = []
    for technique in (coarse, CUBE):
        value = visibility(technique.build(mesh, light, above()), points, normals)
        errors.append(float(np.abs(np.asarray(value - truth))[plain].mean()))
    # 14 texels across a face, then 86; away from rims both are exact.
    assert 0 < errors[1] < errors[0] * 14 / 86 * 1.5


def test_a_spot_of_almost_half_the_sphere_gets_the_maps_of_a_point_light():
    """One flat map has no room for it."""
    spot = SpotLight.create(PLACE, (-0.25, -1.0, 0.125), 1.55)
    one, other = (CUBE.build(room_with_plates(), light, above()) for light in (spot, PointLight.create(PLACE)))
    for mine, its in zip(one.maps, other.maps, strict=True):
        np.testing.assert_array_equal(mine.depth, its.depth)


def test_smooth_filters_cross_edges_too():
    technique = ShadowMapping(Variance(), CUBE.resolution, CubeMap())
    shadows = technique.build(room_with_plates(0.0), PointLight.create(PLACE), above())
    directions = walk_across_edges()
    answer = np.asarray(visibility(shadows, *wall_points(directions)))
    assert answer[away_from_corners(directions, margin=1.2)].min() == 1
    assert shadows.partition.margin > technique.filter.reach


def test_gradients_through_the_maps_are_finite():
    """Points in all faces, at the light and on edges: faces that do not see a point leave no NaN behind."""
    mesh, light = room_with_plates(), PointLight.create(PLACE)

    def total(place):
        grids = CubeMap().grids(mesh, PointLight(place, light.color), above(), 16)
        points = jnp.asarray(PLACE + np.concatenate([walk_across_edges(3, 2), np.zeros((1, 3))]))
        where = [grid.locate(points) for grid in grids]
        shares = CubeMap().shares(grids, above(), points)
        return sum(jnp.sum(share * depth) for share, (_, depth) in zip(shares, where, strict=True))

    assert bool(jnp.isfinite(eqx.filter_jit(jax.grad(total))(light.position)).all())


def test_a_directional_light_needs_one_map_only():
    mesh, light, camera = plate_over_plane(), lights()["directional"], above()
    grids = make_partition("cube").grids(mesh, light, camera, 32)
    assert len(grids) == 1
    assert (CubeMap().select(grids, camera, mesh.vertices) == 0).all()


def test_bad_input_is_named():
    with pytest.raises(ValueError, match="margin must be an integer of at least 0; got -1"):
        CubeMap(-1)
    with pytest.raises(ValueError, match=r"8 texels leaves nothing inside margins of 5 .* at least 11"):
        make_technique("cube+pcf-3x3", 8).build(plate_over_plane(), PointLight.create(PLACE), above())
