"""Slices: planes given, seen or placed; shares that blend across a seam; stable maps that move by whole texels."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from shapes import above, lights, plate_over_plane

from shadowjax import BruteForceCaster, Camera, ShadowMapping
from shadowjax.evaluate.seams import seam_jump, seam_steps, texel_picture
from shadowjax.evaluate.shimmer import shimmer
from shadowjax.partitions.cascades import Cascades, logarithmic_splits
from shadowjax.partitions.seen_depths import seen_range, seen_splits
from shadowjax.partitions.single import SingleMap
from shadowjax.theory.aliasing.optimal import minimax
from shadowjax.theory.aliasing.storage import seam_jumps
from shadowjax.warps.fit import PerspectiveFit, light_frustum
from shadowjax.warps.stable import StableFit, bounding_sphere

MESH, CAMERA, LIGHT = plate_over_plane(), above(), lights()["directional"]
FIT = PerspectiveFit("minimax", tight=False)


def on_the_floor(count=900, seed=0):
    spots = np.random.default_rng(seed).uniform(-3, 3, (count, 2))
    points = np.stack([spots[:, 0], np.zeros(count), spots[:, 1]], axis=-1)
    return jnp.asarray(points), jnp.broadcast_to(jnp.asarray([0.0, 1.0, 0.0]), points.shape)


def along_the_axis(depths):
    return CAMERA.position + jnp.asarray(depths)[:, None] * CAMERA.forward


@pytest.fixture(scope="module")
def split():
    """Three slices, blended over 0.4 of each, and their maps."""
    partition = Cascades(3, warp=FIT, tight=False, blend=0.4)
    return ShadowMapping(resolution=48, partition=partition).build(MESH, LIGHT, CAMERA)


def test_shares_sum_to_one_and_ramp_through_the_band(split):
    planes = split.partition.cuts
    np.testing.assert_allclose(planes, logarithmic_splits(CAMERA.near, CAMERA.far, 3), rtol=1e-12)
    ratio = float(planes[1] / planes[0])
    cut = float(planes[1])
    depths = np.asarray([cut / ratio**0.41, cut / ratio**0.3, cut / ratio**0.2, cut / ratio**0.1, cut * 1.001])
    shares = np.asarray(split.partition.shares(split.grids, CAMERA, along_the_axis(depths)))
    np.testing.assert_allclose(shares[0], [1, 0.75, 0.5, 0.25, 0], atol=1e-9)
    np.testing.assert_allclose(shares[1], 1 - shares[0], atol=1e-12)
    every = np.asarray(split.partition.shares(split.grids, CAMERA, along_the_axis(np.linspace(1, 20, 500))))
    np.testing.assert_allclose(every.sum(axis=0), 1, atol=1e-12)
    assert every.min() >= 0
    assert (np.diff(split.partition.select(split.grids, CAMERA, along_the_axis(np.linspace(2, 16, 200)))) >= 0).all()


def test_every_map_holds_what_it_has_a_share_in(split):
    rng = np.random.default_rng(2)
    depth = rng.uniform(2, 16, (3000, 1))
    plane = np.concatenate([rng.uniform(-1, 1, (3000, 2)) * np.asarray(CAMERA.half_size), np.ones((3000, 1))], axis=1)
    points = CAMERA.position + jnp.asarray(depth * plane) @ CAMERA.rotation
    shares = split.partition.shares(split.grids, CAMERA, points)
    for share, grid in zip(shares, split.grids, strict=True):
        square = grid.locate(points)[0][np.asarray(share) > 0] / 48
        assert square.min() >= 0
        assert square.max() <= 1


def test_blended_visibility_is_the_mixture_of_both_maps(split):
    points, normals = on_the_floor()
    shares = split.partition.shares(split.grids, CAMERA, points)
    mixed = sum(share * split.read(i, points, normals) for i, share in enumerate(shares))
    np.testing.assert_allclose(split.visibility(points, normals), mixed, atol=1e-12)
    assert ((mixed > 0.01) & (mixed < 0.99)).any()  # somewhere the two maps disagree inside the band


def test_measured_seam_is_the_predicted_one_and_blending_hides_it(split):
    """Texels of neighbouring slices on the view axis: the real maps against the closed form of m_x and m_z."""
    hard = Cascades(3, warp=FIT, tight=False, choose="depth").fit(MESH, LIGHT, CAMERA)
    built = eqx.tree_at(lambda s: s.partition, split, hard)
    grids = hard.grids(MESH, LIGHT, CAMERA, 48)
    built = eqx.tree_at(lambda s: [m.grid for m in s.maps], built, list(grids))
    view = light_frustum(CAMERA, LIGHT.direction, CAMERA.near, CAMERA.far)
    across, along = seam_jumps(view, hard.cuts, minimax)
    normals = jnp.asarray([[0.0, 1.0, 0.0]])
    for i in range(2):
        jump = seam_jump(built, i, i + 1, along_the_axis(hard.cuts[i + 1 : i + 2]), normals)
        # the map's margin of a thousandth changes both maps alike but for the position inside them
        np.testing.assert_allclose(jump.along, along[i], rtol=5e-3)
        assert (jump.visibility <= 1).all()
        if abs(float(CAMERA.forward @ LIGHT.direction)) < 1:
            np.testing.assert_allclose(jump.across, across[i], rtol=5e-3)
    # a row of pixels down the view axis on one triangle: a step without blending, a ramp with
    points = along_the_axis(np.linspace(2.1, 15.9, 120))[None]
    valid = jnp.ones((1, 120), bool)
    region = hard.select(grids, CAMERA, points)
    step = seam_steps(texel_picture(built, points), region, valid)
    ramp = seam_steps(texel_picture(split, points), region, valid, jnp.zeros((1, 120), int))
    assert int(step.pairs) == 2
    assert step.across > 5 * step.elsewhere
    assert ramp.across < 0.35 * step.across
    apart = seam_steps(texel_picture(built, points), region, valid, jnp.arange(120)[None])
    assert int(apart.pairs) == 0
    assert float(apart.across) == 0


def test_cuts_can_be_given_and_bad_ones_are_named():
    partition = Cascades.at([2.0, 5.0, 16.0], choose="depth")
    assert partition.num_partitions == 2
    np.testing.assert_array_equal(partition.planes(MESH, LIGHT, CAMERA), [2, 5, 16])
    np.testing.assert_array_equal(partition.select((), CAMERA, along_the_axis([2.5, 4.9, 5.1, 30.0])), [0, 0, 1, 1])
    for call, message in (
        (lambda: Cascades.at([2.0]), "two planes"),
        (lambda: Cascades.at([2.0, 2.0]), "rise"),
        (lambda: Cascades.at([-1.0, 2.0]), "positive"),
        (lambda: Cascades(blend=1.5), "blend"),
        (lambda: Cascades(choose="near"), "choose must"),
        (lambda: Cascades(num_rows=0), "rows"),
        (lambda: Cascades(choose="depth").select((), CAMERA, along_the_axis([3.0])), "must be fitted first"),
    ):
        with pytest.raises(ValueError, match=message):
            call()


def test_seen_depths_make_the_range_tight_and_leave_out_gaps():
    one, far = jnp.ones(()), jnp.full((), 100.0)
    rng = np.random.default_rng(0)
    depth = jnp.asarray(np.concatenate([rng.uniform(2, 4, 900), rng.uniform(30, 40, 100), [90.0]]))
    seen = jnp.arange(1001) < 1000  # the last pixel is background
    low, high = seen_range(depth, seen, one, far)
    np.testing.assert_allclose([low, high], [2, 40], rtol=0.01)
    np.testing.assert_allclose(seen_splits(depth, seen, one, far, 3), logarithmic_splits(low, high, 3), rtol=1e-12)
    # nine tenths of the pixels are near: equal counts cut there, up to the least share of a slice
    cuts = seen_splits(depth, seen, one, far, 2, "quantile")
    np.testing.assert_allclose(cuts[1], np.median(depth), rtol=0.02)
    # occupied bins: ln 2 of near ones, ln(4/3) of far ones; half of them lie before 2·√(8/3)
    cuts = seen_splits(depth, seen, one, far, 2, "histogram")
    np.testing.assert_allclose(cuts[1], 2 * (8 / 3) ** 0.5, rtol=0.02)
    for rule in ("seen", "quantile", "histogram"):
        for mask in (seen, jnp.zeros(1001, bool), jnp.arange(1001) == 3):
            cuts = seen_splits(depth, mask, one, far, 4, rule)
            assert (jnp.diff(cuts) > 0).all()
            assert np.isfinite(cuts).all()
    np.testing.assert_array_equal(seen_splits(depth, jnp.zeros(1001, bool), one, far, 1), [1, 100])
    with pytest.raises(ValueError, match="rule"):
        seen_splits(depth, seen, one, far, 2, "median")


def test_a_view_of_the_floor_gets_planes_from_its_depth_buffer():
    partition = Cascades(2, rule="seen", num_rows=24, caster=BruteForceCaster())
    planes = partition.planes(MESH, LIGHT, CAMERA)
    corners = np.asarray(CAMERA.to_view(MESH.vertices))[:, 2]
    assert planes[0] >= max(2.0, corners.min())
    assert planes[-1] <= corners.max()
    assert planes[-1] < 0.98 * CAMERA.far  # the far plane lies behind the floor


def test_stable_maps_hold_still_and_others_do_not():
    """The camera moves and turns: texels that keep their places show no change at all."""
    points, normals = on_the_floor(2500, 1)
    moved = Camera.look_at((0.33, 5.05, 6.9), (0.2, 0.1, -0.1), phi_y=0.45, near=2.0, far=16.0)
    share = {}
    for name, fit in (("stable", StableFit()), ("free", StableFit(snap=False)), ("tight", FIT)):
        technique = ShadowMapping(resolution=64, partition=SingleMap(fit))
        found = shimmer(technique, MESH, LIGHT, CAMERA, moved, points, normals)
        share[name] = float(found.share)
        assert int(jnp.sum(found.compared)) > 1000
        np.testing.assert_allclose(found.share, jnp.sum(found.changed) / jnp.sum(found.compared))
    assert share["stable"] == 0
    assert share["free"] > 0.005
    assert share["tight"] > 0.005


def test_the_sphere_holds_the_frustum_and_touches_it():
    for phi, far in ((0.45, 16.0), (0.9, 16.0), (0.2, 2.1)):
        camera = Camera.look_at((0.3, 5.0, 7.0), (0.1, 0.2, 0.0), phi_y=phi, near=2.0, far=far, aspect=1.5)
        centre, radius = bounding_sphere(camera)
        away = np.linalg.norm(np.asarray(camera.frustum_corners() - centre), axis=1)
        np.testing.assert_allclose(away.max(), radius, rtol=1e-12)
    with pytest.raises(ValueError, match="steps"):
        StableFit(1)
    with pytest.raises(ValueError, match="directional light; got SpotLight"):
        SingleMap(StableFit()).grids(MESH, lights()["spot"], CAMERA, 8)
