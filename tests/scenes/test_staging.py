"""Ground, light and camera round a bare mesh: everything in view and in its shadow's reach, at any size and place."""

import jax.numpy as jnp
import numpy as np
import pytest

from shadowjax._types import astype
from shadowjax.geometry.light import DirectionalLight, PointLight, SpotLight
from shadowjax.geometry.mesh import Mesh
from shadowjax.scenes import make_scene, staging

TETRAHEDRON = np.array([[0, 0, 0], [1, 0, 0], [0, 0, 1], [0.3, 1.5, 0.2]], float)
FACES = np.array([[0, 1, 2], [0, 3, 1], [1, 3, 2], [2, 3, 0]])


def solid(scale=1.0, offset=(0.0, 0.0, 0.0)):
    return Mesh.create(TETRAHEDRON * scale + np.asarray(offset), FACES)


def in_image(camera, points):
    """Positions in units of the image's half size: inside where |x|, |y| ≤ 1; and depth."""
    local = np.asarray(camera.to_view(jnp.asarray(points, camera.near.dtype)))
    return local[:, :2] / local[:, 2:] / np.asarray(camera.half_size), local[:, 2]


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e3])
@pytest.mark.parametrize("offset", [(0.0, 0.0, 0.0), (50.0, -20.0, 90.0), (-70.0, 10.0, -60.0)])
def test_mesh_and_shadow_are_in_the_image(scale, offset):
    scene = staging.stage(solid(scale, np.asarray(offset) * scale), "solid")
    corners = np.asarray(scene.mesh.vertices)[:4]
    ground = float(scene.mesh.vertices[:4, 1].min()) - 1e-4 * float(scene.mesh.extent)
    shadow = staging.shadow_points(corners, np.asarray(scene.lights[0].direction), ground)
    position, depth = in_image(scene.camera, np.concatenate([corners, shadow]))
    assert np.abs(position).max() < 1
    assert np.abs(position).max() > 0.9  # and as large as it goes
    assert (depth > float(scene.camera.near)).all()
    assert (depth < float(scene.camera.far)).all()


def test_the_ground_catches_the_whole_shadow():
    scene = staging.stage(solid(), "solid")
    lower, upper = (np.asarray(corner) for corner in scene.mesh.bounds())
    shadow = staging.shadow_points(TETRAHEDRON, np.asarray(scene.lights[0].direction), 0.0)
    assert (shadow[:, [0, 2]] > lower[[0, 2]]).all()
    assert (shadow[:, [0, 2]] < upper[[0, 2]]).all()
    assert scene.mesh.num_faces == 4 + 12
    assert staging.stage(solid(), "solid", ground=False).mesh.num_faces == 4


def test_shadow_points_in_closed_form():
    point = np.array([[1.0, 2.0, 3.0]])
    np.testing.assert_allclose(staging.shadow_points(point, np.array([1.0, -2.0, 0.5]), 0.0), [[2.0, 0.0, 3.5]])
    # light that hardly comes down would throw the shadow far away: it is cut at three heights
    far = staging.shadow_points(point, np.array([1.0, -1e-9, 0.0]), 0.0)
    np.testing.assert_allclose(far, [[1.0 + 3 * 2.0, 0.0, 3.0]])
    assert np.isfinite(staging.shadow_points(point, np.array([0.0, 1.0, 0.0]), 0.0)).all()


def test_z_up_is_turned_not_mirrored():
    turned = staging.upright(solid(), "z")
    np.testing.assert_allclose(turned.vertices[3], [0.3, 0.2, -1.5])
    np.testing.assert_allclose(turned.areas(), solid().areas())
    volumes = [np.linalg.det(np.asarray(mesh.triangles())).sum() / 6 for mesh in (solid(), turned)]
    np.testing.assert_allclose(volumes[0], volumes[1])


def test_a_mesh_without_extent_is_refused():
    point = Mesh.create(np.ones((3, 3)), [[0, 1, 2]])
    with pytest.raises(ValueError, match="lie in one point"):
        staging.stage(point, "point")


def test_dtype_is_the_meshs(dtype):
    scene = staging.stage(astype(solid(), dtype), "solid")
    assert scene.mesh.vertices.dtype == scene.camera.near.dtype == scene.lights[0].direction.dtype == dtype


@pytest.mark.parametrize(
    ("kind", "type_"), [("directional", DirectionalLight), ("spot", SpotLight), ("point", PointLight)]
)
def test_other_lights_shine_on_the_whole_scene(kind, type_, dtype):
    scene = staging.relit(astype(staging.stage(solid(), "solid"), dtype), kind, direction=(0.3, -1.0, 0.2))
    (light,) = scene.lights
    assert isinstance(light, type_)
    assert (np.asarray(light.covers(scene.mesh.vertices)) > 0).all()
    assert light.color.dtype == dtype
    middle = 0.5 * sum(scene.mesh.bounds())
    to_light = np.asarray(light.to_light(middle)[0])
    np.testing.assert_allclose(to_light, np.array([-0.3, 1.0, -0.2]) / np.sqrt(1.13), rtol=1e-5, atol=1e-6)
    np.testing.assert_allclose(light.radiance(middle), staging.SUNLIGHT, rtol=1e-4)


def test_lights_out_of_range_are_refused():
    scene = make_scene("plate-over-plane")
    with pytest.raises(ValueError, match="light must be one of"):
        staging.relit(scene, "torch")
    with pytest.raises(ValueError, match="no position"):
        staging.relit(scene, "directional", position=(0.0, 1.0, 0.0))
    with pytest.raises(ValueError, match="zero vector"):
        staging.relit(scene, direction=(0.0, 0.0, 0.0))


def test_another_camera():
    scene = make_scene("plate-over-plane")
    same = staging.viewed(scene, float(scene.camera.aspect)).camera
    np.testing.assert_allclose(same.rotation, scene.camera.rotation, atol=1e-12)
    np.testing.assert_allclose(same.phi_y, scene.camera.phi_y)
    # a narrower picture keeps the width of the view
    tall = staging.viewed(scene, 0.5 * float(scene.camera.aspect)).camera
    np.testing.assert_allclose(tall.half_size[0], scene.camera.half_size[0])
    moved = staging.viewed(scene, 1.0, position=(0.0, 30.0, 1.0), phi_y=0.3).camera
    _, depth = in_image(moved, scene.mesh.vertices)
    assert float(moved.near) < depth.min()
    assert depth.max() < float(moved.far)
    with pytest.raises(ValueError, match="near must be less than far"):
        staging.viewed(scene, 1.0, near=5.0, far=2.0)
    with pytest.raises(ValueError, match="must differ"):
        staging.viewed(scene, 1.0, position=(1.0, 2.0, 3.0), target=(1.0, 2.0, 3.0))
