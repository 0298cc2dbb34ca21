"""Every kind of bias says where its limit leaves acne on steep planes, and which call frees them."""

import math

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from shapes import above, plate_over_plane

from shadowjax import DirectionalLight, Hard, ShadowMapping
from shadowjax.bias import Bias, BiasRule, BiasSum, BufferBias, NormalOffset, ReceiverPlane, SlopeScaled
from shadowjax.evaluate.slope_limits import slope_limit
from shadowjax.rays.brute import BruteForceCaster

# One of each kind that frees a plane of acne up to its limit, as far as the kind does that.
KINDS = {
    Bias: Bias.create(0.5),
    SlopeScaled: SlopeScaled.create(0.0, 0.5),
    ReceiverPlane: ReceiverPlane.create(1e-3),
    BiasSum: BiasSum((SlopeScaled.create(0.001, 0.5), NormalOffset.create(0.001))),
    NormalOffset: NormalOffset.create(0.01),
    BufferBias: BufferBias.create(1e-4),
}
FOLLOW = (Bias, SlopeScaled, ReceiverPlane, BiasSum)
SPOTS = np.random.default_rng(0).uniform(-3, 3, (300, 2))
POINTS = jnp.asarray(np.stack([SPOTS[:, 0], 0 * SPOTS[:, 0], SPOTS[:, 1]], -1))
NORMALS = jnp.broadcast_to(jnp.asarray([0.0, 1.0, 0.0]), POINTS.shape)
FACES = jnp.zeros(len(POINTS), jnp.int32)
ALL = jnp.ones(len(POINTS), bool)


@pytest.fixture(scope="module")
def built():
    """A floor that the sun grazes at 1.5°, in a map whose texels are about square because a plate floats high above."""
    low = math.radians(1.5)
    light = DirectionalLight.create((-math.cos(low), -math.sin(low), 0.2 * math.cos(low)))
    technique = ShadowMapping(Hard(), 256, caster=BruteForceCaster(), bias=KINDS[Bias])
    return technique.build(plate_over_plane(height=8.0), light, above())


def told(shadows, bias):
    changed = eqx.tree_at(lambda s: s.bias, shadows, bias, is_leaf=lambda x: x is shadows.bias)
    return slope_limit(changed, POINTS, NORMALS, FACES, ALL, ALL)


def test_every_kind_is_here():
    assert set(KINDS) == set(BiasRule.__subclasses__())


@pytest.mark.parametrize("kind", FOLLOW)
def test_acne_from_the_limit_is_told_of_and_the_named_call_frees_it(kind, built):
    found = told(built, KINDS[kind])
    assert found is not None
    assert found.limit == KINDS[kind].steepest == 16
    assert found.acne > 0.02
    assert found.remedy in str(found)
    assert told(built, eval(found.remedy)) is None


@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind not in FOLLOW])
def test_a_bias_that_follows_no_slope_has_no_limit(kind, built):
    assert math.isinf(KINDS[kind].steepest)
    assert KINDS[kind].following(99.0) is KINDS[kind]
    assert told(built, KINDS[kind]) is None


def test_a_largest_bias_in_world_units_is_a_limit_too(built):
    found = told(built, SlopeScaled.create(0.0, 0.5, limit=0.3, max_slope=1e4))
    assert found is not None
    assert "10000 texels of slope or 0.3 world units" in str(found)
    assert told(built, eval(found.remedy)) is None


def test_limits_must_be_positive():
    with pytest.raises(ValueError, match="largest slope must be positive; got 0"):
        SlopeScaled.create(max_slope=0.0)
    with pytest.raises(ValueError, match="limit of a receiver plane must be positive; got -1"):
        ReceiverPlane.create(limit=-1.0)
