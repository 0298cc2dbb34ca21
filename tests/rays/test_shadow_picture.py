"""Shadow pictures and their derivatives against closed forms, differences of fine sampling, and bad input."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from pictures import (
    CELL, COLS, LIGHT, PLANE, RECEIVER, ROWS, VIEW, gradient, padded, picture, plate, random_triangles, sphere, summed,
    tetrahedron, two_plates,
)  # fmt: skip

from shadowjax import BruteForce, Mesh, PointLight, RayGrid
from shadowjax.geometry.scenes.closed_forms import project
from shadowjax.geometry.scenes.shadow_moments import (
    convex_shadow_moments, polygon_moments, sphere_shadow_moments, union_moments,
)  # fmt: skip
from shadowjax.rays.coverage import pairs_of
from shadowjax.rays.light_space import light_space

FULL = jnp.ones((ROWS, COLS))


def polygon(vertices, light):
    return polygon_moments(project(vertices[:4], light, PLANE))


def union(vertices, light):
    return union_moments(project(vertices[:8].reshape(2, 4, 3), light, PLANE))


def convex(faces):
    return lambda vertices, light: convex_shadow_moments(vertices[np.asarray(faces)], light, PLANE)


SCENES = {"plate": (plate, polygon), "two plates": (two_plates, union), "tetrahedron": (tetrahedron, None), "sphere": (sphere, None)}


@pytest.mark.parametrize("name", SCENES)
def test_area_and_its_gradient_are_those_of_the_closed_form(name):
    """Of every vertex and of the light, to 1e-6: the edges are straight, so nothing is approximated."""
    make, closed = SCENES[name]
    mesh, edges = make()
    closed = convex(mesh.faces) if closed is None else closed

    def area(vertices, position):
        return closed(vertices, PointLight(position, LIGHT.color)).area

    found = summed(CELL * FULL, mesh, edges)
    np.testing.assert_allclose(found(mesh.vertices, LIGHT.position), area(mesh.vertices, LIGHT.position), rtol=1e-6)
    expected = jax.jit(jax.grad(area, (0, 1)))(mesh.vertices, LIGHT.position)
    for one, other in zip(gradient(CELL * FULL, mesh, edges), expected, strict=True):
        np.testing.assert_allclose(one, other, atol=1e-6 * float(jnp.max(jnp.abs(other))))


def test_centroid_and_its_gradient():
    """Where the picture's mean lies: a pixel's dark part counts at its centre, which costs the square of a pixel."""
    mesh, edges = plate()
    u, v = jnp.moveaxis(RECEIVER_SPOTS, -1, 0)
    for weights, axis in ((u, 0), (v, 1)):
        first = lambda vertices, position: polygon(vertices, PointLight(position, LIGHT.color))  # noqa: E731
        expected = jax.grad(lambda v: first(v, LIGHT.position).centroid[axis] * first(v, LIGHT.position).area)(mesh.vertices)  # noqa: B023
        found = gradient(CELL * weights, mesh, edges)[0]
        np.testing.assert_allclose(found, expected, atol=0.02 * float(jnp.max(jnp.abs(expected))))


RECEIVER_SPOTS = VIEW.plane_map.inverse(VIEW.centres())


@pytest.mark.parametrize("seed", range(3))
def test_forward_and_reverse_mode_agree_and_follow_central_differences(seed):
    """On triangles that hide one another; the differences are those of the picture itself, taken far from kinks."""
    mesh, edges = random_triangles(seed)
    rng = np.random.default_rng(seed)
    weights = jnp.asarray(rng.normal(size=(ROWS, COLS)))
    change = jnp.asarray(rng.normal(size=mesh.vertices.shape)), jnp.asarray(rng.normal(size=3))
    function = summed(weights, mesh, edges)
    at = mesh.vertices, LIGHT.position
    forward = jax.jvp(function, at, change)[1]
    reverse = gradient(weights, mesh, edges)
    paired = sum(float(jnp.sum(a * b)) for a, b in zip(reverse, change, strict=True))
    np.testing.assert_allclose(forward, paired, rtol=1e-10)
    step = 1e-5
    low, high = (function(*(a + sign * step * b for a, b in zip(at, change, strict=True))) for sign in (-1, 1))
    np.testing.assert_allclose((high - low) / (2 * step), forward, rtol=1e-3)


@pytest.mark.parametrize("seed", range(3))
def test_values_and_slopes_against_fine_sampling(seed):
    """Exact visibility on 24 × 24 samples a pixel, and its central differences: the picture's own slope to 5 %."""
    mesh, edges = random_triangles(seed)
    fine = 24
    grid = RayGrid(VIEW.space, VIEW.plane_map, VIEW.far, ROWS * fine, COLS * fine)
    ground = RECEIVER.mesh
    spots = VIEW.plane_map.inverse(grid.centres())
    points = PLANE.to_world(spots)
    space = light_space(LIGHT, jnp.asarray([1.0, 0.0, 0.0]), *mesh.bounds())

    @jax.jit
    def sampled(vertices):
        lit = BruteForce().visible(Mesh(vertices, mesh.faces, mesh.face_colors), space, points)
        return jnp.mean(lit.reshape(ROWS, fine, COLS, fine).astype(float), axis=(1, 3))

    value, truth = picture(mesh.vertices, LIGHT.position, mesh, edges), sampled(mesh.vertices)
    assert float(jnp.min(value)) >= 0
    assert float(jnp.max(value)) <= 1
    # An edge may pass a row of samples that it crosses flat: 1/24 of the pixel, and twice where two cross it.
    np.testing.assert_allclose(value, truth, atol=3 / fine)
    assert float(jnp.mean(jnp.abs(value - truth))) < 0.002
    assert ground.num_faces == 2
    weights = jnp.sin(spots.reshape(ROWS, fine, COLS, fine, 2)[:, 0, :, 0, 0] * 1.3 + 0.4)
    change, step = jnp.asarray(np.random.default_rng(seed).normal(size=3)), 0.02
    slope = float(jnp.sum(gradient(weights, mesh, edges)[0][:36] @ change))
    ends = [float(jnp.sum(weights * (1 - sampled(mesh.vertices + sign * step * change)))) for sign in (-1, 1)]
    np.testing.assert_allclose((ends[1] - ends[0]) / (2 * step), slope, rtol=0.05)


