"""The limit of a bias that follows slopes is told of where it leaves acne, with a remedy; elsewhere nothing is said."""

import jax.numpy as jnp
import numpy as np
import pytest

from shadowjax import Bias, Hard, ShadowMapping, make_scene
from shadowjax._checks import SceneWarning
from shadowjax.evaluate.compare import compare, record, reference_view
from shadowjax.optimize.viewed.bias import bias
from shadowjax.optimize.viewed.views import view_scene
from shadowjax.rays.casters import default_caster
from shadowjax.scenes.base import towards
from shadowjax.scenes.staging import relit
from shadowjax.shading import visibility_on

SCENE = make_scene("smooth-and-abrupt")
LOW = relit(SCENE, direction=tuple(-towards(40.0, 2.0)))
SIZE = {"width": 96, "height": 72}


def test_a_low_sun_is_told_of_and_the_remedy_frees_what_it_grazes():
    view = reference_view(LOW, **SIZE)

    def measured(bias):
        technique = ShadowMapping(Hard(), 1024, caster=default_caster(), bias=bias)
        shadows = technique.build(LOW.mesh, LOW.lights[0], LOW.camera)
        return record("hard", technique, shadows, visibility_on(view.surface, shadows), view, 0.0, 0.0)

    usual = measured(None)
    told = usual.slope_limit
    assert told is not None
    # an incidence of 85° makes 16 texels on a diagonal; faces with less than 1/256 of the light do not count
    assert np.degrees(np.arctan(16 / np.sqrt(2))) < told.incidence_deg <= 88.01
    assert 16 < told.needed < 1.01 * 256 * np.sqrt(2) + 1
    assert 0.01 < told.acne < told.reached
    assert usual.to_json()["slope_limit"]["needed"] == told.needed
    freed = measured(Bias.create(jnp.float32(0.5), "slope", told.needed))
    assert freed.slope_limit is None
    assert freed.false_shadow < usual.false_shadow - 0.9 * told.acne


def test_python_and_search_say_it_in_a_sentence():
    sentence = (
        r"acne on faces that light grazes at more than 8\d\.\d°.*limit of 16 texels.*% falsely; .*limit=\d+\) frees"
    )
    with pytest.warns(SceneWarning, match="hard: " + sentence):
        records = compare(LOW, ["hard", "exact"], resolution=1024, repeats=1, **SIZE)
    assert [one.slope_limit is None for one in records] == [False, True]
    with pytest.warns(SceneWarning, match=LOW.name + ": " + sentence):
        found = bias(view_scene(LOW, 96, 72, 1024), Hard(), num_values=5)
    assert found.certificate.slope_limit is not None
    assert found.to_dict()["slope_limit"]["acne"] > 0.01


def test_the_default_scene_has_none(recwarn):
    assert compare(SCENE, ["hard"], resolution=256, repeats=1, **SIZE)[0].slope_limit is None
    assert not [one for one in recwarn if issubclass(one.category, SceneWarning)]


def test_a_limit_must_be_positive():
    with pytest.raises(ValueError, match="limit must be positive"):
        Bias.create(0.5, "slope", 0.0)
    np.testing.assert_equal(Bias.create(0.5).limit, 16.0)
