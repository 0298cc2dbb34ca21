"""No filter moves shadows sideways: what it reads is centred at the receiver, for every policy, kernel and tap set."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from shapes import above, lights, plate_over_plane

from shadowjax import (
    TECHNIQUES,
    BilinearPercentageCloser,
    FixedNeighbour,
    Mesh,
    MultiDepth,
    Neighbourhood,
    PercentageCloser,
    PropagatedNeighbours,
    Ring,
    ShadowMapping,
    StochasticNeighbour,
    make_technique,
)
from shadowjax.filters.base import Lookup
from shadowjax.filters.chosen_depths import Ranks
from shadowjax.filters.multi_depth import ring_offsets
from shadowjax.filters.offset_pcf import OffsetPercentageCloser

SIDE, PHASES = 40, 16
FILTERS = {
    **{f"ring {n}, radius {r}": MultiDepth(Ring(n, r)) for r in (1, 2) for n in range(2, 10)},
    **{f"{keep} of {s}": MultiDepth(Neighbourhood(keep, s)) for keep in ("max", "min", "min-max") for s in (2, 3, 4)},
    **{f"ring {n}, kernel {k}": MultiDepth(Ring(n), k) for n in (6, 8) for k in (2, 3)},
    **{f"fixed {offset}": MultiDepth(FixedNeighbour(offset)) for offset in ((0, 1), (-1, 0), (2, -1))},
    "propagated": MultiDepth(PropagatedNeighbours()),
    "ranks": MultiDepth(Ranks((2, 8))),
    **{f"pcf {k}": PercentageCloser(k) for k in (1, 2, 3, 4)},
    **{f"bilinear {k}": BilinearPercentageCloser(k) for k in (1, 2, 3)},
    "offset taps": OffsetPercentageCloser.create([[-1.2, 0.3], [0.7, -0.8], [0.5, 0.5]]),
}


@eqx.filter_jit
def lit_length(filter_, depth, positions):
    """Mean visibility of receivers at depth 2."""
    zero = jnp.zeros(())
    where = Lookup(
        positions, zero + jnp.full(positions.shape[:-1], 2.0), zero, zero + 0.01, "clamp",
        gradient=jnp.zeros(positions.shape),
    )  # fmt: skip
    prepare = getattr(filter_, "_prepared", None)
    planes = filter_.prepare(depth) if prepare is None else prepare(depth, None, "clamp")
    return jnp.mean(filter_.visibility(planes, where))


def offset_of(filter_, rows=1):
    """(x, y) by which a filter moves straight edges of both kinds, texels.

    An occluder to one side and then to the other: what a filter lightens or darkens is the same at both, and what it
    moves has opposite signs. Means over positions of the edge within aligned blocks of four texels.
    """
    factor = filter_.cast_factor
    along = (np.arange(SIDE // 2 * PHASES) + 0.5) / PHASES + SIDE // 4
    across = SIDE / 2 - rows / 2 + np.arange(rows) + 0.5
    moved = np.zeros((2, 2))
    for axis in (0, 1):
        spots = np.stack(np.meshgrid(along, across, indexing="ij")[:: 1 - 2 * axis], axis=-1)
        for place in range(4):
            cells = np.arange(SIDE * factor) // factor
            for side in (0, 1):
                near = (cells < SIDE // 2 + place) == (side == 0)
                depth = np.broadcast_to(np.where(near, 1.0, 3.0), (SIDE * factor, SIDE * factor))
                lit = lit_length(filter_, jnp.asarray(depth if axis == 0 else depth.T), jnp.asarray(spots * factor))
                exact = (SIDE // 4 + place * (2 * side - 1)) / (SIDE // 2)
                moved[axis, side] += (float(lit) - exact) * (SIDE // 2) / 4
    return (moved[:, 1] - moved[:, 0]) / 2


@pytest.mark.parametrize("name", FILTERS)
def test_what_a_filter_reads_is_centred_at_the_receiver(name):
    np.testing.assert_allclose(offset_of(FILTERS[name]), 0, atol=0.6 / PHASES)


@pytest.mark.long
@pytest.mark.parametrize("name", [n for n in TECHNIQUES if isinstance(make_technique(n), ShadowMapping)])
def test_registered_filters_are_centred(name):
    np.testing.assert_allclose(offset_of(make_technique(name).filter), 0, atol=0.6 / PHASES)


@pytest.mark.long
@pytest.mark.parametrize("size", [2, 3, 4])
def test_random_neighbours_are_centred_in_the_mean(size):
    np.testing.assert_allclose(offset_of(MultiDepth(StochasticNeighbour(3, size)), rows=24), 0, atol=0.12)


def test_rings_are_balanced_wherever_turning_them_can():
    for radius in (1, 2):
        for count in range(2, 8 * radius + 2):
            total = np.abs(np.sum(ring_offsets(count, radius), axis=0)).max()
            assert (total == 0) == (count not in (2, 8 * radius)), (radius, count, total)


@pytest.mark.parametrize("name", ["ring 2, radius 1", "ring 8, radius 1", "max of 2", "fixed (2, -1)", "propagated"])
def test_a_moved_lookup_frees_a_plane_of_acne_by_its_own_reach(name):
    """The reach is counted from the middle of what is read: with the default bias a floor alone is lit."""
    plate = plate_over_plane(jnp.float32)
    floor = Mesh(plate.vertices, plate.faces[:2], plate.face_colors[:2])
    spots = jnp.stack(jnp.meshgrid(*[jnp.linspace(-3, 3, 90, dtype=jnp.float32)] * 2), axis=-1).reshape(-1, 2)
    points = jnp.stack([spots[:, 0], jnp.zeros_like(spots[:, 0]), spots[:, 1]], axis=-1)
    normals = jnp.broadcast_to(jnp.asarray([0, 1, 0], jnp.float32), points.shape)
    light, camera = lights(jnp.float32)["directional"], above(jnp.float32)
    shadows = ShadowMapping(FILTERS[name], 32).build(floor, light, camera)
    assert float(jnp.min(shadows.visibility(points, normals))) == 1
