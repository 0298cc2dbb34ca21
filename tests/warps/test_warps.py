"""Every warp: bijective, tight around its points, texel sizes as stated, smooth through the uniform map."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from shapes import above, lights, plate_over_plane

from shadowjax import Exact, ShadowMapping, astype
from shadowjax.partitions.cascades import Cascades
from shadowjax.partitions.single import SingleMap
from shadowjax.theory.aliasing.light_frustum import strength_of
from shadowjax.warps.fit import NEAR_DISTANCES, LogarithmicFit, PerspectiveFit, corners
from shadowjax.warps.logarithmic import LogarithmicWarp
from shadowjax.warps.perspective import PerspectiveWarp

WARPS = [PerspectiveWarp, LogarithmicWarp]
STRENGTHS = [0.0, 1e-12, 0.4, 30.0]
POINTS = np.random.default_rng(3).normal(size=(8, 2))
SQUARE = np.random.default_rng(4).uniform(size=(40, 2))


def fitted(kind, strength, dtype):
    return kind.fit(jnp.asarray(POINTS, dtype=dtype), jnp.asarray(strength, dtype=dtype), (0.6, 0.8))


@pytest.mark.parametrize("strength", STRENGTHS)
@pytest.mark.parametrize("kind", WARPS)
def test_inverse_undoes_forward_and_the_fit_is_tight(kind, strength, dtype, rounding):
    warp, square = fitted(kind, strength, dtype), jnp.asarray(SQUARE, dtype=dtype)
    bend = 1 + float(warp.extent) * strength
    back = warp.forward(warp.inverse(square))
    assert back.dtype == dtype
    np.testing.assert_allclose(back, square, atol=rounding * bend)
    seen = warp.forward(jnp.asarray(POINTS, dtype=dtype))
    np.testing.assert_allclose(jnp.min(seen, axis=0), 0, atol=rounding * bend)
    np.testing.assert_allclose(jnp.max(seen, axis=0), 1, atol=rounding * bend)


@pytest.mark.parametrize("strength", STRENGTHS)
@pytest.mark.parametrize("kind", WARPS)
def test_stated_texel_widths_are_the_derivative_of_the_map(kind, strength, dtype, rounding):
    warp, square = fitted(kind, strength, dtype), jnp.asarray(SQUARE, dtype=dtype)
    jacobian = warp.spacing(square)
    along = jnp.einsum("...ij,i->...j", jacobian, warp.axis)
    across = jnp.einsum("...ij,i->...j", jacobian, jnp.stack([warp.axis[1], -warp.axis[0]]))
    bend = 1 + float(warp.extent) * strength
    widths = warp.widths(square)
    np.testing.assert_allclose(along[:, 1], widths[:, 1], rtol=100 * rounding * bend)
    np.testing.assert_allclose(across[:, 0], widths[:, 0], rtol=100 * rounding * bend)
    # s moves straight across the axis, so the area of a texel is the product of its widths
    np.testing.assert_allclose(along[:, 0], 0, atol=100 * rounding * float(warp.extent))
    np.testing.assert_allclose(
        jacobian @ warp.inverse_spacing(warp.inverse(square)),
        np.broadcast_to(np.eye(2), jacobian.shape), atol=1000 * rounding * bend,
    )  # fmt: skip


@pytest.mark.parametrize("kind", WARPS)
def test_gradient_by_strength_is_right_at_the_uniform_map(kind):
    def total(strength):
        return jnp.sum(fitted(kind, 0.0, jnp.float64).axis) * 0 + jnp.sum(
            kind.fit(jnp.asarray(POINTS), strength, (0.6, 0.8)).inverse(jnp.asarray(SQUARE))
        )

    zero, step = jnp.zeros(()), 1e-5
    expected = (4 * total(zero + step) - total(zero + 2 * step) - 3 * total(zero)) / (2 * step)
    np.testing.assert_allclose(jax.grad(total)(zero), expected, rtol=1e-6)


@pytest.mark.parametrize("kind", WARPS)
def test_positions_behind_the_centre_stay_finite_and_outside(kind, dtype):
    warp = fitted(kind, 30.0, dtype)
    behind = warp.origin - warp.axis * jnp.asarray([[1.0], [50.0], [1e6]], dtype=dtype)
    st = warp.forward(behind)
    assert np.isfinite(st).all()
    assert (st[:, 1] < 0).all()


def test_bad_input_is_named():
    with pytest.raises(ValueError, match="lie on one line"):
        PerspectiveWarp.fit(jnp.asarray([[0.0, 0.0], [1.0, 0.0], [2.0, 0.0]]), 0.0)
    with pytest.raises(ValueError, match="n' must be positive"):
        strength_of(-1.0)
    with pytest.raises(ValueError, match="warp rule"):
        PerspectiveFit("steepest")
    mesh, camera, every = plate_over_plane(), above(), lights()
    space = every["point"].space(camera.forward, *mesh.bounds())
    with pytest.raises(ValueError, match="directional or a spot light"):
        PerspectiveFit().fit(space, every["point"], mesh, camera)
    space = every["spot"].space(camera.forward, *mesh.bounds())
    with pytest.raises(ValueError, match="needs a directional light"):
        LogarithmicFit().fit(space, every["spot"], mesh, camera)


FITS = {**{name: PerspectiveFit(name, tight=False) for name in NEAR_DISTANCES}, "logarithmic": LogarithmicFit(False)}


@eqx.filter_jit
def place(fit, space, light, mesh, camera):
    warp = fit.fit(space, light, mesh, camera)
    return warp, warp.forward(space.project(corners(camera, camera.near, camera.far))[0])


@pytest.mark.parametrize("name", ["uniform", "generalised", "minimax", "balanced", "trapezoidal", "logarithmic"])
def test_fits_cover_the_frustum_in_both_dtypes(name, dtype):
    mesh, camera, light = astype((plate_over_plane(), above(), lights()["directional"]), dtype)
    space = light.space(camera.forward, *mesh.bounds())
    warp, st = place(FITS[name], space, light, mesh, camera)
    assert warp.strength.dtype == dtype
    assert st.min() >= 0
    assert st.max() <= 1
    assert st.max() > 0.99


def floor_points(num=40, reach=2.2):
    spots = jnp.stack(jnp.meshgrid(*[jnp.linspace(-reach, reach, num)] * 2), axis=-1).reshape(-1, 2)
    zeros = jnp.zeros(len(spots))
    return jnp.stack([spots[:, 0], zeros, spots[:, 1]], axis=-1), jnp.stack([zeros, zeros + 1, zeros], axis=-1)


read = eqx.filter_jit(lambda shadows, points, normals: shadows.visibility(points, normals))


@pytest.mark.parametrize(
    ("partition", "kind"),
    [
        (SingleMap(PerspectiveFit("minimax")), "directional"),
        (SingleMap(PerspectiveFit("psm")), "directional"),
        (SingleMap(LogarithmicFit()), "directional"),
        (SingleMap(PerspectiveFit("minimax")), "spot"),
        (Cascades(3), "directional"),
    ],
    ids=["minimax", "psm", "logarithmic", "spot", "z_split"],
)
def test_shadows_through_a_warp_converge_to_the_exact_shadow(partition, kind):
    """The wrong area lies along the edge, so it falls as 1/resolution: by 4 from 64 to 256, here at least by 2.5."""
    mesh, camera, light = plate_over_plane(), above(), lights()[kind]
    points, normals = floor_points()
    exact = read(Exact().build(mesh, light, camera), points, normals)
    wrong = []
    for resolution in (64, 256):
        built = ShadowMapping(resolution=resolution, partition=partition).build(mesh, light, camera)
        wrong.append(float(jnp.mean(jnp.abs(read(built, points, normals) - exact))))
    assert 0 < float(jnp.mean(exact)) < 1
    assert wrong[0] < 0.06
    assert wrong[1] <= wrong[0] / 2.5 + 1e-3
