"""Casting over many devices and processes: views, bands of rows, points or triangles sharded across devices."""

from collections.abc import Callable, Sequence
from typing import Any, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.sharding import Mesh as DeviceMesh
from jax.sharding import NamedSharding
from jax.sharding import PartitionSpec as Spec

from shadowjax._checked import checked
from shadowjax._checks import concrete, require
from shadowjax._types import Array, Bool, Float, Int, Points
from shadowjax.geometry.light_space import LightSpace
from shadowjax.geometry.mesh import Mesh
from shadowjax.rays.bands import band_from
from shadowjax.rays.caster import Caster
from shadowjax.rays.ray import MISS, Hit, faces_in_order, intersect
from shadowjax.rays.ray_grid import RayGrid

_Tree = TypeVar("_Tree")
AXIS = "devices"
NONE = jnp.iinfo(jnp.int32).max
# Triangles kept together for depth alone: neighbours share vertices and cells; blocks of thousands still divide evenly.
BLOCK = 4096


@checked
def stack_grids(grids: Sequence[RayGrid]) -> RayGrid:
    """One object holding the arrays of several grids along a new first axis: a batch of views.

    Args:
        grids: Grids that differ in numbers only: of one kind of space and plane map, and of one resolution.

    Raises:
        ValueError: If there is none, or their kinds or resolutions differ.
    """
    require(len(grids) > 0, "stack_grids needs at least one grid; got none")
    kinds = {str(jax.tree.structure(grid)) for grid in grids}
    require(len(kinds) == 1, f"grids of one batch must have one kind of space, map and resolution; got {len(kinds)}")
    return jax.tree.map(lambda *leaves: jnp.stack(leaves), *grids)


@checked
def closest_on_grids(caster: Caster, mesh: Mesh, grids: RayGrid, devices: Sequence[Any] | None = None) -> Hit:
    """First hits of a batch of views, sharded across devices; on each device one view after the other.

    The same as casting them one by one. Under `jax.distributed` every process calls this with the same arguments.

    Args:
        caster: Casts one grid; the mesh and the caster's arrays are copied to every device.
        mesh: The triangles of all views.
        grids: A batch from `stack_grids`. Where the devices do not divide it, spare places repeat its first view.
        devices: Devices (`jax.Device`) to use; all of all processes if None.

    Returns:
        Hits of shape (views, rows, cols), differentiable. Where the devices divide the views, each holds its own, and
        nothing is exchanged: `jax.experimental.multihost_utils.process_allgather` collects them. Otherwise every device
        gets a copy of all.
    """
    device_mesh = _device_mesh(devices)
    num_views = grids.far.shape[0]
    padded = _place(_filled(grids, -num_views % device_mesh.size), device_mesh, Spec(AXIS))
    return _cast_views(_place(caster, device_mesh), _place(mesh, device_mesh), padded, device_mesh, num_views)


@checked
def cast_over_bands(
    cast: Callable[[Mesh, RayGrid], _Tree], mesh: Mesh, grid: RayGrid, devices: Sequence[Any] | None = None
) -> _Tree:
    """One grid cut into as many bands of rows as there are devices, each cast on its own; nothing is compared.

    Every device looks at all triangles, and draws those of its band. With more triangles than rays, sharding
    the triangles is faster: `depth_over_triangles`.

    Args:
        cast: What is done with each band: `caster.depth_on_grid`, `caster.closest_on_grid`,
            `GridCaster().faces_on_grid`, or any other function of a mesh and a grid that returns arrays of shape (rows,
            ...). It must not be bound to anything that depends on the rows.
        mesh: All triangles, copied to every device.
        grid: All rays. Where the rows of a band are a power of two, its rays are exactly those of the whole grid.
        devices: All devices of all processes if None.

    Returns:
        What `cast` returns of the whole grid, differentiable. Where the devices divide the rows, each holds its own
        band; otherwise every device gets a copy of all.

    Raises:
        ValueError: If there are more devices than rows.
    """
    device_mesh = _device_mesh(devices)
    require(
        device_mesh.size <= grid.num_rows,
        f"{grid.num_rows} rows cannot be cut into bands for {device_mesh.size} devices; name fewer devices",
    )
    return _cast_bands(*_place((cast, mesh, grid), device_mesh), device_mesh)


@checked
def visible_over_points(
    caster: Caster,
    mesh: Mesh,
    space: LightSpace,
    points: Points,
    normals: Points | None = None,
    devices: Sequence[Any] | None = None,
) -> Bool[Array, "*points"]:
    """The exact shadow test of `Caster.visible`, the points sharded across devices along their first axis.

    Args:
        caster: Tests each share.
        mesh: All triangles, copied to every device.
        space: Rays of one light.
        points: Where light may arrive: a list or an image of world points.
        normals: Their unit normals; None for points that face the light.
        devices: All devices of all processes if None.

    Returns:
        True where a point is lit. Where the devices divide the first axis, each holds its own share; otherwise every
        device gets a copy of all.

    Raises:
        ValueError: If `points` is a single point.
    """
    require(points.ndim > 1, "dealing points to devices needs a list or an image of them; got a single point")
    device_mesh = _device_mesh(devices)
    dealt = _place(_filled((points, normals), -points.shape[0] % device_mesh.size), device_mesh, Spec(AXIS))
    return _test_points(*_place((caster, mesh, space), device_mesh), *dealt, device_mesh, points.shape[0])


