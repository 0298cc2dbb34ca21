"""Where a mesh file and what it names may be read from: regular files of one folder, or one archive, up to a size."""

import os
import stat
import zipfile
from abc import ABC, abstractmethod
from io import BytesIO
from pathlib import Path, PurePosixPath
from urllib.parse import unquote

import numpy as np

from shadowjax._checks import require

# A file that is larger is refused before it is opened: reading costs several times its size in memory.
MAX_BYTES = 256 << 20
MAX_TEXT_BYTES = 128 << 20
MAX_LINE_BYTES = 2 << 20
MAX_LINES = 6_000_000  # readers hold each line of a text as an object or several
_MIB = 1 << 20


class Missing(ValueError):
    """What a mesh file names is not there; readers may do without it."""


class Place(ABC):
    """Answers for the files that a mesh file names, and counts their bytes."""

    def __init__(self) -> None:
        self._bytes = 0

    def read(self, name: str) -> bytes:
        """The whole content of a file next to the mesh file.

        Args:
            name: As the mesh file writes it: a relative path, with slashes of either kind.

        Raises:
            Missing: If there is no such file.
            ValueError: If it is an address, lies outside the folder, is no regular file, or is too large.
        """
        cleaned = unquote(name).strip().replace("\\", "/")
        require("\0" not in cleaned and cleaned not in ("", "."), f"it names a file {name!r}, which is no name")
        head = cleaned.split("/")[0]
        require(
            ":" not in head or len(head) == 2,  # a drive's letter is a path, all else before a colon is a scheme
            f"it names {name!r}: addresses are not followed; put the file next to the mesh and name it so",
        )
        data = self._content(cleaned)
        self._bytes += len(data)
        require(
            self._bytes <= MAX_BYTES,
            f"what it names holds more than {MAX_BYTES // _MIB} MiB together; make the parts smaller",
        )
        return data

    @abstractmethod
    def _content(self, name: str) -> bytes:
        """The content under a cleaned name."""


class Folder(Place):
    """The folder that a mesh file lies in, with the folders below it."""

    def __init__(self, folder: Path) -> None:
        super().__init__()
        self._folder = folder.resolve()

    def _content(self, name: str) -> bytes:
        # Exporters write the paths of the machine they ran on: the file next to the mesh is meant.
        for candidate in (name, PurePosixPath(name).name):
            try:
                path = (self._folder / candidate).resolve()
                inside = path.is_relative_to(self._folder)
                if inside and path.exists():
                    return read_regular(path, MAX_BYTES)
            except (OSError, RuntimeError) as error:  # loops of links, names too long
                raise Missing(f"{name}: {getattr(error, 'strerror', None) or error}") from error
        try:
            outside = not (self._folder / name).resolve().is_relative_to(self._folder)
        except (OSError, RuntimeError):
            outside = True
        require(not outside, f"it names {name!r}, outside its own folder; put the file next to the mesh and name it so")
        raise Missing(f"{name} is missing")


class Archive(Place):
    """Files of a zip archive, unpacked in memory; names are of the archive, so none leads out of it."""

    def __init__(self, members: dict[str, bytes], folder: str = "") -> None:
        super().__init__()
        self._members, self._folder = members, folder

    def _content(self, name: str) -> bytes:
        inside = str(PurePosixPath(self._folder) / name)
        for candidate in (inside, name, str(PurePosixPath(self._folder) / PurePosixPath(name).name)):
            if candidate in self._members:
                return self._members[candidate]
        raise Missing(f"{name} is missing")


def read_regular(path: Path, limit: int) -> bytes:
    """A regular file whole; pipes, devices, sockets and folders are refused without waiting for them.

    Raises:
        ValueError: If it is no regular file, is larger than `limit` bytes, or cannot be read.
    """
    try:
        _require_regular(path, os.stat(path), limit)
        # Should the file be exchanged meanwhile, opening does not wait, and what was opened is looked at again.
        descriptor = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0))
        with os.fdopen(descriptor, "rb") as stream:
            _require_regular(path, os.fstat(descriptor), limit)
            data = stream.read(limit + 1)
    except OSError as error:
        raise ValueError(f"cannot read {path}: {(error.strerror or str(error)).lower()}") from error
    require(len(data) <= limit, _too_large(path.name, len(data), limit))
    return data


def _require_regular(path: Path, status: os.stat_result, limit: int) -> None:
    kinds = {stat.S_IFIFO: "a pipe", stat.S_IFSOCK: "a socket", stat.S_IFDIR: "a folder"}
    kind = kinds.get(stat.S_IFMT(status.st_mode), "a device")
    require(stat.S_ISREG(status.st_mode), f"{path} is {kind}; only regular files are read")
    require(status.st_size <= limit, _too_large(path.name, status.st_size, limit))


def _too_large(name: str, size: int, limit: int) -> str:
    return (
        f"{name} holds {size / _MIB:,.0f} MiB; at most {limit // _MIB} are read. Simplify the mesh, or save it as "
        "GLB or binary PLY"
    )


def require_text_size(data: bytes, lines: bool = True) -> None:
    """Complain about text that would unfold to more objects than memory holds.

    Args:
        data: The text.
        lines: Whether its format has one statement a line; JSON and XML may be one long line.

    Raises:
        ValueError: If it has more than `MAX_TEXT_BYTES`, more than `MAX_LINES`, or a line of `MAX_LINE_BYTES`.
    """
    require(len(data) <= MAX_TEXT_BYTES, _too_large("its text", len(data), MAX_TEXT_BYTES))
    if not lines:
        return
    # Python ends lines at more signs than the formats do.
    count = sum(data.count(end) for end in (b"\n", b"\r", b"\v", b"\f", b"\x1c", b"\x1d", b"\x1e", b"\x85", b"\xa8"))
    require(
        count <= MAX_LINES, f"its text has {count:,} lines; at most {MAX_LINES:,} are read: save it in a binary form"
    )
    signs = np.frombuffer(data, np.uint8)
    ends = np.flatnonzero((signs == 10) | (signs == 13))
    longest = int(np.max(np.diff(ends, prepend=-1, append=len(data))))
    require(longest <= MAX_LINE_BYTES, f"its text has a line of {longest:,} bytes; at most {MAX_LINE_BYTES:,} are read")


def unpack(data: bytes) -> dict[str, bytes]:
    """The files of a zip archive by name, unless they would be larger than `MAX_BYTES` together.

    Raises:
        ValueError: If the archive declares too much, is damaged, or is encrypted.
    """
    try:
        with zipfile.ZipFile(BytesIO(data)) as archive:
            # Reading stops at the declared size, so what is declared bounds what comes.
            total = sum(info.file_size for info in archive.infolist())
            require(total <= MAX_BYTES, _too_large("the archive unpacked", total, MAX_BYTES))
            return {info.filename: archive.read(info) for info in archive.infolist() if not info.is_dir()}
    except (zipfile.BadZipFile, RuntimeError, NotImplementedError, EOFError, OSError) as error:
        raise ValueError(f"the archive cannot be unpacked: {error}") from error
