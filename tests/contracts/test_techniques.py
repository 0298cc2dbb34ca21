"""What every registered technique owes its users, whatever it is made of."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from shapes import above, lights, plate_over_plane

from shadowjax import (
    TECHNIQUES,
    Bias,
    Hard,
    Mesh,
    Prefilter,
    ShadowMapping,
    Variance,
    astype,
    camera_grid,
    make_technique,
)

RESOLUTION = 32
EXACT = ("exact", "shadow-volumes")  # neither has a map
# Lights and dtypes that are met singly elsewhere in the suite
FURTHER = (("directional", jnp.float64), ("spot", jnp.float64), ("point", jnp.float32))
visibility = eqx.filter_jit(lambda shadows, points, normals: shadows.visibility(points, normals))


def floor_points(dtype, num=48, reach=3.0):
    """Spots on the floor, and its normals."""
    spots = jnp.stack(jnp.meshgrid(*[jnp.linspace(-reach, reach, num, dtype=dtype)] * 2), axis=-1).reshape(-1, 2)
    zeros = jnp.zeros(len(spots), dtype)
    return jnp.stack([spots[:, 0], zeros, spots[:, 1]], axis=-1), jnp.stack([zeros, zeros + 1, zeros], axis=-1)


def compares(name):
    """Whether a technique's visibility is a mean of tests, so exact away from edges."""
    technique = make_technique(name)
    return not isinstance(technique, ShadowMapping) or technique.filter.compares


@pytest.fixture(scope="module")
def built():
    """Each technique over the plate, in float64, for the directional light; built once."""
    mesh, camera, light = plate_over_plane(), above(), lights()["directional"]
    return {name: make_technique(name, RESOLUTION).build(mesh, light, camera) for name in TECHNIQUES}


@pytest.mark.parametrize("name", TECHNIQUES)
def test_visibility_lies_in_the_unit_interval_and_keeps_its_tones(built, name):
    value = np.asarray(visibility(built[name], *floor_points(jnp.float64)))
    # The plate is seven texels wide, as a blur: what reconstructs visibility need not reach 0 under it.
    if name == "back-depth":
        assert value.min() == 1  # a plate has no back, so no depth is kept of it: for closed bodies only
        return
    assert value.min() == 0 if compares(name) else 0 <= value.min() < 0.35
    assert value.max() == 1
    bound = make_technique(name).num_tones
    if bound is not None:
        assert len(np.unique(value)) <= bound
        np.testing.assert_allclose(value * (bound - 1), np.round(value * (bound - 1)), atol=1e-12)


# One of each way to filter; an eager call compiles every operation alone.
EAGER = ("exact", "hard", "pcf-bilinear", "2sm-max+pcf-3x3", "vsm", "evsm4", "msm-hamburger", "pcss", "asm")


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[] if name in EAGER else pytest.mark.long) for name in TECHNIQUES]
)
def test_jit_equals_eager_and_float32_is_near_float64(built, name):
    points, normals = floor_points(jnp.float64)
    compiled = visibility(built[name], points, normals)
    np.testing.assert_allclose(built[name].visibility(points, normals), compiled, atol=1e-12)
    single = astype(built[name], jnp.float32).visibility(*floor_points(jnp.float32))
    assert single.dtype == jnp.float32
    # Only receivers within rounding of a texel border or a depth edge may change their answer.
    assert np.mean(np.abs(np.asarray(single, float) - np.asarray(compiled)) > 1e-3) < 0.01


