"""A lamp's filtered maps answer alike however far its ground reaches: digits go to what the view sees.

Filters that average moments or basis values share one range of depths; rays of a lamp run to the horizon, and the box
and its shadow would take up a millionth of it. Pictures are judged by the closed form of the box's shadow.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from box_shadow import FORWARD_FROM, camera_directions, ground_shadow, stage, undecided

from shadowjax import PARTITIONS, TECHNIQUES, ShadowMapping, make_technique
from shadowjax.filters.prefilter import DepthRange
from shadowjax.partitions.single import SingleMap
from shadowjax.rays.brute import BruteForceCaster
from shadowjax.rays.grid.caster import GridCaster

HALVES = (1e2, 1e3, 1e4, 1e5, 1e6)
# Filters whose shadows fade behind their caster, or bleed, at this resolution; their ground is judged where it is lit.
FADING = ("esm", "evsm2")
PARTITION = {"one map": SingleMap, "cube": PARTITIONS["cube"]}
CODED = [
    name
    for name in TECHNIQUES
    if isinstance(made := make_technique(name), ShadowMapping)
    and not made.filter.compares
    and not made.coverage
    and made.filter.cast_factor == 1
]
look_up = eqx.filter_jit(lambda shadows, points, normals: shadows.visibility(points, normals))


def ground(kind="point", by=0.1):
    """Places on the ground in the picture whose answer a part `by` of a metre does not decide, and whether dark."""
    on_ground, dark = ground_shadow(kind)
    told = on_ground & ~undecided(kind, by)
    seen = camera_directions()[told]
    points = FORWARD_FROM - FORWARD_FROM[1] / seen[:, 1:2] * seen
    return jnp.asarray(points, jnp.float32), dark[told]


def assert_alike(names, partition, caster, halves, resolution):
    points, dark = ground()
    assert np.sum(dark) >= 20
    normals = jnp.broadcast_to(jnp.asarray([0, 1, 0], jnp.float32), points.shape)
    built = []
    for half in halves:
        scene = stage(jnp.float32, kind="point", half=half)
        technique = make_technique(names[0], resolution, caster, partition=partition)
        built.append(technique.build(scene.mesh, scene.light, scene.camera))
    for name in names:
        read = make_technique(name, resolution, caster)
        assert isinstance(read, ShadowMapping)
        filter_ = read.filter
        answers = [np.asarray(look_up(shadows.with_filter(filter_), points, normals)) for shadows in built]
        for half, answer in zip(halves, answers, strict=True):
            judged = ~dark if name in FADING else np.ones_like(dark)
            np.testing.assert_array_equal((answer < 0.5)[judged], dark[judged], err_msg=f"{name} {half}")
            assert np.max(np.abs(answer - answers[0])) <= 0.2, (name, half)


def test_variance_answers_alike_on_a_ground_that_reaches_a_thousand_kilometres():
    assert_alike(["vsm"], SingleMap(), BruteForceCaster(), (1e2, 1e6), 256)


@pytest.mark.long
@pytest.mark.parametrize("partition", PARTITION)
def test_every_prefiltered_map_answers_alike_on_any_ground(partition):
    assert_alike(CODED, PARTITION[partition](), GridCaster(), HALVES, 256)


def test_parts_rise_are_even_over_what_is_seen_and_smooth():
    scale = DepthRange(jnp.float32(1), jnp.float32(1e6), jnp.float32(11))
    depth = jnp.concatenate(
        [jnp.linspace(1, 11, 101, dtype=jnp.float32), jnp.geomspace(11.1, 1e6, 200, dtype=jnp.float32)]
    )
    code = np.asarray(scale.to_unit(depth))
    assert np.all(np.diff(code) >= 0)
    assert np.all(np.diff(code[depth < 1e5]) > 0)
    np.testing.assert_allclose(code[:101], np.linspace(0, 0.9, 101), atol=1e-6)
    assert code[-1] <= 1
    slope = jax.vmap(jax.grad(scale.to_unit))(jnp.asarray([5.0, 10.999, 11.001], jnp.float32))
    np.testing.assert_allclose(slope, 0.09, rtol=1e-2)


def test_where_all_is_seen_or_nothing_near_is_depths_are_parts_of_the_whole_range():
    depth = jnp.linspace(1.0, 9.0, 33, dtype=jnp.float32)
    for seen in (9.0, 12.0, 0.5):
        bent = DepthRange(jnp.float32(1), jnp.float32(9), jnp.float32(seen)).to_unit(depth)
        np.testing.assert_array_equal(bent, DepthRange(jnp.float32(1), jnp.float32(9)).to_unit(depth))


@pytest.mark.parametrize("partition", PARTITION)
def test_what_the_view_sees_bounds_the_seen_depth_and_holds_still(partition):
    made = PARTITION[partition]()
    grids = eqx.filter_jit(lambda scene: made.grids(scene.mesh, scene.light, scene.camera, 64))
    for half in (5.0, 1e2, 1e6):
        scene = stage(jnp.float32, kind="point", half=half)
        seen = [float(grid.seen) for grid in grids(scene)]
        farthest = float(jnp.max(jnp.linalg.norm(ground(by=0.0)[0] - scene.light.homogeneous[:3], axis=-1)))
        for one, grid in zip(seen, grids(scene), strict=True):
            assert min(farthest, float(grid.far)) <= one <= min(13, float(grid.far)), half
        moved = eqx.tree_at(lambda s: s.camera.position, scene, scene.camera.position + 1e-4)
        assert [float(grid.seen) for grid in grids(moved)] == seen
