"""Reads untrusted mesh files: sizes are bounded before reading, and contents compared with what they declare.

trimesh parses; this package reads what it is given. Before trimesh sees a byte, sizes, counts, names of other files and
required extensions are checked, and what trimesh reads otherwise than the format says is written in a form that it
reads right. Its readers, not its scene graph, are called: placing parts takes one matrix product each here.

Reading happens in the process of the caller. Every size that costs time or memory is bounded first (`places`,
`colors`, `parts`, `gltf_tree`), and the readers used are linear in those sizes; a process of its own would add a start
of Python to every small file, and could not be had everywhere.
"""

import importlib.util
import logging
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path, PurePosixPath

import jax.numpy as jnp
import numpy as np

from shadowjax._checked import checked
from shadowjax._checks import require
from shadowjax._types import DType, default_dtype
from shadowjax.geometry.mesh import DEFAULT_ALBEDO, Mesh
from shadowjax.geometry.mesh_files.gltf import read_gltf
from shadowjax.geometry.mesh_files.obj import read_obj
from shadowjax.geometry.mesh_files.parts import Reading, join
from shadowjax.geometry.mesh_files.places import MAX_BYTES, Archive, Folder, Place, read_regular, unpack
from shadowjax.geometry.mesh_files.simple import read_3mf, read_dae, read_off, read_ply, read_stl

Reader = Callable[[bytes, Place], Reading]

READERS: dict[str, Reader] = {
    ".glb": read_gltf, ".gltf": read_gltf, ".obj": read_obj, ".off": read_off, ".ply": read_ply, ".stl": read_stl,
    ".3mf": read_3mf, ".dae": read_dae,
}  # fmt: skip
# What the reader of an ending needs besides trimesh: the extra `meshes`.
NEEDS = {".3mf": ("lxml", "networkx"), ".dae": ("collada", "lxml")}
ARCHIVE = ".zip"
_NO_TRIANGLES = (".dxf", ".pcd", ".svg", ".xyz")

# Farther from zero than this many extents, a file is moved to its own lower corner: 32 bits would
# lose more than four of their 24 digits.
FAR = 16.0
# Triangles with less of the squared extent are degenerate; casters pass through them.
_NO_AREA = 1e-12


@checked
def load(path: str | Path, dtype: DType | None = None) -> Mesh:
    """Read a mesh file: .glb, .gltf, .obj, .off, .ply, .stl, or a .zip of such; .3mf and .dae with an extra.

    A scene graph is merged into one mesh with the transforms of its nodes. Colours come from the file where it has
    them, else they are a light grey (`DEFAULT_ALBEDO`). A file that lies far from zero, against its size, is moved in
    float64 to the corner of its bounds, and the mesh's `origin` says where that is.

    Args:
        path: File to read. What it names (materials, textures, buffers) must lie in its folder or below.
        dtype: Floating dtype of the result; JAX's default if None.

    Returns:
        The mesh, in the file's own units.

    Raises:
        ValueError: If the file is missing, too large, damaged, requires what is not read, or holds no triangles with
            an area; in one line.

    Warns:
        UserWarning: If something is left out that may change shadows; in one line, too.
    """
    path = Path(path)
    ending = path.suffix.lower()
    try:
        require(path.exists(), f"no such mesh file: {path}")
        require(not path.is_dir(), f"{path} is a folder; give the mesh file inside it")
    except OSError as error:
        raise ValueError(f"no such mesh file: {path}: {error.strerror}") from error
    require(
        ending in READERS or ending == ARCHIVE,
        f"{path} has an ending that no mesh reader knows ({path.suffix or 'none'}"
        f"{', which holds no triangles' if ending in _NO_TRIANGLES else ''}); use one of {_endings()}",
    )
    data = read_regular(path, MAX_BYTES)
    with _heard() as said:
        try:
            reading = _read_archive(data) if ending == ARCHIVE else _read(ending, data, Folder(path.parent))
            vertices, faces, colors = join(reading, DEFAULT_ALBEDO)
            mesh = _mesh(vertices, faces, colors, dtype)
        except MemoryError as error:
            raise ValueError(f"{path} cannot be read as a mesh: it needs more memory than there is") from error
        except Exception as error:  # third-party loaders raise arbitrary exceptions; each means one thing to the user
            reason = f"{error}" if isinstance(error, ValueError) else f"{type(error).__name__}: {error}"
            raise ValueError(_line(f"{path} cannot be read as a mesh: {reason}", said)) from error
    notes = list(dict.fromkeys(reading.notes))
    if notes or said:
        warnings.warn(_line(f"{path}: " + "; ".join(notes), said), stacklevel=2)
    return mesh


