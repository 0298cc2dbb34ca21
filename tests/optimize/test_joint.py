"""Planes and n' together: known answers without a limit, bounds that hold, stationary and not beaten by neighbours."""

import jax.numpy as jnp
import numpy as np
import pytest

from shadowjax.optimize.analytic.joint import joint_splits, log_storages
from shadowjax.optimize.analytic.splits import splits
from shadowjax.partitions.cascades import logarithmic_splits
from shadowjax.theory.aliasing import near_distances
from shadowjax.theory.aliasing.error import error_x, error_z, storage_factor
from shadowjax.theory.aliasing.light_frustum import LightFrustum
from shadowjax.theory.aliasing.optimal import least_storage
from shadowjax.theory.aliasing.storage import seam_jumps, storage_of_splits

VIEW = (1.0, 100.0, np.pi / 6)


def slices_of(found, gamma):
    """The slices of a result as frusta."""
    one = jnp.ones(len(found.value.cuts) - 1)
    return LightFrustum(found.value.cuts[:-1], found.value.cuts[1:], one * VIEW[2], one * VIEW[2], one * gamma)


def test_the_published_parameter_s_exception_is_found_again():
    """γ = 45°, k = 4, ΣS: 17.31691748 against 18.05804562, as the search over shares finds too."""
    found = joint_splits(*VIEW, np.pi / 4, 4, "sum", "lispsm")
    np.testing.assert_allclose(found.objective_value, 17.31691748, rtol=1e-8)
    np.testing.assert_allclose(found.baselines["published"], 18.05804562, rtol=1e-8)
    np.testing.assert_allclose(
        found.objective_value, splits(*VIEW, np.pi / 4, 4, "sum", "lispsm").objective_value, rtol=1e-9
    )


def test_free_near_distances_reach_the_closed_form_of_least_storage():
    """Without a limit, planes and n' decouple: equal ratios (eq. 50), and n' in closed form."""
    found = joint_splits(*VIEW, np.pi / 4, 4)
    np.testing.assert_allclose(found.value.cuts, logarithmic_splits(*VIEW[:2], 4), rtol=1e-6)
    parts = slices_of(found, np.pi / 4)
    np.testing.assert_allclose(found.value.near_distances, least_storage(parts, "axis"), rtol=1e-6)
    assert found.certificate.residual < 1e-7
    assert found.gain > 1.1
    assert not found.certificate.seam_limited
    np.testing.assert_allclose(found.baselines["equal"], found.objective_value, rtol=1e-9)


def test_a_seam_limit_is_kept_and_costs_something():
    """At 45°, four maps with seams below 1.5 still need less than the published ones, whose seams are 1.95."""
    found = joint_splits(*VIEW, np.pi / 4, 4, seam_limit=1.5)
    certificate = found.certificate
    assert certificate.seam_limited
    assert certificate.violation < 1e-9
    assert certificate.residual < 1e-6
    np.testing.assert_allclose(certificate.seam_jump, 1.5, rtol=1e-7)
    assert certificate.published_jump > 1.9
    assert found.baselines["equal"] < found.objective_value < found.baselines["published"]
    parts = slices_of(found, np.pi / 4)
    q = found.value.near_distances
    np.testing.assert_allclose(jnp.sum(storage_factor(parts, q)), found.objective_value, rtol=1e-12)
    for error in (error_x, error_z):
        jump = np.asarray(error(parts, q, parts.near))[1:] / np.asarray(error(parts, q, parts.far))[:-1]
        assert np.exp(np.abs(np.log(jump))).max() <= 1.5 * (1 + 1e-7)
    # nothing near it that keeps the limit needs less
    rng = np.random.default_rng(0)
    inner = found.value.cuts[1:-1] * np.exp(rng.normal(0, 1e-3, (4000, 3)))
    near = jnp.concatenate([jnp.ones((4000, 1)), inner], axis=1)
    far = jnp.concatenate([inner, jnp.full((4000, 1), 100.0)], axis=1)
    one = jnp.ones_like(near)
    tried = LightFrustum(near, far, one * VIEW[2], one * VIEW[2], one * np.pi / 4)
    q = q * np.exp(rng.normal(0, 1e-3, (4000, 4)))
    total = np.asarray(jnp.sum(storage_factor(tried, q), axis=-1))
    kept = np.ones(4000, bool)
    for error in (error_x, error_z):
        jump = np.log(error(tried, q, tried.near)[:, 1:] / error(tried, q, tried.far)[:, :-1])
        kept &= np.abs(np.asarray(jump)).max(axis=1) <= np.log(1.5)
    assert kept.any()
    assert (total[kept] >= float(found.objective_value) * (1 - 1e-9)).all()


