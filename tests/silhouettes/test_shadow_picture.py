"""Shadow pictures and their derivatives against closed forms, fine sampling, and bad input."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from pictures import CELL, FINE, LIGHT, PLANE, RECEIVER, RESOLUTION, SCENES, STAGE, VIEW, gradient, hidden, squares

from shadowjax import BruteForceCaster, Camera, Mesh, PointLight, astype, camera_grid, mesh_edges, shadow_picture
from shadowjax.scenes.closed_forms import area, project
from shadowjax.scenes.plate_over_plane import PlateOverPlane
from shadowjax.scenes.shadow_moments import sphere_shadow_moments
from shadowjax.silhouettes._cells import BESIDE
from shadowjax.silhouettes._pieces import INSET
from shadowjax.silhouettes.coverage import pairs_of

FULL = jnp.ones((RESOLUTION, RESOLUTION))


@pytest.mark.parametrize("name", SCENES)
def test_area_and_its_gradient_are_those_of_the_closed_form(name):
    """Of every vertex and of the light, to 1e-6: the edges are straight, so nothing is approximated."""
    mesh, edges, closed = SCENES[name]

    def truth(vertices, position):
        return closed(vertices, PointLight(position, LIGHT.color)).area

    found = STAGE.summed(CELL * FULL, mesh, edges)
    np.testing.assert_allclose(found(mesh.vertices, LIGHT.position), truth(mesh.vertices, LIGHT.position), rtol=1e-6)
    expected = jax.jit(jax.grad(truth, (0, 1)))(mesh.vertices, LIGHT.position)
    for one, other in zip(gradient(CELL * FULL, mesh, edges), expected, strict=True):
        np.testing.assert_allclose(one, other, atol=1e-6 * float(jnp.max(jnp.abs(other))))


def test_first_moments_and_their_gradient():
    """A pixel's dark part counts at its centre, which costs the square of a pixel."""
    mesh, edges, closed = SCENES["plate"]

    @jax.jit
    @jax.grad
    def expected(vertices, axis):
        found = closed(vertices, LIGHT)
        return found.area * (found.centroid @ axis)

    spots = VIEW.plane_map.inverse(VIEW.centres())
    for axis in jnp.eye(2):
        found, truth = gradient(CELL * (spots @ axis), mesh, edges)[0], expected(mesh.vertices, axis)
        np.testing.assert_allclose(found, truth, atol=0.02 * float(jnp.max(jnp.abs(truth))))


@pytest.mark.parametrize("seed", range(2))
def test_forward_and_reverse_mode_agree(seed):
    mesh, edges = hidden(seed)
    rng = np.random.default_rng(seed)
    weights = jnp.asarray(rng.normal(size=FULL.shape))
    change = jnp.asarray(rng.normal(size=mesh.vertices.shape)), jnp.asarray(rng.normal(size=3))
    forward = jax.jvp(STAGE.summed(weights, mesh, edges), (mesh.vertices, LIGHT.position), change)[1]
    reverse = gradient(weights, mesh, edges)
    paired = sum(float(jnp.sum(a * b)) for a, b in zip(reverse, change, strict=True))
    np.testing.assert_allclose(forward, paired, rtol=1e-10)


@pytest.mark.parametrize("seed", range(3))
def test_values_against_fine_sampling(seed):
    """Of triangles that hide one another; the experiment holds slopes against differences of the same samples."""
    mesh, edges = hidden(seed)
    value = STAGE.picture(mesh.vertices, LIGHT.position, mesh, edges)
    truth = STAGE.in_pixels(STAGE.sampled(mesh.vertices, mesh, STAGE.fine_spots(FINE)))
    assert float(jnp.min(value)) >= 0
    assert float(jnp.max(value)) <= 1
    # A row of samples may lie on either side of an edge along it; and one pixel in a hundred may hold a part of an edge
    # that appears and vanishes within a third of a pixel.
    assert float(jnp.mean(jnp.abs(value - truth) > 3 / FINE)) < 0.01
    assert float(jnp.mean(jnp.abs(value - truth))) < 0.25 / FINE


