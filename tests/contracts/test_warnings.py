"""What is warned of: light that reaches nothing which is seen, given in every way that a person gives it."""

import warnings

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from shapes import above, plate_over_plane

from shadowjax import (
    BruteForceCaster,
    DirectionalLight,
    Mesh,
    camera_grid,
    coverage_depth,
    mesh_edges,
    plane_receiver,
    shade,
    shadow_picture,
    trace_surface,
)
from shadowjax._checks import SceneWarning

TOWARDS = np.array([0.4, 1.0, -0.25])
MESH, CAMERA = plate_over_plane(), above()


def picture(light, jitted=False):
    surface = trace_surface(MESH, CAMERA, 8, 6, BruteForceCaster())
    ones = jnp.ones(surface.face.shape)
    draw = (
        jax.jit(lambda light: shade(surface, (light,), (ones,)))
        if jitted
        else lambda light: shade(surface, (light,), (ones,))
    )
    return draw(light)


def test_the_direction_to_the_sun_is_the_other_habit():
    one, other = DirectionalLight.create(-TOWARDS), DirectionalLight.create(towards=TOWARDS)
    np.testing.assert_array_equal(one.direction, other.direction)
    for given in ((), (TOWARDS, TOWARDS)):
        with pytest.raises(ValueError, match=r"give one of direction.*towards"):
            DirectionalLight.create(*given[:1], **({"towards": TOWARDS} if len(given) == 2 else {}))
    with pytest.raises(ValueError, match="direction towards the light must not be the zero vector"):
        DirectionalLight.create(towards=(0.0, 0.0, 0.0))


def test_a_sun_below_the_floor_is_warned_of_once_and_only_where_values_are_known():
    with pytest.warns(SceneWarning, match=r"no surface that is seen faces the light.*towards="):
        picture(DirectionalLight.create(TOWARDS))
    picture(DirectionalLight.create(TOWARDS), jitted=True)
    picture(DirectionalLight.create(towards=TOWARDS))
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("default")
        for _ in range(3):
            picture(DirectionalLight.create(TOWARDS))
    assert len(said) == 1


def moved(shift):
    return Mesh(MESH.vertices + shift, MESH.faces, MESH.face_colors)


def test_a_receiver_that_faces_away_is_warned_of():
    edges = mesh_edges(MESH)
    axes = jnp.asarray([[1.0, 0, 0], [0, 0, 1.0]])
    size = jnp.asarray([2.0, 2.0])
    receiver, view = plane_receiver(jnp.asarray([0.0, -1, 0]), *axes, -size, size, (6, 6))
    sun, away = DirectionalLight.create(towards=TOWARDS), DirectionalLight.create(TOWARDS)
    lit_side = float(receiver.mesh.face_normals()[0, 1])
    lights = (sun, away) if lit_side > 0 else (away, sun)
    shadow_picture(MESH, edges, lights[0], view, receiver=receiver)
    with pytest.warns(SceneWarning, match="no surface that the view may see faces the light"):
        shadow_picture(MESH, edges, lights[1], view, receiver=receiver)


@pytest.mark.long
def test_faces_turned_away_are_warned_of_under_grad_and_without_a_receiver():
    edges, away = mesh_edges(MESH), DirectionalLight.create(TOWARDS)
    view = camera_grid(CAMERA, 6, 6)
    axes, size = jnp.asarray([[1.0, 0, 0], [0, 0, 1.0]]), jnp.asarray([2.0, 2.0])
    receiver, plane = plane_receiver(jnp.asarray([0.0, -1, 0]), *axes, -size, size, (6, 6))
    # A plane that faces up, or one that faces down: whichever the light does not reach.
    dark = away if float(receiver.mesh.face_normals()[0, 1]) > 0 else DirectionalLight.create(towards=TOWARDS)
    with pytest.warns(SceneWarning, match="no surface that the view may see faces the light"):
        jax.grad(lambda shift: shadow_picture(moved(shift), edges, dark, plane, receiver=receiver).sum())(0.0)
    # The mesh itself is seen from above: the sun below lights no side that shows.
    with pytest.warns(SceneWarning, match="turn the receiver round"):
        shadow_picture(MESH, edges, away, view)
    with pytest.warns(SceneWarning, match="turn the receiver round"):
        jax.grad(lambda shift: shadow_picture(moved(shift), edges, away, view).sum())(0.0)


def test_a_map_that_sees_nothing_is_warned_of():
    """A plane that faces away from what is cast: its rays run the other way."""
    edges, size = mesh_edges(MESH), jnp.asarray([2.0, 2.0])
    axes = jnp.asarray([[1.0, 0, 0], [0, 0, 1.0]])
    _, one = plane_receiver(jnp.asarray([0.0, -1, 0]), *axes, -size, size, (6, 6))
    _, other = plane_receiver(jnp.asarray([0.0, 20, 0]), *axes[::-1], -size, size, (6, 6))
    seeing, blind = (one, other) if float(one.space.frame[1, 1]) > 0 else (other, one)
    total = lambda grid: lambda shift: coverage_depth(moved(shift), edges, grid).sum()  # noqa: E731
    assert abs(float(jax.grad(total(seeing))(0.0))) > 1e-3
    for differentiate in (lambda f: f, jax.grad):
        with pytest.warns(SceneWarning, match="no ray of the grid meets the mesh.*turn the grid round"):
            value = float(differentiate(total(blind))(0.0))
        assert value == pytest.approx(0 if differentiate is jax.grad else 36 * float(blind.far))
