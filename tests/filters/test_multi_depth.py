"""Multi-depth maps against loops over neighbourhoods, the composite test, and every policy's limits."""

import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from shadowjax import FixedNeighbour, MultiDepth, Neighbourhood, Ring, StochasticNeighbour
from shadowjax.filters.hard import composite_test
from shadowjax.filters.multi_depth import (
    max_neighbour,
    min_max_neighbours,
    min_neighbour,
    ring,
    ring_offsets,
    stochastic_neighbour,
)

DEPTH = np.random.default_rng(3).uniform(1, 2, (11, 9))


def neighbours(row, col, size, include_centre):
    """Values of a clamped neighbourhood, by hand."""
    low, high = -((size - 1) // 2), size // 2
    return [
        DEPTH[np.clip(row + r, 0, 10), np.clip(col + c, 0, 8)]
        for r, c in itertools.product(range(low, high + 1), repeat=2)
        if include_centre or (r, c) != (0, 0)
    ]


@pytest.mark.parametrize("size", [2, 3, 5])
@pytest.mark.parametrize("include_centre", [True, False])
def test_extremes_equal_the_loop_over_the_neighbourhood(size, include_centre):
    largest, smallest = np.empty_like(DEPTH), np.empty_like(DEPTH)
    for row, col in np.ndindex(DEPTH.shape):
        values = neighbours(row, col, size, include_centre)
        largest[row, col], smallest[row, col] = max(values), min(values)
    np.testing.assert_array_equal(max_neighbour(jnp.asarray(DEPTH), size, include_centre), [DEPTH, largest])
    np.testing.assert_array_equal(min_neighbour(jnp.asarray(DEPTH), size, include_centre), [DEPTH, smallest])
    np.testing.assert_array_equal(
        min_max_neighbours(jnp.asarray(DEPTH), size, include_centre), [DEPTH, largest, smallest]
    )


@pytest.mark.parametrize("num_depths", [2, 4, 5, 6, 9])
def test_ring_reads_distinct_neighbours_spread_round_the_texel(num_depths):
    offsets = ring_offsets(num_depths)
    assert len(set(offsets)) == num_depths - 1
    assert all(max(abs(r), abs(c)) == 1 for r, c in offsets)
    planes = ring(jnp.asarray(DEPTH), num_depths)
    assert planes.shape == (num_depths, *DEPTH.shape)
    np.testing.assert_array_equal(planes[0], DEPTH)
    for plane, (r, c) in zip(planes[1:], offsets, strict=True):
        assert plane[5, 4] == DEPTH[5 + r, 4 + c]
    if num_depths > 3:
        angles = np.sort(np.degrees(np.arctan2([c for _, c in offsets], [-r for r, _ in offsets])) % 360)
        gaps = np.diff(np.append(angles, angles[0] + 360))
        # As even as eight cells allow: no gap is wider than the ideal one rounded up to the next cell.
        assert gaps.max() <= np.ceil(8 / (num_depths - 1)) * 45 + 1e-9


@pytest.mark.parametrize(("num_depths", "radius"), [(10, 1), (18, 2)])
def test_more_depths_than_cells_is_an_error_that_says_what_to_do(num_depths, radius):
    with pytest.raises(
        ValueError, match=rf"has only {8 * radius} cells; use num_depths ≤ {8 * radius + 1} or radius ≥"
    ):
        Ring(num_depths, radius)


def test_one_depth_is_the_traditional_map():
    np.testing.assert_array_equal(Ring(1).planes(jnp.asarray(DEPTH)), DEPTH[None])


def test_stochastic_choice_is_a_neighbour_evenly_drawn_and_repeatable():
    depth = jnp.asarray(np.random.default_rng(5).permutation(64 * 64).reshape(64, 64).astype(float))
    one, two = (stochastic_neighbour(depth, jax.random.key(1)) for _ in range(2))
    np.testing.assert_array_equal(one, two)
    assert np.any(np.asarray(stochastic_neighbour(depth, jax.random.key(2))[1]) != np.asarray(one[1]))
    inner = np.asarray(one[1])[1:-1, 1:-1]
    cells = [(r, c) for r in (-1, 0, 1) for c in (-1, 0, 1) if (r, c) != (0, 0)]
    share = [np.mean(inner == np.asarray(depth)[1 + r : 63 + r, 1 + c : 63 + c]) for r, c in cells]
    np.testing.assert_allclose(sum(share), 1)
    # Eight even chances over 62² texels: five standard deviations.
    np.testing.assert_allclose(share, 1 / 8, atol=5 * np.sqrt(1 / 8 * 7 / 8 / 62**2))


def test_composite_test_counts_shadowing_depths(dtype):
    stored = jnp.asarray([[1.0, 1.0], [2.0, 1.0], [3.0, 1.0]], dtype)
    receiver = jnp.asarray([2.5, 0.5], dtype)
    np.testing.assert_allclose(composite_test(stored, receiver), [1 / 3, 1], rtol=1e-6)
    np.testing.assert_allclose(composite_test(stored, receiver, 0.5), [2 / 3, 1], rtol=1e-6)
    np.testing.assert_allclose(composite_test(stored[:1], receiver), [0, 1])


@pytest.mark.parametrize(
    ("policy", "num_depths", "radius"),
    [
        (Neighbourhood("max"), 2, 1),
        (Neighbourhood("min", size=5), 2, 2),
        (Neighbourhood("min-max"), 3, 1),
        (Ring(4), 4, 1),
        (Ring(6, 2), 6, 2),
        (FixedNeighbour((1, -2)), 2, 2),
        (StochasticNeighbour(), 2, 1),
    ],
)
def test_policies_keep_what_they_declare(policy, num_depths, radius):
    assert (policy.num_depths, policy.radius) == (num_depths, radius)
    planes = policy.planes(jnp.asarray(DEPTH))
    assert planes.shape == (num_depths, *DEPTH.shape)
    np.testing.assert_array_equal(planes[0], DEPTH)
    filter_ = MultiDepth(policy, 3)
    assert (filter_.num_planes, filter_.num_tones, filter_.num_fetches) == (
        num_depths,
        9 * num_depths + 1,
        9 * num_depths,
    )
    assert filter_.reach == 1.5 + policy.spread


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Neighbourhood("median"), "keep must be one of 'max', 'min', 'min-max'"),
        (lambda: Neighbourhood("max", 1), "neighbourhood size"),
        (lambda: Ring(0), "num_depths"),
        (lambda: Ring(4, 0), "radius"),
        (lambda: MultiDepth(Ring(4), 0), "kernel_size"),
    ],
)
def test_bad_policies_are_refused(make, message):
    with pytest.raises(ValueError, match=message):
        make()


def test_depths_are_differentiable_in_the_map():
    """The chosen texel carries the whole gradient, with ties counted once."""
    gradient = jax.grad(lambda d: jnp.sum(max_neighbour(d)[1]))(jnp.asarray(DEPTH))
    np.testing.assert_allclose(jnp.sum(gradient), DEPTH.size)
    assert np.isfinite(gradient).all()
