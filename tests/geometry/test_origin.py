"""Origins: a mesh far from zero is the mesh near zero, moved; and so are its cameras, lights and pictures."""

import jax
import jax.numpy as jnp
import mesh_bytes
import numpy as np
import pytest
from mesh_bytes import BOX_CORNERS, BOX_FACES

from shadowjax import Camera, Mesh, PointLight, SpotLight, astype, load
from shadowjax.geometry.transforms import rotation, scaling, translation
from shadowjax.scenes import staging

UTM = np.array([500_000.0, 35.0, -5_400_000.0])
EYE, AIM = np.array([40.0, 30.0, 60.0]), np.array([10.0, 4.0, 6.0])
BESIDE = np.array([40.0, 0.0, 0.5])
ASIDE = np.array([100.0, 0.0, -50.0])
HOUSE = BOX_CORNERS * [20.0, 8.0, 12.0]


def house(dtype=jnp.float32, origin=(0.0, 0.0, 0.0)):
    return Mesh.create(HOUSE, BOX_FACES, dtype=dtype, origin=origin)


def world(mesh):
    return np.asarray(mesh.vertices, float) + np.asarray(mesh.origin)


@pytest.mark.parametrize("ending", ["obj", "ply", "glb", "off"])
@pytest.mark.parametrize("shift", [UTM, np.array([0.0, 0.0, 1e7]), np.array([-3e3, 8e2, 0.0])])
def test_a_file_far_away_has_the_local_positions_of_the_file_near(tmp_path, ending, shift):
    if ending == "glb":
        made = mesh_bytes.Gltf()
        data = made.show(made.box(), matrix=[20, 0, 0, 0, 0, 8, 0, 0, 0, 0, 12, 0, *shift, 1]).glb()
    elif ending == "ply":
        data = mesh_bytes.ply(HOUSE + shift, BOX_FACES).replace(b"property float", b"property double")
    else:
        data = getattr(mesh_bytes, ending)(HOUSE + shift, BOX_FACES)
    path = tmp_path / f"house.{ending}"
    path.write_bytes(data)
    mesh = load(path, dtype=jnp.float32)
    assert mesh.origin == tuple(shift)
    np.testing.assert_array_equal(mesh.vertices, HOUSE)


def test_a_file_near_zero_keeps_its_numbers(tmp_path):
    path = tmp_path / "house.obj"
    path.write_bytes(mesh_bytes.obj(HOUSE + ASIDE, BOX_FACES))
    mesh = load(path)
    assert mesh.origin == (0.0, 0.0, 0.0)
    np.testing.assert_array_equal(mesh.vertices, HOUSE + ASIDE)


def test_an_origin_is_three_finite_numbers():
    for origin in ([1.0, 2.0], [1.0, 2.0, np.inf], 3.0):
        with pytest.raises(ValueError, match="origin must"):
            house(origin=origin)
    assert jax.tree.leaves(house(origin=UTM))[0].shape == (8, 3)  # static: no leaf that could lose its digits
    assert house(origin=UTM.tolist()).origin == tuple(UTM)


def test_moves_in_the_world_are_those_of_the_positions_there():
    mesh = house(origin=UTM)
    turn, mirror = rotation(jnp.asarray([1.0, 2, 3]), jnp.asarray(0.7)), scaling(jnp.asarray([-1.0, 1, 1]))
    matrix = (translation(jnp.asarray(-UTM)) @ turn @ mirror).astype(jnp.float32)
    expected = world(mesh) @ np.asarray(matrix)[:3, :3].T + np.asarray(matrix)[:3, 3]
    moved = mesh.transformed(matrix)
    np.testing.assert_allclose(world(moved), expected, atol=1e-5)
    assert np.abs(np.asarray(moved.vertices)).max() < 40  # local positions stay small
    traced = jax.jit(lambda m, x: m.transformed(x))(house(jnp.float64, UTM), matrix.astype(jnp.float64))
    np.testing.assert_allclose(world(traced), expected, atol=1e-8)
    near = house().transformed(matrix)
    assert near.origin == (0.0, 0.0, 0.0)
    np.testing.assert_allclose(near.vertices, HOUSE @ np.asarray(matrix)[:3, :3].T - UTM, rtol=1e-6, atol=1e-5)


