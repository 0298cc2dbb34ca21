"""Embree as embreex hands it out: one thread walks through the rays, one by one."""

import importlib.metadata
from typing import Any

import numpy as np

from tests.benchmarks.peers.base import Contestant, Segments, as_image
from tests.benchmarks.scenes import Geometry, View


class EmbreexRaw(Contestant):
    """`EmbreeScene.run` without trimesh around it."""

    name = "embreex"
    can_test_segments = True

    def version(self) -> str:
        """Of the wheel."""
        return importlib.metadata.version("embreex")

    def prepare(self, geometry: Geometry) -> None:
        """A scene with one mesh; Embree builds its tree at the first query, so one ray is asked for."""
        self.faces = geometry.faces
        self.move(geometry.vertices)

    def move(self, vertices: np.ndarray) -> None:
        """There is no way to change a mesh: a new scene."""
        from embreex.mesh_construction import TriangleMesh
        from embreex.rtcore_scene import EmbreeScene

        self.scene = EmbreeScene()
        TriangleMesh(self.scene, vertices, self.faces)
        one = np.ones((1, 3), np.float32)
        self.scene.run(one, one)

    def load_view(self, view: View) -> Any:
        """The arrays as they are."""
        return view.rays

    def cast(self, loaded: Any, with_face: bool) -> Any:
        """The distance query, or all that Embree reports of a hit (it has no query for the distance and face alone)."""
        if with_face:
            hit = self.scene.run(*loaded, output=True)
            return hit["tfar"], hit["primID"]
        return self.scene.run(*loaded, query="DISTANCE"), None

    def read(self, result: Any, view: View) -> tuple[np.ndarray, np.ndarray | None]:
        """Misses come as a huge distance."""
        depth, face = result
        depth = as_image(depth, view).astype(np.float64)
        return np.where(depth < 1e36, depth, np.inf), None if face is None else as_image(face, view)

    def load_segments(self, segments: Segments) -> Any:
        """The arrays as they are."""
        return segments.origins, segments.directions, segments.lengths

    def occluded(self, loaded: Any) -> Any:
        """Embree's own occlusion query."""
        origins, directions, lengths = loaded
        return self.scene.run(origins, directions, lengths, query="OCCLUDED")

    def read_occluded(self, result: Any) -> np.ndarray:
        """−1 is free."""
        return np.asarray(result) != -1
