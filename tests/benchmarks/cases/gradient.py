"""One gradient step: the derivative of a depth loss with respect to all vertices, beside the loss alone."""

import equinox as eqx
import jax
import jax.numpy as jnp

from shadowjax import Mesh
from shadowjax._types import Array
from shadowjax.rays.ray_grid import RayGrid
from tests.benchmarks.cases.programs import compiled
from tests.benchmarks.cases.receivers import device_mesh
from tests.benchmarks.scenes import view
from tests.benchmarks.session import Session


def run(session: Session) -> None:
    """The loss is the mean squared difference from the depth map of another shape."""
    ours = session.ours[0]
    caster = ours.caster

    def loss(vertices: Array, mesh: Mesh, grid: RayGrid, target: Array) -> Array:
        moved = eqx.tree_at(lambda mesh: mesh.vertices, mesh, vertices)
        return jnp.mean((caster.depth_on_grid(moved, grid) - target) ** 2)

    for size in session.middle_sizes:
        session.say(f"gradient, {size} triangles")
        geometry = session.geometry(size)
        mesh, shown = device_mesh(geometry), view(geometry, "orthographic", session.resolution)
        ours.prepare(geometry)
        ours.move(geometry.moved(1))
        target = ours.cast(shown.grid, False)
        calls, beside = {}, {}
        for name, function in (("loss", loss), ("loss and gradient", jax.value_and_grad(loss))):
            calls[name], beside[name], _ = compiled(function, mesh.vertices, mesh, shown.grid, target)
        session.measure("gradient", geometry, shown, calls, beside)
