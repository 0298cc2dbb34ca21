"""ShadowVolumes against shadow rays: every scene, every light, cameras inside volumes, and bad meshes."""

import os
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from shapes import above, bumpy_sphere, lights, plate_over_plane, random_soup

from shadowjax import (
    SCENES,
    BruteForceCaster,
    Camera,
    DirectionalLight,
    Exact,
    JitteredLights,
    Mesh,
    PointLight,
    ShadowVolumes,
    Stencil,
    load,
    make_scene,
    make_technique,
    trace_surface,
    visibility_on,
)
from shadowjax.shading import valid_receivers
from shadowjax.volumes.extrude import shadow_quads, volume_edges
from shadowjax.volumes.jitter import disc, jittered

SIDE = 40  # pixels
FACES, VERTICES, EDGES = 4852, 2582, 8000
FOLDER = os.environ.get("SHADOWJAX_MESHES")
FILES = sorted(path for path in Path(FOLDER).iterdir() if path.suffix.lower() != ".md") if FOLDER else []
look = eqx.filter_jit(lambda shadows, points, normals: shadows.visibility(points, normals))


def filled(mesh, num_faces=FACES, num_vertices=VERTICES, num_edges=EDGES):
    """A mesh with points for faces, up to one size, and its edges: meshes of one size share one program."""
    edges = volume_edges(mesh)

    def pad(array, num):
        return jnp.pad(array, [(0, num - array.shape[0]), (0, 0)])

    parts = [pad(edges.ends, num_edges), pad(edges.side_edges, num_faces), pad(edges.side_signs, num_faces)]
    mesh = Mesh(pad(mesh.vertices, num_vertices), pad(mesh.faces, num_faces), pad(mesh.face_colors, num_faces))
    return mesh, eqx.tree_at(lambda e: [e.ends, e.side_edges, e.side_signs], edges, parts)


# Two closed bodies, the size of every small test.
BODY, SMALL_BODY = bumpy_sphere(), bumpy_sphere(subdivisions=0)
BODIES = Mesh.merge([BODY, Mesh(0.4 * SMALL_BODY.vertices + 1.7, SMALL_BODY.faces, SMALL_BODY.face_colors)])
SIZES = (340, 174, 510)


def disagreements(mesh, light, camera, volumes):
    """Valid pixels, their exact visibility, and where volumes say something else."""
    surface = trace_surface(mesh, camera, SIDE, SIDE, BruteForceCaster())
    exact = visibility_on(surface, Exact().build(mesh, light, camera))
    valid = valid_receivers(surface, light)
    assert int(jnp.sum(valid)) > SIDE
    return surface, valid, exact, valid & (exact != visibility_on(surface, volumes))


def nearest_edge(mesh, light, points):
    """Distance of each point from the nearest of all edges, as the light's rays pass them, over the mesh's extent."""
    ends = np.asarray(mesh.vertices)[np.asarray(volume_edges(mesh).ends)]
    along = -np.asarray(light.to_light(points)[0])
    across = []
    for end in (ends[:, 0], ends[:, 1]):
        offset = end[None] - np.asarray(points)[:, None]
        across.append(offset - np.sum(offset * along[:, None], -1, keepdims=True) * along[:, None])
    step = across[1] - across[0]
    place = np.clip(-np.sum(across[0] * step, -1) / np.maximum(np.sum(step * step, -1), 1e-300), 0, 1)
    return np.linalg.norm(across[0] + place[..., None] * step, axis=-1).min(1) / float(mesh.extent)


@pytest.mark.parametrize("name", SCENES)
def test_every_scene_is_exact_away_from_edges(name):
    family = SCENES[name]
    scene = make_scene(name, family.min_triangles if family.scales else None, dtype=jnp.float64)
    mesh, edges = filled(scene.mesh)
    light, camera = scene.lights[0], scene.camera
    volumes = ShadowVolumes().extrude(edges, mesh, light, camera)
    surface, valid, exact, wrong = disagreements(mesh, light, camera, volumes)
    assert 0.01 < np.asarray(exact)[np.asarray(valid)].mean() < 0.99
    points = np.asarray(surface.points)[np.asarray(wrong)]
    assert len(points) == 0 or nearest_edge(scene.mesh, light, points).max() < 1e-4
    print(name, int(volumes.num_quads), "quads,", len(points), "pixels differ")