@checked
def closest_over_triangles(caster: Caster, mesh: Mesh, grid: RayGrid, devices: Sequence[Any] | None = None) -> Hit:
    """First hits of one grid, its triangles sharded round robin across devices; the nearest hit of all wins.

    Each device casts its share, then depths are compared: of equal depths the lowest triangle index wins, as in every
    caster. The same as casting the whole mesh, but that depths equal to a rounding may be ordered differently.

    Args:
        caster: Casts one grid; it must not be bound to the tree of the whole mesh.
        mesh: All triangles.
        grid: The rays, copied to every device.
        devices: All devices of all processes if None.

    Returns:
        Hits of shape (rows, cols), differentiable, the same on every device.
    """
    device_mesh = _device_mesh(devices)
    arguments = _place((caster, mesh, grid), device_mesh)
    return _cast_shares(*arguments, device_mesh)


@checked
def depth_over_triangles(
    caster: Caster, mesh: Mesh, grid: RayGrid, devices: Sequence[Any] | None = None
) -> Float[jax.Array, "rows cols"]:
    """Depth alone of one grid, its triangles sharded across devices in blocks; of the devices' depth maps the least
    counts.

    The fastest way to one map of many triangles on many devices: a device neither knows nor compares faces.

    Args:
        caster: Gives the depth of one grid; it must not be bound to the tree of the whole mesh.
        mesh: All triangles. Every device holds all vertices.
        grid: The rays, copied to every device.
        devices: All devices of all processes if None.

    Returns:
        Depth of shape (rows, cols), world units, the same on every device. Its gradient is that of the caster; devices
        that found the very same depth share it in equal parts.
    """
    device_mesh = _device_mesh(devices)
    return _least_depth(*_place((caster, mesh, grid), device_mesh), device_mesh)


def _device_mesh(devices: Sequence[Any] | None) -> DeviceMesh:
    chosen = jax.devices() if devices is None else list(devices)
    require(len(chosen) > 0, "casting needs at least one device; got none")
    return DeviceMesh(np.array(chosen), (AXIS,))


def _filled(tree: _Tree, spare: int) -> _Tree:
    """Arrays with spare places added along their first axis, which repeat the first."""
    return jax.tree.map(lambda x: jnp.concatenate([x, jnp.repeat(x[:1], spare, axis=0)]), tree) if spare else tree


def _place(tree: _Tree, device_mesh: DeviceMesh, spec: Spec | None = None) -> _Tree:
    """Lay arrays out over the devices, of other processes too; arrays that are being traced stay."""
    sharding = NamedSharding(device_mesh, Spec() if spec is None else spec)

    def place(leaf: Any) -> Any:
        if not eqx.is_array(leaf) or concrete(leaf) is None:
            return leaf
        host = np.asarray(leaf)
        return jax.make_array_from_callback(host.shape, sharding, lambda index: host[index])

    return jax.tree.map(place, tree)


@eqx.filter_jit
def _cast_views(caster: Caster, mesh: Mesh, grids: RayGrid, device_mesh: DeviceMesh, num_views: int) -> Hit:
    arrays, rest = eqx.partition(lax.stop_gradient(caster), eqx.is_array)

    def faces(arrays: Any, mesh: Mesh, grids: RayGrid) -> Int[jax.Array, "views rows cols"]:
        local = eqx.combine(arrays, rest)
        return lax.map(lambda grid: local.closest_on_grid(mesh, grid).face, grids)

    chosen = jax.shard_map(
        faces, mesh=device_mesh, in_specs=(Spec(), Spec(), Spec(AXIS)), out_specs=Spec(AXIS), check_vma=False
    )(arrays, lax.stop_gradient(mesh), lax.stop_gradient(grids))
    # Casters choose; one function differentiates.
    hits = jax.vmap(lambda grid, face: intersect(mesh, grid.rays(), face))(grids, chosen)
    if num_views == grids.far.shape[0]:
        return hits
    # What is left after the spare views no longer divides evenly: say where it lies, or every compiler may choose.
    everywhere = NamedSharding(device_mesh, Spec())
    return jax.tree.map(lambda x: lax.with_sharding_constraint(x[:num_views], everywhere), hits)


