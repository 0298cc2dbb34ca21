"""One warning names how coarse coordinates are where pixels or texels are finer; none for scenes near their origin."""

import warnings

import jax.numpy as jnp
import numpy as np
import pytest
from box_shadow import stage

from shadowjax import SCENES, Camera, Mesh, make_scene, make_technique
from shadowjax._checks import SceneWarning
from shadowjax.partitions.single import SingleMap
from shadowjax.rays.grid.caster import GridCaster
from shadowjax.rays.precision import warn_of_coarse_pixels
from shadowjax.shading import trace_surface
from shadowjax.warps.uniform import UniformFit


def traced(dtype, **motion):
    scene = stage(dtype, **motion)
    return trace_surface(scene.mesh, scene.camera, 40, 30, GridCaster())


def built(dtype, **motion):
    scene = stage(dtype, **motion)
    technique = make_technique("hard", 256, GridCaster(), partition=SingleMap(UniformFit("view")))
    return technique.build(scene.mesh, scene.light, scene.camera)


@pytest.mark.parametrize(("make", "what"), [(traced, "pixel"), (built, "texel")])
def test_far_from_the_origin_one_warning_names_the_gap(make, what):
    with pytest.warns(SceneWarning, match=rf"float32 are 0\.12 apart where a {what} is 0\.\d+ wide.*subtracted in 64"):
        make(jnp.float32, shift=(1e6, 0.0, -1e6))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        make(jnp.float32, shift=(1e3, 0.0, -1e3))
        make(jnp.float32, half=1e6)
        make(jnp.float32)


def test_a_mesh_about_a_near_origin_is_silent():
    """What the warning advises."""
    near = stage(jnp.float32)
    mesh = Mesh.create(near.mesh.vertices, near.mesh.faces, origin=(1e6, 0.0, -1e6), dtype=jnp.float32)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        trace_surface(mesh, near.camera, 40, 30, GridCaster())


# The widest and the smallest scenes in every run, the others among the long tests.
OFTEN = ("terrain", "cad-assembly", "two-plates")


@pytest.mark.parametrize(
    "name", [name if name in OFTEN else pytest.param(name, marks=pytest.mark.long) for name in SCENES]
)
def test_built_in_scenes_are_silent_in_full_resolution(name):
    scene = make_scene(name)
    points = scene.mesh.vertices
    z = scene.camera.to_view(points)[:, 2]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warn_of_coarse_pixels(scene.mesh, scene.camera, 2160, points, (z > scene.camera.near) & (z < scene.camera.far))


def test_what_is_near_the_eye_alone_does_not_count():
    """Few pixels lie a hair before the eye; a surface that fills the view there is told."""
    camera = Camera.look_at((1e3, 0.0, 0.0), (1e3, 0.0, -1.0), phi_y=0.4, near=1e-3, far=10.0, dtype=jnp.float32)
    mesh = Mesh.create(
        np.array([[1e3, 0, -1], [1e3 + 1, 0, -1], [1e3, 1, -1]]), np.array([[0, 1, 2]]), dtype=jnp.float32
    )
    near, far = np.array([1e3, 0, -2e-3], np.float32), np.array([1e3, 0, -5], np.float32)
    seen = jnp.ones(200, bool)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warn_of_coarse_pixels(mesh, camera, 1000, jnp.asarray(np.stack([near, *[far] * 199])), seen)
    with pytest.warns(SceneWarning, match="where a pixel is"):
        warn_of_coarse_pixels(mesh, camera, 1000, jnp.asarray(np.stack([near] * 200)), seen)