@pytest.mark.parametrize("source", FILES, ids=str)
def test_meshes_of_a_folder_are_exact_away_from_edges(source):
    """`SHADOWJAX_MESHES=FOLDER` runs it on every mesh file of a folder; open meshes are no worse."""
    mesh = load(source, dtype=jnp.float64)
    middle, extent = 0.5 * sum(mesh.bounds()), mesh.extent
    camera = Camera.look_at(
        middle + extent * jnp.asarray([0.6, 0.5, 1.0]), middle, phi_y=0.35, near=0.1 * extent, far=4 * extent
    )
    light = PointLight.create(middle + extent * jnp.asarray([-0.7, 0.9, 0.5]))
    surface, _, exact, wrong = disagreements(mesh, light, camera, ShadowVolumes().build(mesh, light, camera))
    assert 0 < float(jnp.mean(exact)) < 1
    points = np.asarray(surface.points)[np.asarray(wrong)]
    assert len(points) == 0 or nearest_edge(mesh, light, points).max() < 1e-4


def anywhere(num=1024):
    """Points all round the plate, seen or not, with normals of every direction."""
    rng = np.random.default_rng(3)
    points, normals = rng.uniform(-4, 4, (num, 3)), rng.standard_normal((num, 3))
    return jnp.asarray(points), jnp.asarray(normals / np.linalg.norm(normals, axis=-1, keepdims=True))


@pytest.mark.parametrize("kind", ["directional", "spot", "point"])
def test_points_need_not_be_seen(kind):
    """Any points, from cameras in the light and in a shadow, by both methods: none differs."""
    light = lights()[kind]
    exact = look(Exact().build(BODIES, light, above()), *anywhere())
    assert 0.1 < float(jnp.mean(exact)) < 0.6
    started = set()
    for place in ((0.3, 5.0, 7.0), (-0.5, -2.5, 0.1)):
        camera = Camera.look_at(place, (1.0, 4.0, -0.5), phi_y=0.6, near=0.5, far=20)
        for method in ("z-pass", "z-fail") if kind == "point" else ("z-pass",):
            volumes = ShadowVolumes(method).build(BODIES, light, camera)
            started.add(int(volumes.start))
            np.testing.assert_array_equal(look(volumes, *anywhere()), exact, err_msg=f"{place} {method}")
    assert len(started) > 1, "no camera stood in a volume"


def test_lists_and_images_are_counted_alike():
    """Tiles of an image that the camera sees, of the same points shuffled, and a list without tiles."""
    (mesh, edges), light = filled(random_soup(200, 5)), lights()["directional"]
    camera = Camera.look_at((0.2, 0.1, 0.4), (-0.5, -0.3, -1.0), phi_y=0.9, near=0.01, far=9)
    surface = trace_surface(mesh, camera, SIDE, SIDE, BruteForceCaster())
    volumes = ShadowVolumes().extrude(edges, mesh, light, camera)
    points, normals = surface.points, surface.normals
    one = volumes.count(points.reshape(-1, 3), normals.reshape(-1, 3))
    seen = np.asarray(surface.is_seen).reshape(-1)
    order = np.random.default_rng(0).permutation(SIDE * SIDE)
    tiled = volumes.count(points, normals)
    mixed = volumes.count(*(part.reshape(-1, 3)[order].reshape(SIDE, SIDE, 3) for part in (points, normals)))
    np.testing.assert_array_equal(tiled.reshape(-1)[seen], one[seen])
    np.testing.assert_array_equal(mixed.reshape(-1)[seen[order]], one[order][seen[order]])
    assert len(np.unique(one[seen])) > 3


# Three faces on one edge, wound both ways; one of them twice the same vertex; one that the light sees edge-on.
ODD = Mesh.create(
    np.array([[-1, 1, 0], [1, 1, 0], [0, 1, 1], [0, 1, -1], [0, 2, 0], [1, 1, 0], [-0.4, 0, 0.3], [-0.4, 0.9, 0.3]]),
    [[0, 1, 2], [0, 1, 3], [5, 0, 4], [2, 2, 3], [6, 7, 6], [4, 4, 4]],
    dtype=jnp.float64,
)
FLOOR = Mesh(plate_over_plane().vertices[:4], plate_over_plane().faces[:2], plate_over_plane().face_colors[:2])


