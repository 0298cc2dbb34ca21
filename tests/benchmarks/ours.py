"""The package's own contestants: one for each way to run its caster, by name."""

import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.sharding import NamedSharding, PartitionSpec

import shadowjax
from shadowjax import Mesh
from shadowjax.rays.caster import Caster
from shadowjax.rays.grid.caster import GridCaster
from shadowjax.rays.ray_grid import RayGrid
from shadowjax.rays.sharded import cast_over_bands, depth_over_triangles, visible_over_points
from tests.benchmarks.peers.base import Absent, Contestant
from tests.benchmarks.scenes import Geometry, View


class Shadowjax(Contestant):
    """A caster of the package. Vertices, faces and view are arguments of compiled code: nothing is built beforehand."""

    name = "shadowjax"
    kind = "this package"

    def __init__(
        self,
        make_caster: Callable[[], Caster] = GridCaster,
        name: str = "shadowjax",
        compiler_options: dict[str, Any] | None = None,
    ):
        self.name = name
        caster: Any = make_caster()
        self.caster = caster
        self.casts = {False: caster.depth_on_grid, True: caster.faces_on_grid}
        self.visible: Callable[..., Any] = caster.visible
        self.compiler_options = compiler_options
        self.programs: dict[Any, Any] = {}

    def fit(self, tree: Any) -> Any:
        """Arrays where the work happens."""
        return tree

    def dealt(self, tree: Any) -> Any:
        """Arrays whose first axis may be shared out."""
        return tree

    def version(self) -> str:
        """Of the package and of JAX."""
        device = jax.devices()[0]
        return f"{shadowjax.__version__} (JAX {jax.__version__}, {len(jax.devices())} × {device.device_kind})"

    def prepare(self, geometry: Geometry) -> None:
        """Copy the mesh to the device."""
        mesh = Mesh(
            jnp.asarray(geometry.vertices),
            jnp.asarray(geometry.faces),
            jnp.zeros((geometry.num_faces, 3), jnp.float32),
        )
        self.mesh = jax.block_until_ready(self.fit(mesh))
        self.programs.clear()

    def move(self, vertices: np.ndarray) -> None:
        """Copy new vertices to the device; the cast that follows does all other work, as always."""
        self.mesh = Mesh(self.fit(jnp.asarray(vertices)), self.mesh.faces, self.mesh.face_colors)

    def load_view(self, view: View) -> Any:
        """Light space, box and resolution."""
        return self.fit(view.grid)

    def cast(self, loaded: Any, with_face: bool) -> Any:
        """The compiled cast."""
        program = self.programs.get(_key(loaded, with_face))
        if program is None:
            self.compile(loaded, with_face)
            program = self.programs[_key(loaded, with_face)]
        return jax.block_until_ready(program(self.mesh, loaded))

    def compile(self, loaded: Any, with_face: bool) -> dict[str, Any]:
        """Seconds from nothing to machine code, and megabytes of temporaries that XLA plans for."""
        start = time.perf_counter()
        program = jax.jit(self.casts[with_face]).lower(self.mesh, loaded).compile(self.compiler_options)
        seconds = time.perf_counter() - start
        self.programs[_key(loaded, with_face)] = program
        return {"compile_s": seconds, "temporaries_mb": planned_megabytes(program)}

    def read(self, result: Any, view: View) -> tuple[np.ndarray, np.ndarray | None]:
        """Depth `far` is a miss."""
        depth, face = result if isinstance(result, tuple) else (result, None)
        depth = np.asarray(depth, np.float64)
        missed = depth >= float(view.grid.far) if face is None else np.asarray(face) < 0
        return np.where(missed, np.inf, depth), None if face is None else np.asarray(face)


def planned_megabytes(program: jax.stages.Compiled) -> float | None:
    """What XLA sets aside for temporaries of a compiled program, next to arguments and result, if it tells."""
    plan = program.memory_analysis()
    return None if plan is None else plan.temp_size_in_bytes / 1e6


def _key(grid: RayGrid, with_face: bool) -> tuple:
    """What a program is compiled for, next to the shape of the mesh."""
    return type(grid.space), grid.num_rows, grid.num_cols, with_face


class OnDevices(Shadowjax):
    """The grid caster on several devices: rows or triangles of a map dealt out, whichever are fewer, and points."""

    def __init__(self, num_devices: int, name: str, compiler_options: dict[str, Any] | None = None):
        if len(jax.devices()) < num_devices:
            raise Absent(f"needs {num_devices} devices; run with --devices {num_devices}")
        super().__init__(GridCaster, name, compiler_options)
        devices = jax.devices()[:num_devices]
        self.devices = jax.sharding.Mesh(np.array(devices), ("devices",))
        self.casts = {
            False: partial(_dealt_depth, devices),
            True: partial(cast_over_bands, GridCaster().faces_on_grid, devices=devices),
        }
        self.visible = partial(visible_over_points, GridCaster(), devices=devices)

    def fit(self, tree: Any) -> Any:
        """A copy on every device."""
        return jax.device_put(tree, NamedSharding(self.devices, PartitionSpec()))

    def dealt(self, tree: Any) -> Any:
        """A share on every device."""
        return jax.device_put(tree, NamedSharding(self.devices, PartitionSpec("devices")))


def _dealt_depth(devices: list[Any], mesh: Mesh, grid: RayGrid) -> jax.Array:
    """What the documentation advises: bands of rows, but triangles if there are more of them than rays."""
    if mesh.num_faces > grid.num_rows * grid.num_cols:
        return depth_over_triangles(GridCaster(), mesh, grid, devices)
    return cast_over_bands(GridCaster().depth_on_grid, mesh, grid, devices)


def _wide(num_devices: int, name: str) -> Shadowjax:
    """Several devices, and vectors as wide as the processor has them: XLA uses half of 512 bits unless told."""
    if "avx512f" not in processor_flags():
        raise Absent("needs a processor with AVX-512")
    return OnDevices(num_devices, name, {"xla_cpu_prefer_vector_width": 512})


def processor_flags() -> set[str]:
    """What the processor can do, in Linux's words; empty where nobody says."""
    info = Path("/proc/cpuinfo")
    lines = info.read_text().splitlines() if info.is_file() else []
    return {flag for line in lines if line.startswith("flags") for flag in line.partition(":")[2].split()}


# More ways to run the package join here. The first one listed is what all ratios refer to.
VARIANTS: dict[str, Callable[[], Shadowjax]] = {
    "shadowjax": Shadowjax,
    "shadowjax (2 devices)": lambda: OnDevices(2, "shadowjax (2 devices)"),
    "shadowjax (2 devices, 512 bits)": lambda: _wide(2, "shadowjax (2 devices, 512 bits)"),
}
