"""Shadow pictures and their derivatives against closed forms, fine sampling, and bad input."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from pictures import CELL, FINE, LIGHT, PLANE, RESOLUTION, SCENES, STAGE, VIEW, gradient, hidden, squares

from shadowjax import (
    BruteForce,
    DirectionalLight,
    Exact,
    Mesh,
    PointLight,
    camera_grid,
    make_scene,
    mesh_edges,
    shadow_picture,
    trace_surface,
    visibility_on,
)
from shadowjax._numerics import normalize
from shadowjax.geometry.scenes.shadow_moments import sphere_shadow_moments
from shadowjax.rays.coverage import pairs_of
from shadowjax.shading import downsample

FULL = jnp.ones((RESOLUTION, RESOLUTION))


@pytest.mark.parametrize("name", SCENES)
def test_area_and_its_gradient_are_those_of_the_closed_form(name):
    """Of every vertex and of the light, to 1e-6: the edges are straight, so nothing is approximated."""
    mesh, edges, closed = SCENES[name]

    def area(vertices, position):
        return closed(vertices, PointLight(position, LIGHT.color)).area

    found = STAGE.summed(CELL * FULL, mesh, edges)
    np.testing.assert_allclose(found(mesh.vertices, LIGHT.position), area(mesh.vertices, LIGHT.position), rtol=1e-6)
    expected = jax.jit(jax.grad(area, (0, 1)))(mesh.vertices, LIGHT.position)
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


def test_a_camera_sees_outlines_and_shadows_move():
    """A plate over its floor, seen by a camera: values, and the slope when plate, camera and light move."""
    scene = make_scene("plate-over-plane", dtype=jnp.float64)
    edges, (rows, cols), fine = mesh_edges(scene.mesh), (12, 16), 24
    weights = jnp.sin(0.4 * jnp.arange(float(cols)))[None] * jnp.cos(0.3 * jnp.arange(float(rows)))[:, None]
    light = scene.lights[0]

    def moved(amount):
        lift = jnp.zeros_like(scene.mesh.vertices).at[:4].set(amount * jnp.asarray([0.5, 0.4, 0.3]))
        camera = eqx.tree_at(
            lambda c: c.position, scene.camera, scene.camera.position + amount * jnp.asarray([0.3, 0.0, 0.4])
        )
        turned = DirectionalLight(light.direction + amount * jnp.asarray([0.2, 0.0, -0.1]), light.color)
        return Mesh(scene.mesh.vertices + lift, scene.mesh.faces, scene.mesh.face_colors), turned, camera

    def drawn(amount):
        mesh, lamp, camera = moved(amount)
        return shadow_picture(mesh, edges, lamp, camera_grid(camera, cols, rows))

    @jax.jit
    def truth(amount):
        mesh, lamp, camera = moved(amount)
        lamp = DirectionalLight(normalize(lamp.direction), lamp.color)
        surface = trace_surface(mesh, camera, cols, rows, BruteForce(), samples_per_axis=fine)
        return downsample(visibility_on(surface, Exact().build(mesh, lamp, camera)), fine)

    value, slope = jax.jvp(drawn, (0.0,), (1.0,))
    np.testing.assert_allclose(value, truth(0.0), atol=2 / fine)
    step = 0.02
    expected = float(jnp.sum(weights * (truth(step) - truth(-step)))) / (2 * step)
    # Changes of both signs cancel in the sum: the error is held against what moves.
    assert abs(float(jnp.sum(weights * slope)) - expected) < 0.02 * float(jnp.sum(jnp.abs(weights * slope)))


def test_a_tessellated_sphere_nears_the_true_one():
    mesh, edges, _ = SCENES["sphere"]
    true = sphere_shadow_moments(jnp.asarray([0.0, 1.1, 0.0]), jnp.asarray(0.7), LIGHT, PLANE)
    area = float(STAGE.summed(CELL * FULL, mesh, edges)(mesh.vertices, LIGHT.position))
    assert 0.85 * float(true.area) < area < float(true.area)


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


def test_room_that_is_too_small_is_refused():
    count = jax.jit(lambda start, end: pairs_of(start, end, jnp.ones(4, bool), VIEW, 16).count)
    with pytest.raises(Exception, match="raise max_pairs"):
        count(jnp.zeros((4, 2)), jnp.full((4, 2), 30.0)).block_until_ready()