def test_a_search_that_ends_beside_a_kink_is_stationary_and_says_so():
    """γ = 50°, f/n = 60, k = 2, seams below 1.3: the map's width is bounded by two corners at once."""
    found = joint_splits(1.0, 60.0, np.pi / 6, np.deg2rad(50.0), 2, seam_limit=1.3)
    assert found.converged
    assert found.certificate.residual < 1e-9
    assert found.certificate.violation < 1e-12
    np.testing.assert_allclose(found.objective_value, 43.08419266, rtol=1e-8)
    np.testing.assert_allclose(found.certificate.seam_jump, 1.3, rtol=1e-12)


def test_single_precision_finds_the_same_planes(dtype):
    """The search is in double precision whatever it is given."""
    view = [jnp.asarray(x, jnp.float32) for x in (1.0, 40.0, 0.5, 1.0)]
    found = joint_splits(*(x.astype(dtype) for x in view), 2, "sum", "minimax", 3.0)
    exact = joint_splits(*(x.astype(jnp.float64) for x in view), 2, "sum", "minimax", 3.0)
    assert found.converged
    assert found.value.cuts.dtype == dtype
    np.testing.assert_allclose(found.value.cuts, exact.value.cuts, rtol=2e-6)
    np.testing.assert_allclose(found.objective_value, exact.objective_value, rtol=1e-5)


def test_parallel_light_keeps_all_slices_but_the_first_at_the_limit():
    """γ = 0, where every n' is the uniform map: the jump is the next slice's ratio (eq. 55 with λ = 0)."""
    found = joint_splits(*VIEW, 0.0, 4, "max", "minimax", 2.0)
    np.testing.assert_allclose(found.value.cuts, [1, 12.5, 25, 50, 100], rtol=1e-6)
    np.testing.assert_allclose(found.objective_value, 12.5**2, rtol=1e-6)
    view = LightFrustum.create(*VIEW, 0.0)
    assert float(jnp.max(jnp.stack(seam_jumps(view, found.value.cuts, near_distances.uniform)))) <= 2 * (1 + 1e-7)
    direct = storage_of_splits(view, found.value.cuts, near_distances.uniform, "max")
    np.testing.assert_allclose(found.objective_value, direct, rtol=1e-9)


def test_storage_is_the_largest_of_its_smooth_parts():
    rng = np.random.default_rng(1)
    one = jnp.ones(300)
    part = LightFrustum(
        one, jnp.asarray(10 ** rng.uniform(0.01, 4, 300)), jnp.asarray(rng.uniform(0.1, 1.2, 300)), one * 0.5,
        jnp.asarray(rng.uniform(0, np.pi / 2, 300)),
    )  # fmt: skip
    q = part.extent * jnp.asarray(10 ** rng.uniform(-4, 4, 300))
    for section in ("axis", "whole"):
        largest = jnp.exp(jnp.max(log_storages(part, q, section), axis=-1))
        np.testing.assert_allclose(largest, storage_factor(part, q, section), rtol=1e-10)


@pytest.mark.parametrize(
    ("bad", "message"),
    [
        ((*VIEW, 0.5, 0), "at least 1"),
        ((*VIEW, 0.5, 2, "mean"), "objective"),
        ((*VIEW, 0.5, 2, "sum", "steep"), "warp"),
        ((*VIEW, 0.5, 2, "sum", "free", 1.0), "must exceed 1"),
        ((2.0, 1.0, 0.5, 0.5, 2), "far must be greater"),
        ((*VIEW, 1.6, 2), "gamma"),
        ((*VIEW, np.pi / 2, 4, "max", "minimax", 1.1), "raise seam_limit"),
    ],
)
def test_bad_input_and_limits_that_cannot_be_kept(bad, message):
    with pytest.raises(ValueError, match=message):
        joint_splits(*bad)
