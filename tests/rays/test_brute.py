"""The reference caster and the one intersection: against Embree, on edges, on degenerate input, and its gradients."""

from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import trimesh
from grids import closest
from shapes import above, bumpy_sphere, lights, plate_over_plane, random_soup

from shadowjax import BruteForceCaster, Camera, Mesh, PointLight, Rays, camera_grid, intersect
from shadowjax.partitions.single import SingleMap
from shadowjax.rays.ray import orthonormal_frame

visible = eqx.filter_jit(lambda mesh, space, points, normals: BruteForceCaster().visible(mesh, space, points, normals))
closest_on_grid = eqx.filter_jit(lambda mesh, grid: BruteForceCaster().closest_on_grid(mesh, grid))


def embree(mesh: Mesh, origins, directions):
    """Face and depth from trimesh's Embree caster: -1 and infinity for a miss."""
    body = trimesh.Trimesh(np.asarray(mesh.vertices, float), np.asarray(mesh.faces), process=False)
    origins, directions = np.asarray(origins, float), np.asarray(directions, float)
    place, ray, face = body.ray.intersects_location(origins, directions, multiple_hits=False)
    depth = np.full(len(origins), np.inf)
    depth[ray] = np.linalg.norm(place - origins[ray], axis=1)
    found = np.full(len(origins), -1)
    found[ray] = face
    return found, depth


def test_agrees_with_embree_on_a_random_soup(dtype):
    mesh = random_soup(200, 1, dtype)
    rng = np.random.default_rng(2)
    rays = Rays.create(jnp.asarray(rng.uniform(-2, 2, (20000, 3)), dtype), rng.normal(size=(20000, 3)))
    hit = closest(mesh, rays)
    face, depth = embree(mesh, rays.origins, rays.directions)
    same = np.asarray(hit.face) == face
    with np.errstate(invalid="ignore"):
        near = np.abs(np.asarray(hit.depth) - depth) <= 1e-5 * float(mesh.extent)
    disagree = ~(same & (near | (face < 0))) & ~near
    assert disagree.mean() <= 1e-4
    # What is left lies on an edge: a barycentric weight of either answer is close to 0.
    for index in np.flatnonzero(disagree):
        ray = jax.tree.map(lambda x, i=index: x[i], rays.flattened())
        weights = [
            np.asarray(intersect(mesh, ray, jnp.int32(candidate)).barycentrics)
            for candidate in (int(hit.face[index]), int(face[index]))
            if candidate >= 0
        ]
        assert min(w.min() for w in weights) < 1e-4


def test_closed_mesh_leaks_no_ray_aimed_at_edges_and_vertices(dtype):
    """From inside a closed body every ray must hit: a miss is a leak. More than 10⁶ rays in each dtype."""
    mesh = bumpy_sphere(dtype)
    rng = np.random.default_rng(3)
    vertices, faces = np.asarray(mesh.vertices), np.asarray(mesh.faces)
    num = 350_000
    share = rng.uniform(size=(num, 1)).astype(vertices.dtype)
    edge = faces[rng.integers(len(faces), size=num)]
    targets = np.concatenate(
        [
            vertices[rng.integers(len(vertices), size=num)],
            vertices[edge[:, 0]] * share + vertices[edge[:, 1]] * (1 - share),
            (vertices[edge[:, 1]] + vertices[edge[:, 2]]) / 2,
        ]
    )
    # A few shared origins, among them the centre and lattice points, make exact ties as likely as they can be.
    pool = np.concatenate([np.zeros((1, 3)), rng.integers(-2, 3, (4, 3)) / 8, rng.uniform(-0.2, 0.2, (59, 3))])
    origins = pool[rng.integers(len(pool), size=len(targets))].astype(vertices.dtype)
    hit = closest(mesh, Rays.create(jnp.asarray(origins), jnp.asarray(targets - origins)))
    assert len(targets) > 10**6
    assert int(jnp.sum(~hit.is_hit)) == 0
    np.testing.assert_allclose(jnp.sum(hit.barycentrics, axis=-1), 1, atol=1e-5)


def test_axis_aligned_rays_through_lattice_vertices_do_not_leak(dtype):
    """Exact ties everywhere: rays along the axes through the vertices and edges of a subdivided cube."""
    cube = trimesh.creation.box().subdivide().subdivide()
    mesh = Mesh.create(cube.vertices * 2, cube.faces, dtype=dtype)
    line = np.arange(-0.75, 0.76, 0.25)
    spots = np.stack(np.meshgrid(line, line), -1).reshape(-1, 2)
    for axis in range(3):
        directions = np.zeros((len(spots), 3))
        directions[:, axis] = 1
        origins = np.insert(spots, axis, -0.1, axis=1)
        hit = closest(mesh, Rays.create(jnp.asarray(origins, dtype), directions))
        np.testing.assert_allclose(hit.depth, np.full(len(spots), 1.1), rtol=1e-6)


