"""Four depths a texel after Brabec and Seidel, hierarchical minima, and soft shadows whose width blockers decide."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

from shadowjax import ContactHardening, HierarchicalMinimum, MultiDepth, PropagatedNeighbours, Supersampled
from shadowjax.filters.base import Lookup
from shadowjax.filters.hierarchical_minimum import block_minimum
from shadowjax.filters.pcss import penumbra_width

RNG = np.random.default_rng(12)
MAP = RNG.uniform(0, 1, (16, 12))
POSITION, DEPTH = RNG.uniform(0, [12, 16], (80, 2)), RNG.uniform(0, 1, 80)
WHERE = Lookup(jnp.asarray(POSITION), jnp.asarray(DEPTH), jnp.zeros(()), jnp.ones(()), "clamp")
answer = eqx.filter_jit(lambda filter_, depth, where: filter_.visibility(filter_.prepare(depth), where))


def test_supersampled_is_the_mean_over_the_block_of_the_finer_map():
    col, row = (np.floor(POSITION / 2).astype(int) * 2).T
    block = np.stack([MAP[row + i, col + j] for i in (0, 1) for j in (0, 1)])
    np.testing.assert_array_equal(answer(Supersampled(), jnp.asarray(MAP), WHERE), np.mean(block >= DEPTH, axis=0))


def test_propagated_is_the_mean_over_the_texel_and_three_neighbours():
    """The four whose common corner is nearest: a 2 × 2 PCF."""
    col, row = np.floor(POSITION - 0.5).astype(int).T
    block = np.stack([MAP[np.clip(row + i, 0, 15), np.clip(col + j, 0, 11)] for i in (0, 1) for j in (0, 1)])
    value = np.asarray(answer(MultiDepth(PropagatedNeighbours()), jnp.asarray(MAP), WHERE))
    inner = (POSITION > 0.5).all(axis=1)
    np.testing.assert_array_equal(value[inner], np.mean(block >= DEPTH, axis=0)[inner])


def test_minima_of_aligned_blocks_shift_with_the_map():
    """Tones follow the fixed grid: moving the scene by one texel does not move the result by one texel."""
    smallest = np.asarray(block_minimum(jnp.asarray(MAP), 4))
    expected = MAP.reshape(4, 4, 3, 4).min(axis=(1, 3))
    np.testing.assert_array_equal(smallest, expected.repeat(4, 0).repeat(4, 1))
    assert HierarchicalMinimum().num_depths == 3
    # An edge at column 5 or 6 makes the same minima: its place within a block is lost.
    edges = [jnp.where(jnp.arange(12) < at, 0.2, 0.9) * jnp.ones((8, 1)) for at in (5, 6)]
    np.testing.assert_array_equal(*(block_minimum(edge, 4) for edge in edges))


def test_penumbra_widens_with_distance_from_the_blocker():
    """Similar triangles: angle·(d − b) for a distant light, size·(d − b)/b for a local one."""
    d, b = jnp.asarray([3.0, 3.0]), jnp.asarray([2.0, 3.0])
    np.testing.assert_allclose(penumbra_width(d, b, 0.1, True), [0.1, 0])
    np.testing.assert_allclose(penumbra_width(d, b, 0.4, False), [0.2, 0])
    # A straight edge at column 32: the share of taps beyond it falls linearly over the penumbra's width.
    across = jnp.linspace(20.0, 44.0, 481)
    where = Lookup(
        jnp.stack([across, jnp.full_like(across, 8.0)], -1), jnp.full_like(across, 3.0), jnp.zeros(()),
        jnp.asarray(0.01), "clamp", gradient=jnp.zeros((481, 2)),
    )  # fmt: skip
    widths = []
    for blocker in (2.0, 2.6):
        edge = jnp.where(jnp.arange(64) < 32, blocker, 10.0) * jnp.ones((16, 1))
        value = np.asarray(answer(ContactHardening(0.1, num_taps=12, num_search_taps=12, max_width=20.0), edge, where))
        assert (value[0], value[-1]) == (0, 1)
        assert np.all(np.diff(value) >= 0)
        soft = np.asarray(across)[(value > 0) & (value < 1)]
        widths.append(soft[-1] - soft[0])
    # 0.1·(3 − b)/0.01 texels, less the first and last of twelve steps, to a texel.
    np.testing.assert_allclose(widths, [10 * 11 / 12, 4 * 11 / 12], atol=1.0)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Supersampled().prepare(jnp.ones((5, 4))), "even sides; got a map of 5 × 4"),
        (lambda: HierarchicalMinimum(()), "block_sizes"),
        (lambda: HierarchicalMinimum((1,)), "block_sizes"),
        (lambda: ContactHardening(angle=-0.1), "angle of the light"),
        (lambda: ContactHardening(max_width=0.5), "max_width must be at least a texel"),
    ],
)
def test_bad_input(make, message):
    with pytest.raises(ValueError, match=message):
        make()
