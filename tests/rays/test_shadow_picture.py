"""Shadow pictures and their derivatives against closed forms, differences of fine sampling, and bad input."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from pictures import (
    CELL,
    COLS,
    LIGHT,
    PLANE,
    RECEIVER,
    ROWS,
    VIEW,
    gradient,
    padded,
    picture,
    plate,
    quads,
    random_triangles,
    sphere,
    summed,
    tetrahedron,
    two_plates,
)  # fmt: skip

from shadowjax import (
    BruteForce,
    DirectionalLight,
    Exact,
    Mesh,
    PointLight,
    RayGrid,
    camera_grid,
    make_scene,
    mesh_edges,
    shadow_picture,
    trace_surface,
    visibility_on,
)  # fmt: skip
from shadowjax._numerics import normalize
from shadowjax.geometry.scenes.closed_forms import project
from shadowjax.geometry.scenes.shadow_moments import (
    convex_shadow_moments,
    polygon_moments,
    sphere_shadow_moments,
    union_moments,
)  # fmt: skip
from shadowjax.rays.coverage import pairs_of
from shadowjax.rays.grid import Grid
from shadowjax.rays.light_space import light_space
from shadowjax.shading import downsample

FULL = jnp.ones((ROWS, COLS))


def polygon(vertices, light):
    return polygon_moments(project(vertices[:4], light, PLANE))


def union(vertices, light):
    return union_moments(project(vertices[:8].reshape(2, 4, 3), light, PLANE))


def convex(faces):
    return lambda vertices, light: convex_shadow_moments(vertices[np.asarray(faces)], light, PLANE)


SCENES = {
    "plate": (plate, polygon),
    "two plates": (two_plates, union),
    "tetrahedron": (tetrahedron, None),
    "sphere": (sphere, None),
}


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

    def first_moment(vertices, axis):
        found = polygon(vertices, LIGHT)
        return found.centroid[axis] * found.area

    for weights, axis in ((u, 0), (v, 1)):
        expected = jax.grad(first_moment)(mesh.vertices, axis)
        found = gradient(CELL * weights, mesh, edges)[0]
        np.testing.assert_allclose(found, expected, atol=0.02 * float(jnp.max(jnp.abs(expected))))


RECEIVER_SPOTS = VIEW.plane_map.inverse(VIEW.centres())


@pytest.mark.parametrize("seed", range(2))
def test_forward_and_reverse_mode_agree(seed):
    mesh, edges = random_triangles(seed)
    rng = np.random.default_rng(seed)
    weights = jnp.asarray(rng.normal(size=(ROWS, COLS)))
    change = jnp.asarray(rng.normal(size=mesh.vertices.shape)), jnp.asarray(rng.normal(size=3))
    forward = jax.jvp(summed(weights, mesh, edges), (mesh.vertices, LIGHT.position), change)[1]
    reverse = gradient(weights, mesh, edges)
    paired = sum(float(jnp.sum(a * b)) for a, b in zip(reverse, change, strict=True))
    np.testing.assert_allclose(forward, paired, rtol=1e-10)


FINE = 48
FINE_GRID = RayGrid(VIEW.space, VIEW.plane_map, VIEW.far, ROWS * FINE, COLS * FINE)
FINE_SPOTS = VIEW.plane_map.inverse(FINE_GRID.centres())
FINE_WEIGHTS = jnp.sin(1.3 * FINE_SPOTS[..., 0] + 0.4)


def in_pixels(samples):
    return jnp.mean(samples.reshape(ROWS, FINE, COLS, FINE), axis=(1, 3))


@jax.jit
def sampled(vertices, mesh):
    """Visibility of 48 × 48 places a pixel."""
    space = light_space(LIGHT, jnp.asarray([1.0, 0.0, 0.0]), *RECEIVER.mesh.bounds())
    moved = Mesh(vertices, mesh.faces, mesh.face_colors)
    return Grid().visible(moved, space, PLANE.to_world(FINE_SPOTS)).astype(vertices.dtype)


@pytest.mark.parametrize("seed", [0, 3])
def test_values_and_slopes_against_fine_sampling(seed):
    """Of triangles that hide one another: values to the sampling's own error, the slope of an image loss to 5 %."""
    mesh, edges = random_triangles(seed)
    value, truth = picture(mesh.vertices, LIGHT.position, mesh, edges), in_pixels(sampled(mesh.vertices, mesh))
    assert float(jnp.min(value)) >= 0
    assert float(jnp.max(value)) <= 1
    # A row of samples may lie on either side of an edge along it; and three pixels in a hundred may hold a part of an
    # edge that appears and vanishes within a third of a pixel.
    assert float(jnp.mean(jnp.abs(value - truth) > 3 / FINE)) < 0.03
    assert float(jnp.mean(jnp.abs(value - truth))) < 0.25 / FINE
    change, step = jnp.asarray(np.random.default_rng(seed).normal(size=3)), 0.02
    slope = float(jnp.sum(gradient(in_pixels(FINE_WEIGHTS), mesh, edges)[0][:36] @ change))
    low, high = (
        float(jnp.sum(FINE_WEIGHTS * (1 - sampled(mesh.vertices + sign * step * change, mesh)))) / FINE**2
        for sign in (-1, 1)
    )
    np.testing.assert_allclose((high - low) / (2 * step), slope, rtol=0.05)


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
    mesh, edges = sphere()
    true = sphere_shadow_moments(jnp.asarray([0.0, 1.1, 0.0]), jnp.asarray(0.7), LIGHT, PLANE)
    area = float(summed(CELL * FULL, mesh, edges)(mesh.vertices, LIGHT.position))
    assert 0.85 * float(true.area) < area < float(true.area)


def test_nothing_to_see_and_degenerate_input_keep_gradients_finite():
    """Triangles without area, coincident edges, a light in the plane of a face, and no shadow at all."""
    square = [(-0.5, 1.0, -0.5), (0.5, 1.0, -0.5), (0.5, 1.0, 0.5), (-0.5, 1.0, 0.5)]
    upright = [(0.9, 0.5, -0.5), (0.9, 0.5, 0.5), (0.9, 1.5, 0.5), (0.9, 1.5, -0.5)]  # x = 0.9: the light's own plane
    beyond = np.add(square, [50.0, 0.0, 0.0])
    for corners in (square + square, [*square, *upright], list(beyond), [square[0]] * 4):
        mesh, edges = padded(*quads_of(corners))
        for part in gradient(FULL, mesh, edges):
            assert np.isfinite(part).all()
        value = np.asarray(picture(mesh.vertices, LIGHT.position, mesh, edges))
        assert np.isfinite(value).all()
    assert (value == 1).all()


def quads_of(corners):
    return quads(np.array(corners))


def test_room_that_is_too_small_is_refused():
    count = jax.jit(lambda start, end: pairs_of(start, end, jnp.ones(4, bool), VIEW, 16).count)
    with pytest.raises(Exception, match="raise max_pairs"):
        count(jnp.zeros((4, 2)), jnp.full((4, 2), 30.0)).block_until_ready()
