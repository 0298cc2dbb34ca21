"""Records against values worked out by hand, and the checks of a comparison."""

import jax.numpy as jnp
import numpy as np
import pytest

from shadowjax.evaluate.compare import View, measure, record, reference_view, timed
from shadowjax.presets.names import make_technique
from shadowjax.rays.brute import BruteForceCaster
from shadowjax.scenes import make_scene
from shadowjax.scenes.staging import relit
from shadowjax.shading import Surface
from shadowjax.techniques.base import Shadows

SCENE = "sphere-over-plane"


class SevenBytes(Shadows):
    def visibility(self, points, normals):
        return points[..., 0]

    @property
    def map_bytes(self):
        return 7


def view_of(exact, valid, samples, cosine=0.5):
    shape = exact.shape
    filled = jnp.zeros((*shape, 3), exact.dtype)
    surface = Surface(filled, filled, filled, filled, filled, exact, jnp.zeros(shape, jnp.int32))
    return View(surface, valid, exact, jnp.where(valid, jnp.asarray(cosine, exact.dtype), 0), samples)


def test_record_by_hand(dtype):
    exact = jnp.asarray([[1, 1, 0, 0], [1, 0, 0, 1]], dtype)
    test = jnp.asarray([[1, 0.5, 0.25, 0], [0, 0, 0, 1]], dtype)
    valid = jnp.asarray([[True] * 4, [True, True, True, False]])
    got = record("x", make_technique("2sm-max"), SevenBytes(), test, view_of(exact, valid, 1), 1.0, 2.0)
    np.testing.assert_allclose(
        [got.rmse, got.mean_abs_error, got.false_lit, got.false_shadow],
        [((0.25 + 0.0625 + 1) / 7) ** 0.5, 1.75 / 7, 0.25 / 7, 1.5 / 7],
        rtol=1e-6,
    )
    np.testing.assert_allclose(got.light_rmse, got.rmse, rtol=1e-6)  # the same cosine everywhere cancels
    assert (got.tones, got.tones_bound, got.map_bytes, got.ssim) == (4, 3, 7, None)
    assert (got.build_ms, got.visibility_ms) == (1.0, 2.0)


def test_errors_in_grazing_light_weigh_little(dtype):
    exact, test = jnp.asarray([[1, 1]], dtype), jnp.asarray([[1, 0]], dtype)
    cosine = jnp.asarray([[1.0, 0.1]], dtype)
    got = record("x", make_technique("hard"), SevenBytes(), test, view_of(exact, exact > 0, 1, cosine), 1.0, 2.0)
    np.testing.assert_allclose(got.light_rmse, (0.01 / 1.01) ** 0.5, rtol=1e-5)
    np.testing.assert_allclose(got.rmse, 0.5**0.5, rtol=1e-5)


def test_pixels_are_means_over_their_valid_samples(dtype):
    exact = jnp.asarray([[1, 0, 1, 1], [1, 1, 0, 0]], dtype)
    valid = jnp.asarray([[True, True, False, False], [False, True, False, False]])
    view = view_of(exact, valid, 2)
    np.testing.assert_array_equal(view.pixel_mask, [[True, False]])
    np.testing.assert_allclose(view.per_pixel(exact), [[2 / 3, 0]], rtol=1e-6)
    assert view.per_pixel(exact).dtype == dtype


def test_supersampling_keeps_shapes():
    found = measure(
        make_scene(SCENE),
        ("hard",),
        width=16,
        height=12,
        resolution=24,
        samples_per_axis=2,
        repeats=1,
        caster=BruteForceCaster(),
    )
    assert found.visibilities[0].shape == (24, 32)
    assert found.view.per_pixel(found.visibilities[0]).shape == (12, 16)


def test_timing_takes_the_median_and_skips_the_first_call():
    calls = []
    result, milliseconds = timed(lambda: calls.append(1) or jnp.ones(3), repeats=5)
    assert len(calls) == 6
    assert milliseconds > 0
    assert result.shape == (3,)


@pytest.mark.parametrize(
    ("names", "message"),
    [((), "at least one technique"), (("hard", "hard"), "hard more than once"), (("hrad",), "did you mean hard")],
)
def test_bad_names(names, message):
    with pytest.raises(ValueError, match=message):
        measure(make_scene(SCENE), names)


def test_nothing_in_the_light_is_said():
    with pytest.raises(ValueError, match="turn the camera or the light"):
        reference_view(relit(make_scene("plate-over-plane"), direction=(0.0, 1.0, 0.0)), 16, 12, BruteForceCaster())
