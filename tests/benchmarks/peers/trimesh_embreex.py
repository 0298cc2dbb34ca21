"""Embree as most Python programs meet it: through trimesh."""

import importlib.metadata
from typing import Any

import numpy as np
import trimesh

from tests.benchmarks.peers.base import Contestant, as_image
from tests.benchmarks.scenes import Geometry, View


class TrimeshEmbreex(Contestant):
    """`RayMeshIntersector.intersects_id`, first hits alone."""

    name = "trimesh + embreex"
    most_rays = 1 << 18

    def version(self) -> str:
        """Of trimesh."""
        return importlib.metadata.version("trimesh")

    def prepare(self, geometry: Geometry) -> None:
        """A mesh and its intersector, which builds its scene at the first query."""
        self.faces = geometry.faces
        self.move(geometry.vertices)

    def move(self, vertices: np.ndarray) -> None:
        """A new mesh."""
        from trimesh.ray.ray_pyembree import RayMeshIntersector

        self.caster = RayMeshIntersector(trimesh.Trimesh(vertices, self.faces, process=False))
        self.caster.intersects_first([[0, 0, 0]], [[0, 0, 1]])

    def load_view(self, view: View) -> Any:
        """The arrays as they are."""
        return view.rays

    def cast(self, loaded: Any, with_face: bool) -> Any:
        """Places and triangles; depth is their distance. It has no cheaper query for a depth."""
        origins, directions = loaded
        places, ray, face = self.caster.intersects_location(origins, directions, multiple_hits=False)
        depth = np.full(len(origins), np.inf, np.float32)
        depth[ray] = np.einsum("ij,ij->i", places - origins[ray], directions[ray])
        faces = np.full(len(origins), -1, np.int32)
        faces[ray] = face
        return depth, faces

    def read(self, result: Any, view: View) -> tuple[np.ndarray, np.ndarray | None]:
        """As cast."""
        return as_image(result[0], view).astype(np.float64), as_image(result[1], view)
