"""A face along the light, but for rounding, is dark under every technique: it has neither acne nor bright speckles."""

import functools

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

from shadowjax import TECHNIQUES, Camera, DirectionalLight, Material, Mesh, make_technique, shade, trace_surface
from shadowjax.rays.grid.caster import GridCaster
from shadowjax.scenes.base import to_mesh
from shadowjax.scenes.primitives import box
from shadowjax.shading import valid_receivers, visibility_on

SHINY = Material(specular=0.9, shininess=2.0)  # a highlight wide enough to be seen from anywhere
FLOOR = Mesh.create(
    np.array([[-4.0, 0, -4], [4, 0, -4], [4, 0, 4], [-4, 0, 4]]), np.array([[0, 2, 1], [0, 3, 2]]), dtype=jnp.float32
)
BLOCK = to_mesh([box([-1, 0, -1], [1, 1.5, 1])])


@functools.cache
def views():
    """A block turned with the light, so that the wall that is seen lies along it; half of them face it by rounding."""
    found = []
    for azimuth in np.linspace(0.1, 1.4, 4):
        along, across = (np.array([np.cos(a), 0, np.sin(a)]) for a in (azimuth, azimuth + np.pi / 2))
        turned = np.asarray(BLOCK.vertices, float) @ np.stack([along, [0, 1, 0], across])
        block = Mesh.create(turned, np.asarray(BLOCK.faces), dtype=jnp.float32)
        eye = 6 * across + 1.5 * along + [0, 2.5, 0]
        camera = Camera.look_at(eye, (0.0, 0.5, 0), phi_y=0.3, near=1, far=20, dtype=jnp.float32)
        light = DirectionalLight.create(0.7 * along - [0, 0.6, 0], dtype=jnp.float32)
        surface = trace_surface(Mesh.merge([FLOOR, block]), camera, 32, 24, GridCaster())
        cosine = np.asarray(surface.normals) @ -np.asarray(light.direction)
        wall = np.asarray(surface.is_seen) & (np.abs(cosine) < 1e-6)
        assert wall.sum() > 50
        found.append((Mesh.merge([FLOOR, block]), camera, light, surface, wall, (cosine[wall] > 0).any()))
    return found


def test_some_of_the_walls_face_the_light_by_rounding():
    assert 0 < sum(facing for *_, facing in views()) < len(views())


LOOK = eqx.filter_jit(lambda technique, mesh, light, camera: technique.build(mesh, light, camera))


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=() if name in ("exact", "hard", "esm", "shadow-volumes") else pytest.mark.long)
        for name in TECHNIQUES
    ],
)
def test_a_face_along_the_light_is_dark(name):
    technique = make_technique(name, 32, GridCaster())
    build = technique.build if name == "asm" else lambda *scene: LOOK(technique, *scene)
    for mesh, camera, light, surface, wall, _ in views():
        visibility = visibility_on(surface, build(mesh, light, camera))
        assert not np.asarray(valid_receivers(surface, light))[wall].any()
        assert (np.asarray(visibility)[wall] == 0).all()
        lit, unlit = (
            np.asarray(shade(surface, (light,), (v,), SHINY)) for v in (jnp.ones_like(visibility), 0 * visibility)
        )
        np.testing.assert_allclose(lit[wall], unlit[wall], atol=1e-6)
