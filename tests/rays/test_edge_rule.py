"""The edge rule against exact rational arithmetic: never wrong, at worst a tie, and ties never leak."""

from fractions import Fraction

import jax
import jax.numpy as jnp
from hypothesis import given, settings
from hypothesis import strategies as st

from shadowjax.rays.ray import edge_test

# Few distinct values make exact ties common; ordinary floats, huge and tiny ones make rounding common.
coordinate = st.one_of(
    st.integers(-3, 3).map(float),
    st.floats(-1, 1, width=32, allow_subnormal=False),
    st.sampled_from([1e-6, 1 + 2**-23, 1 - 2**-24, 4095.9998, -1e6]),
).map(lambda value: float(jnp.float32(value)))
point = st.tuples(coordinate, coordinate)

rule = jax.jit(edge_test)


def run(corners, depths=(1.0, 2.0, 3.0)):
    """The rule in float32 for the ray at the origin."""
    x, y = (tuple(jnp.float32(corner[axis]) for corner in corners) for axis in (0, 1))
    inside, depth = rule(x, y, tuple(jnp.float32(d) for d in depths))
    return bool(inside), float(depth)


def crosses(corners):
    """Exact edge functions of the origin, one for each edge."""
    exact = [tuple(map(Fraction, corner)) for corner in corners]
    return [
        exact[i][0] * exact[(i + 1) % 3][1] - exact[i][1] * exact[(i + 1) % 3][0]
        for i in range(3)
    ]  # fmt: skip


@settings(max_examples=400, deadline=None)
@given(st.tuples(point, point, point))
def test_strictly_inside_is_always_inside(corners):
    signs = crosses(corners)
    if all(s > 0 for s in signs) or all(s < 0 for s in signs):
        products = [abs(s) for s in signs]
        inside, depth = run(corners)
        # Only where all three edges round to ties is the triangle, to the dtype, without area.
        assert inside or max(products) < Fraction(2) ** -22 * max(Fraction(abs(c)) ** 2 for p in corners for c in p)
        if inside:
            assert 1.0 - 1e-5 <= depth <= 3.0 + 1e-5


@settings(max_examples=400, deadline=None)
@given(st.tuples(point, point, point))
def test_clearly_outside_is_always_outside(corners):
    """Edges on both sides of the ray by more than rounding: no verdict but a miss."""
    scale = max(Fraction(abs(c)) for p in corners for c in p) ** 2
    signs = crosses(corners)
    beyond = Fraction(2) ** -22 * scale
    if any(s > beyond for s in signs) and any(s < -beyond for s in signs):
        assert not run(corners)[0]


@settings(max_examples=400, deadline=None)
@given(st.tuples(point, point, point), st.integers(0, 2))
def test_orientation_and_start_do_not_matter(corners, turn):
    rotated = corners[turn:] + corners[:turn]
    assert run(corners)[0] == run(rotated)[0] == run(corners[::-1])[0]


@settings(max_examples=400, deadline=None)
@given(st.tuples(point, point, point))
def test_two_triangles_over_an_edge_do_not_leak(corners):
    """Cut a triangle at any point of one side that is exact in float32: a ray inside the whole is inside a part."""
    a, b, c = corners
    weight = Fraction(1, 2)
    exact = [weight * Fraction(p) + (1 - weight) * Fraction(q) for p, q in zip(a, b, strict=True)]
    middle = tuple(float(jnp.float32(float(v))) for v in exact)
    if any(Fraction(m) != e for m, e in zip(middle, exact, strict=True)):
        return
    signs = crosses(corners)
    if all(s > 0 for s in signs) or all(s < 0 for s in signs):
        assert run(corners)[0] <= (run((a, middle, c))[0] or run((middle, b, c))[0])


@settings(max_examples=200, deadline=None)
@given(point, point)
def test_repeated_corners_are_always_missed(one, two):
    for corners in ((one, one, two), (one, two, one), (two, one, one), (one, one, one)):
        assert not run(corners)[0]


@settings(max_examples=400, deadline=None)
@given(st.tuples(point, point), st.floats(0, 1), st.floats(-1e-6, 1e-6))
def test_a_ray_in_line_with_a_triangle_but_beside_it_misses(ends, share, off):
    """Corners on one line through the ray, up to a rounding, all on one side of it: products tie, and yet no hit."""
    start, step = ends
    along = [jnp.float32(1), jnp.float32(1 + abs(step[0])), jnp.float32(1 + share * abs(step[0]))]
    corners = [tuple(float(k * jnp.float32(value)) for value in start) for k in along]
    corners[2] = (corners[2][0] * (1 + off), corners[2][1])
    if any(start):
        assert not run(corners)[0]
