"""Atomic file writing, and TOML reading; apart from geometry.mesh_files nothing else opens files."""

import contextlib
import json
import os
import re
import secrets
import stat
import sys
import tomllib
from collections.abc import Iterator, Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any

from shadowjax._checked import checked
from shadowjax._printable import printable_json
from shadowjax._process import unfinished, uninterrupted

Pixels = Any  # (rows, cols), (rows, cols, 3) or (rows, cols, 4): floats in [0, 1] or uint8

_MOST_TOML_BYTES = 2**20
_STANDARD_OUTPUT = 1


@checked
def output_folder(path: str | Path) -> Path:
    """A folder to write into, made with its parents if missing; what it holds already is left alone.

    Args:
        path: Where the folder is or shall be.

    Returns:
        The folder.

    Raises:
        ValueError: If the path is a file, or the folder cannot be made or written to.
    """
    folder = Path(path)
    if os.path.exists(folder) and not os.path.isdir(folder):
        raise ValueError(f"{folder} is a file; give a folder to write into")
    try:
        os.makedirs(folder, exist_ok=True)
    except (OSError, RecursionError) as error:
        raise ValueError(f"cannot make the folder {folder}: {_reason(error)}; choose another one") from error
    if not os.access(folder, os.W_OK | os.X_OK):
        raise ValueError(f"cannot write into the folder {folder}; choose another one")
    return folder


@checked
def check_output(path: str | Path) -> Path:
    """Complain about a file that `write_files` could not write, before the work that makes its content.

    Args:
        path: File to make or to replace; its folder is made if missing.

    Returns:
        The file.

    Raises:
        ValueError: As `write_files` does, as far as it can be known before.
    """
    _place(path)
    return Path(path)


@checked
def is_standard_output(path: str | Path) -> bool:
    """Whether a file is another name of standard output: `-`, `/dev/stdout`, `/dev/fd/1` or a link to one of them."""
    return str(path) == "-" or _descriptor(path) == _STANDARD_OUTPUT


@checked
def write_files(contents: Mapping[str | Path, bytes]) -> None:
    """Write whole files in one step: readers see the old contents or the new ones, never a part.

    The bytes go to temporary names in the same folders, which then take the files' places; if one cannot be written,
    none is. A file that exists keeps its mode and its owner, and a link stays a link: what it leads to is written.
    Where a file has several names (hard links), the given one gets the new content and the others keep the old. Where
    the folder takes no new names, or the owner could not be kept, the file itself is written over. Devices, pipes and
    names of open files such as `/dev/stdout` are written to as they are.

    Args:
        contents: Files to make or to replace, each with all of its content; missing folders are made.

    Raises:
        ValueError: If a path is a folder, a disk or a socket, or cannot be written.
    """
    places = [(_place(path), content) for path, content in contents.items()]
    with ExitStack() as stack:
        drafts = [
            (_draft(stack, place, content), place, content) for place, content in places if not place.takes_stream
        ]
        with uninterrupted():
            for draft, place, content in drafts:
                with _complaints(place.path):
                    if draft is None:
                        _write_over(place.target, content)
                    else:
                        os.replace(draft, place.target)
    for place, content in places:
        if place.takes_stream:
            with _complaints(place.path):
                _pour(place, content)


@checked
def write_bytes(path: str | Path, content: bytes) -> Path:
    """Write one file, and return it; see `write_files`."""
    write_files({path: content})
    return Path(path)


@dataclass(frozen=True)
class _Place:
    """Where the content of a file goes.

    Args:
        path: As it was given.
        target: The file behind all links, absolute.
        old: What is there, if anything.
        descriptor: Of an open file, where the name stands for one.
    """

    path: str | Path
    target: str
    old: os.stat_result | None
    descriptor: int | None = None

    @property
    def takes_stream(self) -> bool:
        return self.descriptor is not None or (self.old is not None and not stat.S_ISREG(self.old.st_mode))


