"""Kinds of bias: each frees planes of acne from its closed-form size on, and no earlier."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from shapes import above, lights, plate_over_plane

from shadowjax import Bias, Hard, Mesh, MultiDepth, Neighbourhood, PercentageCloser, ShadowMapping
from shadowjax.bias.kinds import BiasSum, NormalOffset, ReceiverPlane, SlopeScaled, acne_free_offset
from shadowjax.bias.rule import plane_gradient, texel_size

PLATE = plate_over_plane()
FLOOR = Mesh(PLATE.vertices, PLATE.faces[:2], PLATE.face_colors[:2])
SPOTS = np.random.default_rng(0).uniform(-2.5, 2.5, (4000, 2))
POINTS = jnp.asarray(np.stack([SPOTS[:, 0], 0 * SPOTS[:, 0], SPOTS[:, 1]], -1))
NORMALS = jnp.broadcast_to(jnp.asarray([0.0, 1.0, 0.0]), POINTS.shape)


@eqx.filter_jit
def darkest(shadows):
    return jnp.min(shadows.visibility(POINTS, NORMALS))


@pytest.fixture(scope="module")
def built():
    """PCF 3 × 3 over the bare floor; biases are exchanged on the same map."""
    shadows = ShadowMapping(PercentageCloser(3), 24).build(FLOOR, lights()["directional"], above())
    return shadows, shadows.maps[0].grid


def with_bias(shadows, bias):
    return eqx.tree_at(lambda s: s.bias, shadows, bias, is_leaf=lambda x: x is shadows.bias)


def test_normal_offset_frees_a_plane_from_its_closed_form_on(built):
    shadows, grid = built
    length = float(acne_free_offset(grid, POINTS[:1], NORMALS[:1], 1.5)[0])
    for factor, lit in ((1.0, True), (0.9, False)):
        bias = NormalOffset.create(factor * length, "world", by_sine=False)
        assert (float(darkest(with_bias(shadows, bias))) == 1) == lit


def test_normal_offset_in_texels_by_sine_needs_at_most_the_diagonal(built):
    shadows, grid = built
    sine = float(jnp.linalg.norm(jnp.cross(lights()["directional"].direction, NORMALS[0])))
    needed = acne_free_offset(grid, POINTS[:1], NORMALS[:1], 1.5)[0] / (texel_size(grid, POINTS[:1])[0] * sine)
    assert float(needed) <= 1.5 * np.sqrt(2) + 1e-9
    assert float(darkest(with_bias(shadows, NormalOffset.create(1.001 * float(needed))))) == 1
    assert float(darkest(with_bias(shadows, NormalOffset.create(0.9 * float(needed))))) < 1


@pytest.mark.parametrize("kind", ["directional", "spot"])
@pytest.mark.parametrize("filter_", [Hard(), PercentageCloser(4)])
def test_receiver_plane_needs_no_bias_on_planes(kind, filter_, built):
    """Exact under parallel light; a spot bends depth between texels by a share of a texel of slope."""
    shadows = ShadowMapping(filter_, 24, bias=ReceiverPlane.create(0.0, 0.0 if kind == "directional" else 0.2))
    assert float(darkest(shadows.build(FLOOR, lights()[kind], above()))) == 1
    plain = ShadowMapping(filter_, 24, bias=Bias.create(0.2)).build(FLOOR, lights()[kind], above())
    assert float(darkest(plain)) < 1


def test_receiver_plane_over_a_multi_depth_map_needs_the_radius(built):
    shadows, _ = built
    other = shadows.with_filter(MultiDepth(Neighbourhood("min"), 3), ReceiverPlane.create(slope=1.0))
    assert float(darkest(other)) == 1
    assert float(darkest(with_bias(other, ReceiverPlane.create(slope=0.9)))) < 1


def test_slope_scaled_limits_and_falls_short_on_diagonals(built):
    shadows, grid = built
    slope = jnp.abs(plane_gradient(grid, POINTS[:1], NORMALS[:1])[0])
    assert float(jnp.min(slope)) > 0.1 * float(jnp.max(slope))
    assert float(darkest(with_bias(shadows, SlopeScaled.create(slope=1.5)))) == 1
    assert float(darkest(with_bias(shadows, SlopeScaled.create(slope=1.5, over="largest")))) < 1
    capped = SlopeScaled.create(slope=1.5, limit=float(1.4 * jnp.sum(slope)))
    assert float(darkest(with_bias(shadows, capped))) < 1
    world = SlopeScaled.create(0.25, 2.0).apply(grid, POINTS[:1], NORMALS[:1]).depth
    np.testing.assert_allclose(world, 0.25 + 2 * jnp.sum(slope), rtol=1e-12)


def test_a_sum_adds_depths_and_moves(built):
    _, grid = built
    parts = (Bias.create(0.1, "world"), NormalOffset.create(0.2, "world", by_sine=False), SlopeScaled.create(0.05))
    total = BiasSum(parts).apply(grid, POINTS[:3], NORMALS[:3])
    np.testing.assert_allclose(total.points[:, 1], 0.2, rtol=1e-12)
    expected = sum(part.apply(grid, POINTS[:3], NORMALS[:3]).depth for part in parts)
    np.testing.assert_allclose(total.depth, expected, rtol=1e-12)
    assert BiasSum((*parts, ReceiverPlane.create())).apply(grid, POINTS[:3], NORMALS[:3]).follows_plane


def test_gradients_are_finite_at_grazing_light(built):
    _, grid = built
    sideways = jnp.cross(lights()["directional"].direction, jnp.asarray([0.0, 1.0, 0.0]))
    normals = jnp.stack([sideways / jnp.linalg.norm(sideways), -lights()["directional"].direction])
    bias = BiasSum((NormalOffset.create(1.0), SlopeScaled.create(0.0, 1.0), ReceiverPlane.create(slope=0.5)))

    def total(normals, bias):
        forgiven = bias.apply(grid, POINTS[:2], normals)
        return jnp.sum(forgiven.depth) + jnp.sum(forgiven.points) + jnp.sum(plane_gradient(grid, POINTS[:2], normals))

    for leaf in jax.tree.leaves(jax.grad(total, argnums=(0, 1))(normals, bias)):
        assert np.isfinite(leaf).all()


def test_bad_numbers_are_named():
    with pytest.raises(ValueError, match="normal offset must not be negative; got -1"):
        NormalOffset.create(-1.0)
    with pytest.raises(ValueError, match="unit of a normal offset must be one of 'world', 'texel'"):
        NormalOffset.create(1.0, "slope")
    with pytest.raises(ValueError, match="over must be one of"):
        SlopeScaled.create(over="mean")
    with pytest.raises(ValueError, match="at least one part"):
        BiasSum(())
