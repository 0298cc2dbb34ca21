"""One test pins each convention of the package; the conventions page of the docs names these tests."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from shapes import above, lights, plate_over_plane

from shadowjax import Bias, BruteForceCaster, Camera, Exact, Hard, Mesh, ShadowMapping, build_shadow_map, camera_grid
from shadowjax.filters.base import Lookup
from shadowjax.filters.hard import is_lit
from shadowjax.partitions.single import SingleMap
from shadowjax.shading import trace_surface

UP = jnp.asarray([[0.0, 1.0, 0.0]])


def test_world_is_right_handed():
    camera = Camera.look_at((0.0, 0, 5), (0.0, 0, 0), phi_y=0.5, near=1, far=9)
    np.testing.assert_allclose(camera.rotation, [[1, 0, 0], [0, 1, 0], [0, 0, -1]], atol=1e-15)


def test_phi_is_half_the_angle_of_view_and_depth_is_positive_along_the_view():
    camera = Camera.look_at((0.0, 0, 5), (0.0, 0, 0), phi_y=0.5, near=1, far=9)
    corners = camera.to_view(camera.frustum_corners())
    np.testing.assert_allclose(corners[:, 2], [1] * 4 + [9] * 4)
    np.testing.assert_allclose(jnp.max(corners[4:, 1]), 9 * np.tan(0.5))


def test_gamma_is_the_angle_between_light_and_view():
    camera = above()
    angle = float(camera.gamma(jnp.asarray([0.0, -1.0, 0.0])))
    np.testing.assert_allclose(angle, np.arccos(-camera.forward[1]))
    assert 0 <= angle <= np.pi / 2


def test_image_row_zero_is_the_top():
    camera = Camera.look_at((0.0, 0, 5), (0.0, 0, 0), phi_y=0.5, near=1, far=9)
    grid = camera_grid(camera, 4, 2)
    directions = grid.rays().directions
    assert directions.shape == (2, 4, 3)
    assert jnp.all(directions[0, :, 1] > 0)
    assert jnp.all(directions[:, 0, 0] < 0)


def test_texel_centres():
    """Texel (row i, column j) is sampled at ((j + ½)/columns, (i + ½)/rows), and a point there is located at +½."""
    grid = SingleMap().grids(plate_over_plane(), lights()["directional"], above(), 4)[0]
    np.testing.assert_allclose(grid.centres()[1, 2], [2.5 / 4, 1.5 / 4])
    rays = grid.rays()
    position, depth = grid.locate(rays.at(jnp.full((4, 4), 3.0)))
    np.testing.assert_allclose(position[1, 2], [2.5, 1.5], rtol=1e-12)
    np.testing.assert_allclose(depth, 3.0, rtol=1e-12)


def test_light_plane_follows_the_view():
    """y points against the light, z the way the view points: t grows away from the camera."""
    camera = above()
    grid = SingleMap().grids(plate_over_plane(), lights()["directional"], camera, 4)[0]
    ahead, _ = grid.locate(camera.forward[None] * 0.5)
    behind, _ = grid.locate(-camera.forward[None] * 0.5)
    assert ahead[0, 1] > behind[0, 1]
    np.testing.assert_allclose(ahead[0, 0], behind[0, 0], atol=1e-12)


def test_depth_is_distance_along_the_ray():
    """In world units, not z/w: one metre further along any ray of any light is one more of depth."""
    for light in lights().values():
        grid = SingleMap().grids(plate_over_plane(), light, above(), 8)[0]
        rays = grid.rays()
        near, far = rays.at(jnp.full((8, 8), 2.0)), rays.at(jnp.full((8, 8), 3.0))
        np.testing.assert_allclose(grid.locate(near)[1], 2.0, rtol=1e-12)
        np.testing.assert_allclose(grid.locate(far)[1], 3.0, rtol=1e-12)


def test_a_miss_is_finite():
    for light in lights().values():
        grid = SingleMap().grids(plate_over_plane(), light, above(), 8)[0]
        shadow_map = build_shadow_map(BruteForceCaster(), plate_over_plane(), grid)
        missed = shadow_map.face == -1
        assert np.isfinite(shadow_map.depth).all()
        np.testing.assert_array_equal(shadow_map.depth[missed], grid.far)
        assert jnp.all(shadow_map.depth[~missed] < grid.far)


def test_visibility_is_one_where_lit():
    mesh, light, camera = plate_over_plane(), lights()["directional"], above()
    lit, dark = jnp.asarray([[3.0, 0, 3.0]]), jnp.asarray([[-0.4, 0, 0.25]])
    for technique in (Exact(), ShadowMapping(Hard(), 64)):
        shadows = technique.build(mesh, light, camera)
        assert shadows.visibility(lit, UP)[0] == 1
        assert shadows.visibility(dark, UP)[0] == 0


def test_bias_belongs_to_the_test():
    """The stored depth never moves with the bias; the receiver's depth minus the bias is what is compared."""
    mesh, light, camera = plate_over_plane(), lights()["directional"], above()
    plain, biased = (
        ShadowMapping(Hard(), 32, bias=Bias.create(value, "world")).build(mesh, light, camera) for value in (0.0, 0.5)
    )
    np.testing.assert_array_equal(plain.maps[0].depth, biased.maps[0].depth)
    np.testing.assert_array_equal(plain.planes[0], biased.planes[0])
    assert not is_lit(jnp.asarray(2.0), jnp.asarray(2.4), 0.3)
    assert is_lit(jnp.asarray(2.0), jnp.asarray(2.4), 0.5)