def test_a_camera_sees_the_dark_side_of_a_plate_and_its_shadow():
    """Both are quadrilaterals in the image, apart from each other: their areas, and slopes in all that moves."""
    plate = PlateOverPlane()
    mesh, (rows, cols) = plate.mesh(), (18, 24)
    edges = mesh_edges(mesh)
    camera = Camera.look_at((0.2, 0.35, 5.0), (-0.3, 0.6, 0.0), phi_y=0.36, near=1.0, far=20.0, aspect=cols / rows)

    def view_of(eye):
        return camera_grid(eqx.tree_at(lambda c: c.position, camera, eye), cols, rows)

    def dark(vertices, lamp, eye):
        moved = Mesh(vertices, mesh.faces, mesh.face_colors)
        return jnp.sum(1 - shadow_picture(moved, edges, PointLight(lamp, LIGHT.color), view_of(eye)))

    def closed(vertices, lamp, eye):
        shadow = PLANE.to_world(project(vertices[:4], PointLight(lamp, LIGHT.color), PLANE))
        return sum(area(view_of(eye).locate(corners)[0]) for corners in (vertices[:4], shadow))

    at = mesh.vertices, LIGHT.position, camera.position
    (value, found), (truth, expected) = (
        jax.value_and_grad(dark, (0, 1, 2))(*at),
        jax.jit(jax.value_and_grad(closed, (0, 1, 2)))(*at),
    )
    np.testing.assert_allclose(value, truth, rtol=1e-6)
    assert 8 < float(truth) < 0.4 * rows * cols
    # The ground's own vertices tilt what receives the shadow; the closed form knows a level plane only.
    # The shadow passes from one of the ground's triangles to the other. Where, is known to the distance beside the edge
    # at which it is looked for, 5e-7 pixels; the edge moves there at some ten pixels a unit.
    for one, other in zip((found[0][:4], *found[1:]), (expected[0][:4], *expected[1:]), strict=True):
        np.testing.assert_allclose(one, other, atol=1e-5 * float(jnp.max(jnp.abs(other))))


def test_a_tessellated_sphere_nears_the_true_one():
    mesh, edges, _ = SCENES["sphere"]
    true = sphere_shadow_moments(jnp.asarray([0.0, 1.1, 0.0]), jnp.asarray(0.7), LIGHT, PLANE)
    size = float(STAGE.summed(CELL * FULL, mesh, edges)(mesh.vertices, LIGHT.position))
    assert 0.85 * float(true.area) < size < float(true.area)


def test_nothing_to_see_and_degenerate_input_keep_gradients_finite():
    """Triangles without area, coincident edges, a light in the plane of a face, and no shadow at all."""
    square = [(-0.5, 1.0, -0.5), (0.5, 1.0, -0.5), (0.5, 1.0, 0.5), (-0.5, 1.0, 0.5)]
    upright = [(0.9, 0.5, -0.5), (0.9, 0.5, 0.5), (0.9, 1.5, 0.5), (0.9, 1.5, -0.5)]  # x = 0.9: the light's own plane
    beyond = np.add(square, [50.0, 0.0, 0.0])
    for corners in (square + square, [*square, *upright], [square[0]] * 4, beyond):
        mesh, edges = squares(corners)
        for part in gradient(FULL, mesh, edges):
            assert np.isfinite(part).all()
        value = np.asarray(STAGE.picture(mesh.vertices, LIGHT.position, mesh, edges))
        assert np.isfinite(value).all()
    assert (value == 1).all()


@pytest.mark.parametrize("name", ["plate", "hidden"])
def test_float32_and_many_lights_at_once_agree_with_float64_one_by_one(name):
    """To the rounding of positions in pixels, but for where edges meet: float32 looks a hundredth of a pixel beside."""
    mesh, edges = hidden(0) if name == "hidden" else SCENES[name][:2]
    lamps = LIGHT.position + jnp.asarray([[0.0, 0.0, 0.0], [0.5, -0.6, 0.3]])
    single, view, receiver, color = astype((mesh, VIEW, RECEIVER, LIGHT.color), jnp.float32)

    @jax.vmap
    def pictures(lamp):
        return shadow_picture(single, edges, PointLight(lamp, color), view, BruteForceCaster(), receiver, 2000)

    found = np.asarray(pictures(lamps.astype(jnp.float32)))
    assert found.dtype == np.float32
    expected = np.stack([STAGE.picture(mesh.vertices, lamp, mesh, edges) for lamp in lamps])
    assert (1 - expected).sum(axis=(1, 2)).min() > 50
    eps = float(jnp.finfo(jnp.float32).eps)
    off = np.abs(found - expected)
    if name == "plate":
        assert off.max() <= 4 * RESOLUTION * eps
    # A piece ends as near to the true end as places beside it lie, and two edges end there. As in float64, one pixel in
    # a hundred may hold a part of an edge that appears and vanishes in between.
    assert (off > 2 * INSET * BESIDE * eps**0.5).mean() < 0.01
    assert off.mean() < 0.25 / FINE


def test_room_that_is_too_small_is_refused():
    count = jax.jit(lambda start, end: pairs_of(start, end, jnp.ones(4, bool), VIEW, 16).num)
    with pytest.raises(Exception, match="raise max_pairs"):
        count(jnp.zeros((4, 2)), jnp.full((4, 2), 30.0)).block_until_ready()