@pytest.mark.parametrize("w", ["directional", "point"])
def test_odd_meshes_are_counted_face_by_face(w):
    """Non-manifold, wound inconsistently, with zero-length edges, and with the light in the plane of a face."""
    # The point light and, upright, the directional one lie in the planes of these.
    plane = Mesh.create([[1.0, 3, -0.5], [1, 2, -0.5], [2, 1, -0.5]], [[0, 1, 2]], dtype=jnp.float64)
    upright = Mesh.create([[0.0, 0.5, 2], [-0.2, 0, 2.125], [0.4, 1.5, 1.75]], [[0, 1, 2]], dtype=jnp.float64)
    odd, light, camera = Mesh.merge([FLOOR, ODD, plane, upright]), lights()[w], above()
    mesh, edges = filled(odd, *SIZES)
    volumes = ShadowVolumes().extrude(edges, mesh, light, camera)
    truth = look(Exact().build(mesh, light, camera), *anywhere())
    assert 0.2 < float(jnp.mean(truth)) < 0.6
    np.testing.assert_array_equal(look(volumes, *anywhere()), truth)
    for build in (ShadowVolumes(casters="facing").build, eqx.filter_jit(ShadowVolumes(casters="facing").build)):
        with pytest.raises(ValueError, match=r'need a closed mesh, wound outwards.*casters="both", which takes any'):
            build(odd, light, camera)


def test_a_traced_mesh_has_a_volume_for_every_face_and_the_same_shadow():
    light, camera = lights()["point"], above()
    traced = eqx.filter_jit(lambda mesh: ShadowVolumes().build(mesh, light, camera))(BODIES)
    welded = ShadowVolumes().build(BODIES, light, camera)
    assert int(traced.num_quads) == 3 * 340 > 3 * int(welded.num_quads)
    np.testing.assert_array_equal(look(traced, *anywhere()), look(welded, *anywhere()))


def test_faces_that_see_the_light_are_enough_for_a_closed_mesh_with_the_light_outside():
    camera, facing = above(), ShadowVolumes(casters="facing")
    for light, same in ((lights()["point"], True), (PointLight.create((0.1, 0.0, 0.1)), False)):
        truth = look(Exact().build(BODIES, light, camera), *anywhere())
        np.testing.assert_array_equal(look(ShadowVolumes().build(BODIES, light, camera), *anywhere()), truth)
        assert bool(jnp.all(look(facing.build(BODIES, light, camera), *anywhere()) == truth)) is same
    # A mesh with one face turned round is closed and yet cannot be trusted.
    turned, light = (
        Mesh(BODIES.vertices, BODIES.faces.at[0].set(BODIES.faces[0, ::-1]), BODIES.face_colors),
        lights()["point"],
    )
    with pytest.raises(ValueError, match="3 of 510 edges are open or wound inconsistently"):
        facing.build(turned, light, camera)
    truth = look(Exact().build(turned, light, camera), *anywhere())
    np.testing.assert_array_equal(look(ShadowVolumes().build(turned, light, camera), *anywhere()), truth)


def test_quads_have_their_far_corners_at_infinity():
    mesh = plate_over_plane()
    edges = volume_edges(mesh)
    for light in lights().values():
        quads = np.asarray(shadow_quads(mesh, light, edges))
        np.testing.assert_array_equal(quads[:, :, 3], [[1, 1, 0, 0]] * len(quads))
        source = np.asarray(light.homogeneous)
        # The far corner lies on the line of the light and the near one: x − w·near is along the light's ray.
        away = source[3] * quads[:, 0, :3] - source[:3]
        np.testing.assert_allclose(np.cross(away, quads[:, 3, :3]), 0, atol=1e-12)
        assert np.all(np.sum(away * quads[:, 3, :3], -1) > 0)


