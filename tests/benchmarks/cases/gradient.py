"""One gradient step: the derivative of a depth loss with respect to all vertices, next to the loss alone."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from shadowjax import Mesh
from shadowjax._types import Array
from shadowjax.rays.ray_grid import RayGrid
from tests.benchmarks.cases.programs import compiled
from tests.benchmarks.cases.receivers import device_mesh
from tests.benchmarks.scenes import view
from tests.benchmarks.session import Session


def run(session: Session) -> None:
    """The loss is the mean squared difference from the depth map of another shape.

    Peers that differentiate keep the tree that they have. Their gradient is compared with ours.
    """
    ours = session.ours[0]
    caster = ours.caster

    def loss(vertices: Array, mesh: Mesh, grid: RayGrid, target: Array) -> Array:
        moved = eqx.tree_at(lambda mesh: mesh.vertices, mesh, vertices)
        return jnp.mean((caster.depth_on_grid(moved, grid) - target) ** 2)

    for size in session.middle_sizes:
        session.say(f"gradient, {size}")
        geometry = session.geometry(size)
        mesh, shown = device_mesh(geometry), view(geometry, "orthographic", session.resolution)
        ours.prepare(geometry)
        ours.move(geometry.moved(1))
        target = ours.cast(shown.grid, False)
        calls, beside = {}, {}
        for name, function in (("loss", loss), ("loss and gradient", jax.value_and_grad(loss))):
            calls[name], beside[name], result = compiled(function, mesh.vertices, mesh, shown.grid, target)
        gradient = np.asarray(result[1])
        for peer in (peer for peer in session.peers if peer.can_differentiate):
            peer.prepare(geometry)
            held = peer.load_view(shown), peer.load_target(np.asarray(target))
            theirs = np.asarray(peer.loss_and_gradient(*held)[1]).reshape(gradient.shape)
            name = f"{peer.name}, gradient"
            beside[name] = {"gradient_median_difference_percent": _difference(theirs, gradient)}
            calls[name] = lambda step, peer=peer, held=held: peer.loss_and_gradient(*held)
        session.measure("gradient", geometry, shown, calls, beside)


def _difference(theirs: np.ndarray, ours: np.ndarray) -> float:
    """Median over the vertices that matter of the relative difference of two derivatives, per cent.

    Not a norm of all: the derivative of the depth of a triangle seen nearly edge-on has no bound, and one such triangle
    that one program hits and another does not would outweigh all others.
    """
    size = np.maximum(np.linalg.norm(theirs, axis=1), np.linalg.norm(ours, axis=1))
    matters = size > 0
    return float(100 * np.median(np.linalg.norm(theirs - ours, axis=1)[matters] / size[matters]))
