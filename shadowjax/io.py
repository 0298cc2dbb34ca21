"""The only opener of files besides geometry.mesh.load: whole-file writes that never leave half a file, and TOML."""

import json
import os
import tempfile
import tomllib
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from shadowjax._checks import require

Pixels = Any  # (rows, cols), (rows, cols, 3) or (rows, cols, 4): floats in [0, 1] or uint8


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
    require(not folder.exists() or folder.is_dir(), f"{folder} is a file; give a folder to write into")
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ValueError(f"cannot make the folder {folder}: {_reason(error)}; choose another one") from error
    require(os.access(folder, os.W_OK), f"cannot write into the folder {folder}; choose another one")
    return folder


def write_bytes(path: str | Path, content: bytes) -> Path:
    """Write a whole file in one step: readers see the old content or the new, never a part.

    The bytes go to a temporary name in the same folder, which then takes the file's place.

    Args:
        path: File to make or to replace; its folder is made if missing.
        content: All of it.

    Returns:
        The file.

    Raises:
        ValueError: If the path is a folder, or cannot be written.
    """
    path = Path(path)
    require(not path.is_dir(), f"{path} is a folder; give the name of a file")
    folder = output_folder(path.parent)
    temporary = None
    try:
        with tempfile.NamedTemporaryFile(dir=folder, prefix=f".{path.name}.", delete=False) as stream:
            temporary = Path(stream.name)
            stream.write(content)
        # A temporary file is private; the result gets the mode that a plain new file would have had.
        umask = os.umask(0)
        os.umask(umask)
        temporary.chmod(0o666 & ~umask)
        os.replace(temporary, path)
    except OSError as error:
        raise ValueError(f"cannot write {path}: {_reason(error)}; choose another place") from error
    finally:
        if temporary is not None:
            temporary.unlink(missing_ok=True)
    return path


def write_text(path: str | Path, content: str) -> Path:
    """Write a text file in UTF-8, in one step; see `write_bytes`."""
    return write_bytes(path, content.encode())


def json_text(content: Any) -> str:
    """JSON of plain values; NaN and infinity, which JSON does not know, are an error.

    Raises:
        ValueError: If a number is not finite.
    """
    return json.dumps(content, indent=2, allow_nan=False, ensure_ascii=False) + "\n"


def write_json(path: str | Path, content: Any) -> Path:
    """Write plain values as JSON, in one step; see `write_bytes`."""
    return write_text(path, json_text(content))


def png_bytes(pixels: Pixels) -> bytes:
    """A picture as the bytes of a PNG file; the same pixels always give the same bytes.

    Args:
        pixels: (rows, cols), (rows, cols, 3) or (rows, cols, 4); uint8, or floats in [0, 1] (clipped).

    Raises:
        ValueError: If the shape is no picture or a value is not finite.
    """
    array = np.asarray(pixels)
    require(
        array.size > 0 and (array.ndim == 2 or (array.ndim == 3 and array.shape[-1] in (3, 4))),
        f"a picture has shape (rows, cols), (rows, cols, 3) or (rows, cols, 4); got {array.shape}",
    )
    if array.dtype != np.uint8:
        array = array.astype(np.float64)
        require(bool(np.isfinite(array).all()), "a picture must be finite; some values are NaN or infinite")
        array = np.round(255 * np.clip(array, 0.0, 1.0)).astype(np.uint8)
    stream = BytesIO()
    Image.fromarray(array).save(stream, "PNG", optimize=True)
    return stream.getvalue()


def write_png(path: str | Path, pixels: Pixels) -> Path:
    """Write a picture as PNG, in one step; see `png_bytes` and `write_bytes`.

    Raises:
        ValueError: If the name does not end in .png, or as `png_bytes` and `write_bytes` do.
    """
    require(
        Path(path).suffix.lower() == ".png", f"pictures are written as PNG; give a name that ends in .png, not {path}"
    )
    return write_bytes(path, png_bytes(pixels))


def read_toml(path: str | Path) -> dict[str, Any]:
    """The tables of a TOML file.

    Args:
        path: File to read.

    Raises:
        ValueError: If the file is missing, unreadable or not TOML; the message names the file and the line.
    """
    path = Path(path)
    require(path.exists(), f"no such configuration file: {path}")
    require(path.is_file(), f"{path} is a folder; give a TOML file")
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except tomllib.TOMLDecodeError as error:
        raise ValueError(f"{path} is not valid TOML: {error}") from error
    except (OSError, UnicodeDecodeError) as error:
        raise ValueError(f"cannot read {path}: {_reason(error)}") from error


def read_lines(path: str | Path) -> list[str]:
    """Lines of a text file that may be missing or unreadable: none then."""
    try:
        return Path(path).read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        return []


def _reason(error: Exception) -> str:
    """The system's own short words for an error."""
    return (getattr(error, "strerror", None) or str(error)).lower()
