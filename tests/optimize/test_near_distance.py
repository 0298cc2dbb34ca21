"""Best n': search meets closed form, published losses come out, nothing on a grid is better."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from views import random_frusta

from shadowjax.optimize.analytic.near_distance import WARP_OBJECTIVES, near_distance
from shadowjax.theory.aliasing.error import max_error_x, max_error_z, storage_factor
from shadowjax.theory.aliasing.near_distances import generalised
from shadowjax.theory.aliasing.optimal import balanced, least_storage, minimax

COUNT = 400


def fields(frusta):
    return frusta.near, frusta.far, frusta.phi_y, frusta.gamma


@pytest.mark.parametrize("section", ["axis", "whole"])
@pytest.mark.parametrize("objective", WARP_OBJECTIVES)
def test_search_meets_the_closed_form(objective, section):
    frusta = random_frusta(COUNT, seed=2)
    found = near_distance(*fields(frusta), section, objective)
    certificate = found.certificate
    # below γ = 1e-6 rounding of W − 2E hides the optimum from a search, not from the closed form
    clear = np.asarray(frusta.gamma > 1e-6)
    if objective == "both":
        # at γ_lim M_x is constant over the section: equally good n' differ
        clear = clear & (np.abs(np.asarray(frusta.gamma - frusta.gamma_limit)) > 1e-9)
    assert np.max(np.asarray(certificate.difference)[clear]) < 1e-8
    assert np.max(np.abs(certificate.excess)) < 1e-10
    assert (certificate.slope_below < 1e-12).all()
    assert (certificate.uniform | (certificate.slope_above > -1e-12)).all()
    assert (found.gain > 1 - 1e-12).all()
    assert all(np.isfinite(x).all() for x in jax.tree.leaves(found))


@pytest.mark.parametrize("section", ["axis", "whole"])
def test_nothing_on_a_grid_beats_the_closed_forms(section):
    frusta = random_frusta(COUNT, seed=3)
    ratio = jnp.asarray(10 ** np.random.default_rng(0).uniform(-1, 1, COUNT))
    grid = jnp.exp(jnp.linspace(-16, 46, 4001))[:, None] * frusta.near

    def worst(q):
        return jnp.maximum(max_error_x(frusta, q, section, ratio), max_error_z(frusta, q, section))

    def m_z(q):
        return max_error_z(frusta, q, section)

    def texels(q):
        return storage_factor(frusta, q, section)

    for closed, value in (
        (minimax(frusta, section), m_z),
        (least_storage(frusta, section), texels),
        (balanced(frusta, ratio, 1.0, section), worst),
    ):
        assert (value(closed) <= jnp.min(value(grid), axis=0) * (1 + 1e-12)).all()
        assert (value(closed) <= value(frusta.uniform_near_distance) * (1 + 1e-12)).all()


def test_losses_of_the_published_parameter():
    """×1.1998 on the axis at 29.317°, ×1.8892 over the section at γ_lim; storage above uniform below 23.206°."""
    degrees = jnp.deg2rad(jnp.asarray([29.317033, 60.0]))
    axis = near_distance(1.0, 100.0, jnp.pi / 6, degrees)
    np.testing.assert_allclose(axis.gain, [1.199833484, 1.0], rtol=1e-9)
    limit = jnp.arctan(jnp.tan(jnp.pi / 6) * 101 / 99)
    whole = near_distance(1.0, 100.0, jnp.pi / 6, limit, "whole")
    np.testing.assert_allclose(whole.gain, 1.8892391304, rtol=1e-9)
    frusta = random_frusta(2)
    view = jax.tree.map(lambda x: jnp.zeros(2) + x, (1.0, 100.0, np.pi / 6))
    around = jnp.deg2rad(jnp.asarray([23.2062251038 - 1e-6, 23.2062251038 + 1e-6]))
    frusta = type(frusta).create(*view, around)
    published = storage_factor(frusta, generalised(frusta))
    uniform = storage_factor(frusta, frusta.uniform_near_distance)
    assert published[0] > uniform[0]
    assert published[1] < uniform[1]


def test_the_uniform_map_is_chosen_where_it_wins():
    flat = near_distance(1.0, 100.0, jnp.pi / 6, jnp.deg2rad(jnp.asarray([0.2, 5.0])), "whole")
    np.testing.assert_array_equal(flat.certificate.uniform, [True, False])
    storage = near_distance(1.0, 100.0, jnp.pi / 6, jnp.deg2rad(jnp.asarray([10.0, 60.0])), "whole", "storage")
    np.testing.assert_array_equal(storage.certificate.uniform, [True, False])


def test_balanced_overhead_has_the_stated_closed_form():
    found = near_distance(1.0, 1000.0, 0.5, jnp.pi / 2, "axis", "both")
    share = jnp.sqrt(999.0 / (2 * jnp.tan(0.5))) / 1000
    np.testing.assert_allclose(found.value, 999 * share / (1 - share), rtol=1e-9)


def test_single_precision_is_near(dtype):
    frusta = random_frusta(60, seed=4, dtype=dtype, largest=3)
    found = near_distance(*fields(frusta))
    assert found.value.dtype == dtype
    double = [x.astype(jnp.float64) for x in fields(frusta)]
    exact = near_distance(*double[:3], jnp.minimum(double[3], jnp.pi / 2))
    np.testing.assert_allclose(
        found.objective_value, exact.objective_value, rtol=1e-12 if dtype == jnp.float64 else 2e-4
    )


@pytest.mark.parametrize(
    "bad", [(2.0, 1.0, 0.5, 0.5), (1.0, 2.0, 2.0, 0.5), (1.0, 2.0, 0.5, 1.6), (1.0, 2.0, 0.5, 0.5, "edge")]
)
def test_bad_input(bad):
    with pytest.raises(ValueError, match="must"):
        near_distance(*bad)