def test_arithmetic_of_a_few_bits():
    start, up, down = (jnp.asarray(part) for part in ([0, 1, 0, 0, 255], [0, 2, 300, 1, 3], [0, 3, 300, 2, 0]))
    np.testing.assert_array_equal(Stencil().value(start, up, down), [0, 0, 0, 255, 2])
    np.testing.assert_array_equal(Stencil(wraps=False).value(start, up, down), [0, 0, 0, 0, 255])
    np.testing.assert_array_equal(Stencil(bits=1).value(start, up, down), [0, 0, 0, 1, 0])
    np.testing.assert_array_equal(Stencil(wraps=False).value(-start, up, down), [0, 0, 0, 0, 3])
    for bits in (0, 17):
        with pytest.raises(ValueError, match=f"got {bits}"):
            Stencil(bits)
    with pytest.raises(ValueError, match="method must be one of 'z-pass', 'z-fail'"):
        ShadowVolumes("z-past")
    with pytest.raises(ValueError, match="casters must be one of 'both', 'facing'"):
        make_technique("shadow-volumes", casters="front")


def test_saturating_counters_do_where_no_camera_stands_in_a_volume():
    """Counts never fall below 0 then: the same shadows as with wrapping counters, which need not care."""
    light, camera = lights()["point"], above()
    wrap, clip = (ShadowVolumes(stencil=Stencil(wraps=wraps)).build(BODIES, light, camera) for wraps in (True, False))
    np.testing.assert_array_equal(look(wrap, *anywhere()), look(clip, *anywhere()))
    # Sixteen numbers a quad, and eight bits a sample.
    assert wrap.volume_bytes(100) == int(wrap.num_quads) * 16 * 8 + 100
    assert 20 < int(wrap.num_quads) < 200
    assert wrap.map_bytes == 0


def test_soft_shadows_are_the_mean_over_jittered_lights():
    light, camera = lights()["point"], above()
    soft = JitteredLights.create(ShadowVolumes(), 0.5, 3)
    shadows = soft.build(BODIES, light, camera)
    each = [look(Exact().build(BODIES, one.light, camera), *anywhere()) for one in shadows.shadows]
    np.testing.assert_allclose(look(shadows, *anywhere()), np.mean(each, axis=0), atol=1e-15)
    assert soft.num_tones == len(np.unique(np.asarray(sum(each)))) == 4
    assert shadows.volume_bytes(8) == max(one.volume_bytes(8) for one in shadows.shadows)
    with pytest.raises(ValueError, match="radius of a light must not be negative"):
        JitteredLights.create(Exact(), -1.0)
    with pytest.raises(ValueError, match="num_lights"):
        JitteredLights.create(Exact(), 1.0, 0)


def test_places_of_a_light_lie_on_a_disc():
    """Each ring of the disc gets its share of the places; a sun's lie on cones about it; without a size all are one."""
    radii = jnp.linalg.norm(disc(50), axis=-1)
    np.testing.assert_allclose(jnp.sort(radii) ** 2, (np.arange(50) + 0.5) / 50)
    towards = jnp.zeros(3)
    for light in (lights()["directional"], lights()["point"]):
        axis = light.direction if isinstance(light, DirectionalLight) else -light.position
        places = jnp.stack([place_of(one) for one in jittered(light, jnp.asarray(0.1), 5, towards)])
        if isinstance(light, DirectionalLight):
            places = places / (places @ axis)[:, None]
        offset = places - place_of(light)
        np.testing.assert_allclose(offset @ axis, 0, atol=1e-12)
        np.testing.assert_allclose(jnp.linalg.norm(offset, axis=-1), 0.1 * np.sqrt((np.arange(5) + 0.5) / 5))
        (still,) = jittered(light, jnp.asarray(0.0), 1, towards)
        np.testing.assert_allclose(place_of(still), place_of(light), atol=1e-15)


def place_of(light):
    return light.direction if isinstance(light, DirectionalLight) else light.position


def test_views_may_be_mapped_over():
    """Under vmap: cameras of a path, one technique."""
    light, edges, (points, normals) = lights()["point"], volume_edges(BODIES), anywhere()

    @jax.jit
    @jax.vmap
    def many(place):
        camera = eqx.tree_at(lambda c: c.position, above(), place)
        return ShadowVolumes().extrude(edges, BODIES, light, camera).visibility(points, normals)

    found = many(jnp.asarray([[0.3, 5.0, 7.0], [-0.5, -2.5, 0.1]]))
    np.testing.assert_array_equal(found[0], found[1])
    np.testing.assert_array_equal(found[0], look(Exact().build(BODIES, light, above()), points, normals))
