"""Tones: formulas against exhaustive counts, straight edges against the known table, images against their levels."""

import itertools
import math
from fractions import Fraction

import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from shadowjax.theory import tones, windows

POLICIES = tuple(tones.POLICIES)


@settings(max_examples=40, deadline=None)
@given(n=st.integers(1, 7), w=st.integers(1, 5))
def test_nominal_tones_are_the_distinct_sums_of_equally_spaced_levels(n, w):
    assert tones.nominal_tones(n, w) == tones.count_sums([Fraction(level, 7) for level in range(w)], n)


@settings(max_examples=40, deadline=None)
@given(n=st.integers(1, 5), levels=st.lists(st.integers(0, 10**6), min_size=1, max_size=4, unique=True))
def test_no_levels_give_more_tones_than_the_multisets(n, levels):
    values = [Fraction(level) for level in levels]
    sums = {sum(choice) for choice in itertools.combinations_with_replacement(values, n)}
    assert tones.count_sums(values, n) == len(sums) <= tones.max_tones(n, len(levels))


@pytest.mark.parametrize(("n", "w"), [(2, 3), (3, 3), (4, 4), (9, 2)])
def test_levels_in_general_position_attain_the_bound(n, w):
    levels = [Fraction(0), Fraction(1), Fraction(101), Fraction(10203)][:w]
    assert tones.count_sums(levels, n) == tones.max_tones(n, w) == math.comb(n + w - 1, w - 1)


def test_different_weights_attain_the_larger_bound():
    weights = [Fraction(3**i) for i in range(4)]
    levels = [Fraction(level) for level in range(3)]
    assert tones.count_sums(levels, 4, weights) == tones.max_tones(4, 3, equal_weights=False) == 81


@pytest.mark.parametrize("include_centre", [True, False])
@pytest.mark.parametrize("policy", POLICIES)
@pytest.mark.parametrize("num_taps", [1, 4])
def test_transfer_matrix_counts_what_enumeration_counts(num_taps, policy, include_centre):
    enumerated = windows.enumerated_histogram(num_taps, policy, include_centre)
    assert enumerated.sum() == 2 ** (math.isqrt(num_taps) + 2) ** 2
    assert windows.window_histogram(num_taps, policy, include_centre) == tuple(enumerated)


def test_transfer_matrix_counts_all_windows_of_nine_taps():
    enumerated = windows.enumerated_histogram(9, "3-SM min/max", include_centre=False)
    assert windows.window_histogram(9, "3-SM min/max", include_centre=False) == tuple(enumerated)
    assert enumerated.sum() == 2**25


@pytest.mark.parametrize("policy", POLICIES)
@pytest.mark.parametrize("num_taps", [1, 4])
def test_enumeration_agrees_with_the_arrays(num_taps, policy):
    side = math.isqrt(num_taps) + 2
    bits = np.arange(2 ** (side * side))[:, None] >> np.arange(side * side) & 1
    lit = bits.astype(bool).reshape(-1, side, side)
    counts = np.bincount(windows.lit_numerators(lit, policy), minlength=windows.num_depths(policy) * num_taps + 1)
    assert windows.window_histogram(num_taps, policy) == tuple(counts)


@pytest.mark.parametrize("policy", POLICIES)
@pytest.mark.parametrize("num_taps", [1, 4, 9, 16])
def test_every_nominal_tone_is_attained_by_some_window(num_taps, policy):
    expected = tones.predicted_tones(num_taps, windows.num_depths(policy))
    assert tones.exhaustive_tones(num_taps, policy) == tuple(range(expected))


@pytest.mark.parametrize(("side", "count"), [(2, 14), (3, 58), (4, 174), (5, 402), (6, 838)])
def test_half_plane_windows_are_the_known_number_of_separable_subsets(side, count):
    found = windows.half_plane_windows(side)
    assert len(found) == len(np.unique(found.reshape(len(found), -1), axis=0)) == count


