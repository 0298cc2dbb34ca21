"""Best planes: equal ratios where they are best, the one known exception, and an exhaustive search for reference."""

import jax.numpy as jnp
import numpy as np
import pytest

from shadowjax.optimize.analytic.splits import splits
from shadowjax.partitions.cascades import logarithmic_splits
from shadowjax.theory.aliasing.error import storage_factor
from shadowjax.theory.aliasing.light_frustum import LightFrustum
from shadowjax.theory.aliasing.near_distances import generalised
from shadowjax.theory.aliasing.split_search import best_shares, planes_of

VIEW = (1.0, 100.0, np.pi / 6, np.pi / 4)


@pytest.mark.parametrize(
    ("k", "objective", "warp"), [(4, "sum", "minimax"), (4, "max", "lispsm"), (1, "sum", "uniform")]
)
def test_equal_ratios_are_best(k, objective, warp):
    found = splits(*VIEW, k, objective, warp)
    np.testing.assert_allclose(found.value.cuts, logarithmic_splits(*VIEW[:2], k), rtol=1e-9)
    np.testing.assert_array_equal(found.baselines["equal"], found.objective_value)
    assert found.certificate.slope_spread < 1e-9
    assert found.certificate.storage_spread < 1e-9


def test_the_published_parameter_prefers_one_narrow_slice():
    """γ = 45°, k = 4: 17.31691748 against 18.05804562 at equal ratios."""
    found = splits(*VIEW, 4, "sum", "lispsm")
    np.testing.assert_allclose(found.objective_value, 17.31691748, rtol=1e-8)
    np.testing.assert_allclose(found.baselines["equal"], 18.05804562, rtol=1e-8)
    shares = np.diff(np.log(found.value.cuts)) / np.log(100)
    np.testing.assert_allclose(shares, [0.1421, 0.2860, 0.2860, 0.2860], atol=1e-4)
    # three slices sit on the kink, at the ratio f_i/n_i whose γ_lim is γ: sin(γ + φ)/sin(γ − φ)
    kink = np.sin(np.deg2rad(75)) / np.sin(np.deg2rad(15))
    np.testing.assert_allclose(found.value.cuts[2:] / found.value.cuts[1:-1], kink, rtol=1e-4)

    def cost(log_ratio):
        one = jnp.ones(np.shape(log_ratio))
        part = LightFrustum(one, jnp.exp(jnp.asarray(log_ratio)), one * VIEW[2], one * VIEW[2], one * VIEW[3])
        return np.asarray(storage_factor(part, generalised(part)))

    reference, value = best_shares(cost, np.log(100), 4, "sum")
    np.testing.assert_allclose(found.objective_value, value, rtol=1e-9)
    np.testing.assert_allclose(found.value.cuts, planes_of(reference, 1.0, 100.0), rtol=1e-4)


def test_result_is_json_and_bad_input_is_named():
    found = splits(*VIEW, 1, "sum", "uniform").to_dict()
    assert found["splits"] == [1.0, 100.0]
    assert set(found) == {"splits", "storage", "near_distances", "baselines", "gain", "certificate", "result"}
    for bad in ((*VIEW, 0), (*VIEW, 2, "mean"), (*VIEW, 2, "max", "steep"), (2.0, 1.0, 0.5, 0.5, 2)):
        with pytest.raises(ValueError, match="must"):
            splits(*bad)
