"""Blurs, mip chains, footprints and summed-area tables against direct sums, and their precision at 4096²."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.ndimage

from shadowjax.maps.blur import blur, box_weights, extend, gaussian_weights
from shadowjax.maps.pyramid import footprint_axes, mip_chain, mip_level, read_anisotropic, read_trilinear
from shadowjax.maps.sampling import read_bilinear
from shadowjax.maps.summed_area import box_sum, read_box_mean, summed_area_table

RNG = np.random.default_rng(2)
MAP = RNG.uniform(0, 1, (2, 13, 9))
POSITION = RNG.uniform([0.5, 0.5], [8.5, 12.5], (40, 2))
JACOBIANS = RNG.normal(0, 3, (40, 2, 2))


@pytest.mark.parametrize("weights", [gaussian_weights(7), gaussian_weights(3, 0.8), box_weights(5)])
def test_blur_is_the_separable_correlation(weights):
    radius = len(weights) // 2
    extended = jnp.stack([extend(jnp.asarray(m), radius, "clamp", jnp.zeros(())) for m in MAP])
    expected = np.stack([scipy.ndimage.correlate(m, np.outer(weights, weights), mode="nearest") for m in MAP])
    np.testing.assert_allclose(blur(extended, weights), expected, rtol=1e-12)
    np.testing.assert_allclose(weights.sum(), 1, rtol=1e-15)


def test_borders_of_a_blur():
    lit = extend(jnp.asarray(MAP[0]), 2, "lit", jnp.asarray(7.0))
    assert lit.shape == (17, 13)
    assert np.all(np.asarray(lit)[:2] == 7)
    folded = np.asarray(extend(jnp.asarray(MAP[0, :9, :9]), 1, "octahedral", jnp.zeros(())))
    np.testing.assert_array_equal(folded[0, 1:-1], MAP[0, 0, :9][::-1])


@pytest.mark.parametrize("make", [gaussian_weights, box_weights])
def test_even_kernels_are_refused(make):
    with pytest.raises(ValueError, match=r"odd size.*got 4, use 5"):
        make(4)


def test_every_mip_level_is_a_mean_of_blocks():
    chain = mip_chain(jnp.asarray(MAP))
    assert chain.shapes == ((13, 9), (7, 5), (4, 3), (2, 2), (1, 1))
    padded = np.pad(MAP, ((0, 0), (0, 1), (0, 1)), mode="edge")
    np.testing.assert_allclose(chain.level(1), padded.reshape(2, 7, 2, 5, 2).mean(axis=(2, 4)), rtol=1e-14)
    whole = mip_chain(jnp.asarray(RNG.uniform(0, 1, (1, 8, 8))))
    np.testing.assert_allclose(whole.level(3)[0, 0, 0], jnp.mean(whole.level(0)), rtol=1e-14)
    for wrong in (lambda: mip_chain(jnp.asarray(MAP), 6), lambda: chain.level(5)):
        with pytest.raises(ValueError, match=r"mip level 5 (is|would be) empty"):
            wrong()


def test_trilinear_reads_are_exact_at_whole_levels_and_linear_between():
    chain, position = mip_chain(jnp.asarray(MAP)), jnp.asarray(POSITION)
    read = jax.jit(lambda level: jnp.stack(read_trilinear(chain, position, jnp.full(40, level))))
    fine, coarse = (read_bilinear(chain.level(i), position / 2**i) for i in (0, 1))
    np.testing.assert_allclose(read(0.0), fine, atol=1e-14)
    np.testing.assert_allclose(read(1.0), coarse, atol=1e-14)
    np.testing.assert_allclose(read(0.25), 0.75 * fine + 0.25 * coarse, atol=1e-14)


def test_axes_of_a_footprint_are_its_singular_values():
    axis, longer, shorter = jax.jit(footprint_axes)(jnp.asarray(JACOBIANS))
    directions, values, _ = np.linalg.svd(JACOBIANS)
    np.testing.assert_allclose(np.stack([longer, shorter], -1), values, rtol=1e-9)
    np.testing.assert_allclose(np.abs(np.sum(directions[:, :, 0] * np.asarray(axis), -1)), 1, rtol=1e-9)
    sides = np.linalg.norm(JACOBIANS, axis=1).max(axis=1)
    np.testing.assert_allclose(mip_level(jnp.asarray(JACOBIANS)), np.log2(np.maximum(sides, 1)), atol=1e-12)
    turned = jax.jit(jax.grad(lambda j: jnp.sum(footprint_axes(j)[1])))(jnp.eye(2)[None] * 3)
    assert np.isfinite(turned).all()


def test_anisotropic_reads_keep_what_isotropic_ones_blur_away():
    """A footprint 16 × 1 texels along the stripes of a map: the mean stays the stripe's own value."""
    stripes = jnp.broadcast_to(jnp.asarray([0.0, 1.0])[jnp.arange(64) % 2, None], (64, 64))[None]
    chain = jax.jit(mip_chain)(stripes)
    footprint = jnp.asarray([[[16.0, 0.0], [0.0, 1.0]]])
    position = jnp.asarray([[32.0, 31.5]])
    (sharp,) = jax.jit(lambda f: read_anisotropic(chain, position, f, 16))(footprint)
    (smeared,) = jax.jit(lambda f: read_trilinear(chain, position, mip_level(f)))(footprint)
    np.testing.assert_allclose(sharp, 1.0, atol=1e-12)
    np.testing.assert_allclose(smeared, 0.5, atol=1e-12)


