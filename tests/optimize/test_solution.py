"""What an optimiser found is put to work: beams of the frozen technique's maps measure the objective it reports."""

import json

import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
import pytest
from beam_errors import slice_errors

import shadowjax as sj
from shadowjax.optimize.analytic.near_distance import WARP_OBJECTIVES

VIEW = (1.0, 40.0, 0.5, 1.0)
JOINED = {"z": lambda x, z: z, "storage": lambda x, z: x * z, "both": np.maximum}


@pytest.mark.parametrize("section", ["axis", pytest.param("whole", marks=pytest.mark.long)])
@pytest.mark.parametrize("objective", JOINED)
def test_beams_measure_the_objective_of_a_near_distance(objective, section):
    found = sj.optimize.near_distance(*VIEW, section, objective)
    (errors,) = slice_errors(found.technique(64), VIEW, VIEW[:2], section)
    np.testing.assert_allclose(JOINED[objective](*errors), found.objective_value, rtol=1e-3)


SPLITS = [
    (3, "sum", "lispsm", "axis", None), (2, "max", "uniform", "axis", None), (2, "sum", "minimax", "whole", None),
    (3, "max", "minimax", "axis", 1.7),
]  # fmt: skip


@pytest.mark.parametrize("asked", SPLITS, ids=lambda asked: "-".join(map(str, asked)))
def test_beams_measure_the_storage_of_splits(asked):
    k, objective, _, section, _ = asked
    found = sj.optimize.splits(*VIEW, *asked)
    assert found.value.cuts.shape == (k + 1,)
    assert found.value.near_distances.shape == (k,)
    storages = np.prod(slice_errors(found.technique(64), VIEW, found.value.cuts, section), axis=1)
    measured = storages.sum() if objective == "sum" else storages.max()
    np.testing.assert_allclose(measured, found.objective_value, rtol=1e-3)


def test_beams_measure_every_point_of_a_sweep():
    found = sj.optimize.sweep([0.9], [40.0], [0.5], [1, 2, 2.5])
    for index, k in enumerate((1, 2)):
        one = found[0, 0, 0, index]
        cuts = 40.0 ** (np.arange(k + 1) / k)
        errors = slice_errors(one.technique(64), (1.0, 40.0, 0.5, 0.9), cuts)
        np.testing.assert_allclose(errors[:, 1], one.objective_value, rtol=1e-3)
        np.testing.assert_allclose(errors[:, 0], one.certificate.max_error_x, rtol=1e-3)
    with pytest.raises(ValueError, match=r"2\.5 slices make no technique"):
        found[0, 0, 0, 2].technique()


def test_an_objective_of_the_user_s_is_searched_and_differentiated():
    """Least q/a + a/q is q = a; of the larger of two it is where they cross."""
    smooth = lambda a: sj.optimize.near_distance(*VIEW, objective=lambda q, frustum: q / a + a / q).value  # noqa: E731
    np.testing.assert_allclose(smooth(3.0), 3.0, rtol=1e-6)
    np.testing.assert_allclose(jax.grad(smooth)(3.0), 1.0, rtol=1e-6)
    kink = lambda a: sj.optimize.near_distance(  # noqa: E731
        *VIEW, objective=lambda q, frustum: jnp.stack([q / a, (a / q) ** 2 * frustum.far])
    )
    found = kink(3.0)
    np.testing.assert_allclose(found.value, 3.0 * 40 ** (1 / 3), rtol=1e-9)
    np.testing.assert_allclose(found.objective_value, 40 ** (1 / 3), rtol=1e-9)
    np.testing.assert_allclose(jax.grad(lambda a: kink(a).value)(3.0), 40 ** (1 / 3), rtol=1e-6)
    assert found.certificate.closed_form is None
    assert found.converged
    with pytest.raises(ValueError, match="'z', 'storage', 'both'"):
        sj.optimize.near_distance(*VIEW, objective="y")


def test_one_line_adds_an_objective(monkeypatch):
    monkeypatch.setitem(WARP_OBJECTIVES, "mine", lambda q, frustum: q / frustum.near + frustum.near / q)
    np.testing.assert_allclose(sj.optimize.near_distance(*VIEW, objective="mine").value, 1.0, rtol=1e-6)


def test_a_solution_is_a_pytree_that_is_indexed_batched_and_written(tmp_path):
    gammas = jnp.asarray([0.4, 0.9, 1.3])
    found = jax.jit(lambda g: sj.optimize.near_distance(*VIEW[:3], g))(gammas)
    mapped = jax.vmap(lambda g: sj.optimize.near_distance(*VIEW[:3], g))(gammas)
    for one, other in zip(jax.tree.leaves(found), jax.tree.leaves(mapped), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-6)
    assert found.converged.all()
    assert found.text == "successful"
    assert found[1].value == found.value[1]
    assert found[::2].gain.shape == (2,)
    assert [float(one.value) for one in found] == found.value.tolist()
    with pytest.raises(IndexError, match="out of bounds"):
        found[3]
    with pytest.raises(ValueError, match=r"take \[i\] of it"):
        found.technique()
    written = json.loads(found[0].to_json(tmp_path / "n.json").read_text())
    assert set(written) == {"near_distance", "error", "published", "gain", "certificate"}
    assert written["gain"] == float(found[0].gain)
    assert found[0].baselines["published"] / found[0].objective_value == found[0].gain
    mixed = jax.vmap(lambda good: optx.RESULTS.where(good, optx.RESULTS.successful, optx.RESULTS.stagnation))(
        gammas < 1
    )
    told = sj.optimize.Solution(found.value, found.objective_value, found.baselines, None, mixed).text
    assert told.startswith("2 of 3: successful; 1 of 3: ")


@pytest.mark.parametrize(
    ("make", "told"),
    [
        (lambda: sj.PerspectiveFit(near_distance=0.0), "must be positive; got 0"),
        (lambda: sj.PerspectiveFit(bend=1.0), r"must lie in \[0, 1\)"),
        (lambda: sj.PerspectiveFit(near_distance=1.0, bend=0.5), "give one of them"),
        (lambda: sj.PerspectiveFit(margin=-0.1), "margin"),
        (lambda: sj.Cascades.at([1.0, 2.0, 4.0], [1.0]), "near_distances must hold one n' for each of 2 slices"),
        (lambda: sj.Cascades.at([1.0, 2.0], [-1.0]), "near_distances must be positive"),
        (lambda: sj.Cascades.at([1.0, 2.0], [1.0], warp=sj.UniformFit()), "need the warp PerspectiveFit"),
    ],
)
def test_near_distances_that_make_no_map_are_refused(make, told):
    with pytest.raises(ValueError, match=told):
        make()
