"""Every optimum of the package carries its implicit derivative, or refuses to be differentiated."""

import ast
import inspect
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimum_oracle as oracle
import pytest
from shapes import above, plate_over_plane

import shadowjax
from shadowjax import BruteForceCaster, DirectionalLight, Hard, trace_surface
from shadowjax.optimize.analytic import near_distance as near_distances
from shadowjax.optimize.analytic.joint import joint_splits
from shadowjax.optimize.analytic.near_distance import near_distance
from shadowjax.optimize.analytic.splits import splits
from shadowjax.optimize.solvers.bounded import minimise_multistart
from shadowjax.optimize.solvers.descent import descend
from shadowjax.optimize.solvers.least_squares import recover
from shadowjax.optimize.viewed.bias import bias
from shadowjax.optimize.viewed.filter_numbers import exponent
from shadowjax.optimize.viewed.near_distance_and_splits import near_distance_for_view, seen_pixels, splits_for_view
from shadowjax.optimize.viewed.taps import depths, taps
from shadowjax.theory.aliasing.light_frustum import LightFrustum
from shadowjax.theory.aliasing.roots import implicit
from shadowjax.theory.aliasing.split_search import best_shares
from shadowjax.theory.aliasing.strength import least_worst_strength
from shadowjax.warps.logarithmic import log_distance

COUNT = 400
NEARBY = 1e-4  # of a change of the active set, relative


