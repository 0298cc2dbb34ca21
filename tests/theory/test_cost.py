"""Cost: the model's formulas against sums and searches, and the counters against functions whose reads are known."""

from fractions import Fraction

import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from shadowjax.filters import multi_depth
from shadowjax.filters.pcf import percentage_closer
from shadowjax.theory import cost

sizes = st.integers(1, 64)


def a_map(dtype, size=6):
    steps = np.random.default_rng(3).permutation(size * size).reshape(size, size)
    return jnp.asarray((steps - size * size / 2 + 0.25) / size, dtype=dtype)


@settings(max_examples=60, deadline=None)
@given(h=sizes, w=sizes, q=st.integers(1, 25), r=st.integers(1, 25), k=st.integers(1, 16))
def test_first_cheaper_is_where_the_two_costs_cross(h, w, q, r, k):
    first = cost.first_cheaper_fragments(h, w, q, r)
    for fragments in (first - 1, first):
        cheaper = cost.multi_depth_fetches(h, w, q, fragments, k) < cost.lookup_fetches(fragments, k + r)
        assert cheaper == (fragments >= first)
    assert first - 1 <= cost.crossover_fragments(h, w, q, r) < first
    assert cost.crossover_fragments(h, w, q, r) / (h * w) == cost.size_ratio_threshold(q, r)


def test_scene_cost_is_the_sum_over_fragments():
    assert cost.scene_cost(10**6, 1, 4, 1) == 6_000_000
    assert cost.scene_cost(10**6, 1, 4, 1, num_taps=9) == 46_000_000
    assert cost.scene_cost(7, Fraction(1, 3), 2, 1, 4) == sum([Fraction(1, 3) + 4 * 3] * 7)


def test_published_numbers_of_the_crossover():
    assert float(cost.crossover_fragments(512, 512, 9, 5)) == 471859.2
    assert cost.first_cheaper_fragments(512, 512, 9, 5) == 471860
    assert cost.multi_depth_fetches(512, 512, 9, 471860, 4) == 4246736 < cost.lookup_fetches(471860, 9) == 4246740
    assert cost.size_ratio_threshold(9, 12) < 1  # cheaper even at equal sizes


@pytest.mark.parametrize(
    ("build", "reads"),
    [
        (multi_depth.single, 1),
        (multi_depth.max_neighbour, 9),
        (multi_depth.min_neighbour, 9),
        (multi_depth.min_max_neighbours, 9),
        (lambda depth: multi_depth.max_neighbour(depth, size=5), 25),
        (lambda depth: multi_depth.max_neighbour(depth, include_centre=False), 9),
        (lambda depth: multi_depth.ring(depth, 4), 4),
        (lambda depth: multi_depth.ring(depth, 9), 9),
        (lambda depth: multi_depth.fixed_neighbour(depth, (0, 1)), 2),
    ],
)
def test_build_reads_are_those_of_the_neighbourhood(build, reads, dtype):
    assert cost.count_build_fetches(build, a_map(dtype)) == reads


@pytest.mark.parametrize("width", [1, 2, 3, 4])
@pytest.mark.parametrize("policy", [multi_depth.single, multi_depth.max_neighbour])
def test_lookup_reads_are_the_taps_whatever_the_depths_a_texel(width, policy, dtype):
    planes = policy(a_map(dtype))
    middle = jnp.full((1, 2), 3.5 if width % 2 else 3.0, dtype=dtype)
    zero = jnp.zeros((1,), dtype=dtype)

    def visibility(stored):
        return percentage_closer(stored, middle, zero, width)

    assert cost.count_lookup_fetches(visibility, planes) == width * width


def test_dependence_finds_reads_behind_a_comparison(dtype):
    depth = a_map(dtype, 3)
    reads = cost.dependence(lambda d: jnp.stack([d[0, 0] + d[2, 1], (d[1, 1] > 0).astype(d.dtype)]), depth)
    expected = np.zeros((2, 9), bool)
    expected[0, [0, 7]] = expected[1, 4] = True
    np.testing.assert_array_equal(reads, expected)


def test_bad_arguments_say_what_to_do():
    with pytest.raises(ValueError, match="saved taps"):
        cost.crossover_fragments(512, 512, 9, 0)
    with pytest.raises(ValueError, match="height must be"):
        cost.build_fetches(0, 512, 9)
    with pytest.raises(ValueError, match="at most 4096"):
        cost.dependence(lambda d: d, jnp.zeros((65, 64)))
