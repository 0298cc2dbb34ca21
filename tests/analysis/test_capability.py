"""The capability table against derivatives: 0 where it says so, central differences where it says exact."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from shapes import above, lights, plate_over_plane

from shadowjax import TECHNIQUES, Exponential, Prefilter, ShadowMap, make_technique
from shadowjax.analysis.capability import FUNCTIONS, GRADES, PARAMETERS, capability, capability_table
from shadowjax.filters.offset_pcf import OffsetPercentageCloser

# One of each kind of filter; the others of the registry differ in numbers, or in the layer that their maps keep.
KINDS = ("hard", "pcf-2x2", "pcf-bilinear", "pcss", "brabec-seidel", "3sm", "vsm", "esm", "csm")
POINTS = jnp.stack([jnp.linspace(-1.7, 1.2, 9), jnp.zeros(9), jnp.linspace(-0.93, 0.87, 9)], axis=-1)
NORMALS = jnp.broadcast_to(jnp.asarray([0.0, 1.0, 0.0]), POINTS.shape)


def kind_of(name):
    return type(getattr(make_technique(name), "filter", None))


@pytest.fixture(scope="module")
def slopes():
    """For each kind: derivative and central difference in stored depths, places and depths of receivers, and bias."""
    shadows = make_technique("hard", 12).build(plate_over_plane(), lights()["directional"], above())
    bare = shadows.maps[0]
    lookup = shadows.lookup(bare, POINTS, NORMALS)
    lookup = dataclasses.replace(lookup, gradient=jnp.zeros((len(POINTS), 2)))
    rng = np.random.default_rng(3)
    shake = jnp.asarray(rng.normal(size=bare.depth.shape)), jnp.asarray(rng.normal(size=(len(POINTS), 2)))
    found = {}
    for name in (*KINDS, "OffsetPercentageCloser"):
        # On so small a map a wide blur of exponentials is 1 everywhere, clamped.
        special = {
            "OffsetPercentageCloser": lambda: OffsetPercentageCloser.create([(0.3, 0.2)]),
            "esm": lambda: Exponential(10.0, Prefilter(1)),
        }
        filter_ = special.get(name, lambda name=name: make_technique(name).filter)()

        def total(amounts, filter_=filter_):
            moved = ShadowMap(bare.grid, bare.depth + amounts[0] * shake[0], bare.face)
            place = eqx.tree_at(
                lambda one: (one.position, one.depth, one.bias),
                lookup,
                (
                    lookup.position + amounts[1] * shake[1],
                    lookup.depth + jnp.linspace(0.02, 0.6, len(POINTS)) + amounts[1] * 0.3,
                    jnp.zeros_like(lookup.depth) + amounts[2],
                ),
            )
            fine = jnp.repeat(jnp.repeat(moved.depth, 2, axis=0), 2, axis=1)
            planes = filter_.prepare_map(moved) if filter_.cast_factor == 1 else filter_.prepare(fine)
            return jnp.sum(filter_.visibility(planes, place))

        start, step = jnp.zeros(3), 1e-7
        both = jax.jit(jax.value_and_grad(total))
        exact = np.asarray(both(start)[1])
        differences = [
            float((both(start.at[k].set(step))[0] - both(start.at[k].set(-step))[0]) / (2 * step)) for k in range(3)
        ]
        found[name] = exact, np.array(differences)
    return found


@pytest.mark.parametrize("name", [*KINDS, "OffsetPercentageCloser"])
def test_what_the_table_says_of_a_filter_is_what_its_derivative_does(slopes, name):
    """Vertices act through stored depths, light and camera through where receivers lie, and bias on its own."""
    exact, differences = slopes[name]
    np.testing.assert_allclose(exact, differences, rtol=1e-4, atol=1e-5)
    for parameter, slope in (("light", exact[1]), ("camera", exact[1]), ("bias", exact[2])):
        assert (slope != 0) == (capability(name, parameter) == "topology"), parameter
    # Bilinear weights follow vertices by the fit of the map alone, not by what it holds.
    smooth = capability(name, "bias") == "topology"
    assert (exact[0] != 0) == smooth
    if smooth:
        assert capability(name, "vertices") == "topology"


def test_every_technique_is_of_a_checked_kind_and_graded_like_it():
    checked = {kind_of(name): name for name in KINDS}
    for name in TECHNIQUES:
        if name == "exact" or kind_of(name) not in checked:
            continue
        for parameter in ("vertices", "light", "camera", "bias"):
            assert capability(name, parameter) == capability(checked[kind_of(name)], parameter)
    # The page on differentiability, which tests run, differentiates these.
    elsewhere = {kind_of(name) for name in ("msm-hamburger", "xcsm", "evsm4")}
    known = set(checked) | {type(None)} | elsewhere
    assert {kind_of(name) for name in TECHNIQUES} <= known


def test_static_numbers_are_no_leaves_and_the_table_is_complete():
    table = capability_table()
    assert set(table) == set(TECHNIQUES) | set(FUNCTIONS)
    for name, row in table.items():
        assert set(row) == set(PARAMETERS)
        assert set(row.values()) <= set(GRADES)
        if name in TECHNIQUES and "static" in row.values():
            assert not jax.tree.leaves(make_technique(name).filter)
    assert table["esm"]["exponent"] == table["evsm2"]["exponent"] == "static"
    assert table["hard"]["exponent"] == table["exact"]["bias"] == "none"


def test_unknown_names_are_refused():
    with pytest.raises(ValueError, match="parameter must be one of"):
        capability("hard", "colour")
    with pytest.raises(ValueError, match="technique or function"):
        capability("harder", "bias")
