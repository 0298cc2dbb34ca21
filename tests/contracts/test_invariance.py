"""Shadows do not depend on where the scene lies, how wide its ground is, how large it is or how it is turned.

The box on its ground is judged by a closed form in 64 bits that knows no caster. Pixels whose answer hangs on what the
numbers cannot tell are left out: a few roundings of the scene's place, and no less than a millimetre.
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from box_shadow import HEIGHT, WIDTH, as_numpy, ground_shadow, stage, undecided

from shadowjax import Camera, Exact, Mesh, PointLight, ShadowVolumes, SpotLight
from shadowjax.rays.casters import CASTERS
from shadowjax.rays.grid.caster import GridCaster
from shadowjax.shading import trace_surface

# Wide grounds and far places leave a few roundings between right and wrong.
pytestmark = pytest.mark.optimised

HALVES = (5.0, 1e2, 1e3, 1e4, 1e5, 1e6)
SHIFTS = (1e2, 1e3, 1e4, 1e5, 1e6)
SCALES = (1e-3, 1e-1, 10.0, 1e3)
JUDGES = {"shadow-volumes": ShadowVolumes(), **{name: Exact(make()) for name, make in CASTERS.items()}}
KINDS = ("directional", "spot", "point")


@eqx.filter_jit
def pictured(technique, mesh, light, camera):
    """Pixels that see the ground, and visibility."""
    surface = trace_surface(mesh, camera, WIDTH, HEIGHT, GridCaster())
    shadows = technique.build(mesh, light, camera)
    return surface.is_seen & (surface.face < 2), shadows.visibility_of(surface.points, surface.normals, surface.face)


def rotation(seed: int) -> np.ndarray:
    """A random rotation."""
    matrix = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))[0]
    return matrix * np.sign(np.linalg.det(matrix))


def assert_right(technique, dtype, kind="directional", blur=0.0, **motion):
    """Every pixel of the ground that is not within the blur of an edge has the answer of the closed form."""
    scene = stage(dtype, kind=kind, **motion)
    ground, visible = (as_numpy(part) for part in pictured(technique, scene.mesh, scene.light, scene.camera))
    on_ground, dark = ground_shadow(kind)
    # The eye may take a wide ground for the foot of the box, but no more than that.
    assert np.sum((ground > 0) & on_ground) >= 0.98 * on_ground.sum()
    told = ~undecided(kind, max(1e-3, blur)) & (ground > 0) & on_ground
    np.testing.assert_array_equal(visible[told], np.where(dark, 0, 1)[told])


def everything(technique, dtype, kind):
    eps = float(jnp.finfo(dtype).eps)
    for half in HALVES:
        assert_right(technique, dtype, kind, half=half)
    for size in SHIFTS:
        # A hundredth of a box is what numbers in 32 bits tell at 10⁵ m.
        assert_right(technique, dtype, kind, 2 * eps * size, shift=(size, 0.0, -size))
    for scale in SCALES:
        assert_right(technique, dtype, kind, scale=scale)
    for seed in range(3):
        assert_right(technique, dtype, kind, turn=rotation(seed))
        assert_right(technique, dtype, kind, turn=rotation(seed), scale=30.0, shift=(2e3, -1e3, 1e3), half=50.0)


@pytest.mark.parametrize("name", ["grid", "shadow-volumes"])
def test_the_truth_is_that_of_a_closed_form_wherever_the_scene_lies(name):
    everything(JUDGES[name], jnp.float32, "directional")


@pytest.mark.long
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", JUDGES)
def test_the_truth_is_that_of_a_closed_form_for_every_caster_and_light(name, kind, dtype):
    everything(JUDGES[name], dtype, kind)


@pytest.mark.parametrize("kind", ["spot", "point"])
def test_a_lamp_on_a_surface_shines_as_one_just_off_it(kind, dtype):
    """On the ceiling of a room, in whose floor and walls nothing else is: all lit; and beneath a plate, dark."""
    room = np.array([[x, y, z] for x in (-2, 2) for y in (0, 3) for z in (-2, 2)], float)
    floor_and_ceiling = [[0, 1, 5], [0, 5, 4], [2, 7, 3], [2, 6, 7]]
    plate = np.array([[-0.5, 1, -0.5], [0.5, 1, -0.5], [0.5, 1, 0.5], [-0.5, 1, 0.5]])
    mesh = Mesh.create(
        np.concatenate([room, plate]), np.array([*floor_and_ceiling, [8, 10, 9], [8, 11, 10]]), dtype=dtype
    )
    x, z = np.meshgrid(np.linspace(-1.7, 1.7, 12), np.linspace(-1.7, 1.7, 12))
    points = jnp.asarray(np.stack([x, np.zeros_like(x), z], axis=-1).reshape(-1, 3), dtype)
    up = jnp.broadcast_to(jnp.asarray([0.0, 1.0, 0.0], dtype), points.shape)
    camera = Camera.look_at((0.0, 2.0, 1.9), (0.0, 0.0, 0.0), phi_y=0.5, near=0.1, far=9.0, dtype=dtype)
    lit = (np.maximum(np.abs(x), np.abs(z)) > 0.75).reshape(-1)
    assert 0 < lit.mean() < 1
    for name in ("grid", "brute", "shadow-volumes"):
        for height in (3.0, 3.0 - 1e-6):
            place = (0.0, height, 0.0)
            light = {
                "spot": lambda place=place: SpotLight.create(place, (0.1, -1.0, 0.0), 1.2, dtype=dtype),
                "point": lambda place=place: PointLight.create(place, dtype=dtype),
            }[kind]()
            visible = JUDGES[name].build(mesh, light, camera).visibility(points, up)
            np.testing.assert_array_equal(as_numpy(visible), lit)