def test_meshes_of_two_origins_are_merged_where_they_stand():
    mesh = Mesh.merge([house(origin=UTM), house(origin=UTM + BESIDE), house(origin=UTM)])
    assert mesh.origin == tuple(UTM)
    np.testing.assert_array_equal(mesh.vertices, np.concatenate([HOUSE, HOUSE + BESIDE, HOUSE]))
    assert astype(mesh, jnp.float64).origin == mesh.origin
    np.testing.assert_array_equal(world(mesh.about(UTM - 8.0)), world(mesh))
    up = staging.upright(house(origin=UTM), "z")
    np.testing.assert_array_equal(world(up), (HOUSE + UTM)[:, [0, 2, 1]] * [1, 1, -1])


def test_positions_are_shifted_before_they_are_rounded():
    mesh, place, aim = house(origin=UTM), UTM + EYE + 0.1, UTM + AIM
    settings = {"phi_y": 0.3, "near": 1.0, "far": 200.0, "dtype": jnp.float32}
    camera = Camera.look_at(place, aim, **settings, origin=mesh.origin)
    np.testing.assert_array_equal(camera.position, np.float32(place - UTM))
    near = Camera.look_at(place - UTM, aim - UTM, **settings)
    np.testing.assert_array_equal(camera.rotation, near.rotation)
    for light in (
        PointLight.create(tuple(place), dtype=jnp.float32, origin=mesh.origin),
        SpotLight.create(list(place), (0.0, -1.0, 0.0), 0.5, dtype=jnp.float32, origin=mesh.origin),
    ):
        np.testing.assert_array_equal(light.position, np.float32(place - UTM))
    np.testing.assert_array_equal(mesh.to_local(place), place - UTM)


@pytest.mark.parametrize("kind", ["directional", "spot", "point"])
def test_scenes_of_both_are_the_same_but_for_the_origin(kind):
    def scene(origin):
        made = staging.stage(house(origin=origin), "house")
        origin = np.asarray(origin)
        position = None if kind == "directional" else tuple(origin + EYE)
        made = staging.relit(made, kind, None, position)
        return staging.viewed(made, 1.5, position=tuple(origin + EYE), target=tuple(origin + AIM))

    far, near = scene(tuple(UTM)), scene((0.0, 0.0, 0.0))
    assert far.mesh.origin == tuple(UTM)
    for one, other in zip(jax.tree.leaves(far), jax.tree.leaves(near), strict=True):
        np.testing.assert_array_equal(one, other)


def test_the_command_line_takes_positions_of_the_file(tmp_path):
    from PIL import Image

    from shadowjax.cli import main

    sun = ["--light-direction", "-0.44761", "-0.38793", "-0.80570"]
    size = ["--width", "48", "--height", "36", "--samples", "1", "--resolution", "48", "--technique", "exact"]
    for name, shift in {"near": 0 * UTM, "far": UTM}.items():
        (tmp_path / f"{name}.obj").write_bytes(mesh_bytes.obj(HOUSE + shift, BOX_FACES))
        camera = ["--camera-position", *map(str, shift + EYE)]
        aim = ["--camera-target", *map(str, shift + AIM)]
        words = ["render", str(tmp_path / f"{name}.obj"), "-o", str(tmp_path / f"{name}.png"), *camera, *aim, *sun]
        assert main([*words, *size]) == 0
    near, far = (np.asarray(Image.open(tmp_path / f"{name}.png")) for name in ("near", "far"))
    np.testing.assert_array_equal(near, far)
    assert near.std() > 10
