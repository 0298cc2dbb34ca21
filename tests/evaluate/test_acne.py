"""The bias that surfaces need: on a plane the closed form; and a wall's gap is what the bias predicts."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

from shadowjax import Bias, DirectionalLight, Hard, Mesh, ShadowMapping, make_scene, make_technique
from shadowjax.evaluate.acne import component_labels, contact_gap, least_grid_bias, needed_bias
from shadowjax.geometry.camera import Camera
from shadowjax.scenes.base import to_mesh
from shadowjax.scenes.primitives import box

LIGHT = DirectionalLight.create((-0.6, -1.0, 0.35))
CAMERA = Camera.look_at((0.3, 5.0, 7.0), (0.1, 0.2, 0.0), phi_y=0.45, near=2.0, far=16.0)


def quad(corners):
    return Mesh.create(np.asarray(corners, float), np.array([[0, 2, 1], [0, 3, 2]]))


FLOOR = quad([[-4, 0, -4], [4, 0, -4], [4, 0, 4], [-4, 0, 4]])


def test_a_plane_needs_its_closed_form_and_nearly_all_of_it():
    shadows = make_technique("hard", 24).build(FLOOR, LIGHT, CAMERA)
    spots = np.random.default_rng(1).uniform(-3, 3, (4000, 2))
    points = jnp.asarray(np.stack([spots[:, 0], 0 * spots[:, 0], spots[:, 1]], -1))
    normals = jnp.broadcast_to(jnp.asarray([0.0, 1.0, 0.0]), points.shape)
    on, lit = jnp.zeros(len(spots), jnp.int32), jnp.ones(len(spots), bool)
    for kernel_size in (1, 3):
        reach = kernel_size / 2
        need = needed_bias(shadows, FLOOR, points, normals, on, lit, kernel_size)
        assert 0.93 * reach < need.least("slope") <= reach + 1e-9
        predicted = least_grid_bias(shadows.maps[0].grid, points, normals, reach)
        assert float(np.max(need.world / predicted)) <= 1 + 1e-9
    assert need.least("world", 0.5) < need.least("world")
    with pytest.raises(ValueError, match="share must lie in"):
        need.least("world", 0.0)
    with pytest.raises(ValueError, match="unit must be one of"):
        need.least("ndc")


def test_bodies_are_told_apart():
    scene = make_scene("two-plates")
    assert len(np.unique(component_labels(scene.mesh))) == 3
    solid = to_mesh([box([0, 0, 0], [1, 1, 1])])
    assert len(np.unique(component_labels(solid))) == 1


@eqx.filter_jit
def look_up(shadows, points, normals):
    return shadows.visibility(points, normals)


@pytest.mark.parametrize("lean", [0.0, 0.3])
def test_the_gap_behind_a_wall_is_the_bias_seen_along_the_ground(lean):
    """A thin wall on the ground, lit across: what is lit behind its foot ends at b·cos(ε − ψ)/cos ψ."""
    elevation, bias, texels = 0.8, 0.5, 400
    light = DirectionalLight.create((np.cos(elevation), -np.sin(elevation), 0.0))
    top = 2 * np.tan(lean)
    wall = quad([[0, 0, -3], [0, 0, 3], [top, 2, 3], [top, 2, -3]])
    shadows = ShadowMapping(Hard(), texels, bias=Bias.create(bias, "world")).build(
        Mesh.merge([FLOOR, wall]), light, CAMERA
    )
    x = jnp.linspace(0.0, 1.2, 2401)
    points = jnp.stack([x, 0 * x, 0 * x + 0.013], -1)
    lit = np.asarray(look_up(shadows, points, jnp.broadcast_to(jnp.asarray([0.0, 1.0, 0.0]), points.shape)))
    measured = float(x[np.flatnonzero(lit == 0)[0]])
    texel = 8.0 / texels / np.sin(elevation)
    assert measured == pytest.approx(float(contact_gap(bias, elevation, lean)), abs=1.5 * texel)
