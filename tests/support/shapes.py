"""Small scenes that tests share, so that they share compiled functions too."""

import jax.numpy as jnp
import numpy as np
import trimesh

from shadowjax import Camera, DirectionalLight, Mesh, PointLight, SpotLight, astype


def plate_over_plane(dtype=jnp.float64, height: float = 1.0) -> Mesh:
    """A 2 × 2 plate `height` above an 8 × 8 floor at y = 0; triangles 0 and 1 are the floor."""
    floor = np.array([[-4, 0, -4], [4, 0, -4], [4, 0, 4], [-4, 0, 4]], float)
    plate = np.array([[-1, height, -1], [1, height, -1], [1, height, 1], [-1, height, 1]], float)
    faces = np.array([[0, 2, 1], [0, 3, 2], [4, 6, 5], [4, 7, 6]])
    return Mesh.create(np.concatenate([floor, plate]), faces, dtype=dtype)


def above(dtype=jnp.float64) -> Camera:
    """A camera that sees the plate and its floor from above and in front."""
    return Camera.look_at((0.3, 5.0, 7.0), (0.1, 0.2, 0.0), phi_y=0.45, near=2.0, far=16.0, dtype=dtype)


def lights(dtype=jnp.float64):
    """One light of every kind over the plate."""
    return {
        "directional": DirectionalLight.create((-0.4, -1.0, 0.25), dtype=dtype),
        "spot": SpotLight.create((1.0, 4.0, -0.5), (-0.25, -1.0, 0.125), 0.7, 20.0, dtype=dtype),
        "point": PointLight.create((1.0, 4.0, -0.5), 20.0, dtype=dtype),
    }


def bumpy_sphere(dtype=jnp.float64, subdivisions: int = 2) -> Mesh:
    """A closed star-shaped body about the origin, with no symmetry left that could hide a fault."""
    sphere = trimesh.creation.icosphere(subdivisions)
    rng = np.random.default_rng(7)
    radius = 1 + 0.2 * rng.standard_normal((len(sphere.vertices), 1)).clip(-2, 2)
    return Mesh.create(sphere.vertices * radius * [1.0, 1.3, 0.8], sphere.faces, dtype=dtype)


def random_soup(num_faces: int, seed: int, dtype=jnp.float64) -> Mesh:
    """Triangles without any order, in the unit cube about the origin."""
    rng = np.random.default_rng(seed)
    middle = rng.uniform(-1, 1, (num_faces, 1, 3))
    corners = middle + rng.normal(0, 0.3, (num_faces, 3, 3))
    return Mesh.create(corners.reshape(-1, 3), np.arange(3 * num_faces).reshape(-1, 3), dtype=dtype)


def as_dtype(tree, dtype):
    """A copy of any object in `dtype`."""
    return astype(tree, dtype)
