"""Optimal near distances in float32, next to the angles and ratios at which formulas lose digits, against 80 bits."""

import jax.numpy as jnp
import numpy as np
import optimum_oracle as oracle
import pytest

from shadowjax.optimize.analytic.near_distance import near_distance
from shadowjax.theory.aliasing.light_frustum import LightFrustum
from shadowjax.theory.aliasing.near_distances import generalised
from shadowjax.theory.aliasing.optimal import balanced, least_storage, minimax
from shadowjax.theory.aliasing.rounding import Running

COUNT = 300
ONCE_WRONG = (0.09538526, 488041.09, 0.18516608, 0.18516614)


def views(dtype=np.float32):
    """f/n to 10⁷; γ next to φ, next to γ_lim and next to 0, a sixth each, by down to one rounding."""
    rng = np.random.default_rng(1)
    near = 10 ** rng.uniform(-2, 2, COUNT)
    far, phi = near * 10 ** rng.uniform(0.01, 7, COUNT), rng.uniform(0.05, 1.4, COUNT)
    gamma, part = rng.uniform(0, np.pi / 2, COUNT), COUNT // 6
    beside = 1 + 10 ** rng.uniform(-8, -1, COUNT) * rng.choice([-1, 1], COUNT)
    limit = np.arctan(np.tan(phi) * (far + near) / (far - near))
    gamma[:part], gamma[part : 2 * part] = (phi * beside)[:part], (limit * beside)[part : 2 * part]
    gamma[2 * part : 3 * part] = 10 ** rng.uniform(-7, -1, part)
    gamma = np.clip(gamma, 0, 1.5707962)
    return tuple(np.append(a, b).astype(dtype) for a, b in zip((near, far, phi, gamma), ONCE_WRONG, strict=True))


VIEWS = views()
LONG = tuple(np.asarray(part, np.longdouble) for part in VIEWS)


@pytest.mark.parametrize("section", ["axis", "whole"])
@pytest.mark.parametrize("objective", ["z", "storage", "both"])
def test_single_precision_loses_a_hundred_thousandth_at_most(objective, section):
    """Search and closed form; and the certificate's bound on rounding holds, while it stays small."""
    found = near_distance(*map(jnp.asarray, VIEWS), section, objective)
    assert found.value.dtype == jnp.float32
    _, best, _ = oracle.solve(LONG, objective, section)

    def there(distance):
        return oracle.leader(LONG, np.log(np.asarray(distance).astype(np.longdouble)), objective, section)[0]

    error = np.asarray(found.objective_value).astype(np.longdouble)
    assert np.max(np.expm1(there(found.value) - best)) < 1e-5
    assert np.max(np.expm1(there(found.certificate.closed_form) - best)) < 1e-5
    assert np.max(np.abs(error / np.exp(best) - 1)) < 1e-4
    bound = np.asarray(found.certificate.rounding)
    assert (np.abs(error / np.exp(there(found.value)) - 1) <= bound).all()
    assert bound.max() < 1e-4
    assert (found.certificate.difference < 1).all()


def test_a_running_bound_sees_what_a_difference_of_equal_terms_loses():
    """sin γ − tan φ·cos γ as it stands, at the angles once wrong: its bound exceeds its value, and so does no other."""
    phi, gamma = (Running.exact(jnp.asarray(angle, jnp.float32)) for angle in ONCE_WRONG[2:])
    lost = gamma.sin() - phi.tan() * gamma.cos()
    kept = (gamma - phi).sin() / phi.cos()
    angles = [np.asarray(angle.value).astype(np.longdouble) for angle in (gamma, phi)]
    true = np.sin(angles[0] - angles[1]) / np.cos(angles[1])
    for number in (lost, kept):
        assert abs(np.asarray(number.value).astype(np.longdouble) - true) <= np.asarray(number.error)
    assert lost.error > abs(lost.value)
    assert kept.relative < 1e-5


def test_formulas_that_fits_use_keep_their_digits():
    """Offsets, extent and each rule's n' in float32 against float64 of the same numbers."""
    single = LightFrustum.create(*map(jnp.asarray, VIEWS))
    double = LightFrustum.create(*(jnp.asarray(part, jnp.float64) for part in VIEWS))
    for name in ("low_near", "low_far", "extent", "low_slope"):
        np.testing.assert_allclose(getattr(single, name), getattr(double, name), rtol=3e-6, atol=1e-30)
    # as strengths: float32 ends at another stand-in for the uniform map
    bends = [np.asarray(view.extent / generalised(view), float) for view in (single, double)]
    np.testing.assert_allclose(*bends, rtol=2e-5, atol=1e-7)
    for section, objective in (("axis", "z"), ("whole", "z"), ("axis", "storage"), ("whole", "both")):
        rule = {"z": minimax, "storage": least_storage, "both": lambda f, s: balanced(f, section=s)}[objective]
        logs = [
            oracle.leader(LONG, np.log(np.asarray(rule(view, section)).astype(np.longdouble)), objective, section)[0]
            for view in (single, double)
        ]
        np.testing.assert_allclose(np.exp(logs[0] - logs[1]).astype(float), 1, atol=1e-5)