def test_degenerate_triangles_are_passed_through(dtype):
    floor = plate_over_plane(dtype)
    point, line = [[0.2, 0.5, 0.1]] * 3, [[-1, 0.5, 0], [0, 0.5, 0], [1, 0.5, 0]]
    junk = Mesh.create(np.array(point + line, float), [[0, 1, 2], [0, 0, 1], [3, 3, 5], [3, 5, 5]], dtype=dtype)
    origins = jnp.asarray([[0.2, 3, 0.1], [0, 3, 0], [0.5, 3, 0]], dtype)
    rays = Rays.create(origins, [[0.0, -1, 0]] * 3)
    both = closest(Mesh.merge([junk, floor]), rays)
    alone = closest(floor, rays)
    np.testing.assert_array_equal(both.face, alone.face + junk.num_faces)
    np.testing.assert_array_equal(both.depth, alone.depth)


def test_of_equal_triangles_the_first_wins(dtype):
    plate = plate_over_plane(dtype)
    doubled = Mesh.merge([plate, plate])
    rays = Rays.create(jnp.asarray([[0.3, 2.0, 0.2], [3.0, 2.0, 0.2]], dtype), [[0.0, -1, 0]] * 2)
    np.testing.assert_array_equal(closest(doubled, rays).face, closest(plate, rays).face)


def test_limits_of_a_ray_are_kept():
    mesh = plate_over_plane()
    origin, down = jnp.asarray([[0.0, 3.0, 0.25]]), [[0.0, -1, 0]]
    assert closest(mesh, Rays.create(origin, down)).depth[0] == 2.0
    assert closest(mesh, Rays.create(origin, down, t_max=2.0)).face[0] >= 2
    below = closest(mesh, Rays.create(origin, down, t_max=1.5))
    assert below.face[0] == -1
    assert below.depth[0] == 1.5
    assert closest(mesh, Rays.create(origin, down, t_min=2.5)).depth[0] == 3.0


def test_far_from_the_origin_depth_keeps_the_precision_of_its_vertices(dtype):
    """Vertices near 1000 with a step of 1/16: both are exact in float32, and the depth must be too."""
    mesh = plate_over_plane(dtype, height=1 / 16)
    offset = jnp.asarray([1000.0, 2000, -1000], dtype)
    moved = Mesh(mesh.vertices + offset, mesh.faces, mesh.face_colors)
    rays = Rays.create(offset + jnp.asarray([0.25, 4.0, 0.5], dtype), jnp.asarray([0.0, -1, 0], dtype))
    assert float(closest(moved, rays).depth) == 4 - 1 / 16


def test_jit_vmap_and_chunks_agree(dtype, rounding):
    mesh = random_soup(40, 5, dtype)
    rng = np.random.default_rng(6)
    rays = Rays.create(jnp.asarray(rng.uniform(-2, 2, (6, 50, 3)), dtype), rng.normal(size=(6, 50, 3)))
    whole = closest(mesh, rays)

    @jax.jit
    def others(rays):
        mapped = jax.vmap(lambda o, d: BruteForceCaster().closest(mesh, Rays(o, d, rays.t_min, rays.t_max)))
        return mapped(rays.origins, rays.directions), BruteForceCaster(ray_chunk=64).closest(mesh, rays)

    for other in others(rays):
        np.testing.assert_array_equal(other.face, whole.face)
        np.testing.assert_allclose(other.depth, whole.depth, rtol=16 * rounding)


def test_orthonormal_frame_at_the_poles(dtype, rounding):
    directions = jnp.asarray([[0, 0, 1], [0, 0, -1], [1e-20, 0, -1], [0.6, 0, 0.8], [0, -1, 0]], dtype)
    u, v = orthonormal_frame(directions)
    frames = jnp.stack([u, v, directions], axis=1)
    np.testing.assert_allclose(frames @ frames.mT, np.tile(np.eye(3), (5, 1, 1)), atol=8 * rounding)


def _interior(hit, margin=0.02):
    return hit.is_hit & (jnp.min(hit.barycentrics, axis=-1) > margin)


