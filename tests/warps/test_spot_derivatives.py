"""Warps for spot lights follow the camera: rays of a map are differentiated by where it stands and how wide it sees."""

import functools

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from shadowjax import Camera, Mesh, SpotLight
from shadowjax.partitions.single import SingleMap
from shadowjax.warps.fit import PerspectiveFit
from shadowjax.warps.perspective import PerspectiveWarp

VIEWS, STEP = 60, 1e-5
FLOOR = [[-8, 0, -8], [8, 0, -8], [8, 0, 8], [-8, 0, 8]]
PLATE = [[-1, 1, -1], [1, 1, -1], [1, 1, 1], [-1, 1, 1]]
WALL = [[-6, 0, -6], [6, 0, -6], [6, 5, -6], [-6, 5, -6]]
FACES = [[0, 2, 1], [0, 3, 2], [4, 6, 5], [4, 7, 6], [8, 9, 10], [8, 10, 11]]
MESH = Mesh.create(np.array(FLOOR + PLATE + WALL, float), np.array(FACES))
PLACES = jnp.stack(jnp.meshgrid(*[jnp.linspace(0.05, 0.95, 3)] * 2), axis=-1).reshape(-1, 2)


def random_views(seed=0):
    """Cameras around the plate that look past it, spot lights above it, and a way to move each camera."""
    rng = np.random.default_rng(seed)
    around = rng.uniform(0, 2 * np.pi, VIEWS)
    eye = np.stack([5 * np.cos(around), rng.uniform(0.7, 4, VIEWS), 5 * np.sin(around)], axis=-1)
    target = rng.uniform(-1, 1, (VIEWS, 3)) * [2, 0.3, 2]
    place = rng.uniform(-4, 4, (VIEWS, 3)) * [1, 0, 1] + rng.uniform(3, 8, (VIEWS, 1)) * [0, 1, 0]
    aim = rng.uniform(-1, 1, (VIEWS, 3)) * [1, 0.2, 1] - place
    angles = rng.uniform(0.2, 0.5, VIEWS), rng.uniform(8, 20, VIEWS), rng.uniform(0.3, 0.9, VIEWS)
    return tuple(jnp.asarray(x) for x in (eye, target, place, aim, *angles, rng.normal(size=(VIEWS, 4))))


def rays(t, eye, target, place, aim, phi, far, cone, way):
    """Directions of nine rays of the map, and W/n', of a camera moved by t along its way."""
    camera = Camera.look_at(eye, target, phi_y=phi, near=0.1, far=far)
    camera = eqx.tree_at(lambda c: (c.position, c.phi_y), camera, (eye + t * way[:3], phi + t * way[3]))
    light = SpotLight.create(place, aim, cone)
    (grid,) = SingleMap(PerspectiveFit("minimax")).grids(MESH, light, camera, 8)
    warp = grid.plane_map
    assert isinstance(warp, PerspectiveWarp)
    return jnp.append(grid.rays_at(PLACES).directions.ravel(), warp.strength * warp.extent)


# It is compiled for longer than it runs.
@functools.partial(jax.jit, compiler_options={"xla_backend_optimization_level": 0})
def values_and_slopes(t, views):
    along = lambda *view: jax.jvp(lambda t: rays(t, *view), (t,), (jnp.ones(()),))  # noqa: E731
    return jax.vmap(along)(*views)


def test_rays_of_a_spot_light_s_map_follow_the_camera():
    """Slopes are central differences, also where a corner of what is seen is the outermost but for rounding."""
    views = random_views()
    at = {k: values_and_slopes(jnp.asarray(k * STEP), views) for k in (-2, -1, 0, 1, 2)}
    moved = {k: np.asarray(value) for k, (value, _) in at.items()}
    slope = np.asarray(at[0][1])
    central = (8 * (moved[1] - moved[-1]) - (moved[2] - moved[-2])) / (12 * STEP)
    off = np.abs(slope - central).max(axis=-1) / np.maximum(np.abs(slope).max(axis=-1), 1)
    assert off.max() < 1e-6
    assert (moved[0][:, -1] > 0).mean() > 0.9
