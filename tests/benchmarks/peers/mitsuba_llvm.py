"""Mitsuba 3: Embree called in packets from code that Dr.Jit compiles with LLVM, on all cores."""

from typing import Any

import numpy as np

from tests.benchmarks.peers.base import Absent, Contestant, Segments, as_image
from tests.benchmarks.scenes import Geometry, View


class MitsubaLLVM(Contestant):
    """The variant `llvm_ad_rgb`, coherent preliminary intersections."""

    name = "Mitsuba LLVM"
    can_test_segments = True
    can_differentiate = True
    variant = "llvm_ad_rgb"
    coherent = True

    def __init__(self):
        import drjit
        import mitsuba

        mitsuba.set_variant(self.variant)
        self.mi, self.dr = mitsuba, drjit
        try:
            drjit.eval(drjit.arange(mitsuba.Float, 4))
        except Exception as error:  # Dr.Jit reports a missing libLLVM only when code is to be made
            raise Absent(f"Dr.Jit finds no LLVM library (Debian: apt-get install libllvm15): {error}") from error

    def version(self) -> str:
        """Of Mitsuba and Dr.Jit, and the variant."""
        return f"{self.mi.__version__} ({self.variant}, Dr.Jit {self.dr.__version__}, {self.dr.thread_count()} threads)"

    def prepare(self, geometry: Geometry) -> None:
        """A scene with one mesh; Embree builds its tree as the scene is made."""
        mesh = self.mi.Mesh("mesh", len(geometry.vertices), len(geometry.faces))
        parts = self.mi.traverse(mesh)
        parts["vertex_positions"] = self.mi.Float(geometry.vertices.ravel())
        parts["faces"] = self.mi.UInt32(geometry.faces.astype(np.uint32).ravel())
        parts.update()
        self.scene = self.mi.load_dict({"type": "scene", "mesh": mesh})
        self.parts = self.mi.traverse(self.scene)
        (self.key,) = (key for key in self.parts.keys() if key.endswith("vertex_positions"))  # noqa: SIM118
        self.dr.sync_thread()

    def move(self, vertices: np.ndarray) -> None:
        """New positions of the same mesh; Mitsuba rebuilds the tree."""
        self.parts[self.key] = self.mi.Float(vertices.ravel())
        self.parts.update()
        self.dr.sync_thread()

    def _rays(self, origins: np.ndarray, directions: np.ndarray) -> Any:
        """Rays as three arrays for each vector."""
        point, vector = (
            kind(*(self.mi.Float(np.ascontiguousarray(column)) for column in values.T))
            for kind, values in ((self.mi.Point3f, origins), (self.mi.Vector3f, directions))
        )
        ray = self.mi.Ray3f(point, vector)
        self.dr.eval(ray)
        self.dr.sync_thread()
        return ray

    def load_view(self, view: View) -> Any:
        """Evaluated arrays in Dr.Jit's memory."""
        return self._rays(*view.rays)

    def cast(self, loaded: Any, with_face: bool) -> Any:
        """Preliminary intersections; only what is asked for is computed and stored."""
        hit = self.scene.ray_intersect_preliminary(loaded, coherent=self.coherent)
        face = hit.prim_index if with_face else None
        self.dr.eval(hit.t) if face is None else self.dr.eval(hit.t, face)
        self.dr.sync_thread()
        return hit.t, face

    def read(self, result: Any, view: View) -> tuple[np.ndarray, np.ndarray | None]:
        """A miss has infinite depth; its index means nothing."""
        depth, face = result
        depth = as_image(depth.numpy(), view).astype(np.float64)
        if face is None:
            return depth, None
        return depth, np.where(np.isfinite(depth), as_image(face.numpy(), view).astype(np.int32), -1)

    def load_segments(self, segments: Segments) -> Any:
        """Rays that end."""
        ray = self._rays(segments.origins, segments.directions)
        ray.maxt = self.mi.Float(segments.lengths)
        self.dr.eval(ray)
        self.dr.sync_thread()
        return ray

    def occluded(self, loaded: Any) -> Any:
        """Mitsuba's shadow test."""
        result = self.scene.ray_test(loaded, coherent=self.coherent)
        self.dr.eval(result)
        self.dr.sync_thread()
        return result

    def read_occluded(self, result: Any) -> np.ndarray:
        """As cast."""
        return result.numpy()

    def load_target(self, depth: np.ndarray) -> Any:
        """Row by row."""
        return self.mi.Float(np.ascontiguousarray(depth, np.float32).ravel())

    def loss_and_gradient(self, loaded: Any, target: Any) -> tuple[Any, Any]:
        """Reverse mode through the intersection; the tree stays as it is."""
        positions = self.parts[self.key]
        if not self.dr.grad_enabled(positions):
            self.dr.enable_grad(positions)
            self.parts.update()
        self.dr.set_grad(positions, 0)
        # The fewest things about a hit that still let its distance be differentiated.
        hit = self.scene.ray_intersect(loaded, int(self.mi.RayFlags.Minimal), self.coherent)
        loss = self.dr.mean(self.dr.square(hit.t - target))
        self.dr.backward(loss)
        gradient = self.dr.grad(positions)
        self.dr.eval(loss, gradient)
        self.dr.sync_thread()
        return loss, gradient


class MitsubaLLVMDefault(MitsubaLLVM):
    """The same without the hint that rays are coherent, which is what a call without options does: no packets."""

    name = "Mitsuba LLVM, no hint"
    coherent = False
    most_rays = 1 << 20
    can_test_segments = False
    can_differentiate = False
