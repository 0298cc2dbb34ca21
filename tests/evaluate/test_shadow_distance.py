"""Texels against objects: a box on wide ground under stable slices, told with numbers that hold when they are taken."""

import dataclasses

import numpy as np

from shadowjax import Camera, DirectionalLight, Hard, Mesh, ShadowMapping
from shadowjax.evaluate.shadow_distance import objects, stable_texel, texel_advice
from shadowjax.partitions.cascades import Cascades
from shadowjax.partitions.single import SingleMap
from shadowjax.warps.stable import StableFit

LIGHT = DirectionalLight.create((-0.4, -1.0, 0.25))
BOX = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], float)
SIDES = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]


def box_on_ground():
    """A box of a metre on a ground of two kilometres; the ground is triangles 0 and 1."""
    ground = np.array([[-1000, 0, -1000], [1000, 0, -1000], [1000, 0, 1000], [-1000, 0, 1000]], float)
    quads = [(0, 3, 2, 1), *[tuple(4 + i for i in side) for side in SIDES]]
    faces = np.array([half for a, b, c, d in quads for half in ((a, b, c), (a, c, d))])
    return Mesh.create(np.concatenate([ground, BOX - [0.5, 0, 0.5]]), faces)


def view(far):
    return Camera.look_at((0.0, 2.0, 8.0), (0.0, 0.5, 0.0), phi_y=np.pi / 6, near=0.1, far=far, aspect=16 / 9)


def test_objects_are_connected_parts_without_the_ground():
    middles, sizes = objects(box_on_ground())
    np.testing.assert_allclose(middles, [[0, 0.5, 0]])
    np.testing.assert_allclose(sizes, [1])


def test_a_stable_map_to_a_far_plane_has_texels_as_long_as_the_object_and_the_advice_holds():
    """One map of 512 to 1000 m has texels of 8 m by the closed form; the told distance and resolution mend it."""
    mesh, camera = box_on_ground(), view(1000.0)
    texel = float(stable_texel(camera, 1000.0, 512))
    # the far corners of a wide view bound the sphere: 2·f·τ·(32/31)/512
    np.testing.assert_allclose(texel, 2 * 1000 * np.tan(np.pi / 6) * np.hypot(1, 16 / 9) * 32 / 31 / 512, rtol=1e-12)
    technique = ShadowMapping(Hard(), 512, Cascades(1, warp=StableFit(), tight=False, choose="depth"))
    told = texel_advice(technique, mesh, LIGHT, camera)
    np.testing.assert_allclose([told.texel, told.size, told.far], [texel, 1, 1000], rtol=1e-9)
    assert told.distance is not None
    assert "shadow distance of" in str(told)
    assert texel_advice(ShadowMapping(Hard(), 512, SingleMap(StableFit())), mesh, LIGHT, camera) == told
    for mended in (
        dataclasses.replace(technique, partition=dataclasses.replace(technique.partition, distance=told.distance)),
        dataclasses.replace(technique, resolution=told.resolution),
    ):
        assert texel_advice(mended, mesh, LIGHT, camera) is None
    # not needlessly near: a tenth farther, and texels are too long again
    farther = dataclasses.replace(technique.partition, distance=1.12 * told.distance)
    assert texel_advice(dataclasses.replace(technique, partition=farther), mesh, LIGHT, camera) is not None


def test_maps_without_slices_are_told_a_resolution_and_what_is_out_of_view_nothing():
    mesh = box_on_ground()
    told = texel_advice(ShadowMapping(Hard(), 512, SingleMap()), mesh, LIGHT, view(50.0))
    assert told.distance is None
    assert told.resolution > 512 * 16
    away = Camera.look_at((0.0, 2.0, 8.0), (0.0, 0.5, 30.0), phi_y=0.5, near=0.1, far=50.0)
    assert texel_advice(ShadowMapping(Hard(), 512), mesh, LIGHT, away) is None
