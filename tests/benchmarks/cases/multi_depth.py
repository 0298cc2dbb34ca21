"""Multi-depth maps: building the planes of a 2-SM from a depth map and reading them with PCF(9, 2)."""

import jax.numpy as jnp

from shadowjax import Mesh, MultiDepth, Neighbourhood
from shadowjax._types import Array
from shadowjax.filters.base import Lookup
from shadowjax.rays.ray_grid import RayGrid
from tests.benchmarks.cases.programs import compiled
from tests.benchmarks.cases.receivers import camera_and_light, device_mesh, visible_points
from tests.benchmarks.session import Session


def run(session: Session) -> None:
    """From a depth map, and from the mesh; as many receivers as texels."""
    ours = session.ours[0]
    caster = ours.caster
    filter_ = MultiDepth(Neighbourhood("max"), 3)

    def read(depth: Array, grid: RayGrid, points: Array) -> Array:
        position, receiver = grid.locate(points)
        bias = jnp.asarray(1e-3, depth.dtype)
        return filter_.visibility(filter_.prepare(depth), Lookup(position, receiver, bias, bias))

    def cast_and_read(mesh: Mesh, grid: RayGrid, points: Array) -> Array:
        return read(caster.depth_on_grid(mesh, grid), grid, points)

    for size in session.middle_sizes:
        session.say(f"multi-depth, {size}")
        geometry = session.geometry(size)
        mesh = device_mesh(geometry)
        seen, lit = camera_and_light(session, geometry)
        ours.prepare(geometry)
        points, _ = visible_points(ours, mesh, seen.grid)
        depth = ours.cast(lit.grid, False)
        calls, beside = {}, {}
        for name, function, source in (
            ("planes, PCF(9, 2)", read, depth),
            ("cast, planes, PCF(9, 2)", cast_and_read, mesh),
        ):
            calls[name], beside[name], _ = compiled(function, source, lit.grid, points)
        session.measure("multi-depth", geometry, seen, calls, beside)
