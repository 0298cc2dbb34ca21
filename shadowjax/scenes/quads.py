"""Meshes of flat quadrilaterals whose corners may be traced: the bodies of the scenes with a known shadow."""

import jax.numpy as jnp
import numpy as np

from shadowjax._checked import checked
from shadowjax._types import Array, Float, Scalar
from shadowjax.geometry.mesh import Mesh


@checked
def quad_mesh(corners: Float[Array, "quads 4 3"], colors: np.ndarray) -> Mesh:
    """Two triangles a quadrilateral, single-sided; a quad's triangles are 2k and 2k + 1.

    Args:
        corners: Corners in order, counter-clockwise seen from the front.
        colors: (quads, 3) linear albedo.
    """
    halves = np.array([[0, 1, 2], [0, 2, 3]])
    faces = (halves + 4 * np.arange(len(corners))[:, None, None]).reshape(-1, 3)
    return Mesh.create(corners.reshape(-1, 3), faces, jnp.asarray(np.repeat(colors, 2, axis=0), corners.dtype))


@checked
def level_quad(
    half_x: Scalar,
    half_z: Scalar,
    height: Scalar,
    turn: float | Scalar = 0.0,
    x: float | Scalar = 0.0,
    z: float | Scalar = 0.0,
) -> Float[Array, "4 3"]:
    """Corners of a level rectangle whose front looks up.

    Args:
        half_x: Half its extent along x before the turn, metres.
        half_z: Half its extent along z before the turn, metres.
        height: Its y, metres.
        turn: Radians about +y through its middle.
        x: Where its middle lies, metres.
        z: Where its middle lies, metres.
    """
    signs = jnp.asarray([[-1, -1], [-1, 1], [1, 1], [1, -1]], height.dtype)
    along_x, along_z = signs[:, 0] * half_x, signs[:, 1] * half_z
    turn = jnp.asarray(turn, height.dtype)
    cosine, sine = jnp.cos(turn), jnp.sin(turn)
    level = jnp.broadcast_to(height, along_x.shape)
    return jnp.stack([x + cosine * along_x + sine * along_z, level, z - sine * along_x + cosine * along_z], axis=-1)
