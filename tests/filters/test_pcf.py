"""PCF against the loop of the source's Algorithm 1, bilinear taps against hand-made numbers, world-sized kernels."""

import itertools

import jax.numpy as jnp
import numpy as np
import pytest

from shadowjax import BilinearPercentageCloser, PercentageCloser
from shadowjax.filters.base import Lookup
from shadowjax.filters.pcf import kernel_offsets, percentage_closer, percentage_closer_of

RNG = np.random.default_rng(11)
DEPTHS = RNG.uniform(0, 1, (3, 17, 13))
RECEIVERS = RNG.uniform([-1, -1], [14, 18], (300, 2))
DEPTH = RNG.uniform(0, 1, 300)


def lookup(dtype=jnp.float64, **more):
    fields = {
        "position": jnp.asarray(RECEIVERS, dtype),
        "depth": jnp.asarray(DEPTH, dtype),
        "bias": jnp.asarray(0.05, dtype),
        "texel_size": jnp.ones((), dtype),
    }
    return Lookup(**(fields | more))


def nearest(planes, kernel_size, dtype=jnp.float64, **more):
    """PCF of the receivers, or of others."""
    given = {"position": jnp.asarray(RECEIVERS, dtype), "depth": jnp.asarray(DEPTH, dtype), "bias": 0.05, **more}
    return percentage_closer(planes, kernel_size=kernel_size, **given)


def bilinear(planes, kernel_size, **more):
    return nearest(planes, kernel_size, taps="bilinear", **more)


def algorithm_1(planes, kernel_size):
    """The loop of the source, for one receiver at a time, over every depth of a texel; outside the map is lit."""
    result = []
    for (x, y), d in zip(RECEIVERS, DEPTH, strict=True):
        lit = total = 0
        for i, j in itertools.product(range(kernel_size), repeat=2):
            col = int(np.floor(x + i - (kernel_size - 1) / 2))
            row = int(np.floor(y + j - (kernel_size - 1) / 2))
            for plane in planes:
                inside = 0 <= row < plane.shape[0] and 0 <= col < plane.shape[1]
                lit += not inside or d - 0.05 <= plane[row, col]
                total += 1
        result.append(lit / total)
    return np.array(result)


@pytest.mark.parametrize("kernel_size", [1, 2, 3, 4])
@pytest.mark.parametrize("num_planes", [1, 3])
def test_equals_the_loop_of_algorithm_1(kernel_size, num_planes):
    planes = DEPTHS[:num_planes]
    value = nearest(jnp.asarray(planes), kernel_size)
    np.testing.assert_allclose(value, algorithm_1(planes, kernel_size), atol=1e-15)


@pytest.mark.parametrize(
    ("size", "expected"), [(1, [0]), (2, [-0.5, 0.5]), (3, [-1, 0, 1]), (4, [-1.5, -0.5, 0.5, 1.5])]
)
def test_offsets_are_whole_for_odd_and_half_for_even_kernels(size, expected):
    assert list(kernel_offsets(size)) == expected


def test_all_lit_is_exactly_one_and_all_dark_exactly_zero(dtype):
    """Adding 1/18 eighteen times in float32 gives 0.99999899 (mdsm, figure 4.19); counting does not."""
    planes = jnp.ones((2, 8, 8), dtype)
    inside, depth = jnp.full((300, 2), 4.2, dtype), jnp.asarray(DEPTH, dtype)
    assert jnp.all(nearest(planes, 3, dtype, position=inside) == 1)
    assert jnp.all(nearest(planes - 1, 3, dtype, position=inside, depth=depth + 1) == 0)


@pytest.mark.parametrize(
    ("depth", "across", "along", "expected"), [(0.4, 0.3, 0.7, 0.58), (0.25, 0.1, 0.9, 0.91), (0.55, 0.5, 0.5, 0.25)]
)
def test_bilinear_mix_of_four_results(depth, across, along, expected):
    """filtering, eq. 2.2 with z = (.3, .6, .5, .2): z₀₀, z₁₀ in the first row, z₀₁, z₁₁ in the second."""
    planes = jnp.asarray([[[0.3, 0.6], [0.5, 0.2]]])
    where = {"position": jnp.asarray([[0.5 + across, 0.5 + along]]), "depth": jnp.asarray([depth])}
    lit = (np.asarray(planes[0]) >= depth).astype(float)
    weights = np.outer([1 - along, along], [1 - across, across])
    value = float(bilinear(planes, 1, bias=0.0, border="clamp", **where)[0])
    np.testing.assert_allclose(value, np.sum(lit * weights), rtol=1e-14)
    np.testing.assert_allclose(value, expected, rtol=1e-14)


