"""The scenes of the experiment on gradients, at the size of its quick run: tests share its compiled programs."""

import jax

from experiments.gradient_scenes import Stage, padded, quads, random_triangles, size_of

FREQUENCY, RESOLUTION, FINE = 2, 32, 48
SIZE = size_of(FREQUENCY)
STAGE = Stage.create(RESOLUTION)
SCENES = STAGE.closed_scenes(FREQUENCY)
LIGHT, PLANE, VIEW, RECEIVER, CELL = STAGE.light, STAGE.plane, STAGE.view, STAGE.receiver, STAGE.cell


def gradient(weights, mesh, edges):
    """Of `Stage.summed`, in vertices and position, by reverse mode."""
    return jax.grad(STAGE.summed(weights, mesh, edges), (0, 1))(mesh.vertices, LIGHT.position)


def hidden(seed):
    """Triangles that hide one another."""
    return random_triangles(seed, 12, SIZE)


def squares(corners):
    """A mesh of two triangles for each four corners."""
    return padded(*quads(corners), SIZE)