def test_depth_gradients_match_central_differences_in_vertices_camera_and_light():
    """At fixed topology, in float64, to 1e-6: for every kind of light and for a camera; forward equals reverse mode."""
    mesh = bumpy_sphere()
    weights = jnp.asarray(np.random.default_rng(4).uniform(0.5, 1.5, (12, 12)))

    def loss(parameters, make_grid, keep):
        vertices, source = parameters
        moved = Mesh(vertices, mesh.faces, mesh.face_colors)
        hit = BruteForceCaster().closest_on_grid(moved, make_grid(moved, source))
        return jnp.sum(jnp.where(keep, hit.depth * weights, 0.0))

    camera = Camera.look_at((0.3, 0.4, 4.0), (0.0, 0, 0), phi_y=0.3, near=1.0, far=8.0)
    cases = {"camera": (camera, lambda _, source: camera_grid(source, 12, 12))}
    inside = PointLight.create((0.1, 0.05, -0.1))
    for name, light in (lights() | {"point": inside}).items():
        cases[name] = (light, lambda moved, source: SingleMap().grids(moved, source, camera, 12)[0])
    rng = np.random.default_rng(5)
    for name, (source, make_grid) in cases.items():
        keep = _interior(BruteForceCaster().closest_on_grid(mesh, make_grid(mesh, source)))
        assert int(jnp.sum(keep)) > 3, name
        parameters = (mesh.vertices, source)
        value = partial(loss, make_grid=make_grid, keep=keep)
        tangent = jax.tree.map(lambda leaf: jnp.asarray(rng.normal(size=leaf.shape)), parameters)

        @jax.jit
        def everything(at, along, value=value):
            """Value, its derivative along a direction in reverse mode, and in forward mode: compiled once."""
            total, gradient = jax.value_and_grad(value)(at)
            products = jax.tree.map(lambda g, t: jnp.sum(g * t), gradient, along)
            return total, sum(jax.tree.leaves(products)), jax.jvp(value, (at,), (along,))[1]

        _, predicted, forward = everything(parameters, tangent)
        # The five-point rule: its error falls with the fourth power of the step.
        step = 1e-5
        at = {
            s: float(everything(jax.tree.map(lambda x, t, s=s * step: x + s * t, parameters, tangent), tangent)[0])
            for s in (-2, -1, 1, 2)
        }
        measured = (8 * (at[1] - at[-1]) - (at[2] - at[-2])) / (12 * step)
        np.testing.assert_allclose(predicted, measured, rtol=1e-6, err_msg=name)
        np.testing.assert_allclose(forward, predicted, rtol=1e-10, err_msg=name)


def test_gradients_are_finite_for_misses_grazing_rays_and_degenerate_triangles(dtype):
    mesh = Mesh.merge([plate_over_plane(dtype), Mesh.create(np.zeros((3, 3)), [[0, 1, 2]], dtype=dtype)])
    origins = jnp.asarray([[0, 3, 0.25], [9, 3, 0], [-6, 1, 0.1], [-6, 0, 0], [0, 0, 0], [1, 1, 1]], dtype)
    directions = jnp.asarray([[0, -1, 0], [0, -1, 0], [1, 0, 0], [1, 0, 0], [0, 1, 0], [0, -1, 0]], dtype)

    def total(vertices, origins, directions):
        hit = BruteForceCaster().closest(
            Mesh(vertices, mesh.faces, mesh.face_colors), Rays.create(origins, directions, t_max=50.0)
        )
        return jnp.sum(hit.depth) + jnp.sum(hit.barycentrics**2)

    for gradient in jax.jit(jax.grad(total, argnums=(0, 1, 2)))(mesh.vertices, origins, directions):
        assert np.isfinite(gradient).all()

    @jax.jit
    @jax.grad
    def forced(vertices, face):
        moved = Mesh(vertices, mesh.faces, mesh.face_colors)
        return jnp.sum(intersect(moved, Rays.create(origins, directions), jnp.broadcast_to(face, 6)).depth)

    for face in range(mesh.num_faces):
        assert np.isfinite(forced(mesh.vertices, jnp.int32(face))).all()


def test_rays_refuse_bad_input():
    with pytest.raises(ValueError, match="zero vector"):
        Rays.create([[0.0, 0, 0]], [[0.0, 0, 0]])
    with pytest.raises(ValueError, match="axis of 3"):
        Rays.create([[0.0, 0]], [[0.0, 1]])
    with pytest.raises(ValueError, match="finite"):
        Rays.create([[0.0, 0, np.inf]], [[0.0, 1, 0]])
    with pytest.raises(ValueError, match="t_max must be finite"):
        Rays.create([[0.0, 0, 0]], [[0.0, 1, 0]], t_max=np.inf)


def test_visible_is_the_shadow_of_the_plate(dtype):
    """Exact visibility equals the closed form: the plate's corners projected along the light onto the floor."""
    mesh, light = plate_over_plane(dtype), lights(dtype)["directional"]
    grid = SingleMap().grids(mesh, light, above(dtype), 4)[0]
    spots = jnp.stack(jnp.meshgrid(*[jnp.linspace(-3.9, 3.9, 64, dtype=dtype)] * 2), axis=-1)
    points = jnp.stack([spots[..., 0], jnp.zeros_like(spots[..., 0]), spots[..., 1]], axis=-1)
    normals = jnp.broadcast_to(jnp.asarray([0, 1, 0], dtype), points.shape)
    lit = visible(mesh, grid.space, points, normals)
    shift = light.direction[jnp.asarray([0, 2])] / -light.direction[1]
    inside = jnp.max(jnp.abs(spots - shift), axis=-1)
    margin = 1e-4
    np.testing.assert_array_equal(lit[inside < 1 - margin], False)
    np.testing.assert_array_equal(lit[inside > 1 + margin], True)
    assert not np.any(visible(mesh, grid.space, points, -normals))