@pytest.mark.parametrize("name", TECHNIQUES)
def test_far_from_the_edge_every_technique_is_exact(built, name):
    """Disagreement with the closed-form shadow only within the filter's reach of its edge."""
    points, normals = floor_points(jnp.float64)
    light = lights()["directional"]
    shift = light.direction[jnp.asarray([0, 2])] / -light.direction[1]
    beyond = jnp.max(jnp.abs(points[:, ::2] - shift), axis=-1) - 1
    truth = (beyond > 0).astype(points.dtype)
    technique = make_technique(name)
    if name in EXACT:
        band = 1e-9
    elif name == "asm":
        # Its coarsest texels answer for what the camera does not see.
        grid, reach = built[name].map.grid, 0.5
        across, down = (vector / 2 for vector in grid.cell_vectors(points))
        carried = [v - light.direction * (v[:, 1:2] / light.direction[1]) for v in (across, down)]
        band = float(reach * jnp.max(sum(jnp.abs(v) for v in carried)))
        assert int(built[name].map.store.keys[0, 0]) == 1
    else:
        grid = built[name].maps[0].grid
        across, down = grid.cell_vectors(points)
        # A texel's world vectors, carried onto the floor along the light: how far one texel reaches there.
        carried = [v - light.direction * (v[:, 1:2] / light.direction[1]) for v in (across, down)]
        band = float(technique.filter.reach * jnp.max(sum(jnp.abs(v) for v in carried)))
        # The bias lifts the test by as much: it never reaches the plate one metre above.
        assert float(jnp.max(built[name].bias.in_world(grid, points, normals))) < 0.9
    value = visibility(built[name], points, normals)
    wrong = jnp.abs(value - truth) > 1e-9
    if not compares(name) or name in ("second-depth", "back-depth"):
        # Light bleeds into smooth shadows, and a plate without thickness has no second side.
        wrong = wrong & (truth == 1)
    assert float(jnp.max(jnp.where(wrong, jnp.abs(beyond), 0))) <= band


@pytest.mark.parametrize(
    ("kind", "dtype"),
    [
        ("directional", jnp.float32),
        ("spot", jnp.float32),
        ("point", jnp.float64),
        *(pytest.param(*pair, marks=pytest.mark.long) for pair in FURTHER),
    ],
)
def test_without_occluders_everything_is_lit(kind, dtype):
    """No acne on a plane for any light, filter and dtype with the default bias: the slope bias is what it claims."""
    plate = plate_over_plane(dtype)
    floor = Mesh(plate.vertices, plate.faces[:2], plate.face_colors[:2])
    points, normals = floor_points(dtype)
    for name in (*EXACT, "hard", "pcf-4x4", "pcf-bilinear-3x3", "3sm+pcf-3x3", "4sm+pcf-3x3"):
        shadows = make_technique(name, RESOLUTION).build(floor, lights(dtype)[kind], above(dtype))
        assert float(jnp.min(visibility(shadows, points, normals))) == 1, name


@pytest.mark.parametrize(
    "name",
    ["vsm", "esm-z-max", "evsm2", "evsm4", "msm-hausdorff", "csm", "xcsm", "pcss", "brabec-seidel", "midpoint-depth"],
)
def test_smooth_and_wide_filters_leave_a_plane_lit_under_a_local_light(name):
    """Their default bias is less than their reach: means of a plane are the plane's own, and taps can follow it."""
    plate, dtype = plate_over_plane(jnp.float32), jnp.float32
    floor = Mesh(plate.vertices, plate.faces[:2], plate.face_colors[:2])
    shadows = make_technique(name, RESOLUTION).build(floor, lights(dtype)["spot"], above(dtype))
    assert float(jnp.min(visibility(shadows, *floor_points(dtype)))) == 1


def test_half_the_slope_bias_is_not_enough():
    """The default bias is the smallest: an eighth less and the floor shadows itself."""
    plate, light, camera = plate_over_plane(), lights()["directional"], above()
    floor = Mesh(plate.vertices, plate.faces[:2], plate.face_colors[:2])
    points, normals = floor_points(jnp.float64, num=200)
    shadows = ShadowMapping(Hard(), RESOLUTION, bias=Bias.create(0.5 * 7 / 8)).build(floor, light, camera)
    assert float(jnp.min(shadows.visibility(points, normals))) == 0