@eqx.filter_jit
def _cast_bands(cast: Callable, mesh: Mesh, grid: RayGrid, device_mesh: DeviceMesh) -> Any:
    arrays, rest = eqx.partition(cast, eqx.is_array)
    num = device_mesh.size
    rows = -(-grid.num_rows // num)

    def one(arrays: Any, mesh: Mesh, grid: RayGrid) -> Any:
        # The last bands start early rather than beyond the end; their first rows are then those of others, too.
        first = jnp.minimum(lax.axis_index(AXIS).astype(jnp.int32) * rows, grid.num_rows - rows)
        return eqx.combine(arrays, rest)(mesh, band_from(grid, first, rows))

    found = jax.shard_map(
        one, mesh=device_mesh, in_specs=(Spec(), Spec(), Spec()), out_specs=Spec(AXIS), check_vma=False
    )(arrays, mesh, grid)
    if rows * num == grid.num_rows:
        return found
    row = np.arange(grid.num_rows)
    device = row // rows
    # Where each row lies in the bands, one after the other.
    index = device * rows + row - np.minimum(device * rows, grid.num_rows - rows)
    everywhere = NamedSharding(device_mesh, Spec())
    return jax.tree.map(lambda x: lax.with_sharding_constraint(x[index], everywhere), found)


@eqx.filter_jit
def _test_points(
    caster: Caster,
    mesh: Mesh,
    space: LightSpace,
    points: Points,
    normals: Points | None,
    device_mesh: DeviceMesh,
    num_points: int,
) -> Bool[Array, "*points"]:
    arrays, rest = eqx.partition(lax.stop_gradient(caster), eqx.is_array)

    def one(arrays: Any, mesh: Mesh, space: LightSpace, points: Points, normals: Points | None) -> Any:
        return eqx.combine(arrays, rest).visible(mesh, space, points, normals)

    found = jax.shard_map(
        one,
        mesh=device_mesh,
        in_specs=(Spec(), Spec(), Spec(), Spec(AXIS), Spec(AXIS)),
        out_specs=Spec(AXIS),
        check_vma=False,
    )(arrays, *lax.stop_gradient((mesh, space, points, normals)))
    if num_points == found.shape[0]:
        return found
    return lax.with_sharding_constraint(found[:num_points], NamedSharding(device_mesh, Spec()))


@eqx.filter_jit
def _cast_shares(caster: Caster, mesh: Mesh, grid: RayGrid, device_mesh: DeviceMesh) -> Hit:
    arrays, rest = eqx.partition(lax.stop_gradient(caster), eqx.is_array)
    num = device_mesh.size
    spare = -mesh.num_faces % num
    # A triangle with its corners in one place is always missed.
    # In one order on all devices, so that copies of a triangle are equally near.
    ordered = faces_in_order(lax.stop_gradient(mesh))
    dealt = jnp.concatenate([ordered, jnp.zeros((spare, 3), ordered.dtype)]).reshape(-1, num, 3)

    def faces(arrays: Any, vertices: Any, dealt: Any, grid: RayGrid) -> Int[jax.Array, "rows cols"]:
        share = Mesh(vertices, dealt[:, 0], jnp.zeros(dealt[:, 0].shape, vertices.dtype))
        hit = eqx.combine(arrays, rest).closest_on_grid(share, grid)
        depth = jnp.where(hit.is_hit, hit.depth, jnp.inf)
        # Place k of a device's share is triangle k·num + device.
        index = hit.face * num + lax.axis_index(AXIS).astype(jnp.int32)
        winner = hit.is_hit & (depth == lax.pmin(depth, AXIS))
        face = lax.pmin(jnp.where(winner, index, NONE), AXIS)
        return jnp.where(face == NONE, MISS, face)

    chosen = jax.shard_map(
        faces, mesh=device_mesh, in_specs=(Spec(), Spec(), Spec(None, AXIS), Spec()), out_specs=Spec(), check_vma=False
    )(arrays, lax.stop_gradient(mesh.vertices), dealt, lax.stop_gradient(grid))
    return intersect(mesh, grid.rays(), chosen)


@eqx.filter_jit
def _least_depth(caster: Caster, mesh: Mesh, grid: RayGrid, device_mesh: DeviceMesh) -> Float[jax.Array, "rows cols"]:
    arrays, rest = eqx.partition(caster, eqx.is_array)
    num = device_mesh.size
    block = max(1, min(BLOCK, -(-mesh.num_faces // num)))
    spare = -mesh.num_faces % (num * block)
    dealt = jnp.concatenate([mesh.faces, jnp.zeros((spare, 3), mesh.faces.dtype)]).reshape(-1, num, block, 3)

    def depth(arrays: Any, vertices: Any, dealt: Any, grid: RayGrid) -> Float[jax.Array, "1 rows cols"]:
        faces = dealt.reshape(-1, 3)
        share = Mesh(vertices, faces, jnp.zeros(faces.shape, vertices.dtype))
        return eqx.combine(arrays, rest).depth_on_grid(share, grid)[None]

    depths = jax.shard_map(
        depth,
        mesh=device_mesh,
        in_specs=(Spec(), Spec(), Spec(None, AXIS), Spec()),
        out_specs=Spec(AXIS),
        check_vma=False,
    )(arrays, mesh.vertices, dealt, grid)
    return lax.with_sharding_constraint(jnp.min(depths, axis=0), NamedSharding(device_mesh, Spec()))