def _endings() -> str:
    """The endings that are read, for people; those that need an extra say so unless it is there."""
    ready = sorted([ARCHIVE, *(ending for ending in READERS if not _lacking(ending))])
    more = sorted(ending for ending in READERS if _lacking(ending))
    hint = f"; {' and '.join(more)} need pip install 'shadowjax[meshes]'" if more else ""
    return ", ".join(ready) + hint


def _lacking(ending: str) -> bool:
    return any(importlib.util.find_spec(module) is None for module in NEEDS.get(ending, ()))


def _read(ending: str, data: bytes, place: Place) -> Reading:
    require(not _lacking(ending), f"{ending} files need pip install 'shadowjax[meshes]'")
    return READERS[ending](data, place)


def _read_archive(data: bytes) -> Reading:
    """All mesh files of an archive as one; what they name is looked for in the archive alone."""
    members, whole = unpack(data), Reading([])
    meshes = [
        name for name in members
        if PurePosixPath(name).suffix.lower() in READERS
        and not PurePosixPath(name).name.startswith(".") and "__MACOSX" not in name
    ]  # fmt: skip
    require(len(meshes) > 0, f"the archive holds no mesh file ({_endings()})")
    for name in meshes:
        place = Archive(members, str(PurePosixPath(name).parent))
        one = _read(PurePosixPath(name).suffix.lower(), members[name], place)
        whole.parts += one.parts
        whole.notes += one.notes
    return whole


def _mesh(vertices: np.ndarray, faces: np.ndarray, colors: np.ndarray, dtype: DType | None) -> Mesh:
    """The mesh about its origin, if it has an area and fits the dtype."""
    dtype = jnp.dtype(default_dtype() if dtype is None else dtype)
    lower, upper = vertices.min(axis=0), vertices.max(axis=0)
    extent = float(np.linalg.norm(upper - lower))
    far = float(np.max(np.abs([lower, upper]))) > FAR * extent
    origin = lower if far else np.zeros(3)
    # Lengths of normals hold the fourth power of lengths.
    most = float(jnp.finfo(dtype).max) ** 0.25 / 8
    require(extent <= most, f"it is {extent:.3g} units large; {dtype} numbers can work with {most:.1g}: scale it down")
    local = vertices - origin
    require(extent > 0, "all its triangles lie in one point: none has an area")
    a, b, c = np.moveaxis(local[faces], 1, 0)
    doubled = np.linalg.norm(np.cross(b - a, c - a), axis=-1)
    require(
        bool(np.any(doubled > 2 * _NO_AREA * extent**2)),
        f"none of its {len(faces):,} triangles has an area: it would cast no shadow",
    )
    return Mesh.create(local, faces, colors, dtype, origin)


@contextmanager
def _heard() -> Iterator[list[str]]:
    """What trimesh complains of in its log, which is kept from the terminal; and Python's warnings of its readers."""
    said: list[str] = []
    logger = logging.getLogger("trimesh")
    handler = logging.Handler(logging.WARNING)
    # Collected instead of printed, and said in the one line of the warning or error.
    handler.emit = lambda record: said.append(record.getMessage())
    propagates = logger.propagate
    logger.addHandler(handler)
    logger.propagate = False
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield said
    finally:
        logger.removeHandler(handler)
        logger.propagate = propagates


def _line(message: str, said: list[str]) -> str:
    """One line of bounded length, with what trimesh said."""
    heard = f" (trimesh: {'; '.join(dict.fromkeys(said))[:200]})" if said else ""
    words = " ".join(message.split())
    return (words if len(words) <= 600 else words[:597] + "...") + " ".join(heard.split(" "))
