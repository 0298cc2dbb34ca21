"""Metrics: closed forms, a slow transcription of SSIM's definition, and edges moved by known distances."""

import sys
import types

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from shadowjax.evaluate import metrics


def images(dtype, shape=(24, 20)):
    generator = np.random.default_rng(4)
    return tuple(jnp.asarray(generator.uniform(size=shape), dtype=dtype) for _ in range(2))


def test_errors_match_their_definitions(dtype, rounding):
    a, b = images(dtype)
    x, y = np.asarray(a, np.float64), np.asarray(b, np.float64)
    mask = x > 0.3
    cases = {
        metrics.rmse: lambda m: np.sqrt(np.mean((x - y)[m] ** 2)),
        metrics.mean_abs_error: lambda m: np.mean(np.abs(x - y)[m]),
        metrics.psnr: lambda m: -10 * np.log10(np.mean((x - y)[m] ** 2)),
        metrics.false_lit: lambda m: np.mean(np.maximum(x - y, 0)[m]),
        metrics.false_shadow: lambda m: np.mean(np.maximum(y - x, 0)[m]),
    }
    for metric, definition in cases.items():
        for chosen in (None, mask):
            found = metric(a, b, chosen)
            assert found.dtype == dtype
            np.testing.assert_allclose(
                found, definition(np.ones_like(mask) if chosen is None else mask), rtol=9 * rounding
            )


def test_mean_absolute_error_of_visibility_is_false_light_and_false_shadow(dtype, rounding):
    a, b = images(dtype)
    parts = metrics.false_lit(a, b) + metrics.false_shadow(a, b)
    np.testing.assert_allclose(metrics.mean_abs_error(a, b), parts, rtol=9 * rounding)


def test_false_areas_of_binary_images_count_pixels():
    reference = np.zeros((10, 10))
    test = reference.copy()
    test[:2] = 1
    assert float(metrics.false_lit(test, reference)) == pytest.approx(0.2)
    assert float(metrics.false_shadow(test, reference)) == 0
    mask = np.zeros((10, 10), bool)
    mask[1:3] = True
    assert float(metrics.false_lit(test, reference, mask)) == pytest.approx(0.5)


def test_masks_spread_over_channels_and_may_be_empty(dtype):
    a, b = images(dtype, (8, 9, 3))
    mask = np.zeros((8, 9), bool)
    assert float(metrics.rmse(a, b, mask)) == 0
    mask[2, 3] = True
    expected = np.sqrt(np.mean((np.asarray(a)[2, 3] - np.asarray(b)[2, 3]) ** 2))
    np.testing.assert_allclose(metrics.rmse(a, b, mask), expected, rtol=1e-5)


def test_equal_images_have_finite_perfect_scores_and_gradients(dtype):
    a, _ = images(dtype)
    assert float(metrics.rmse(a, a)) == 0
    assert np.isfinite(float(metrics.psnr(a, a)))
    assert float(metrics.psnr(a, a)) > 130
    np.testing.assert_allclose(metrics.ssim(a, a), 1, rtol=1e-5)
    for metric in (metrics.rmse, metrics.psnr, metrics.ssim, metrics.mean_abs_error):
        assert np.isfinite(np.asarray(jax.jit(jax.grad(metric))(a, a))).all()


def slow_ssim(x, y):
    """Wang et al. 2004: weighted statistics of every 11 × 11 window, one by one."""
    offset = np.arange(11) - 5
    weight = np.exp(-(offset[:, None] ** 2 + offset**2) / (2 * 1.5**2))
    weight /= weight.sum()
    values = []
    for row in range(x.shape[0] - 10):
        for col in range(x.shape[1] - 10):
            p, q = x[row : row + 11, col : col + 11], y[row : row + 11, col : col + 11]
            mp, mq = (weight * p).sum(), (weight * q).sum()
            vp, vq = (weight * (p - mp) ** 2).sum(), (weight * (q - mq) ** 2).sum()
            cov = (weight * (p - mp) * (q - mq)).sum()
            c1, c2 = 0.01**2, 0.03**2
            values.append((2 * mp * mq + c1) * (2 * cov + c2) / ((mp**2 + mq**2 + c1) * (vp + vq + c2)))
    return np.array(values).reshape(x.shape[0] - 10, x.shape[1] - 10)


