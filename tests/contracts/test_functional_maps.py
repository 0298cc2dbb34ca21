"""What `sj.functional` makes is what the objects make: the map of a light, and every filter that reads it."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import shadowjax as sj
from shadowjax.filters.policies import POLICY_NAMES

F = sj.functional
SUN = np.array([0.35, -1.0, 0.25])
SIZE = 24


@pytest.fixture(scope="module")
def made():
    """Shadows of balls over a ground, and what the functions make of the same triangles.

    Triangles without area in the corners of the box make the mesh's own rectangle that of its box, which the functions
    are given; the camera stands in the middle, where they count places from.
    """
    scene = sj.make_scene("sphere-over-plane", num_triangles=182)
    lower, upper = scene.mesh.bounds()
    which = np.stack(np.meshgrid(*[[0, 1]] * 3), -1).reshape(-1, 3)
    corners = np.where(which, upper, lower)
    own = len(scene.mesh.vertices)
    vertices = jnp.concatenate([scene.mesh.vertices, jnp.asarray(corners, scene.mesh.vertices.dtype)])
    spikes = jnp.repeat(own + jnp.arange(8, dtype=jnp.int32)[:, None], 3, axis=1)
    mesh = sj.Mesh.create(vertices, jnp.concatenate([scene.mesh.faces, spikes]))
    light = sj.DirectionalLight.create(SUN, dtype=vertices.dtype)
    middle = 0.5 * (lower + upper)
    camera = sj.Camera.look_at(middle, middle + jnp.asarray([1.0, 0.0, -2.0]), phi_y=0.5, near=0.1, far=9.0)
    box = (jnp.asarray(SUN), lower, upper, SIZE, camera.forward)
    surface = sj.trace_surface(scene.mesh, scene.camera, 32, 24, sj.rays.default_caster())
    seen = np.asarray(surface.is_seen)
    return mesh, light, camera, box, (surface.points[seen], surface.normals[seen])


def short(names):
    """The first three in every run, the others among the long tests."""
    return [*list(names)[:3], *(pytest.param(name, marks=pytest.mark.long) for name in list(names)[3:])]


def shadows_of(made, filter_):
    mesh, light, camera, _, _ = made
    return sj.ShadowMapping(filter_, SIZE, caster=sj.rays.default_caster()).build(mesh, light, camera)


def cast(made):
    mesh, _, _, box, _ = made
    return F.cast_depth(mesh.vertices, mesh.faces, *F.map_rays(*box))


def test_the_map_is_that_of_a_single_map(made):
    depth, built = cast(made), shadows_of(made, sj.Hard()).maps[0]
    assert jnp.any(built.face < 0)
    assert jnp.any(built.face >= 0)
    np.testing.assert_allclose(depth, built.depth, rtol=1e-14)
    position, along = F.to_map(made[4][0], *made[3])
    expected = built.grid.locate(made[4][0])
    np.testing.assert_allclose(position, expected[0], atol=1e-11)
    np.testing.assert_allclose(along, expected[1], atol=1e-13)


FILTERS = {
    "pcf": (sj.PercentageCloser(3), {"kernel_size": 3}),
    "pcf, wide": (sj.PercentageCloser(2, width_world=0.7), {"kernel_size": 2, "width_world": 0.7}),
    "bilinear": (sj.BilinearPercentageCloser(2), {"kernel_size": 2, "taps": "bilinear"}),
    "bilinear, wide": (
        sj.BilinearPercentageCloser(2, width_world=0.7),
        {"kernel_size": 2, "taps": "bilinear", "width_world": 0.7},
    ),
    "multi-depth": (sj.MultiDepth(sj.Neighbourhood("min-max"), 2), {"kernel_size": 2, "policy": "min-max"}),
    "to one side": (sj.MultiDepth(sj.Neighbourhood("max", 4)), {"kernel_size": 1, "policy": "max", "size": 4}),
}


@pytest.mark.parametrize("name", short(FILTERS))
def test_counted_tests_are_those_of_the_object(made, name):
    filter_, options = FILTERS[name]
    options = dict(options)
    shadows = shadows_of(made, filter_)
    lookup = shadows.lookup(shadows.maps[0], *made[4])
    policy = {key: options.pop(key) for key in ("policy", "size") if key in options} or {"policy": "single"}
    planes = F.multi_depth(cast(made), **policy)
    vis = F.percentage_closer(
        planes, *F.to_map(made[4][0], *made[3]), bias=lookup.bias, texel_size=lookup.texel_size,
        shift=F.multi_depth_shift(**policy), **options,
    )  # fmt: skip
    np.testing.assert_allclose(vis, shadows.read(0, *made[4]), rtol=0, atol=1e-12)
    assert jnp.any(vis < 1)


STEP = sj.FourierStep(6, 0.7, 0.02, 1.8)
BLUR = sj.Prefilter(5)
CODES = {
    "variance": (sj.Variance(BLUR, 1e-5, 0.2), F.encode_variance, lambda v, z: F.decode_variance(v, z, 1e-5, 0.2)),
    "exponential": (
        sj.Exponential(60.0, BLUR, "linear"), lambda z: F.encode_exponential(z, 60.0),
        lambda v, z: F.decode_exponential(v, z, 60.0),
    ),
    "exponential variance": (
        sj.ExponentialVariance(20.0, 4.0, BLUR, 1e-5), lambda z: F.encode_exponential_variance(z, 20.0, 4.0),
        lambda v, z: F.decode_exponential_variance(v, z, 20.0, 4.0, 1e-5),
    ),
    "moments": (
        sj.Moments("hausdorff", 1e-6, BLUR, 0.1), F.encode_moments,
        lambda v, z: F.decode_moments(v, z, "hausdorff", 1e-6, 0.1),
    ),
    "convolution": (
        sj.Convolution(STEP, BLUR), lambda z: F.encode_convolution(z, 6, 0.02),
        lambda v, z: F.decode_convolution(v, z, 0.7, 0.02, 1.8),
    ),
    "mean depth": (
        sj.MeanDepthConvolution(STEP, BLUR), lambda z: F.encode_mean_depth(z, 6, 0.02),
        lambda v, z: F.decode_mean_depth(v, z, 6, 0.7, 0.02, 1.8),
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", short(CODES))
def test_encoded_filters_are_those_of_the_object(made, name):
    filter_, encode, decode = CODES[name]
    shadows = shadows_of(made, filter_)
    lookup = shadows.lookup(shadows.maps[0], *made[4])
    depth = cast(made)
    near, far = jnp.min(depth), jnp.max(depth)
    unit = F.extend(F.unit_depth(depth, near, far), 2, "lit", jnp.ones(()))
    planes = F.blur(encode(unit), F.gaussian_weights(5))
    position, along = F.to_map(made[4][0], *made[3])
    vis = decode(F.read_bilinear(planes, position), F.unit_depth(along - lookup.bias, near, far))
    np.testing.assert_allclose(vis, shadows.read(0, *made[4]), rtol=0, atol=1e-9)
    assert 0.05 < float(jnp.mean(vis)) < 0.999


@pytest.mark.parametrize("policy", POLICY_NAMES)
def test_every_policy_keeps_the_own_depth_first(policy):
    depth = jnp.asarray(np.random.default_rng(2).uniform(1, 2, (9, 8)))
    planes = F.multi_depth(depth, policy)
    np.testing.assert_array_equal(planes[0], depth)
    assert planes.shape[0] == 1 or jnp.any(planes[1:] != depth)
    assert all(abs(part) < 1 for part in F.multi_depth_shift(policy))


def test_an_unknown_policy_is_named():
    with pytest.raises(ValueError, match="policy must be one of 'single', 'max'"):
        F.multi_depth(jnp.ones((3, 3)), "maximum")
    with pytest.raises(ValueError, match="odd square, size ≥ 3; got 4"):
        F.multi_depth(jnp.ones((3, 3)), "ring", 4)


def test_rays_of_a_map_are_drawn_and_others_traced_alike(made):
    """Turned, mirrored and bent grids of rays, and a list, hit what brute force says."""
    mesh, _, _, box, _ = made
    origins, directions = F.map_rays(*box)
    ways = {
        "map": (origins, directions),
        "transposed and mirrored": (jnp.swapaxes(origins, 0, 1)[::-1], directions),
        "list": (origins[0], directions[0]),
        "row": (origins[:1], directions[:1]),
        "fan": (origins[:9], directions[:9] + 0.01 * jnp.arange(9.0)[:, None, None]),
        "stretched": (origins[:9] * (1 + 1e-3 * jnp.arange(9.0)[:, None, None]), directions[:9]),
    }
    for name, (start, way) in ways.items():
        unit = way / jnp.linalg.norm(way, axis=-1, keepdims=True)
        rays = sj.Rays(start, unit, jnp.zeros(()), jnp.asarray(50.0))
        expected = sj.BruteForceCaster().closest(mesh, rays).depth
        np.testing.assert_allclose(
            F.cast_depth(mesh.vertices, mesh.faces, start, way, 50.0), expected, rtol=1e-12, err_msg=name
        )


def test_many_maps_and_biases_in_one_vmap(made):
    """Light directions and biases are batched; each answer is that of one call; the gradient sees vertices move."""
    mesh, _, _, (sun, lower, upper, _, _), (points, _) = made
    suns = sun + 0.1 * jnp.asarray([[0.0, 0, 0], [1, 0, 0], [0, 0, 1]])
    biases = jnp.asarray([0.0, 0.05])

    def visibility(vertices, sun, bias):
        where = sun, lower, upper, 12
        planes = F.multi_depth(F.cast_depth(vertices, mesh.faces, *F.map_rays(*where)), "max")
        return F.percentage_closer(planes, *F.to_map(points, *where), bias=bias)

    over = jax.vmap(jax.vmap(visibility, (None, None, 0)), (None, 0, None))
    every = jax.jit(over)(mesh.vertices, suns, biases)
    for i, j in ((0, 0), (1, 1), (2, 0)):
        np.testing.assert_allclose(every[i, j], visibility(mesh.vertices, suns[i], biases[j]), atol=1e-12)


def test_the_map_moves_with_its_vertices(made):
    mesh, _, _, box, _ = made
    rays = F.map_rays(*box)
    up = jnp.asarray([0.0, 1.0, 0.0])

    def total(height):
        return jnp.sum(F.cast_depth(mesh.vertices + height * up, mesh.faces, *rays, 50.0))

    # The visibility of the triangles changes along silhouettes alone, which so small a step does not move over a ray.
    slope = jax.jit(jax.grad(total))(0.0)
    np.testing.assert_allclose(slope, (total(1e-7) - total(-1e-7)) / 2e-7, rtol=1e-6)
    hits = jnp.sum(cast(made) < jnp.max(cast(made)))
    assert hits > 0
    assert abs(float(slope)) > 1
