"""Maps that know where outlines cross their texels: values, and what cannot have them."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from shapes import above, lights, plate_over_plane

from shadowjax import (
    Convolution,
    DirectionalLight,
    Exponential,
    ExponentialVariance,
    FourierStep,
    Hard,
    Mesh,
    Moments,
    Prefilter,
    ShadowMapping,
    Variance,
    make_technique,
    mesh_edges,
)

MESH = plate_over_plane()
POINT = jnp.asarray([[-0.4, 0.0, 0.25]]), jnp.asarray([[0.0, 1.0, 0.0]])


@pytest.fixture(scope="module")
def shadows():
    """Straight down, so that plate and floor are flat for the light; at the size of the contract of all techniques."""
    light = DirectionalLight.create((0.0, -1.0, 0.0), dtype=jnp.float64)
    return make_technique("vsm+coverage", 32).build(MESH, light, above())


SMALL = Prefilter(1)


@pytest.mark.parametrize(
    "filter_",
    [
        Variance(SMALL, footprint=0.0),
        ExponentialVariance(footprint=0.0, positive=5.0, prefilter=SMALL),
        Moments(prefilter=SMALL),
        Convolution(FourierStep(2), SMALL),
    ],
    ids=lambda filter_: type(filter_).__name__,
)
def test_every_code_tells_the_area_of_the_plate(shadows, filter_):
    """Each number lies between those of plate and floor by the exact share of the texel, so its sum is an area."""
    prepared, grid = shadows.with_filter(filter_).planes[0], shadows.maps[0].grid
    corners = jnp.asarray([[0.0, 1.0, 0.0], [0.0, 0.0, 0.0]])
    near, far = filter_.encode(prepared.range.to_unit(grid.locate(corners)[1])[None])[:, 0].T
    across, down = grid.cell_vectors(corners)
    texel = float(jnp.linalg.norm(jnp.cross(across[0], down[0])))
    # The floor's own rim is an outline too: look at what lies well inside.
    spots = grid.point(grid.centres() * grid.resolution, jnp.full((32, 32), grid.locate(corners)[1][1]))
    inside = jnp.max(jnp.abs(spots), axis=-1) < 3
    share = jnp.where(inside, (far[:, None, None] - prepared.planes) / (far - near)[:, None, None], 0.0)
    np.testing.assert_allclose(jnp.sum(share, axis=(1, 2)) * texel, 4.0, rtol=1e-9)
    assert float(jnp.min(share)) > -1e-9
    assert float(jnp.max(share)) < 1 + 1e-9
    assert int(jnp.sum((share[0] > 0.01) & (share[0] < 0.99))) > 20


def test_what_takes_no_outlines_is_refused(shadows):
    for filter_ in (Hard(), Variance(), ExponentialVariance(), Exponential()):
        with pytest.raises(ValueError, match="averages codes of single depths"):
            ShadowMapping(filter_, 32, coverage=True)
        with pytest.raises(ValueError, match="averages codes of single depths"):
            shadows.with_filter(filter_)
    with pytest.raises(ValueError, match="follows the first layer"):
        ShadowMapping(Moments(), 32, coverage=True, layer="second")


def test_under_jit_edges_are_given():
    def visibility(vertices, technique):
        mesh = Mesh(vertices, MESH.faces, MESH.face_colors)
        return technique.build(mesh, lights()["directional"], above()).visibility(*POINT)

    with pytest.raises(ValueError, match="edges=mesh_edges"):
        jax.eval_shape(lambda v: visibility(v, make_technique("vsm+coverage", 32)), MESH.vertices)
    given = make_technique("vsm+coverage", 32, edges=mesh_edges(MESH))
    assert jax.eval_shape(lambda v: visibility(v, given), MESH.vertices).shape == (1,)
