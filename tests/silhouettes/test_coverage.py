"""Edge-aware depth: exact area of texels at a straight edge, in value and slope, for depth and for its powers."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from shapes import plate_over_plane

from shadowjax import DirectionalLight, Mesh, RayGrid, astype, coverage_planes, mesh_edges, plane_receiver
from shadowjax._numerics import normalize
from shadowjax.geometry.light_space import OctahedralSpace
from shadowjax.rays.plane_map import Box
from shadowjax.silhouettes._cells import BESIDE
from shadowjax.silhouettes._pieces import INSET
from shadowjax.silhouettes.coverage import edge_ends, powers

SIZE = 16
UP, U, V = (jnp.asarray(axis) for axis in ([0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]))
MESH = plate_over_plane()
EDGES = mesh_edges(MESH)
# Straight down on a square of the floor, one texel 1/5 of a unit wide.
_, GRID = plane_receiver(UP, U, V, jnp.asarray([-1.57, -1.6]), jnp.asarray([1.63, 1.6]), (SIZE, SIZE))
TEXEL = 3.2 / SIZE


def planes(shift, turn=0.0):
    """Depth and its square with the plate moved along u, and turned."""
    plate = MESH.vertices[4:]
    x, z = plate[:, 0], plate[:, 2]
    turned = jnp.stack(
        [x * jnp.cos(turn) - z * jnp.sin(turn) + shift, plate[:, 1], x * jnp.sin(turn) + z * jnp.cos(turn)], -1
    )
    mesh = Mesh(jnp.concatenate([MESH.vertices[:4], turned]), MESH.faces, MESH.face_colors)
    return coverage_planes(mesh, EDGES, GRID, powers(2))


@pytest.mark.parametrize("turn", [0.0, 0.3, 0.785])
def test_blended_planes_hold_the_exact_share_of_the_plate(turn):
    """Near and far depth are flat, so every plane's sum tells the plate's area: 4 square units, at any turn."""
    value, slope = jax.jvp(lambda shift: planes(shift, turn), (0.0,), (1.0,))
    for k, (near, far) in enumerate(zip(*depths_of_powers(), strict=True)):
        covered = (far - value[k]) / (far - near)
        assert float(jnp.min(covered)) >= -1e-9
        assert float(jnp.max(covered)) <= 1 + 1e-9
        np.testing.assert_allclose(jnp.sum(covered) * TEXEL**2, 4.0, rtol=1e-9)
        # Sliding changes no area, and moves its middle by one: exactly, since texels know what they are covered by.
        moved = -slope[k] / (far - near)
        np.testing.assert_allclose(jnp.sum(moved), 0.0, atol=1e-9)
        if turn == 0.0:
            # An upright edge: a texel that it crosses changes by one texel's width for each width that it moves.
            crossed = jnp.abs(moved) > 1e-9
            np.testing.assert_allclose(jnp.abs(moved[crossed]) * TEXEL, 1.0, atol=1e-9)
            assert int(jnp.sum(crossed)) == 2 * 2.0 / TEXEL


def depths_of_powers():
    """(near, far) of each plane: depth from the view's start, and its square."""
    far = float(GRID.space.origin[1])
    return jnp.array([[far - 1.0, (far - 1.0) ** 2], [far, far**2]])


@jax.jit
def seen_along(direction):
    """The rays of a parallel light, in a map almost as wide as the floor."""
    mesh = astype(MESH, direction.dtype)
    space = DirectionalLight(normalize(direction), 1 + 0 * direction).space(1 + 0 * direction, *mesh.bounds())
    half = 3 + 0 * direction[:2]
    return mesh, RayGrid(space, Box(-half, half), 12 + 0 * direction[0], SIZE, SIZE)


def test_float32_and_many_lights_at_once_agree_with_float64_one_by_one():
    """Depth to the rounding of positions in texels; at a corner of the plate, to where it is looked for."""
    directions = jnp.asarray([[0.1, -1.0, 0.2], [-0.4, -1.0, 0.25], [0.6, -0.9, -0.5]])

    def depth(direction, room=None):
        mesh, grid = seen_along(direction)
        return coverage_planes(mesh, EDGES, grid, powers(2), max_pairs=room)[0]

    # The room is no multiple of what is looked at together.
    found = np.asarray(jax.vmap(lambda one: depth(one, 500))(directions.astype(jnp.float32)))
    assert found.dtype == np.float32
    expected = np.stack([depth(one) for one in directions])
    assert expected.std(axis=(1, 2)).min() > 0.3
    eps, jump = float(jnp.finfo(jnp.float32).eps), 1 / 0.6  # the plate is 1 above the floor: at most that along a ray
    off = np.abs(found - expected)
    assert off.max() <= (INSET * BESIDE) ** 2 * eps * jump
    assert (off > 8 * SIZE * eps * jump).sum() <= 4 * len(directions)


def test_a_map_bent_by_a_point_light_is_refused():
    bent = RayGrid(
        OctahedralSpace(jnp.asarray([0.0, 4.0, 0.0])), Box(-jnp.ones(2), jnp.ones(2)), jnp.asarray(9.0), 4, 4
    )
    with pytest.raises(ValueError, match="keep lines straight"):
        edge_ends(bent, MESH, EDGES)