def _place(path: str | Path) -> _Place:
    """Where a path leads to, once it is known to be writable."""
    descriptor = _descriptor(path)
    if descriptor is not None:
        return _Place(path, str(path), None, descriptor)
    with _complaints(path):
        target = os.path.realpath(path)
        try:
            old = os.stat(target)
        except (FileNotFoundError, NotADirectoryError):
            output_folder(os.path.dirname(target))
            return _Place(path, target, None)
    if stat.S_ISDIR(old.st_mode):
        raise ValueError(f"{path} is a folder; give the name of a file")
    if stat.S_ISBLK(old.st_mode) or stat.S_ISSOCK(old.st_mode):
        raise ValueError(f"{path} is a disk or a socket; give the name of a file")
    if not os.access(target, os.W_OK):
        raise ValueError(f"{path} is read-only; choose another name, or make it writable")
    return _Place(path, target, old)


def _descriptor(path: str | Path) -> int | None:
    """Number of the open file that a name stands for, as `/dev/stdout` does; None for other names."""
    place = os.path.abspath(path)
    for _ in range(40):  # as many links as the system follows
        if place in ("/dev/stdout", "/dev/stderr"):
            return _STANDARD_OUTPUT if place.endswith("out") else 2
        found = re.fullmatch(rf"(?:/dev/fd|/proc/(?:self|{os.getpid()})/fd)/(\d{{1,9}})", place)
        if found:
            return int(found[1])
        folder = os.path.realpath(os.path.dirname(place))
        try:
            place = os.path.normpath(os.path.join(folder, os.readlink(place)))
        except (OSError, ValueError):
            return None
    return None


def _draft(stack: ExitStack, place: _Place, content: bytes) -> str | None:
    """A file next to the target that can take its place; None where the target itself must be written over."""
    draft = os.path.join(os.path.dirname(place.target), f".shadowjax-{secrets.token_hex(8)}")
    stack.enter_context(unfinished(draft))
    flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | getattr(os, "O_BINARY", 0)
    with _complaints(place.path):
        try:
            # A new file gets the mode of any new file; what replaces another is private until it has that one's mode.
            descriptor = os.open(draft, flags, 0o666 if place.old is None else 0o600)
        except PermissionError:
            if place.old is None:
                raise
            return None
        with open(descriptor, "wb") as stream:
            stream.write(content)
        return draft if place.old is None or _takes_after(draft, place.old) else None


def _takes_after(draft: str, old: os.stat_result) -> bool:
    """Give a file the owner and the mode of another; whether it could be done."""
    if os.name == "posix":
        new = os.stat(draft)
        if (new.st_uid, new.st_gid) != (old.st_uid, old.st_gid):
            try:
                os.chown(draft, old.st_uid, old.st_gid)
            except PermissionError:
                return False
    os.chmod(draft, stat.S_IMODE(old.st_mode))
    return True


def _write_over(target: str, content: bytes) -> None:
    """Replace the content of a file in place; where the disk is too full for it, the old one stays."""
    with open(os.open(target, os.O_WRONLY | getattr(os, "O_BINARY", 0)), "wb", buffering=0) as stream:
        size = os.fstat(stream.fileno()).st_size
        if len(content) > size and hasattr(os, "posix_fallocate"):
            try:
                os.posix_fallocate(stream.fileno(), 0, len(content))
            except OSError:
                stream.truncate(size)
                raise
        _write_all(stream.fileno(), content)
        stream.truncate(len(content))


def _pour(place: _Place, content: bytes) -> None:
    """Write to a device, a pipe or an open file."""
    if place.descriptor is not None:
        for stream in (sys.stdout, sys.stderr):
            if stream is not None:
                stream.flush()
        _write_all(place.descriptor, content)
        return
    descriptor = os.open(place.target, os.O_WRONLY)
    try:
        _write_all(descriptor, content)
    finally:
        os.close(descriptor)


def _write_all(descriptor: int, content: bytes) -> None:
    left = memoryview(content)
    while left:
        left = left[os.write(descriptor, left) :]