@pytest.mark.parametrize("kind", ["spot", "point"])
def test_local_lights_agree_with_the_exact_shadow(kind):
    mesh, camera, light = plate_over_plane(), above(), lights()[kind]
    points, normals = floor_points(jnp.float64, reach=2.0)
    truth = make_technique("exact").build(mesh, light, camera).visibility(points, normals)
    errors = []
    for resolution in (32, 256):
        value = make_technique("hard", resolution).build(mesh, light, camera).visibility(points, normals)
        errors.append(float(jnp.mean(jnp.abs(value - truth))))
    assert 0.1 < float(jnp.mean(truth)) < 0.9
    # The wrong band along the edge is a texel wide: the error falls with the texel.
    assert errors[-1] < errors[0] / 4
    assert errors[-1] < 0.02


@pytest.mark.parametrize("name", ["hard", "pcf-3x3", "2sm-max+pcf-3x3", "shadow-volumes"])
def test_hard_tests_have_zero_gradient_by_construction(name):
    """The capability table says "values only" for these; nothing soft hides in them, and nothing is NaN."""
    mesh, camera, light = plate_over_plane(), above(), lights()["directional"]
    points, normals = floor_points(jnp.float64, num=8)

    def total(vertices, light):
        moved = Mesh(vertices, mesh.faces, mesh.face_colors)
        return jnp.sum(make_technique(name, 16).build(moved, light, camera).visibility(points, normals))

    for leaf in jax.tree.leaves(jax.grad(total, argnums=(0, 1))(mesh.vertices, light)):
        np.testing.assert_array_equal(leaf, 0)


def test_unknown_names_get_suggestions():
    with pytest.raises(ValueError, match=r"did you mean.*pcf-3x3"):
        make_technique("pcf3x3")


@pytest.mark.parametrize("resolution", [0, -4])
def test_resolution_is_checked(resolution):
    with pytest.raises(ValueError, match="resolution"):
        ShadowMapping(Hard(), resolution)


def test_bias_is_checked():
    with pytest.raises(ValueError, match="unit must be one of 'world', 'texel', 'slope'"):
        Bias.create(1.0, "metres")
    with jax.debug_nans(False), pytest.raises(ValueError, match="finite"):
        Bias.create(float("nan"))


def test_with_filter_needs_the_rays_that_were_cast(built):
    with pytest.raises(ValueError, match="needs 2 rays a texel along an axis, but these maps have 1"):
        built["hard"].with_filter(make_technique("brabec-seidel").filter)


def test_with_filter_reads_the_same_maps_with_that_filters_own_bias(built):
    points, normals = floor_points(jnp.float64, num=16)
    other = built["hard"].with_filter(make_technique("3sm+pcf-3x3").filter)
    assert other.maps is built["hard"].maps
    expected = built["3sm+pcf-3x3"]
    np.testing.assert_array_equal(visibility(other, points, normals), visibility(expected, points, normals))
    biased = built["hard"].with_filter(Hard(), Bias.create(5.0, "world"))
    assert float(jnp.min(visibility(biased, points, normals))) == 1


@pytest.mark.parametrize("sampling", ["trilinear", "anisotropic", "summed-area"])
def test_footprints_of_an_image_reach_the_filter(built, sampling):
    """Seen in few pixels the shadow's mean stays and its edges soften; without an image a texel is averaged."""
    points, normals = floor_points(jnp.float64, num=16)
    near = built["vsm"].with_filter(Variance(Prefilter(1, sampling=sampling, max_anisotropy=4), min_variance=1e-6))
    coarse = near.with_pixel_footprints(camera_grid(above(), 6, 6))
    plain = built["vsm"].with_filter(Variance(Prefilter(1)))
    sharp, soft, reference = (visibility(shadows, points, normals) for shadows in (near, coarse, plain))
    if sampling != "anisotropic":
        # A footprint of one texel is the bilinear read.
        np.testing.assert_allclose(sharp, reference, atol=1e-9)
    assert float(jnp.max(jnp.abs(soft - reference))) > 0.1
    assert 0 <= float(jnp.min(soft)) <= float(jnp.max(soft)) <= 1