def test_half_plane_windows_hold_every_random_line():
    generator = np.random.default_rng(0)
    angle, offset = generator.uniform(0, 2 * np.pi, 20_000), generator.uniform(-3, 3, 20_000)
    across = np.arange(4) - 1.5
    lit = np.cos(angle)[:, None, None] * across + np.sin(angle)[:, None, None] * across[:, None] > offset[:, None, None]
    known = {pattern.tobytes() for pattern in windows.half_plane_windows(4)}
    drawn = {pattern.tobytes() for pattern in lit}
    assert drawn <= known
    assert len(drawn) == len(known)


@pytest.mark.parametrize(
    ("num_taps", "policy", "edge", "missing", "axis", "diagonal"),
    [
        (4, "1-SM", 5, set(), (0, 2, 4), 4),
        (4, "2-SM max", 8, {4}, (0, 2, 6, 8), 6),
        (4, "2-SM min", 8, {4}, (0, 2, 6, 8), 6),
        (4, "3-SM min/max", 11, {4, 8}, (0, 2, 6, 10, 12), 8),
        (9, "1-SM", 10, set(), (0, 3, 6, 9), 6),
        (9, "2-SM max", 17, {5, 13}, (0, 3, 9, 15, 18), 8),
        (9, "3-SM min/max", 24, {5, 13, 14, 22}, (0, 3, 9, 18, 24, 27), 10),
        (16, "1-SM", 17, set(), (0, 4, 8, 12, 16), 8),
        (16, "2-SM max", 32, {16}, (0, 4, 12, 20, 28, 32), 10),
        (16, "3-SM min/max", 45, None, (0, 4, 12, 24, 36, 44, 48), 12),
    ],
)
def test_straight_edges_give_the_published_tones(num_taps, policy, edge, missing, axis, diagonal):
    found = tones.straight_edge_tones(num_taps, policy)
    nominal = set(range(tones.predicted_tones(num_taps, windows.num_depths(policy))))
    assert len(found) == edge
    assert missing is None or nominal - set(found) == missing
    assert tones.axis_step_tones(num_taps, policy) == axis
    assert len(tones.diagonal_step_tones(num_taps, policy)) == diagonal
    assert set(axis) | set(tones.diagonal_step_tones(num_taps, policy)) <= set(found)


@pytest.mark.parametrize("size", [3, 5, 7])
def test_policies_shift_edges_by_half_their_reach(size):
    reach = Fraction(size - 1, 2)
    assert tones.edge_shift("1-SM", size) == tones.edge_shift("3-SM min/max", size) == 0
    assert tones.edge_shift("2-SM max", size) == -tones.edge_shift("2-SM min", size) == reach / 2


def test_tones_of_an_image_survive_rounding(dtype):
    levels = np.arange(28) / 27
    picked = np.random.default_rng(1).integers(0, 28, (40, 50))
    noise = np.random.default_rng(2).uniform(-1e-6, 1e-6, picked.shape)
    image = jnp.asarray(levels[picked] + noise, dtype=dtype)
    assert tones.count_tones(image) == 28
    np.testing.assert_allclose(tones.tones(image), levels, atol=2e-6)
    assert tones.count_tones(image, mask=picked < 5) == 5
    assert tones.count_tones(image, mask=np.zeros_like(picked, bool)) == 0


def test_bad_arguments_say_what_to_do():
    with pytest.raises(ValueError, match="square"):
        tones.straight_edge_tones(6, "1-SM")
    with pytest.raises(ValueError, match="2-SM max"):
        tones.straight_edge_tones(4, "2-SM")
    with pytest.raises(ValueError, match="at most 9 taps"):
        windows.enumerated_histogram(16, "1-SM")
    with pytest.raises(ValueError, match="odd"):
        windows.lit_numerators(np.ones((4, 4), bool), "2-SM max", size=2)
    with pytest.raises(ValueError, match="finite"):
        tones.tones(np.array([0.0, np.nan]))
    with pytest.raises(ValueError, match="one number a sample"):
        tones.count_sums([Fraction(1)], 3, [Fraction(1)])
