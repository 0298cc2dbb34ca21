"""Every public operation of every caster, transformed in every way, equals the plain call: values and gradients.

The plain call is compiled, but neither batched, branched nor looped. By default the exact shadow test is transformed in
the way that asks most; `--long` transforms every operation in every way.
"""

import itertools
from collections.abc import Callable, Iterable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import lax
from shapes import bumpy_sphere, lights

from shadowjax import Camera, Mesh, Rays, camera_grid, coverage_depth, mesh_edges, shadow_picture
from shadowjax.rays.caster import Caster
from shadowjax.rays.casters import CASTERS, make_caster
from shadowjax.rays.grid.caster import GridCaster
from shadowjax.rays.layers import back_layer, second_layer
from shadowjax.rays.plane_map import Box
from shadowjax.rays.ray_grid import RayGrid

DTYPE = jnp.float32
SIDE = 6
BODY = bumpy_sphere(DTYPE, 1)
MESH = Mesh.merge([BODY, Mesh.create([[-3, -2, -3], [3, -2, -3], [0, -2, 5]], [[0, 2, 1]], dtype=DTYPE)])
EDGES = mesh_edges(MESH, weld=False)
LIGHTS = lights(DTYPE)
CAMERA = Camera.look_at((0.3, 3.0, 4.0), (0.1, -0.5, 0.0), phi_y=0.45, near=1.0, far=16.0, dtype=DTYPE)
# How far the mesh is moved: what is batched.
SHIFTS = jnp.asarray([0.0, 0.07, -0.11], DTYPE)

Operation = Callable[[Caster, Mesh, str], Any]


def grid_of(mesh: Mesh, kind: str) -> RayGrid:
    """Rays of a light over the mesh, through the middle of its plane."""
    bounds = mesh.bounds()
    space = LIGHTS[kind].space(jnp.asarray([0.1, 0.2, 1.0], DTYPE), *bounds)
    half = jnp.full(2, {"directional": 2.0, "spot": 0.5, "point": 1.0}[kind], DTYPE)
    return RayGrid(space, Box(-half, half), space.farthest(*bounds), SIDE, SIDE)


def depth(caster: Caster, mesh: Mesh, kind: str) -> Any:
    return caster.depth_on_grid(mesh, grid_of(mesh, kind))


def closest_on_grid(caster: Caster, mesh: Mesh, kind: str) -> Any:
    grid = grid_of(mesh, kind)
    return caster.closest_on_grid(mesh, grid), caster.faces_on_grid(mesh, grid) if isinstance(
        caster, GridCaster
    ) else ()


def closest(caster: Caster, mesh: Mesh, kind: str) -> Any:
    rays = grid_of(mesh, kind).rays().flattened()
    return caster.closest(mesh, Rays(rays.origins, rays.directions, rays.t_min, rays.t_max))


def layers(caster: Caster, mesh: Mesh, kind: str) -> Any:
    grid = grid_of(mesh, kind)
    return second_layer(caster, mesh, grid, caster.closest_on_grid(mesh, grid)), back_layer(caster, mesh, grid)


def visible(caster: Caster, mesh: Mesh, kind: str) -> Any:
    space = grid_of(mesh, kind).space
    x, z = jnp.meshgrid(*[jnp.linspace(-2.5, 2.5, 12, dtype=DTYPE)] * 2)
    # Just over the ground, which stays: the body's shadow moves across.
    points = jnp.stack([x, jnp.full_like(x, -1.9), z], axis=-1)
    normals = jnp.broadcast_to(jnp.asarray([0.0, 1.0, 0.0], DTYPE), points.shape)
    return caster.visible(mesh, space, points), caster.visible(mesh, space, points, normals)


def coverage(caster: Caster, mesh: Mesh, kind: str) -> Any:
    return coverage_depth(mesh, EDGES, grid_of(mesh, kind), caster)


def picture(caster: Caster, mesh: Mesh, kind: str) -> Any:
    return shadow_picture(mesh, EDGES, LIGHTS[kind], camera_grid(CAMERA, SIDE, SIDE), caster)


OPERATIONS: dict[str, Operation] = {
    operation.__name__: operation for operation in (depth, closest_on_grid, closest, layers, visible, coverage, picture)
}


def moved(shift: Any) -> Mesh:
    """The mesh with its body moved aside; the ground stays."""
    offset = jnp.where(jnp.arange(MESH.num_vertices) < BODY.num_vertices, shift, 0.0)
    return Mesh(MESH.vertices.at[:, 0].add(offset), MESH.faces, MESH.face_colors)


def total(result: Any) -> Any:
    """A sum of all numbers with a derivative."""
    floats = [leaf for leaf in jax.tree.leaves(result) if jnp.issubdtype(leaf.dtype, jnp.floating)]
    return sum((jnp.sum(jnp.sin(leaf)) for leaf in floats), jnp.zeros((), DTYPE))


def branch(function: Callable) -> Callable:
    """In the branch of a choice that is taken, of two."""

    def call(shift: Any) -> Any:
        nothing = jax.tree.map(lambda x: jnp.zeros(x.shape, x.dtype), jax.eval_shape(function, shift))
        return lax.cond(shift > -100, function, lambda _: nothing, shift)

    return call


