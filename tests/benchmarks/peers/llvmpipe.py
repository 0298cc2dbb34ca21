"""An OpenGL rasteriser in software: Mesa's llvmpipe through EGL, without a window."""

import os
from typing import Any

import numpy as np

from shadowjax.geometry.light_space import DirectionalSpace
from tests.benchmarks.peers.base import Absent, Contestant
from tests.benchmarks.scenes import Geometry, View, along

VERTEX = """
#version 330
uniform mat4 clip_from_world;
in vec3 position;
void main() { gl_Position = clip_from_world * vec4(position, 1.0); }
"""
FACE = """
#version 330
out int face;
void main() { face = gl_PrimitiveID; }
"""
NOTHING = """
#version 330
void main() {}
"""


class Llvmpipe(Contestant):
    """A depth-only pass into a 32-bit depth buffer; with faces, an integer colour buffer next to it.

    A call ends with `glFinish`; reading the picture back is another contestant.
    """

    name = "llvmpipe"
    kind = "rasteriser"
    reads_back = False

    def __init__(self):
        os.environ.setdefault("LIBGL_ALWAYS_SOFTWARE", "1")
        import moderngl

        create: Any = moderngl.create_context
        try:
            self.gl = create(standalone=True, backend="egl", require=330)
        except Exception as error:  # whatever the loader of EGL raises, there is no rasteriser
            raise Absent(f"no EGL context (Debian: apt-get install libegl1 libgl1-mesa-dri): {error}") from error
        if "llvmpipe" not in self.gl.info["GL_RENDERER"]:
            raise Absent(f"EGL gives {self.gl.info['GL_RENDERER']}, not llvmpipe; set LIBGL_ALWAYS_SOFTWARE=1")
        self.gl.enable_only(moderngl.DEPTH_TEST)
        self.programs: dict[bool, Any] = {
            False: self.gl.program(vertex_shader=VERTEX, fragment_shader=NOTHING),
            True: self.gl.program(vertex_shader=VERTEX, fragment_shader=FACE),
        }
        self.targets: dict[Any, Any] = {}
        self.arrays: dict[bool, Any] = {}
        self.vertices: Any = None

    def version(self) -> str:
        """Renderer and Mesa."""
        return f"{self.gl.info['GL_RENDERER']}, {self.gl.info['GL_VERSION'].split(') ')[-1]}"

    def prepare(self, geometry: Geometry) -> None:
        """Buffers in the rasteriser's memory."""
        self._drop_buffers()
        self.vertices = self.gl.buffer(geometry.vertices.tobytes())
        self.indices = self.gl.buffer(geometry.faces.tobytes())
        self.arrays = {
            with_face: self.gl.vertex_array(program, [(self.vertices, "3f", "position")], self.indices)
            for with_face, program in self.programs.items()
        }
        self.gl.finish()

    def move(self, vertices: np.ndarray) -> None:
        """New contents of the buffer."""
        self.vertices.write(vertices)

    def load_view(self, view: View) -> Any:
        """The matrix."""
        return view.grid.num_cols, view.grid.num_rows, clip_from_world(view).T.astype(np.float32).tobytes()

    def cast(self, loaded: Any, with_face: bool) -> Any:
        """Clear, draw, finish; and read back where that is asked for."""
        width, height, matrix = loaded
        target = self._target(width, height, with_face)
        self.programs[with_face]["clip_from_world"].write(matrix)
        target.use()
        target.clear(depth=1.0)
        self.arrays[with_face].render()
        if not self.reads_back:
            self.gl.finish()
            return target, with_face
        return self._pixels(target, with_face)

    def _pixels(self, target: Any, with_face: bool) -> tuple[np.ndarray, np.ndarray | None]:
        shape = (target.height, target.width)
        depth = np.empty(shape, np.float32)
        target.read_into(depth, attachment=-1, dtype="f4")
        if not with_face:
            return depth, None
        face = np.empty(shape, np.int32)
        target.read_into(face, components=1, attachment=0, dtype="i4")
        return depth, face

    def read(self, result: Any, view: View) -> tuple[np.ndarray, np.ndarray | None]:
        """Window depth turned into distance along the ray, in double precision."""
        depth, face = result if self.reads_back else self._pixels(*result)
        miss, window = depth >= 1.0, depth.astype(np.float64)
        if isinstance(view.grid.space, DirectionalSpace):
            distance = view.near + window * (view.far - view.near)
        else:
            along_axis = view.near * view.far / (view.far - window * (view.far - view.near))
            plane = np.asarray(view.grid.plane_map.inverse(view.grid.centres()), np.float64)
            distance = along_axis * np.sqrt(1 + np.sum(plane**2, axis=-1))
        face = None if face is None else np.where(miss, -1, face)
        return np.where(miss, np.inf, distance), face

    def _target(self, width: int, height: int, with_face: bool) -> Any:
        key = width, height, with_face
        if key not in self.targets:
            depth = self.gl.depth_texture((width, height))
            color = [self.gl.texture((width, height), 1, dtype="i4")] if with_face else []
            self.targets[key] = self.gl.framebuffer(color, depth)
        return self.targets[key]

    def _drop_buffers(self) -> None:
        for array in self.arrays.values():
            array.release()
        if self.vertices is not None:
            self.vertices.release()
            self.indices.release()


class LlvmpipeReadback(Llvmpipe):
    """The same, with the picture copied into an array of the caller."""

    name = "llvmpipe + read-back"
    reads_back = True


def clip_from_world(view: View) -> np.ndarray:
    """The matrix that puts cell (row, column) of a grid at the same pixel: window row 0 is the grid's row 0."""
    frame, origin = along(view.grid)
    box: Any = view.grid.plane_map
    lower, upper = (np.asarray(x, np.float64) for x in (box.lower, box.upper))
    scale, shift = 2 / (upper - lower), -(upper + lower) / (upper - lower)
    near, far = view.near, view.far
    clip = np.zeros((4, 4))
    clip[0, 0], clip[1, 1] = scale
    if isinstance(view.grid.space, DirectionalSpace):
        clip[:2, 3] = shift
        clip[2, 2:] = 2 / (far - near), -(far + near) / (far - near)
        clip[3, 3] = 1
    else:
        clip[:2, 2] = shift
        clip[2, 2:] = (far + near) / (far - near), -2 * far * near / (far - near)
        clip[3, 2] = 1
    camera = np.eye(4)
    camera[:3, :3], camera[:3, 3] = frame, -frame @ origin
    return clip @ camera