def test_a_tessellated_sphere_nears_the_true_one():
    mesh, edges = sphere()
    true = sphere_shadow_moments(jnp.asarray([0.0, 1.1, 0.0]), jnp.asarray(0.7), LIGHT, PLANE)
    area = float(summed(CELL * FULL, mesh, edges)(mesh.vertices, LIGHT.position))
    assert 0.85 * float(true.area) < area < float(true.area)


def test_nothing_to_see_and_degenerate_input_keep_gradients_finite():
    """Triangles without area, coincident edges, a light in the plane of a face, and no shadow at all."""
    square = [(-0.5, 1.0, -0.5), (0.5, 1.0, -0.5), (0.5, 1.0, 0.5), (-0.5, 1.0, 0.5)]
    upright = [(0.9, 0.5, -0.5), (0.9, 0.5, 0.5), (0.9, 1.5, 0.5), (0.9, 1.5, -0.5)]  # x = 0.9: the light's own plane
    beyond = np.array(square) + [50.0, 0.0, 0.0]
    for corners in (square + square, [*square, *upright], list(beyond), [square[0]] * 4):
        mesh, edges = padded(*quads_of(corners))
        for part in gradient(FULL, mesh, edges):
            assert np.isfinite(part).all()
        value = np.asarray(picture(mesh.vertices, LIGHT.position, mesh, edges))
        assert np.isfinite(value).all()
    assert (value == 1).all()


def quads_of(corners):
    from pictures import quads

    return quads(np.array(corners))


def test_room_that_is_too_small_is_refused():
    ends = jnp.zeros((4, 2)), jnp.full((4, 2), 30.0)
    with pytest.raises(Exception, match="raise max_pairs"):
        pairs_of(*ends, jnp.ones(4, bool), VIEW, 16).count.block_until_ready()