def random_views(count=COUNT, seed=0):
    """near, far, phi, gamma: f/n from 1.1 to 10⁶; an eighth of the lights nearly parallel to the view."""
    rng = np.random.default_rng(seed)
    near = 10 ** rng.uniform(-2, 2, count)
    gamma = rng.uniform(0, np.pi / 2, count)
    gamma[: count // 8] = 10 ** rng.uniform(-5, -1, count // 8)
    return near, near * 10 ** rng.uniform(0.05, 6, count), rng.uniform(0.1, 1.3, count), gamma


VIEWS = random_views()
ARRAYS = tuple(jnp.asarray(part) for part in VIEWS)
ONE = jnp.ones(COUNT)


def reverse(function):
    """Values, and derivatives by each number of the views times that number, by one reverse pass for each value."""
    values, back = jax.vjp(function, *ARRAYS)
    zeros = [jnp.zeros_like(value) for value in values]
    rows = [back((*zeros[:i], jnp.ones_like(values[i]), *zeros[i + 1 :])) for i in range(len(values))]
    return [np.asarray(value) for value in values], np.asarray(rows) * np.asarray(VIEWS)


def forward(function):
    """The same derivatives by a forward pass for each number."""
    columns = []
    for i in range(4):
        along = tuple(ONE if k == i else 0 * ONE for k in range(4))
        columns.append(np.asarray(jax.jvp(function, ARRAYS, along)[1]) * VIEWS[i])
    return np.stack(columns, axis=1)


def agree(slopes, expected, one_sided, near_change):
    """To 1e-6, relative to what is of order 1; near a change of the active set from one side."""
    scale = np.maximum(np.abs(expected), 1)
    off = np.abs(slopes - expected) / scale
    beside = np.min([np.abs(slopes - side) for side in one_sided], axis=0) / scale
    assert np.max(np.where(near_change, beside, off)) < 1e-6
    assert np.mean(near_change) <= 0.02


def check_against_differences(slopes, solve):
    """Derivatives of all that `solve(views)` gives but the last, its active set, against whole new solutions."""
    active = solve(VIEWS)[-1]
    for i in range(4):
        moved = [solve(tuple(v * (1 + side * NEARBY * (k == i)) for k, v in enumerate(VIEWS)))[-1] for side in (-1, 1)]
        near_change = (moved[0] != active) | (moved[1] != active)
        found = oracle.differences(lambda v: solve(v)[:-1], VIEWS, i, VIEWS[i])
        central, *sides = (np.asarray(part * VIEWS[i], float) for part in found)
        agree(slopes[:, i], central, sides, near_change)


CASES = [(objective, section) for objective in ("z", "storage", "both") for section in ("axis", "whole")]


def optimum(objective, section):
    """ln n' and ln of the objective of the public search, and ln n' of the closed form."""

    def function(*view):
        found = near_distance(*view, section, objective)
        return jnp.log(found.value), jnp.log(found.objective_value), jnp.log(found.certificate.closed_form)

    return function


@pytest.mark.parametrize(("objective", "section"), [pytest.param(*case, marks=pytest.mark.long) for case in CASES])
def test_near_distance_is_differentiated_in_both_modes(objective, section):
    """Public, through jit and vmap: reverse equals forward, and both equal differences of 80-bit solutions."""
    function = optimum(objective, section)
    values, slopes = reverse(function)
    x, error, _ = oracle.solve(VIEWS, objective, section)
    np.testing.assert_allclose(values[0], np.asarray(x, float), atol=1e-8)
    np.testing.assert_allclose(values[1], np.asarray(error, float), atol=1e-10)
    np.testing.assert_allclose(forward(function), slopes, rtol=1e-8, atol=1e-8)

    def solve(view):
        x, error, active = oracle.solve(view, objective, section)
        return x, error, x, active

    check_against_differences(slopes, solve)


@pytest.mark.parametrize(
    ("objective", "section"),
    [pytest.param(*case, marks=pytest.mark.long if case[1] == "whole" else ()) for case in CASES],
)
def test_the_search_for_a_near_distance_has_its_implicit_derivative(objective, section):
    """The search alone, reverse, against differences of 80-bit solutions from the frustum's corners."""

    @jax.jit
    def function(*view):
        one = lambda n, f, p, g: near_distances.search(LightFrustum(n, f, p, p, g), objective, section)  # noqa: E731
        return (jnp.log(jax.vmap(one)(*view)),)

    values, slopes = reverse(function)
    x, *_ = oracle.solve(VIEWS, objective, section)
    np.testing.assert_allclose(values[0], np.asarray(x, float), atol=1e-8)
    check_against_differences(slopes, lambda view: oracle.solve(view, objective, section)[::2])


def test_forward_mode_and_the_cases_once_wrong():
    """γ = 60°: dn'/dγ = 6 and dM_z/dγ = 3.5924; γ = 31°: 9.7262 and 7.0692 (n = 1, f = 100, φ = 30°)."""
    gammas = jnp.deg2rad(jnp.asarray([60.0, 31.0]))
    found, change = jax.jvp(lambda g: near_distance(1.0, 100.0, jnp.pi / 6, g), (gammas,), (jnp.ones(2),))
    assert found.objective_value.shape == (2,)
    np.testing.assert_allclose(change.value, [6.0, 9.726197679], rtol=1e-8)
    np.testing.assert_allclose(change.objective_value, [3.592405815, 7.069217714], rtol=1e-8)


SPLITS = [
    (2, "sum", "minimax", "whole"), (4, "sum", "lispsm", "axis"), (5, "sum", "least_storage", "axis"),
    (3, "max", "lispsm", "axis"), (3, "sum", "minimax", "whole"), (4, "sum", "uniform", "axis"),
]  # fmt: skip


@pytest.mark.parametrize(
    ("k", "objective", "warp", "section"),
    [pytest.param(*case, marks=pytest.mark.long if i else ()) for i, case in enumerate(SPLITS)],
)
def test_splits_carry_their_implicit_derivative(k, objective, warp, section):
    """A random mix of the planes' logarithms, and the storage, against differences of whole new searches."""
    mix = jnp.asarray(np.random.default_rng(1).normal(size=(COUNT, k + 1)))
    near, far, phi, gamma = VIEWS
    spread = np.clip(far / near, 1.3, 1e5)
    views = (near, near * spread, phi, np.clip(gamma, 1e-3, np.pi / 2 - 1e-3))

    @jax.jit
    def function(*view):
        found = splits(*view, k, objective, warp, section)
        return jnp.sum(mix * jnp.log(found.value.cuts), axis=-1), jnp.log(found.objective_value)

    arrays = tuple(jnp.asarray(part) for part in views)
    values, back = jax.vjp(function, *arrays)
    slopes = [np.asarray(row) for row in back((ONE, ONE))]
    assert values[0].shape == values[1].shape == (COUNT,)
    for i in range(4):
        step = 1e-5 * views[i]

        def moved(steps, i=i, step=step):
            changed = list(arrays)
            changed[i] = jnp.asarray(views[i] + steps * step)
            return sum(np.asarray(part) for part in function(*changed))

        central = (8 * (moved(1) - moved(-1)) - (moved(2) - moved(-2))) / 12e-5
        sides = [side * (-3 * moved(0) + 4 * moved(side) - moved(2 * side)) / 2e-5 for side in (-1, 1)]
        off = np.abs(slopes[i] * views[i] - central) / np.maximum(np.abs(central), 1)
        crosses = off > 1e-6  # a change of the active set within 2e-5 of the view
        assert np.mean(crosses) <= 0.02
        beside = np.min([np.abs(slopes[i] * views[i] - side) for side in sides], axis=0) / np.maximum(
            np.abs(central), 1
        )
        assert np.max(np.where(crosses, beside, 0)) < 1e-6


def test_strength_of_least_worst_error_carries_its_implicit_derivative():
    """Random weights along random axes: kinks between two points, smooth minima of one, and the uniform map."""
    rng = np.random.default_rng(5)
    offset = jnp.asarray(np.sort(rng.uniform(0, 1, (COUNT, 9)), axis=-1))
    weight = jnp.asarray(10 ** rng.uniform(-3, 0, (COUNT, 9)) * np.linspace(3, 0.02, 9))
    weight = weight.at[:, 3].set(0.0)
    along = [jnp.asarray(rng.normal(size=part.shape)) for part in (offset, weight)]

    @jax.jit
    def best(t):
        moved = offset + t[:, None] * along[0] * 0.1, weight * jnp.exp(t[:, None] * along[1])
        return jnp.log1p(jax.vmap(lambda u, w, e: least_worst_strength(u, w, e) * e)(*moved, jnp.exp(0.5 * t)))

    zero = jnp.zeros(COUNT)
    value, slope = jax.jvp(best, (zero,), (ONE,))
    back = jax.vjp(best, zero)[1](ONE)[0]
    np.testing.assert_allclose(slope, back, rtol=1e-9, atol=1e-9)
    central = (8 * (best(zero + 1e-4) - best(zero - 1e-4)) - (best(zero + 2e-4) - best(zero - 2e-4))) / 12e-4
    off = np.abs(np.asarray(slope - central)) / np.maximum(np.abs(central), 1)
    assert np.mean(off > 1e-6) <= 0.02
    assert 0.1 < np.mean(np.asarray(value) > 0) < 0.999


@pytest.mark.long
@pytest.mark.parametrize("seam_limit", [None, 1.4])
def test_joint_splits_carry_their_implicit_derivative(seam_limit):
    """Planes, n' and storage of a dozen views, through the callback that searches, against whole new searches.

    Under a limit a search has 27 starts, so three views must do; in one of them both slices have a uniform map, between
    which the limits on m_x and m_z are one.
    """
    picked = np.arange(60, 72) if seam_limit is None else np.asarray([61, 63, 64])
    near, far, phi, gamma = (part[picked] for part in random_views(seed=3))
    views = [jnp.asarray(part) for part in (near, near * np.clip(far / near, 3, 300), phi, np.clip(gamma, 0.3, 1.4))]

    def function(*view):
        found = joint_splits(*view, 2, seam_limit=seam_limit)
        mixed = jnp.log(found.value.cuts[:, 1]) + jnp.sum(
            jnp.asarray([0.3, -0.2]) * jnp.log(found.value.near_distances), axis=-1
        )
        return mixed + jnp.log(found.objective_value), found.converged

    _, back, converged = jax.vjp(function, *views, has_aux=True)
    assert bool(converged.all())
    along = tuple(part * rate for part, rate in zip(views, (0.4, -0.3, 0.5, 0.2), strict=True))
    slope = jax.jit(lambda *v: jax.jvp(lambda *w: function(*w)[0], v, along)[1])(*views)
    expected = sum(b * a for b, a in zip(back(jnp.ones(len(picked))), along, strict=True))
    np.testing.assert_allclose(slope, expected, rtol=1e-8)
    moved = [function(*(v + s * 1e-4 * a for v, a in zip(views, along, strict=True)))[0] for s in (1, -1, 2, -2)]
    central = (8 * (moved[0] - moved[1]) - (moved[2] - moved[3])) / 12e-4
    np.testing.assert_allclose(slope, central, rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize("objective", ["mean", "worst"])
@pytest.mark.parametrize("lean", [0.0, 0.3])
def test_near_distance_for_a_view_carries_its_implicit_derivative(objective, lean):
    """Weights changed at random rates, with the light upright about the view (smooth) and leaning (a kink)."""
    mesh, camera = plate_over_plane(), above()
    surface = trace_surface(mesh, camera, 24, 24, BruteForceCaster())
    towards = 0.6 * np.asarray(camera.forward) - 0.8 * np.asarray(camera.up)
    pixels = seen_pixels(surface, camera, DirectionalLight.create(towards + lean * np.asarray(camera.right)))
    rates = jnp.asarray(np.random.default_rng(2).normal(size=pixels.weight.shape))

    @jax.jit
    def best(t):
        edges = pixels.edges * (1 + 0.1 * t * jnp.asarray([[1.0, 0.5], [0.7, -0.2], [-0.4, 0.9], [0.2, 0.3]]))
        changed = eqx.tree_at(lambda p: (p.weight, p.edges), pixels, (pixels.weight * jnp.exp(t * rates), edges))
        found = near_distance_for_view(changed, objective)
        return jnp.log(found.value) + jnp.log(found.objective_value)

    at, step = jnp.asarray(0.1), 1e-4
    slopes = jax.jvp(best, (at,), (jnp.ones(()),))[1], jax.grad(best)(at)
    central = (8 * (best(at + step) - best(at - step)) - (best(at + 2 * step) - best(at - 2 * step))) / (12 * step)
    np.testing.assert_allclose(slopes, central, rtol=1e-6)


def refusals():
    """Searches that only choose: each with a call that gives it a traced number."""
    numbers = lambda t: (t, (0.0,))  # noqa: E731
    slope = lambda x: (float(x[0] ** 2), 2 * x)  # noqa: E731
    calls = {
        best_shares: lambda t: (np.exp, t, 2),
        minimise_multistart: lambda t: (slope, [[1.0]], [t], [2.0]),
        descend: lambda t: (slope, t * jnp.ones((1, 3)), np.eye(1), 1, 0.1),
        recover: lambda t: (lambda x: x, [t * jnp.ones(1)]),
        depths: lambda t: (numbers(t), numbers(t)),
        taps: lambda t: (numbers(t), numbers(t)),
        exponent: lambda t: (numbers(t), "vsm"),
        bias: lambda t: (numbers(t), Hard()),
    }
    # without the checks of annotations that only tests have
    return {f.__name__: lambda t, f=f, given=given: inspect.unwrap(f)(*given(t)) for f, given in calls.items()}


@pytest.mark.parametrize("name", refusals())
def test_what_only_chooses_refuses_to_be_differentiated(name):
    for transform in (jax.grad, jax.jit, lambda f: lambda t: jax.vmap(f)(t[None])):
        with pytest.raises(ValueError, match=f"{name} searches on the host, and what it chooses has no derivative"):
            transform(refusals()[name])(jnp.asarray(1.0))


def test_planes_chosen_from_seen_pixels_refuse_to_be_differentiated():
    mesh, camera = plate_over_plane(), above()
    light = DirectionalLight.create((0.2, -1.0, 0.3))
    pixels = seen_pixels(trace_surface(mesh, camera, 12, 12, BruteForceCaster()), camera, light)
    total = lambda w: jnp.sum(splits_for_view(eqx.tree_at(lambda p: p.weight, pixels, w), 2, 8).value.cuts)  # noqa: E731
    with pytest.raises(ValueError, match="chooses planes among candidates, which has no derivative"):
        jax.grad(total)(pixels.weight)


# Where the package searches or chooses, and how its derivative is held to account. A new module that does fails here.
SEARCHES = {
    "optimize/analytic/near_distance.py": test_near_distance_is_differentiated_in_both_modes,
    "optimize/analytic/pairs.py": test_splits_carry_their_implicit_derivative,
    "optimize/analytic/joint.py": test_joint_splits_carry_their_implicit_derivative,
    "optimize/viewed/near_distance_and_splits.py": test_near_distance_for_a_view_carries_its_implicit_derivative,
    "theory/aliasing/strength.py": test_strength_of_least_worst_error_carries_its_implicit_derivative,
    "theory/aliasing/optimal.py": test_near_distance_is_differentiated_in_both_modes,  # its closed forms
    "warps/logarithmic.py": "test_the_logarithmic_warp_carries_its_implicit_derivative",
    "theory/aliasing/split_search.py": "best_shares",
    "optimize/solvers/bounded.py": "minimise_multistart",
    "optimize/solvers/descent.py": "descend",
    "optimize/solvers/least_squares.py": "recover",
    "optimize/viewed/taps.py": "taps",
    "optimize/viewed/filter_numbers.py": "exponent",
    "optimize/viewed/bias.py": "bias",
}
ELSEWHERE = {
    "optimize/viewed/seen_pixels.py": "which corners bound a map's width, an index",
    "theory/aliasing/roots.py": "the finders themselves",
}
FINDERS = {"minimise", "minimize", "minimize_scalar", "root_find", "bisect", "least", "least_largest", "implicit",
           "custom_root", "nnls", "BFGS", "linearized", "least_squares"}  # fmt: skip
NOT_OURS = ("ledger/", "rays/", "volumes/", "cli/", "report/", "plotting/")


def searches(path):
    """Whether a module calls a finder, or is an optimiser's and takes the best of several."""
    calls = [node.func for node in ast.walk(ast.parse(path.read_text())) if isinstance(node, ast.Call)]
    names = {f.attr if isinstance(f, ast.Attribute) else getattr(f, "id", "") for f in calls}
    return bool(names & (FINDERS | ({"argmin", "argmax"} if "optimize" in path.parts else set())))


def test_every_search_of_the_package_is_differentiated_or_refuses():
    root = Path(shadowjax.__file__).parent
    found = {path.relative_to(root).as_posix() for path in root.rglob("*.py") if searches(path)}
    found = {name for name in found if not name.startswith(NOT_OURS)}
    assert found <= set(SEARCHES) | set(ELSEWHERE), found - set(SEARCHES) - set(ELSEWHERE)
    for name, check in SEARCHES.items():
        assert (root / name).exists()
        assert callable(check) or check in refusals() or check in globals()


def test_the_logarithmic_warp_carries_its_implicit_derivative():
    """c of least M_z for a logarithmic warp, by all four numbers, against differences."""

    @jax.jit
    def function(*view):
        n, f, p, g = view
        return (jnp.log(jax.vmap(lambda n, f, p, g: log_distance(LightFrustum(n, f, p, p, g)))(n, f, p, g)),)

    _, slopes = reverse(function)
    for i in range(4):
        moved = [
            np.asarray(function(*(v * (1 + s * 1e-5 * (k == i)) for k, v in enumerate(ARRAYS)))[0])
            for s in (1, -1, 2, -2)
        ]
        central = (8 * (moved[0] - moved[1]) - (moved[2] - moved[3])) / 12e-5
        off = np.abs(slopes[0, i] - central) / np.maximum(np.abs(central), 1)
        assert np.mean(off > 1e-6) <= 0.02


def test_an_optimum_that_is_not_unique_refuses():
    """A flat residual has no implicit derivative: an error at run time, in no mode a silent 0."""
    flat = jax.jit(lambda t: implicit(lambda x: 0 * x * t, jnp.asarray(0.5)))
    assert flat(1.0) == 0.5
    with pytest.raises(Exception, match="equally good optima"):
        jax.grad(flat)(1.0)
