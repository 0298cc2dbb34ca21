"""Open3D's ray-casting scene: Embree on all cores."""

from typing import Any

import numpy as np

from tests.benchmarks.peers.base import Contestant, Segments, as_image
from tests.benchmarks.scenes import Geometry, View


class Open3DScene(Contestant):
    """`open3d.t.geometry.RaycastingScene` with its automatic number of threads."""

    name = "Open3D"
    can_test_segments = True

    def version(self) -> str:
        """Of Open3D."""
        import open3d

        return open3d.__version__

    def prepare(self, geometry: Geometry) -> None:
        """A scene with one mesh; the tree is built at the first query, so one ray is asked for."""
        self.faces = geometry.faces.astype(np.uint32)
        self.move(geometry.vertices)

    def move(self, vertices: np.ndarray) -> None:
        """A scene cannot change: a new one."""
        import open3d

        self.tensor = open3d.core.Tensor.from_numpy
        self.scene = open3d.t.geometry.RaycastingScene()
        self.scene.add_triangles(self.tensor(vertices), self.tensor(self.faces))
        self.scene.cast_rays(self.tensor(np.ones((1, 6), np.float32)))

    def load_view(self, view: View) -> Any:
        """Origin and direction of a ray side by side, as an image."""
        rays = np.concatenate(view.rays, axis=1)
        return self.tensor(rays.reshape(view.grid.num_rows, view.grid.num_cols, 6))

    def cast(self, loaded: Any, with_face: bool) -> Any:
        """Everything about a hit: there is no cheaper query."""
        return self.scene.cast_rays(loaded)

    def read(self, result: Any, view: View) -> tuple[np.ndarray, np.ndarray | None]:
        """Unsigned ids of misses wrap to −1."""
        depth, face = result["t_hit"].numpy(), result["primitive_ids"].numpy().astype(np.int32)
        return as_image(depth, view).astype(np.float64), as_image(face, view)

    def load_segments(self, segments: Segments) -> Any:
        """`test_occlusions` takes one length for all rays, so their directions carry each one's own."""
        scaled = segments.directions * segments.lengths[:, None]
        return self.tensor(np.concatenate([segments.origins, scaled], axis=1))

    def occluded(self, loaded: Any) -> Any:
        """Anything up to one length of the direction."""
        return self.scene.test_occlusions(loaded, tnear=0.0, tfar=1.0)

    def read_occluded(self, result: Any) -> np.ndarray:
        """As cast."""
        return result.numpy()
