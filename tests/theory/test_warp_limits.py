"""Limits and bad input of warps: smooth into the uniform map, casters behind the view, strengths that mean nothing."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from shapes import plate_over_plane

from shadowjax import Camera, DirectionalLight, Exact, ShadowMapping, SpotLight
from shadowjax.evaluate.shimmer import in_view
from shadowjax.partitions.cascades import Cascades
from shadowjax.partitions.faces import FacePartition
from shadowjax.partitions.single import SingleMap
from shadowjax.theory.aliasing import near_distances
from shadowjax.theory.aliasing.light_frustum import LightFrustum
from shadowjax.theory.aliasing.optimal import minimax
from shadowjax.warps.fit import LogarithmicFit, PerspectiveFit
from shadowjax.warps.logarithmic import LogarithmicWarp
from shadowjax.warps.perspective import PerspectiveWarp
from shadowjax.warps.receivers import receiver_outline

NEAR, FAR, PHI = 1.0, 50.0, 0.5


def view(gamma):
    one = jnp.ones_like(gamma)
    return LightFrustum(one * NEAR, one * FAR, one * PHI, one * PHI, gamma)


def test_strength_leaves_the_uniform_map_along_a_straight_line():
    """γ → 0: 1/n' = γ·(f − n)/b² + O(γ²) with b = f·tan φ, in value and in slope. No jump, no kink, no NaN."""
    gamma = 10.0 ** jnp.arange(-9.0, -3.0)
    strength = lambda g: 1 / minimax(view(g))  # noqa: E731
    rate = (FAR - NEAR) / (FAR * np.tan(PHI)) ** 2
    np.testing.assert_allclose(strength(gamma) / gamma, rate, rtol=1e-3)
    np.testing.assert_allclose(jax.vmap(jax.grad(strength))(gamma), rate, rtol=2e-3)
    assert float(strength(jnp.zeros(()))) < 1e-14
    assert np.isfinite(jax.grad(strength)(jnp.zeros(())))


def test_strength_of_the_eta_family_is_smooth_at_minus_one():
    """1/n' = (1 + η)/(n + √(fn) − η(f − n)): slope 1/(f + √(fn)) at the uniform map, continuous through η = 0."""
    overhead = view(jnp.full((), np.pi / 2))
    strength = lambda eta: 1 / near_distances.near_distance_from_eta(overhead, eta)  # noqa: E731
    above = -1 + 10.0 ** jnp.arange(-9.0, -3.0)
    rate = 1 / (FAR + (FAR * NEAR) ** 0.5)
    np.testing.assert_allclose([strength(eta) / (1 + eta) for eta in above], rate, rtol=1e-3)
    np.testing.assert_allclose(jax.vmap(jax.grad(strength))(above), rate, rtol=2e-3)
    assert np.isfinite(jax.grad(strength)(jnp.asarray(-1.0)))
    sides = strength(jnp.asarray(-1e-9)), strength(jnp.asarray(1e-9))
    np.testing.assert_allclose(*sides, rtol=1e-7)


@pytest.mark.parametrize("kind", [PerspectiveWarp, LogarithmicWarp])
@pytest.mark.parametrize("strength", [-0.1, np.nan, np.inf])
def test_a_strength_that_is_no_near_distance_is_named(kind, strength):
    points = jnp.asarray([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    with jax.debug_nans(False), pytest.raises(ValueError, match=r"n' must be positive|strength must be finite"):
        kind.fit(points, strength)


read = eqx.filter_jit(lambda shadows, points, normals: shadows.visibility(points, normals))


@pytest.mark.parametrize(
    "partition",
    [SingleMap(PerspectiveFit("minimax")), SingleMap(LogarithmicFit()), Cascades(2), FacePartition()],
    ids=["minimax", "logarithmic", "z", "faces"],
)
def test_casters_behind_the_near_plane_still_cast(partition):
    """The plate hangs behind the camera; its shadow falls into the view, whatever the map was fitted to."""
    mesh = plate_over_plane()
    camera = Camera.look_at((0.0, 0.7, 0.9), (0.0, 0.1, 3.5), phi_y=0.5, near=0.3, far=6.0)
    assert (np.asarray(camera.to_view(mesh.vertices[4:]))[:, 2] < 0.3).all()
    light = DirectionalLight.create((0.1, -1.0, 1.8))
    spots = jnp.stack(jnp.meshgrid(jnp.linspace(-2.0, 2.0, 60), jnp.linspace(1.0, 4.0, 60)), axis=-1).reshape(-1, 2)
    points = jnp.stack([spots[:, 0], jnp.zeros(len(spots)), spots[:, 1]], axis=-1)
    normals = jnp.broadcast_to(jnp.asarray([0.0, 1.0, 0.0]), points.shape)
    keep = in_view(camera, points)
    exact = read(Exact().build(mesh, light, camera), points, normals)
    value = read(ShadowMapping(resolution=256, partition=partition).build(mesh, light, camera), points, normals)
    assert 0.2 < float(jnp.mean(exact, where=keep)) < 0.9
    assert float(jnp.mean(jnp.abs(value - exact), where=keep)) < 0.02


def test_a_spot_light_that_sees_part_of_the_view_gets_that_part_and_a_flat_frustum_is_an_error():
    """The camera lies behind the light: the map covers what the cone reaches. A light turned away: the even cone."""
    mesh = plate_over_plane()
    camera = Camera.look_at((0.0, 0.7, 0.9), (0.0, 0.1, 3.5), phi_y=0.5, near=0.3, far=6.0)
    for direction, some in (((0.0, -0.1, 1.0), True), ((0.0, 1.0, -0.2), False)):
        beside = SpotLight.create((0.0, 1.2, 2.0), direction, 0.6)
        space = beside.space(camera.forward, *mesh.bounds())
        warp = PerspectiveFit().fit(space, beside, mesh, camera)
        assert all(np.isfinite(x).all() for x in jax.tree.leaves(warp))
        seen = receiver_outline(space, beside, mesh, camera)
        assert bool(seen.some) == some
        square = warp.forward(seen.plane)
        assert square.min() >= 0
        assert square.max() <= 1
        if not some:
            assert float(warp.strength) == 0
            # the square around the cone, whichever way the map lies
            assert 1 <= float(jnp.max(jnp.abs(warp.inverse(jnp.eye(2))))) / np.tan(0.6) < 2**0.5 * 1.01
    flat = jnp.asarray([[0.0, 0.0], [0.5, 1.0], [1.0, 2.0]])
    with pytest.raises(ValueError, match="is the camera in the light's plane"):
        PerspectiveWarp.fit(flat, 0.1, (1.0, 2.0))
