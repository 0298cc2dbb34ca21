"""Every function of `sj.functional`: jit = eager, vmap = loop, gradients finite and those of differences."""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import shadowjax as sj

F = sj.functional
RNG = np.random.default_rng(5)
DEPTH = RNG.uniform(0.2, 0.8, (6, 5))
PLANES = np.stack([DEPTH, DEPTH[::-1] ** 2])
POSITION = RNG.uniform([0.3, 0.3], [4.7, 5.7], (7, 2))
UNIT = RNG.uniform(0.25, 0.75, 7)
TRIANGLES = np.array([[0.0, 0.0, 0.0], [2.0, 0.1, 0.0], [0.1, 0.2, 2.0], [0.4, 1.0, 0.3]])
FACES = np.array([[0, 1, 2], [0, 1, 3]], np.int32)
LOWER, UPPER, SUN = np.array([0.0, 0.0, 0.0]), np.array([2.0, 1.0, 2.0]), np.array([0.3, -1.0, 0.2])
# Two depths whose codes are averaged, and receivers between them.
TWO = np.array([0.3, 0.7])[:, None] + 0.02 * UNIT
BETWEEN = 0.5 + 0.1 * UNIT


class Case(NamedTuple):
    """A function of arrays alone, what it is called with, and whether its derivative is that of its differences."""

    call: Callable[..., Any]
    arrays: Sequence[np.ndarray]
    smooth: bool = True


CASES = {
    "blur": Case(F.blur, [PLANES, np.array([0.2, 0.5, 0.3])]),
    "blur_exponents": Case(lambda z: F.blur_exponents(40 * z, F.gaussian_weights(3)), [DEPTH]),
    "box_weights": Case(lambda planes: F.blur(planes, F.box_weights(5)), [PLANES]),
    "cast_depth": Case(
        lambda v, o, d: F.cast_depth(v, jnp.asarray(FACES), o, d, 9.0),
        [TRIANGLES, np.array([[0.5, 2.0, 0.4], [0.6, 2.0, 0.2], [5.0, 2.0, 5.0]]), np.tile(SUN, (3, 1))],
    ),
    "chebyshev_visibility": Case(F.chebyshev_visibility, [UNIT, 0.01 + 0.1 * UNIT, UNIT + 0.1]),
    "composite_test": Case(F.composite_test, [TWO, UNIT, 0.1 * UNIT]),
    "decode_convolution": Case(
        lambda two, depth: F.decode_convolution(F.encode_convolution(two, 4).mean(1), depth), [TWO, 0.4 + 0.1 * UNIT]
    ),
    "decode_exponential": Case(
        lambda two, depth, c: F.decode_exponential(F.encode_exponential(two, c).mean(1), depth, c),
        [TWO, 0.75 + 0.1 * UNIT, np.array(30.0)],
    ),
    "decode_exponential_variance": Case(
        lambda two, depth, c, low: F.decode_exponential_variance(
            F.encode_exponential_variance(two, c, 4.0, 0.0).mean(1), depth, c, 4.0, 1e-6, low
        ),
        [TWO, BETWEEN, np.array(6.0), np.array(0.05)],
    ),
    "decode_mean_depth": Case(
        lambda two, depth: F.decode_mean_depth(F.encode_mean_depth(two, 4).mean(1), depth, 4), [TWO, UNIT]
    ),
    "decode_moments": Case(
        lambda two, depth, alpha: F.decode_moments(
            F.encode_moments(two).mean(1), depth, "hausdorff", alpha, 0.1
        ),
        [TWO, BETWEEN, np.array(0.01)],
    ),
    "decode_variance": Case(
        lambda two, depth, least, high: F.decode_variance(F.encode_variance(two, 0.0).mean(1), depth, least, 0.1, high),
        [TWO, 0.75 + 0.1 * UNIT, np.array(1e-4), np.array(0.9)],
    ),
    "depth_moments": Case(F.depth_moments, [DEPTH, np.array(0.2)]),
    "encode_convolution": Case(lambda z: F.encode_convolution(z, 3, 0.1), [DEPTH]),
    "encode_exponential": Case(lambda z, c: F.encode_exponential(z, c, "log"), [DEPTH, np.array(50.0)]),
    "encode_exponential_variance": Case(F.encode_exponential_variance, [DEPTH, np.array(7.0), np.array(3.0)]),
    "encode_mean_depth": Case(F.encode_mean_depth, [DEPTH]),
    "encode_moments": Case(F.encode_moments, [DEPTH]),
    "encode_variance": Case(F.encode_variance, [DEPTH]),
    "exponential_test": Case(F.exponential_test, [UNIT, UNIT[::-1].copy(), np.array(5.0)]),
    "extend": Case(lambda z, beyond: F.extend(z, 2, "lit", beyond), [DEPTH, np.array(1.0)]),
    "fourier_bases": Case(lambda z: F.fourier_bases(z, 3), [DEPTH]),
    "fourier_test": Case(lambda t: F.fourier_test(t, 5, 1.0), [UNIT - 0.5]),
    "fourier_visibility": Case(
        lambda two, d: F.fourier_visibility(F.fourier_bases(two, 3).mean(1), d), [TWO, UNIT]
    ),
    "gaussian_weights": Case(lambda sigma: F.gaussian_weights(5, sigma), [np.array(1.3)]),
    "hamburger_visibility": Case(
        lambda two, d: F.hamburger_visibility(F.power_moments(two).mean(1), d), [TWO, BETWEEN]
    ),
    "hausdorff_visibility": Case(
        lambda two, d: F.hausdorff_visibility(F.power_moments(two).mean(1), d), [TWO, BETWEEN]
    ),
    "linear_step": Case(F.linear_step, [UNIT, np.array(0.1), np.array(0.95)]),
    "map_rays": Case(lambda d, low, high: F.map_rays(d, low, high, 4), [SUN, LOWER, UPPER]),
    "mip_level": Case(F.mip_level, [1.5 * np.eye(2) + RNG.uniform(0, 1, (7, 2, 2))]),
    "mip_levels": Case(F.mip_levels, [PLANES]),
    "multi_depth": Case(lambda z: tuple(F.multi_depth(z, name) for name in ("max", "min-max", "ring")), [DEPTH]),
    "multi_depth_shift": Case(lambda z: F.multi_depth(z, "max", 2) * F.multi_depth_shift("max", 2)[0], [DEPTH]),
    "percentage_closer": Case(
        lambda planes, at, z, bias: (
            F.percentage_closer(planes, at, z, 3, bias),
            F.percentage_closer(planes, at, z, 2, bias, "clamp", taps="bilinear"),
        ),
        [PLANES, POSITION, UNIT, np.array(0.05)],
    ),
    "power_moments": Case(F.power_moments, [DEPTH]),
    "read_bilinear": Case(F.read_bilinear, [PLANES, POSITION]),
    "read_mip": Case(
        lambda planes, at, level: F.read_mip(F.mip_levels(planes), at, level), [PLANES, POSITION, 2 * UNIT]
    ),
    "read_mip_anisotropic": Case(
        lambda planes, at, steps: F.read_mip_anisotropic(F.mip_levels(planes), at, steps, 2),
        [PLANES, POSITION, np.array([[2.5, 0.1], [0.2, 1.3]]) + RNG.uniform(0, 0.2, (7, 2, 2))],
    ),
    "read_nearest": Case(F.read_nearest, [PLANES, POSITION]),
    "read_summed_area": Case(
        lambda planes, at, size: F.read_summed_area(F.summed_area_table(planes), at, size),
        [PLANES, POSITION, np.full((7, 2), 1.7)],
    ),
    "shadow_test": Case(F.shadow_test, [UNIT, UNIT[::-1].copy()]),
    "summed_area_table": Case(F.summed_area_table, [PLANES]),
    "to_map": Case(lambda points, d, low, high: F.to_map(points, d, low, high, 8), [TRIANGLES, SUN, LOWER, UPPER]),
    "tone_count": Case(F.tone_count, [UNIT]),
    "unit_depth": Case(F.unit_depth, [DEPTH, np.array(0.1), np.array(0.9)]),
    "variance_of": Case(F.variance_of, [UNIT, UNIT**2 + 0.1]),
    "warp_depth": Case(F.warp_depth, [DEPTH, np.array(-3.0)]),
}  # fmt: skip


