"""Arrays of views are many views, everywhere: what theory says of all at once is what it says of each."""

import inspect

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from shadowjax.optimize.analytic import near_distance, pairs
from shadowjax.theory.aliasing import error, near_distances, optimal, overhead, rounding, split_rules, storage
from shadowjax.theory.aliasing.light_frustum import LightFrustum
from shadowjax.warps import logarithmic, trapezoidal

# Two ranges of depth, one angle of view, three lights: fields of three shapes. The last range is short.
NEAR, FAR, PHI = np.array([[0.5], [2.0]]), np.array([[40.0], [2.5]]), np.array(0.5)
GAMMA = np.array([0.05, 1.4])
SHAPE = (2, 2)
DEPTH, KNOWN, HALF = NEAR * 1.1, np.array([3.0, 50.0]), np.array(0.3)


def rule(view):
    """A rule for n' with numbers of its own."""
    return view.near + jnp.sqrt(view.near * view.far)


def of_view(function, *options, section="axis", is_long=False, **named):
    """A function of a frustum, then numbers that come with each view."""
    takes = inspect.signature(function).parameters
    named |= {"section": section} if "section" in takes else {}
    name = f"{function.__module__.rsplit('.', 1)[1]}.{function.__name__}-{named.get('section', '')}"
    marks = [pytest.mark.long] if is_long or section == "whole" else []
    return pytest.param(function, options, named, id=name, marks=marks)


OF_A_VIEW = ("frustum", "view")  # how theory names its first argument
MODULES = (error, near_distances, optimal, overhead, rounding, storage, logarithmic, trapezoidal, near_distance, pairs)
SECTIONS = ("axis", "whole")
PLANES = np.stack([NEAR + 0 * GAMMA, np.sqrt(NEAR * FAR) + 0 * GAMMA, FAR + 0 * GAMMA], axis=-1)
CALLS = [
    *(of_view(function) for function in (
        near_distances.psm, near_distances.uniform, near_distances.wimmer, near_distances.wimmer_over_sine,
        near_distances.mean_depth, near_distances.generalised, near_distances.faded, trapezoidal.trapezoidal,
        storage.storage_logarithmic, storage.best_parallel_partitions)),
    of_view(near_distances.near_distance_from_eta, HALF), of_view(near_distances.eta_from_near_distance, KNOWN),
    *(of_view(function, section=section) for section in SECTIONS for function in (
        near_distances.equalising, optimal.minimax, optimal.near_branch_minimum, optimal.least_storage,
        optimal.storage_minimum, optimal.storage_strength, logarithmic.log_distance)),
    *(of_view(function, KNOWN, section=section) for section in SECTIONS for function in (
        error.max_error_z, error.max_error_x, error.storage_factor)),
    of_view(error.error_z, KNOWN, DEPTH, HALF, KNOWN), of_view(error.error_x, KNOWN, DEPTH, HALF, KNOWN),
    of_view(logarithmic.log_error_z, KNOWN, DEPTH, HALF, KNOWN), of_view(optimal.balanced, KNOWN, HALF),
    of_view(rounding.rounding_bound, KNOWN, objective="both"),
    of_view(rounding.rounding_bound, KNOWN, objective="both", section="whole"),
    *(of_view(function, KNOWN, DEPTH) for function in (
        overhead.overhead_t, overhead.overhead_ds_dx, overhead.overhead_dt_dz, overhead.overhead_error_x,
        overhead.overhead_error_z, overhead.literal_error_z)),
    of_view(overhead.overhead_s, KNOWN, HALF, DEPTH), of_view(overhead.overhead_max_x, KNOWN, HALF),
    of_view(overhead.overhead_max_z, KNOWN), of_view(overhead.least_error_depth, KNOWN),
    of_view(storage.overhead_storage, KNOWN), of_view(storage.critical_resolution, KNOWN, HALF, DEPTH),
    of_view(storage.storage_z_partitions, KNOWN, warped=False), of_view(storage.storage_parallel, KNOWN),
    of_view(near_distance.search, is_long=True),
    of_view(near_distance.solve_views, objective="storage", section="whole"),
    of_view(pairs.solve_pairs, num_partitions=3, objective="sum", warp="minimax", is_long=True),
]  # fmt: skip


@pytest.mark.parametrize(("function", "options", "named"), CALLS)
def test_many_views_at_once_are_each_view(function, options, named):
    def call(near, far, phi, gamma, *numbers):
        return jax.tree.leaves(function(LightFrustum(near, far, phi, phi, gamma), *numbers, **named))

    given = (NEAR, FAR, PHI, GAMMA, *options)
    together = call(*(jnp.asarray(x) for x in given))
    views = zip(*(np.broadcast_to(x, SHAPE).reshape(-1) for x in given), strict=True)
    alone = [call(*(jnp.asarray(x) for x in view)) for view in views]
    for many, *few in zip(together, *alone, strict=True):
        # what does not depend on all parts of a view may keep the shape that broadcasts
        spread = np.broadcast_to(many, (*SHAPE, *np.shape(few[0]))).reshape(len(few), *np.shape(few[0]))
        np.testing.assert_allclose(spread, np.stack(few), rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("name", ["slices", "storage_of_splits", "seam_jumps"])
def test_many_partitions_at_once_are_each_partition(name):
    function = getattr(storage, name)
    rest = () if name == "slices" else (rule,)

    def call(near, far, phi, gamma, planes):
        return jax.tree.leaves(function(LightFrustum(near, far, phi, phi, gamma), planes, *rest))

    together = call(*(jnp.asarray(x) for x in (NEAR, FAR, PHI, GAMMA, PLANES)))
    for i, j in np.ndindex(SHAPE):
        numbers = [np.broadcast_to(x, SHAPE)[i, j] for x in (NEAR, FAR, PHI, GAMMA)]
        few = call(*(jnp.asarray(x) for x in (*numbers, PLANES[i, j])))
        for many, one in zip(together, few, strict=True):
            np.testing.assert_allclose(np.broadcast_to(many, (*SHAPE, *np.shape(one)))[i, j], one, rtol=1e-12)


@pytest.mark.parametrize("name", ["uniform_splits", "logarithmic_splits", "practical_splits"])
def test_planes_of_many_ranges_are_those_of_each(name):
    function = getattr(split_rules, name)
    far = np.array([40.0, 2.5, 9.0])
    many = np.asarray(function(np.array([0.5, 2.0, 1.0]), far, 4))
    for k, near in enumerate((0.5, 2.0, 1.0)):
        np.testing.assert_allclose(many[k], function(near, far[k], 4), rtol=1e-12)


def test_every_function_of_a_view_is_tried():
    """Public functions of theory whose first argument is a frustum."""
    tried = {call.values[0] for call in CALLS} | {storage.slices, storage.storage_of_splits, storage.seam_jumps}
    single = {error.error_pieces}  # holds one frustum, for a search
    for module in MODULES:
        for name in module.__all__:
            function = getattr(module, name)
            if inspect.isfunction(function) and next(iter(inspect.signature(function).parameters)) in (
                "frustum",
                "view",
            ):
                assert function in tried | single, name
