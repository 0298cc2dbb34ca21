"""Shadows known in closed form against ray tests of the scenes' own triangles, and against independent geometry."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial import ConvexHull, HalfspaceIntersection, KDTree

from shadowjax._types import astype
from shadowjax.geometry.light import DirectionalLight, PointLight, SpotLight
from shadowjax.scenes import SCENES
from shadowjax.scenes import closed_forms as exact
from shadowjax.scenes.base import sun
from shadowjax.scenes.comb import Comb
from shadowjax.scenes.plate_over_plane import PlateOverPlane
from shadowjax.scenes.sphere_over_plane import SphereOverPlane
from shadowjax.scenes.two_plates import TwoPlates

LIGHTS = {
    "directional": DirectionalLight.create((-0.6, -1.0, 0.25), dtype=jnp.float64),
    "point": PointLight.create((0.9, 3.1, -0.4), dtype=jnp.float64),
    "spot": SpotLight.create((0.9, 3.1, -0.4), (-0.3, -1.0, 0.1), 0.9, dtype=jnp.float64),
}
POSITIONS = np.random.default_rng(5).uniform((-2.6, -1.8), (1.6, 1.8), size=(1500, 2))
lights = pytest.mark.parametrize("light", LIGHTS.values(), ids=LIGHTS)

area = jax.jit(exact.area)
contains = jax.jit(exact.contains)
signed_distance = jax.jit(exact.signed_distance)
union_area = jax.jit(exact.union_area)
union_contains = jax.jit(exact.union_contains)
union_distance = jax.jit(exact.union_signed_distance)
ellipse_distance = jax.jit(lambda ellipse, positions: ellipse.signed_distance(positions))


def occluded(triangles, points, light):
    """Brute force: does the segment from a point to the light hit a triangle? (Möller and Trumbore.)"""
    to_light, distance = (np.asarray(a) for a in light.to_light(jnp.asarray(points)))
    shaded = np.zeros(len(points), bool)
    for a, b, c in triangles:
        first, second = b - a, c - a
        across = np.cross(to_light, second)
        determinant = across @ first
        offset = points - a
        u = np.einsum("ij,ij->i", offset, across) / determinant
        turned = np.cross(offset, first)
        v = np.einsum("ij,ij->i", to_light, turned) / determinant
        t = turned @ second / determinant
        shaded |= (u >= 0) & (v >= 0) & (u + v <= 1) & (t > 1e-9) & (t < distance)
    return shaded


def on_ground(positions, height=0.0):
    return np.insert(positions, 1, height, axis=1)


def central_difference(function, value, step=1e-6):
    return (function(value + step) - function(value - step)) / (2 * step)


def edge_samples(polygon, count=4000):
    fraction = np.arange(count)[:, None] / count
    return np.concatenate([a + fraction * (b - a) for a, b in zip(polygon, np.roll(polygon, -1, axis=0), strict=True)])


# --- polygons -------------------------------------------------------------------------------------------------------


@lights
def test_plate_shadow_is_what_rays_find(light):
    scene = PlateOverPlane()
    triangles = np.asarray(scene.mesh().triangles())[:2]
    shaded = occluded(triangles, on_ground(POSITIONS), light)
    assert 100 < shaded.sum() < 1400
    polygon = scene.shadow_polygon(light)
    np.testing.assert_array_equal(contains(polygon, jnp.asarray(POSITIONS)), shaded)


@lights
def test_union_of_two_plates_is_what_rays_find(light):
    scene = TwoPlates(upper_x=0.4, upper_z=0.35)
    triangles = np.asarray(scene.mesh().triangles())[:4]
    polygons, positions = scene.shadow_polygons(light), jnp.asarray(POSITIONS)
    shaded = occluded(triangles, on_ground(POSITIONS), light)
    both = contains(polygons[0], positions) & contains(polygons[1], positions)
    assert int(both.sum()) > 20  # they overlap, so that the union is worth a test
    np.testing.assert_array_equal(union_contains(polygons, positions), shaded)
    np.testing.assert_array_equal(union_distance(polygons, positions) <= 0, shaded)


@lights
def test_shadow_of_one_plate_on_the_other_is_what_rays_find(light):
    scene = TwoPlates()
    half = float(scene.lower_half)
    positions = np.random.default_rng(6).uniform(-half, half, size=POSITIONS.shape)
    shaded = occluded(np.asarray(scene.mesh().triangles())[2:4], on_ground(positions, float(scene.lower_height)), light)
    assert 20 < shaded.sum() < 1480
    np.testing.assert_array_equal(contains(scene.shadow_on_lower(light), jnp.asarray(positions)), shaded)


@lights
def test_comb_shadow_is_what_rays_find(light):
    scene, positions = Comb(num_slats=7), jnp.asarray(POSITIONS)
    shaded = occluded(np.asarray(scene.mesh().triangles())[:14], on_ground(POSITIONS), light)
    polygons = scene.shadow_polygons(light)
    np.testing.assert_array_equal(union_contains(polygons, positions), shaded)
    alone = np.min([signed_distance(polygon, positions) for polygon in polygons], axis=0)
    np.testing.assert_allclose(union_distance(polygons, positions), alone, atol=1e-13)
    np.testing.assert_allclose(union_area(polygons), sum(float(area(polygon)) for polygon in polygons), rtol=1e-12)


def test_area_of_a_level_plates_shadow(dtype, rounding):
    scene = astype(PlateOverPlane(), dtype)
    plate = 4 * float(scene.half_x) * float(scene.half_z)
    parallel = scene.shadow_polygon(astype(LIGHTS["directional"], dtype))
    assert parallel.dtype == dtype
    np.testing.assert_allclose(area(parallel), plate, rtol=10 * rounding)
    central = scene.shadow_polygon(astype(LIGHTS["point"], dtype))
    np.testing.assert_allclose(area(central), plate * (3.1 / (3.1 - 1.0)) ** 2, rtol=10 * rounding)


def test_area_follows_the_light_as_its_derivative_says(dtype, rounding):
    scene = astype(PlateOverPlane(), dtype)

    def shadow_area(light_height):
        position = jnp.stack([jnp.full_like(light_height, 0.9), light_height, jnp.full_like(light_height, -0.4)])
        return area(scene.shadow_polygon(PointLight(position, jnp.ones(3, dtype))))

    # A(H) = plate (H / (H - h))², so A' = -2 h plate H / (H - h)³
    plate, height, tall = 4 * 0.8 * 0.6, 1.0, 3.1
    expected = -2 * height * plate * tall / (tall - height) ** 3
    np.testing.assert_allclose(jax.grad(shadow_area)(jnp.asarray(tall, dtype)), expected, rtol=100 * rounding)


def test_signed_distance_to_a_polygon(dtype, rounding):
    square = jnp.asarray([(0, 0), (2, 0), (2, 1), (0, 1)], dtype)
    at = jnp.asarray([(1, 0.5), (1, 0.9), (3, 0.5), (5, 5), (-3, -4), (2, 0.5)], dtype)
    expected = [-0.5, -0.1, 1.0, 5.0, 5.0, 0.0]
    for polygon in (square, square[::-1]):  # either way round
        np.testing.assert_allclose(signed_distance(polygon, at), expected, atol=10 * rounding)
    slopes = jax.jit(jax.vmap(jax.grad(exact.signed_distance, argnums=1), in_axes=(None, 0)))(square, at[:5])
    np.testing.assert_allclose(slopes[1:], [(0, 1), (1, 0), (0.6, 0.8), (-0.6, -0.8)], atol=10 * rounding)
    assert np.isfinite(slopes).all()


def test_signed_distance_moves_with_the_light():
    scene = PlateOverPlane()
    at = jnp.asarray([-0.4, 0.2])

    def distance(slant):
        light = DirectionalLight(jnp.stack([-slant, -jnp.ones_like(slant), 0.3 * slant]), jnp.ones(3))
        return signed_distance(scene.shadow_polygon(light), at)

    slant = jnp.asarray(0.7)
    np.testing.assert_allclose(jax.grad(distance)(slant), central_difference(distance, slant), rtol=1e-8)


@pytest.mark.parametrize("seed", range(4))
def test_area_and_distance_of_a_union_against_other_geometry(seed):
    rng = np.random.default_rng(seed)
    shapes = []
    for centre in ((0.0, 0.0), (0.55, 0.3)):
        angles = np.sort(rng.uniform(0, 0.4 * np.pi, 4) + 0.5 * np.pi * np.arange(4))
        shapes.append(np.array(centre) + np.stack([np.cos(angles), np.sin(angles)], -1))
    polygons = jnp.asarray(np.stack(shapes))

    hulls = [ConvexHull(shape) for shape in shapes]
    planes = np.concatenate([hull.equations for hull in hulls])
    common = ConvexHull(HalfspaceIntersection(planes, np.array([0.27, 0.15])).intersections).volume
    expected = hulls[0].volume + hulls[1].volume - common
    np.testing.assert_allclose(union_area(polygons), expected, rtol=1e-12)

    positions = rng.uniform(-1.5, 2.0, size=POSITIONS.shape)
    samples = [edge_samples(shape) for shape in shapes]
    outer = np.concatenate(
        [
            samples[k][(samples[k] @ hulls[1 - k].equations[:, :2].T + hulls[1 - k].equations[:, 2]).max(axis=1) > 0]
            for k in (0, 1)
        ]
    )
    nearest, _ = KDTree(outer).query(positions)
    found = np.asarray(union_distance(polygons, jnp.asarray(positions)))
    np.testing.assert_allclose(np.abs(found), nearest, atol=1e-3)  # half a sample's spacing, along and across
    inside = np.array([(hull.equations[:, :2] @ positions.T + hull.equations[:, 2:]).max(axis=0) for hull in hulls])
    np.testing.assert_array_equal(found < 0, inside.min(axis=0) < 0)


@pytest.mark.parametrize(
    ("shift", "expected"),
    [((0.5, 0.5), 1.75), ((3.0, 0.1), 2.0), ((0.25, 0.25), 1.4375)],
    ids=["corner", "apart", "deep"],
)
def test_union_area_of_two_squares(shift, expected, dtype, rounding):
    square = jnp.asarray([(0, 0), (1, 0), (1, 1), (0, 1)], dtype)
    pair = jnp.stack([square, square[::-1] + jnp.asarray(shift, dtype)])
    np.testing.assert_allclose(union_area(pair), expected, rtol=10 * rounding)


def test_union_with_a_polygon_inside_another():
    outer = jnp.asarray([(-2.0, -2.0), (2.0, -2.0), (2.0, 2.0), (-2.0, 2.0)])
    pair = jnp.stack([0.25 * outer, outer])
    np.testing.assert_allclose(union_area(pair), 16.0, rtol=1e-14)
    np.testing.assert_allclose(union_distance(pair, jnp.asarray([[0.0, 0.0], [0.5, 0.1]])), [-2.0, -1.5], rtol=1e-14)


def test_union_area_has_the_derivative_of_the_area():
    square = jnp.asarray([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)])

    def covered(shift):
        return union_area(jnp.stack([square, square + shift]))

    # area = 2 - (1 - x)(1 - y)
    np.testing.assert_allclose(jax.jit(jax.grad(covered))(jnp.asarray([0.3, 0.6])), [0.4, 0.7], rtol=1e-13)


# --- planes and projections -----------------------------------------------------------------------------------------


def test_plane_coordinates_return(dtype, rounding):
    plane = exact.ReceivingPlane.horizontal(jnp.asarray(0.7, dtype))
    positions = jnp.asarray(POSITIONS[:10], dtype)
    np.testing.assert_allclose(plane.to_plane(plane.to_world(positions)), positions, rtol=10 * rounding)
    np.testing.assert_array_equal(plane.normal, [0, 1, 0])
    np.testing.assert_allclose(plane.to_world(positions)[:, 1], 0.7, rtol=10 * rounding)


def test_projection_onto_a_slanted_plane_stays_on_the_ray():
    axis_u = np.array([2.0, 1.0, 0.0]) / np.sqrt(5)
    plane = exact.ReceivingPlane(jnp.asarray([0.0, 0.1, 0.0]), jnp.asarray(axis_u), jnp.asarray([0.0, 0.0, 1.0]))
    points = jnp.asarray([(0.2, 1.0, 0.1), (-0.5, 0.6, -0.7)])
    for light in LIGHTS.values():
        landed = plane.to_world(exact.project(points, light, plane))
        to_light, _ = light.to_light(landed)
        np.testing.assert_allclose(jnp.cross(points - landed, to_light), 0.0, atol=1e-14)
        assert (np.sum(np.asarray((points - landed) * to_light), axis=1) > 0).all()


@pytest.mark.parametrize(
    ("point", "light"),
    [
        ((0.0, -0.1, 0.0), LIGHTS["directional"]),
        ((0.0, 4.0, 0.0), LIGHTS["point"]),
        ((0.0, 1.0, 0.0), DirectionalLight.create((1.0, 0.2, 0.0), dtype=jnp.float64)),
    ],
    ids=["below the plane", "above the light", "light from below"],
)
def test_points_without_a_shadow_are_refused(point, light):
    with pytest.raises(ValueError, match="between the light and the plane"):
        exact.project(jnp.asarray(point), light, exact.ReceivingPlane.horizontal(0.0))


# --- spheres --------------------------------------------------------------------------------------------------------


def sphere_blocks(centre, radius, points, light):
    """Does the ray from a point to the light pass the centre within the radius?"""
    to_light = np.asarray(light.to_light(jnp.asarray(points))[0])
    offset = centre - points
    along = np.einsum("ij,ij->i", offset, to_light)
    return (along > 0) & (np.sum(offset**2, axis=1) - along**2 <= radius**2)


@lights
def test_sphere_shadow_is_what_rays_find(light):
    scene = SphereOverPlane()
    shaded = sphere_blocks(np.asarray(scene.centre), float(scene.radius), on_ground(POSITIONS), light)
    assert 100 < shaded.sum() < 1400
    np.testing.assert_array_equal(scene.shadow(light).contains(jnp.asarray(POSITIONS)), shaded)


def test_sphere_in_parallel_light_casts_the_textbook_ellipse(dtype, rounding):
    elevation, radius, height = 0.7, 0.7, 1.1
    light = DirectionalLight.create((-np.cos(elevation), -np.sin(elevation), 0.0), dtype=dtype)
    shadow = astype(SphereOverPlane(radius, height), dtype).shadow(light)
    assert shadow.matrix.dtype == dtype
    np.testing.assert_allclose(shadow.semi_axes, [radius / np.sin(elevation), radius], rtol=20 * rounding)
    np.testing.assert_allclose(shadow.area, np.pi * radius**2 / np.sin(elevation), rtol=20 * rounding)
    np.testing.assert_allclose(shadow.centre, [-height / np.tan(elevation), 0.0], atol=20 * rounding)


def test_light_straight_above_a_sphere_casts_a_circle(dtype, rounding):
    radius, height, tall = 0.7, 1.1, 3.0
    scene = astype(SphereOverPlane(radius, height), dtype)
    shadow = scene.shadow(PointLight.create((0.0, tall, 0.0), dtype=dtype))
    expected = tall * radius / np.sqrt((tall - height) ** 2 - radius**2)
    np.testing.assert_allclose(shadow.semi_axes, [expected, expected], rtol=100 * rounding)
    np.testing.assert_allclose(shadow.area, np.pi * expected**2, rtol=100 * rounding)


def test_point_light_far_away_casts_the_shadow_of_parallel_light():
    scene = SphereOverPlane()
    direction = np.array([-0.6, -1.0, 0.25])
    far = scene.shadow(PointLight.create(-1e6 * direction, dtype=jnp.float64))
    parallel = scene.shadow(DirectionalLight.create(direction, dtype=jnp.float64))
    np.testing.assert_allclose(far.centre, parallel.centre, atol=1e-5)
    np.testing.assert_allclose(far.semi_axes, parallel.semi_axes, rtol=1e-5)


@lights
def test_tessellated_spheres_shadow_lies_between_two_ellipses(light):
    gaps = []
    for frequency in (3, 6):
        scene = SphereOverPlane(frequency=frequency)
        inner = SphereOverPlane(scene.inner_radius(), scene.height).shadow(light)
        positions = POSITIONS[:600]
        shaded = occluded(np.asarray(scene.ball().triangles()), on_ground(positions), light)
        surely, possibly = (ellipse.contains(jnp.asarray(positions)) for ellipse in (inner, scene.shadow(light)))
        assert (shaded | ~np.asarray(surely)).all()
        assert (~shaded | np.asarray(possibly)).all()
        gaps.append(float(scene.radius - scene.inner_radius()))
    assert gaps[1] < 0.3 * gaps[0]  # second order in the edge


@lights
def test_distance_to_an_ellipse_against_dense_samples(light):
    shadow, positions = SphereOverPlane().shadow(light), jnp.asarray(POSITIONS)
    edge = np.asarray(shadow.boundary(jnp.linspace(0, 2 * np.pi, 20001)))
    np.testing.assert_allclose(shadow.form(jnp.asarray(edge)), 0.0, atol=1e-13)
    nearest, _ = KDTree(edge).query(POSITIONS)
    found = np.asarray(ellipse_distance(shadow, positions))
    spacing = np.linalg.norm(np.diff(edge, axis=0), axis=1).max()
    assert (np.abs(found) <= nearest + 1e-12).all()
    assert (np.abs(found) >= nearest - spacing / 2).all()
    np.testing.assert_array_equal(found <= 0, shadow.contains(positions))


def test_distance_to_an_ellipse_on_its_axes(dtype, rounding):
    a, b = 1.5, 0.5
    ellipse = exact.Ellipse(jnp.diag(jnp.asarray([1 / a**2, 1 / b**2, -1.0], dtype)))
    at = jnp.asarray([(0, 0), (a, 0), (a + 2, 0), (0, b + 1), (0, 0.5 * b)], dtype)
    np.testing.assert_allclose(ellipse_distance(ellipse, at), [-b, 0.0, 2.0, 1.0, -0.5 * b], atol=50 * rounding)


def test_distance_to_an_ellipse_has_its_derivative():
    at = jnp.asarray([[-1.9, 0.5], [-0.4, 0.1], [0.6, -0.9]])

    @jax.jit
    def distances(values):
        scene = SphereOverPlane(values[0], values[1])
        light = DirectionalLight(values[2:5] / jnp.linalg.norm(values[2:5]), jnp.ones(3))
        return scene.shadow(light).signed_distance(at)

    values = jnp.asarray([0.7, 1.1, -0.6, -1.0, 0.25])
    steps = 1e-6 * np.eye(5)
    expected = jnp.stack([(distances(values + s) - distances(values - s)) / 2e-6 for s in steps], axis=-1)
    np.testing.assert_allclose(jax.jit(jax.jacrev(distances))(values), expected, atol=2e-8)


@pytest.mark.parametrize(
    ("scene", "light", "message"),
    [
        (SphereOverPlane(1.0, 0.5), LIGHTS["directional"], "lit side"),
        (SphereOverPlane(), PointLight.create((3.0, 1.5, 0.0), dtype=jnp.float64), "farther from the plane"),
        (SphereOverPlane(), DirectionalLight.create((1.0, 0.2, 0.0), dtype=jnp.float64), "shine onto"),
    ],
    ids=["sunk sphere", "low light", "light from below"],
)
def test_spheres_without_an_ellipse_are_refused(scene, light, message):
    with pytest.raises(ValueError, match=message):
        scene.shadow(light)


# --- the scenes of the registry -------------------------------------------------------------------------------------


def test_plate_mesh_follows_its_parameters():
    def top(height):
        return PlateOverPlane(height=height).mesh().vertices[:4, 1].sum()

    np.testing.assert_allclose(jax.grad(top)(jnp.asarray(1.3)), 4.0, rtol=1e-14)


@pytest.mark.parametrize("name", ["plate-over-plane", "two-plates", "comb", "sphere-over-plane"])
def test_registered_scene_is_the_parametrised_one(name):
    scene = {
        "plate-over-plane": PlateOverPlane, "two-plates": TwoPlates, "comb": Comb, "sphere-over-plane": SphereOverPlane,
    }[name]()  # fmt: skip
    mesh, _, lights_ = SCENES[name].build(SCENES[name].default_triangles)
    assert mesh.num_faces == scene.mesh().num_faces == SCENES[name].default_triangles
    np.testing.assert_array_equal(mesh.faces, scene.mesh().faces)
    if name != "comb":  # the registered comb's slats have the width that its number gives
        np.testing.assert_array_equal(mesh.vertices, scene.mesh().vertices)
    assert len(lights_) == 1


def test_sun_stands_where_it_is_said_to():
    (light,) = sun(90.0, 30.0)
    np.testing.assert_allclose(light.direction, [-np.sqrt(0.75), -0.5, 0.0], atol=1e-6)