def weighted(out: Any) -> jax.Array:
    """One number that every floating number of a result moves."""
    leaves = [leaf.astype(jnp.float64) for leaf in jax.tree.leaves(out) if eqx.is_inexact_array(leaf)]
    shares = [jnp.cos(jnp.arange(leaf.size, dtype=jnp.float64)).reshape(leaf.shape) for leaf in leaves]
    return sum((jnp.sum(leaf * share) for leaf, share in zip(leaves, shares, strict=True)), jnp.zeros(()))


def test_every_function_has_a_case():
    assert set(CASES) == set(F.__all__)


@pytest.mark.parametrize("dtype", [jnp.float64, pytest.param(jnp.float32, marks=pytest.mark.long)])
@pytest.mark.parametrize("name", F.__all__)
def test_jit_vmap_and_grad(name, dtype, pytestconfig):
    call, given, smooth = CASES[name]
    arrays = [jnp.asarray(array, dtype) for array in given]
    # A second example, so near that no test changes its outcome by chance alone.
    other = [array * (1 - 2.0**-6) for array in arrays]
    stacked = [jnp.stack(pair) for pair in zip(arrays, other, strict=True)]
    places = tuple(range(len(arrays)))

    @jax.jit
    def all_three(arrays, stacked):
        slopes = jax.grad(lambda *a: weighted(call(*a)), places)(*arrays)
        return call(*arrays), jax.vmap(call)(*stacked), slopes

    @jax.jit
    def alone(*arrays):
        out = call(*arrays)
        return out, weighted(out)

    compiled, batched, slopes = all_three(arrays, stacked)
    # An eager call compiles every operation alone, so the short run calls a compiled function twice.
    loop = [call(*each) if pytestconfig.getoption("--long") else alone(*each)[0] for each in (arrays, other)]
    tolerance = 2e-11 if dtype == jnp.float64 else 2e-4
    for one, two in ((compiled, loop[0]), (batched, jax.tree.map(lambda *pair: jnp.stack(pair), *loop))):
        jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, rtol=tolerance, atol=tolerance), one, two)
    floats = [leaf for leaf in jax.tree.leaves(compiled) if eqx.is_inexact_array(leaf)]
    assert all(leaf.dtype == dtype for leaf in floats)
    assert all(bool(jnp.all(jnp.isfinite(leaf))) for leaf in (*floats, *slopes))
    if dtype == jnp.float64 and smooth:
        ways = [jnp.asarray(np.random.default_rng(1).normal(size=array.shape)) for array in arrays]
        step = 1e-6

        def at(side):
            return float(alone(*(a + side * step * way for a, way in zip(arrays, ways, strict=True)))[1])

        along = sum(float(jnp.sum(slope * way)) for slope, way in zip(slopes, ways, strict=True))
        np.testing.assert_allclose(along, (at(1) - at(-1)) / (2 * step), rtol=1e-5, atol=1e-7)