def test_ssim_matches_its_definition(dtype):
    a, b = images(dtype)
    b = (a + b) / 2
    expected = slow_ssim(np.asarray(a, np.float64), np.asarray(b, np.float64))
    tolerance = 2e-5 if dtype == jnp.float32 else 1e-12
    np.testing.assert_allclose(metrics.ssim(a, b), expected.mean(), rtol=tolerance)
    mask = np.asarray(a) > 0.5
    np.testing.assert_allclose(metrics.ssim(a, b, mask), expected[mask[5:-5, 5:-5]].mean(), rtol=tolerance)
    three = jnp.stack([a, b, a], axis=-1), jnp.stack([b, b, b], axis=-1)
    np.testing.assert_allclose(metrics.ssim(*three), (2 * expected.mean() + 1) / 3, rtol=tolerance)


def test_a_shifted_edge_lies_as_far_as_it_was_shifted():
    cols = np.arange(30)
    reference = np.broadcast_to(cols >= 12, (20, 30)).astype(float)
    for shift in (0, 1, 4):
        test = np.broadcast_to(cols >= 12 + shift, (20, 30)).astype(float)
        found = metrics.edge_distance(test, reference)
        assert found.mean == found.maximum == shift
        assert found.num_misclassified == 20 * shift
        assert found.misclassified_maximum == (shift - 0.5 if shift else 0)
        assert found.misclassified_mean == (shift / 2 if shift else 0)  # centres ½, 3/2, ... from the edge


def test_edge_distance_is_symmetric_and_finds_an_outlier_that_a_mean_hides():
    reference = np.zeros((40, 40))
    reference[:, 20:] = 1
    test = reference.copy()
    test[5, 2] = 1
    there, back = metrics.edge_distance(test, reference), metrics.edge_distance(reference, test)
    assert there.maximum == back.maximum == 18.0  # the stray pixel's far side, 2 − ½, to the edge at 19½
    assert there.mean == pytest.approx(back.mean)
    assert there.misclassified_maximum == 17.5


def test_edges_of_masked_pixels_do_not_count():
    reference = np.zeros((10, 10))
    reference[:, 5:] = 1
    test = reference.copy()
    test[3, 1] = 1
    mask = np.ones((10, 10), bool)
    mask[3, 1] = False
    assert metrics.edge_distance(test, reference, mask) == metrics.EdgeDistance(0.0, 0.0, 0.0, 0.0, 0)


def test_images_without_edges_have_documented_distances():
    lit, half = np.ones((3, 4)), np.ones((3, 4))
    half[:, :2] = 0
    assert metrics.edge_distance(lit, lit) == metrics.EdgeDistance(0.0, 0.0, 0.0, 0.0, 0)
    assert metrics.edge_distance(lit, half).maximum == 5.0
    assert metrics.edge_distance(half, lit).misclassified_maximum == 5.0


def test_flip_is_none_without_its_package_and_its_mean_with_it(monkeypatch):
    a, b = (np.asarray(image) for image in images(jnp.float32))
    monkeypatch.setitem(sys.modules, "flip_evaluator", None)
    assert metrics.flip(a, b) is None
    seen = []

    def evaluate(reference, test, dynamic_range):
        seen.append((reference, test, dynamic_range))
        return np.abs(reference - test), float(np.mean(np.abs(reference - test))), {}

    monkeypatch.setitem(sys.modules, "flip_evaluator", types.SimpleNamespace(evaluate=evaluate))
    assert metrics.flip(a, b) == pytest.approx(float(np.mean(np.abs(a - b))), rel=1e-6)
    ((reference, test, dynamic_range),) = seen
    assert dynamic_range == "LDR"
    assert reference.shape == test.shape == (24, 20, 3)
    np.testing.assert_array_equal(reference[..., 1], b)
    np.testing.assert_array_equal(test[..., 2], a)


def test_bad_arguments_say_what_to_do():
    a = np.zeros((12, 12))
    with pytest.raises(ValueError, match="one shape"):
        metrics.rmse(a, a[:5])
    with pytest.raises(ValueError, match="rows and columns"):
        metrics.rmse(a, a, mask=np.ones((3, 3), bool))
    with pytest.raises(ValueError, match="at least 11"):
        metrics.ssim(a[:8], a[:8])
    with pytest.raises(ValueError, match="rows, cols"):
        metrics.edge_distance(a[..., None], a[..., None])
    with pytest.raises(ValueError, match="peak"):
        metrics.psnr(a, a, peak=0.0)