def test_outside_the_map_is_lit():
    planes = jnp.zeros((1, 4, 4))
    where = jnp.asarray([[2.0, 2.0], [-0.5, 2.0], [2.0, 4.5], [1e9, -1e9]])
    lookup = Lookup(where, jnp.ones(4), jnp.zeros(()), jnp.ones(()))
    np.testing.assert_array_equal(Hard().visibility(planes, lookup), [0, 1, 1, 1])


def test_a_surface_shows_the_side_the_camera_sees():
    """Normals are turned to the camera; a side that faces away from the light is dark, on open meshes too."""
    mesh = plate_over_plane()
    camera = Camera.look_at((0.0, 0.3, 3.0), (0.0, 1.0, 0.0), phi_y=0.3, near=0.5, far=9)
    surface = trace_surface(mesh, camera, 8, 8, BruteForceCaster())
    below = surface.is_seen & (surface.points[..., 1] > 0.5)
    assert jnp.sum(below) > 4
    assert jnp.all(surface.normals[below][:, 1] < 0)
    for technique in (Exact(), ShadowMapping(Hard(), 64)):
        shadows = technique.build(mesh, lights()["directional"], camera)
        np.testing.assert_array_equal(shadows.visibility(surface.points, surface.normals)[below], 0)


def test_units_are_free():
    """Everything scales: a scene a thousand times larger gives the same picture, with the default bias too."""
    mesh, camera, light = plate_over_plane(), above(), lights()["directional"]
    big = Mesh(1000 * mesh.vertices, mesh.faces, mesh.face_colors)
    points = jnp.stack(jnp.meshgrid(*[jnp.linspace(-3, 3, 33)] * 2), axis=-1).reshape(-1, 2)
    points = jnp.stack([points[:, 0], jnp.zeros(len(points)), points[:, 1]], axis=-1)
    normals = jnp.broadcast_to(UP, points.shape)
    technique = ShadowMapping(Hard(), 64)
    visibility = eqx.filter_jit(lambda shadows, points: shadows.visibility(points, normals))
    small_answer = visibility(technique.build(mesh, light, camera), points)
    big_answer = visibility(technique.build(big, light, camera), 1000 * points)
    np.testing.assert_array_equal(small_answer, big_answer)