def looped(function: Callable) -> Callable:
    """In the body of a loop, of two turns."""

    def call(shift: Any) -> Any:
        out = lax.scan(lambda carry, k: (carry, function(carry + k)), shift, jnp.zeros(2, DTYPE))[1]
        return jax.tree.map(lambda x: x[1], out)

    return call


def each(function: Callable) -> Callable:
    """One after the other."""
    compiled = jax.jit(function)
    return lambda shifts: jax.tree.map(lambda *rows: jnp.stack(rows), *(compiled(shift) for shift in shifts))


# Functions of a number → of many.
TRANSFORMATIONS: dict[str, Callable[[Callable], Callable]] = {
    "jit(vmap)": lambda function: jax.jit(jax.vmap(function)),
    "branch": lambda function: each(branch(function)),
    "vmap(jit(branch))": lambda function: jax.vmap(jax.jit(branch(function))),
    "vmap(jit(loop))": lambda function: jax.vmap(jax.jit(looped(function))),
}


def assert_same(found: Any, expected: Any) -> None:
    leaves = list(zip(jax.tree.leaves(found), jax.tree.leaves(expected), strict=True))
    assert leaves
    for one, other in leaves:
        assert one.dtype == other.dtype
        if jnp.issubdtype(one.dtype, jnp.floating):
            # What XLA fuses differs from program to program: a few roundings.
            size = max(float(jnp.max(jnp.abs(other))), 1.0)
            np.testing.assert_allclose(one, other, rtol=0, atol=100 * float(jnp.finfo(DTYPE).eps) * size)
        else:
            np.testing.assert_array_equal(one, other)


def check(operation: str, caster: str, kind: str, names: Iterable[str], with_slope: bool) -> None:
    made = make_caster(caster)

    def value(shift: Any) -> Any:
        return OPERATIONS[operation](made, moved(shift), kind)

    def value_and_slope(shift: Any) -> Any:
        return value(shift), jax.grad(lambda shift: total(value(shift)))(shift)

    function = value_and_slope if with_slope else value
    expected = each(function)(SHIFTS)
    # The shift matters to every result: a transformation that mixed elements of the batch up would be seen.
    assert any(len(np.unique(np.asarray(leaf), axis=0)) == len(SHIFTS) for leaf in jax.tree.leaves(expected))
    for name in names:
        assert_same(TRANSFORMATIONS[name](function)(SHIFTS), expected)


@pytest.mark.parametrize("caster", CASTERS)
def test_shadows_in_a_branch_that_is_batched_equal_the_plain_call(caster):
    check("visible", caster, "directional", ["vmap(jit(branch))"], False)


@pytest.mark.long
@pytest.mark.parametrize("kind", ["directional", "point"])
@pytest.mark.parametrize("operation", OPERATIONS)
@pytest.mark.parametrize("caster", CASTERS)
def test_every_operation_transformed_equals_the_plain_call(caster, operation, kind):
    if operation in ("coverage", "picture"):
        # Their own programs call the others'; edges are followed on a plane.
        if kind == "directional":
            check(operation, caster, kind, ["vmap(jit(branch))", "vmap(jit(loop))"], True)
        return
    check(operation, caster, kind, TRANSFORMATIONS, operation != "visible")


@pytest.mark.parametrize("dtype", [jnp.float32, pytest.param(jnp.float64, marks=pytest.mark.long)], ids=str)
@pytest.mark.parametrize("caster", CASTERS)
def test_of_copies_of_a_triangle_the_lowest_index_wins_whatever_corner_they_begin_with(caster, dtype):
    """Every triangle six times, with its corners in every order; needles too, whose depths round most."""
    rng = np.random.default_rng(5)
    num = 40
    corners = rng.uniform(-1, 1, (num, 1, 3)) + rng.normal(0, 0.5, (num, 3, 3))
    corners[::2, 2] = corners[::2, 0] + 0.6 * (corners[::2, 1] - corners[::2, 0]) + rng.normal(0, 0.05, (num // 2, 3))
    orders = list(itertools.permutations(range(3)))
    copies = np.concatenate([corners[:, order] for order in orders]).reshape(-1, 3)
    mesh = Mesh.create(copies, np.arange(len(copies)).reshape(-1, 3), dtype=dtype)
    for kind in ("directional", "spot"):
        space = lights(dtype)[kind].space(jnp.asarray([0.1, 0.2, 1.0], dtype), *mesh.bounds())
        half = jnp.full(2, 0.8 if kind == "directional" else 0.3, dtype)
        grid = RayGrid(space, Box(-half, half), space.farthest(*mesh.bounds()), 40, 40)
        face = np.asarray(cast_grid(make_caster(caster), mesh, grid).face)
        assert np.sum(face >= 0) > 500
        assert face.max() < num, f"{np.sum(face >= num)} of {np.sum(face >= 0)} hits go to a later copy"


cast_grid = eqx.filter_jit(lambda caster, mesh, grid: caster.closest_on_grid(mesh, grid))