@pytest.mark.parametrize("kernel_size", [1, 2, 3])
def test_bilinear_kernel_is_the_mean_of_its_single_taps(kernel_size):
    planes = jnp.asarray(DEPTHS[:2])
    taps = []
    for dx, dy in itertools.product(kernel_offsets(kernel_size), repeat=2):
        taps.append(bilinear(planes, 1, shift=(dx, dy)))
    expected = jnp.mean(jnp.stack(taps), axis=0)
    np.testing.assert_allclose(bilinear(planes, kernel_size), expected, atol=1e-13)


def test_bilinear_is_continuous_where_nearest_jumps():
    line = jnp.linspace(2.0, 6.0, 4001)
    where = {
        "position": jnp.stack([line, jnp.full_like(line, 3.3)], -1),
        "depth": jnp.full_like(line, 0.5),
        "bias": 0.0,
    }
    planes = jnp.asarray(DEPTHS[:1])
    smooth = jnp.max(jnp.abs(jnp.diff(bilinear(planes, 3, **where))))
    assert float(smooth) < 2e-3
    assert float(jnp.max(jnp.abs(jnp.diff(nearest(planes, 3, **where))))) > 0.1


def test_world_sized_kernel_keeps_its_width_when_the_texel_shrinks():
    """Taps lie width/K apart in the world: half the texel, twice the texels between taps."""
    fixed = PercentageCloser(2, width_world=4.0)
    planes = jnp.asarray(DEPTHS[:1])
    coarse = fixed.visibility(planes, lookup(texel_size=jnp.asarray(2.0)))
    np.testing.assert_array_equal(coarse, nearest(planes, 2))
    fine = fixed.visibility(planes, lookup(texel_size=jnp.asarray(1.0)))
    np.testing.assert_array_equal(fine, nearest(planes, 2, width_world=4.0))
    assert np.any(np.asarray(fine) != np.asarray(coarse))


@pytest.mark.parametrize("make", [PercentageCloser, BilinearPercentageCloser])
@pytest.mark.parametrize("size", [0, -1, 2.5])
def test_kernel_size_is_checked(make, size):
    with pytest.raises((ValueError, TypeError), match="kernel_size"):
        make(size)


def test_world_width_is_checked():
    for make in (PercentageCloser, BilinearPercentageCloser):
        with pytest.raises(ValueError, match="width_world must be positive"):
            make(3, width_world=0.0)


@pytest.mark.parametrize("kernel_size", [1, 2, 3])
def test_world_sized_bilinear_taps_equal_a_loop(kernel_size):
    """Each receiver has texels of its own size, so taps lie width/(K · texel) texels apart; outside is lit."""
    texel, width = RNG.uniform(0.3, 3.0, len(DEPTH)), 2.5
    planes = DEPTHS[:2]
    expected = []
    for (x, y), d, size in zip(RECEIVERS, DEPTH, texel, strict=True):
        offsets = [(i - (kernel_size - 1) / 2) * width / (kernel_size * size) for i in range(kernel_size)]
        total = 0.0
        for dx, dy, plane in itertools.product(offsets, offsets, planes):
            u, v = x + dx - 0.5, y + dy - 0.5
            for col, row in itertools.product((np.floor(u), np.floor(u) + 1), (np.floor(v), np.floor(v) + 1)):
                inside = 0 <= row < plane.shape[0] and 0 <= col < plane.shape[1]
                lit = not inside or d - 0.05 <= plane[int(row), int(col)]
                total += lit * (1 - abs(u - col)) * (1 - abs(v - row))
        expected.append(total / (kernel_size**2 * len(planes)))
    found = bilinear(jnp.asarray(planes), kernel_size, width_world=width, texel_size=jnp.asarray(texel))
    np.testing.assert_allclose(found, expected, atol=1e-13)
    filter_ = BilinearPercentageCloser(kernel_size, width_world=width)
    same = filter_.visibility(jnp.asarray(planes), lookup(texel_size=jnp.asarray(texel)))
    np.testing.assert_array_equal(found, same)
    lit = bilinear(jnp.full((2, 17, 13), 2.0), kernel_size, width_world=width, texel_size=jnp.asarray(texel))
    assert set(np.asarray(lit).tolist()) == {1.0}


@pytest.mark.parametrize("taps", ["nearest", "bilinear"])
def test_receivers_of_a_lookup_are_its_arrays(taps):
    """A plane under each receiver, a bias for each, and a border that goes on."""
    rng = np.random.default_rng(4)
    gradient, bias = jnp.asarray(rng.normal(size=(300, 2)) / 9), jnp.asarray(rng.uniform(0, 0.1, 300))
    where = lookup(border="clamp", gradient=gradient, bias=bias)
    planes = jnp.asarray(DEPTHS)
    arrays = nearest(planes, 3, bias=bias, border="clamp", taps=taps, gradient=gradient)
    np.testing.assert_array_equal(percentage_closer_of(planes, where, 3, taps), arrays)
    assert np.any(np.asarray(arrays) != np.asarray(nearest(planes, 3, bias=bias, border="clamp", taps=taps)))