def test_box_means_are_area_weighted():
    table, position = jax.jit(summed_area_table)(jnp.asarray(MAP)), jnp.asarray(POSITION)
    read = jax.jit(lambda size: jnp.stack(read_box_mean(table, position, jnp.full((40, 2), size))))
    # The mean over one texel's square is the bilinear read.
    np.testing.assert_allclose(read(1.0), read_bilinear(jnp.asarray(MAP), position), atol=1e-12)
    wide = np.asarray(read(3.3))
    for i in (0, 7, 23):
        x, y = POSITION[i]
        cols, rows = (
            np.clip(np.minimum(np.arange(n) + 1, c + 1.65) - np.maximum(np.arange(n), c - 1.65), 0, 1)
            for n, c in ((9, x), (13, y))
        )
        expected = np.einsum("nrc,r,c->n", MAP, rows, cols) / (rows.sum() * cols.sum())
        np.testing.assert_allclose(wide[:, i], expected, rtol=1e-10)


def test_float32_sums_of_a_4096_map_are_right_to_a_millionth():
    """Boxes from one texel to all; a plain float32 table is off by more than the sum itself."""
    size = 4096
    rng = np.random.default_rng(0)
    values = rng.uniform(0.2, 1, (size, size)).astype(np.float32)
    table = jax.jit(summed_area_table)(jnp.asarray(values)[None])
    start = rng.integers(0, size - 1, (20_000, 2))
    end = start + np.minimum(2 ** rng.integers(0, 13, (20_000, 2)), size - start)
    lower, upper = (tuple(jnp.asarray(corner.T, jnp.int32)) for corner in (start, end))
    found = np.asarray(jax.jit(box_sum)(table, lower, upper)[0], np.float64)

    def sums(dtype):
        full = np.zeros((size + 1, size + 1), dtype)
        full[1:, 1:] = values.cumsum(0, dtype=dtype).cumsum(1, dtype=dtype)
        (left, top), (right, bottom) = start.T, end.T
        return (full[bottom, right] - full[bottom, left]) - (full[top, right] - full[top, left])

    exact = sums(np.float64)
    assert np.max(np.abs(found / exact - 1)) < 1e-6
    assert np.max(np.abs(sums(np.float32) / exact - 1)) > 0.1