@contextlib.contextmanager
def _complaints(path: str | Path) -> Iterator[None]:
    """Errors of the system as complaints about a file; that a reader has gone is none."""
    try:
        yield
    except BrokenPipeError:
        raise
    except OSError as error:
        raise ValueError(f"cannot write {path}: {_reason(error)}; choose another place") from error


@checked
def write_text(path: str | Path, content: str) -> Path:
    """Write a text file in UTF-8, in one step; see `write_files`."""
    return write_bytes(path, content.encode())


@checked
def json_text(content: Any, ascii_only: bool = False) -> str:
    """JSON of plain values; NaN and infinity, which JSON does not know, are an error.

    Signs stand as they are, except those that a screen does not show, such as control characters: they are escaped.

    Args:
        content: Dictionaries, lists, strings, numbers, booleans and None.
        ascii_only: Whether all signs outside ASCII are escaped too.

    Raises:
        ValueError: If a number is not finite.
    """
    return printable_json(json.dumps(content, indent=2, allow_nan=False, ensure_ascii=ascii_only) + "\n")


@checked
def write_json(path: str | Path, content: Any) -> Path:
    """Write plain values as JSON, in one step; see `write_files`."""
    return write_text(path, json_text(content))


@checked
def png_bytes(pixels: Pixels) -> bytes:
    """A picture as the bytes of a PNG file; the same pixels always give the same bytes.

    Args:
        pixels: (rows, cols), (rows, cols, 3) or (rows, cols, 4); uint8, or floats in [0, 1] (clipped).

    Raises:
        ValueError: If the shape is no picture or a value is not finite.
    """
    import numpy as np
    from PIL import Image

    array = np.asarray(pixels)
    if array.size == 0 or not (array.ndim == 2 or (array.ndim == 3 and array.shape[-1] in (3, 4))):
        raise ValueError(f"a picture has shape (rows, cols), (rows, cols, 3) or (rows, cols, 4); got {array.shape}")
    if array.dtype != np.uint8:
        array = array.astype(np.float64)
        if not np.isfinite(array).all():
            raise ValueError("a picture must be finite; some values are NaN or infinite")
        array = np.round(255 * np.clip(array, 0.0, 1.0)).astype(np.uint8)
    stream = BytesIO()
    Image.fromarray(array).save(stream, "PNG", optimize=True)
    return stream.getvalue()


@checked
def write_png(path: str | Path, pixels: Pixels) -> Path:
    """Write a picture as PNG, in one step; see `png_bytes` and `write_files`.

    Raises:
        ValueError: If the name does not end in .png, or as `png_bytes` and `write_files` do.
    """
    if Path(path).suffix.lower() != ".png":
        raise ValueError(f"pictures are written as PNG; give a name that ends in .png, not {path}")
    return write_bytes(path, png_bytes(pixels))


@checked
def read_toml(path: str | Path) -> dict[str, Any]:
    """The tables of a TOML file.

    Args:
        path: File to read.

    Raises:
        ValueError: If the file is missing, unreadable or not TOML; the message names the file and the line.
    """
    try:
        if not stat.S_ISREG(os.stat(path).st_mode):
            raise ValueError(f"{path} is no regular file; give a TOML file")
        with open(path, "rb") as stream:
            content = stream.read(_MOST_TOML_BYTES + 1)
        if len(content) > _MOST_TOML_BYTES:
            raise ValueError(f"{path} is larger than {_MOST_TOML_BYTES} bytes; a configuration is a few lines")
        return tomllib.loads(content.decode())
    except FileNotFoundError as error:
        raise ValueError(f"no such configuration file: {path}") from error
    except tomllib.TOMLDecodeError as error:
        raise ValueError(f"{path} is not valid TOML: {error}") from error
    except (OSError, UnicodeDecodeError, RecursionError) as error:
        raise ValueError(f"cannot read {path}: {_reason(error)}") from error


@checked
def read_lines(path: str | Path) -> list[str]:
    """Lines of a text file that may be missing or unreadable: none then."""
    try:
        return Path(path).read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        return []


def _reason(error: Exception) -> str:
    """The system's own short words for an error."""
    return (getattr(error, "strerror", None) or str(error)).lower()
