"""Colours of files as linear albedo: the sRGB curve, textures looked up at the middle of faces, factors and corners."""

import warnings
from dataclasses import dataclass
from io import BytesIO

import numpy as np
from PIL import Image

from shadowjax._checks import require

# Pillow's own limit of what is no decompression bomb, which a user may have moved.
MAX_PIXELS = 1 << 26
_FORMATS = ("PNG", "JPEG", "WEBP", "BMP", "GIF", "TGA", "TIFF")


class Unreadable(ValueError):
    """A texture that cannot be read; its material's plain colour serves."""


def from_srgb(encoded: np.ndarray) -> np.ndarray:
    """Linear values of sRGB-encoded ones, both in [0, 1], by the standard's curve (IEC 61966-2-1)."""
    return np.where(encoded <= 0.04045, encoded / 12.92, ((np.maximum(encoded, 0) + 0.055) / 1.055) ** 2.4)


def channels(values: np.ndarray) -> np.ndarray:
    """Colours (colours, 3 or more) of a file as floats (colours, 3) in [0, 1], still encoded as they were.

    Unsigned integers are shares of their largest value.
    """
    values = np.asarray(values)
    colors = values[:, :3].astype(np.float64)
    if np.issubdtype(values.dtype, np.unsignedinteger):
        colors /= np.iinfo(values.dtype).max
    return np.clip(np.nan_to_num(colors), 0.0, 1.0)


def channels_of_text(values: np.ndarray) -> np.ndarray:
    """As `channels`, for formats that say no range: other numbers that exceed 1 are shares of 255."""
    values = np.asarray(values)
    whole_bytes = values.dtype.kind != "u" and np.nanmax(values[:, :3], initial=0.0) > 1
    return channels(values.astype(np.float64) / 255.0 if whole_bytes else values)


@dataclass(frozen=True)
class Texture:
    """An image with what lies outside it.

    Args:
        image: Opened, not yet decoded.
        name: For people.
        wrap: What repeats along u and v: "repeat", "clamp" or "mirror".
    """

    image: Image.Image
    name: str
    wrap: tuple[str, str] = ("repeat", "repeat")

    def linear(self, coordinates: np.ndarray) -> np.ndarray:
        """Linear colours (points, 3) of the texels that hold texture coordinates (points, 2): u right, v down.

        Raises:
            Unreadable: If the image turns out to be damaged.
        """
        try:
            image = self.image
            if image.mode.startswith(("I", "F")):  # grey of 16 bits or more
                grey = np.asarray(image, np.float64)
                texels = np.repeat((grey / (65535.0 if image.mode.startswith("I") else 1.0))[..., None], 3, axis=-1)
            else:
                texels = np.asarray(image.convert("RGB"))
        except MemoryError:
            raise
        except Exception as error:  # Pillow's decoders raise everything
            raise Unreadable(f"the texture {self.name} cannot be read: {error}") from error
        size = np.array([texels.shape[1], texels.shape[0]])
        places = np.stack([_wrapped(coordinates[:, axis], self.wrap[axis]) for axis in (0, 1)], axis=-1)
        columns, rows = np.minimum((places * size).astype(np.int64), size - 1).T
        found = texels[rows, columns]
        return from_srgb(found / 255.0 if found.dtype == np.uint8 else np.clip(found, 0.0, 1.0))


def _wrapped(coordinate: np.ndarray, wrap: str) -> np.ndarray:
    """Coordinates brought into [0, 1]."""
    coordinate = np.nan_to_num(coordinate.astype(np.float64))
    if wrap == "clamp":
        return np.clip(coordinate, 0.0, 1.0)
    if wrap == "mirror":
        return 1.0 - np.abs(np.mod(coordinate, 2.0) - 1.0)
    return np.mod(coordinate, 1.0)


class Images:
    """Opens the textures of one file and bounds their pixels together."""

    def __init__(self) -> None:
        self._pixels = 0

    def open(self, data: bytes, name: str, wrap: tuple[str, str] = ("repeat", "repeat")) -> Texture:
        """A texture whose header was read and whose size is bearable.

        Raises:
            Unreadable: If it is no image of a known kind.
            ValueError: If it would unpack to too many pixels.
        """
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                warnings.simplefilter("error", Image.DecompressionBombWarning)
                image = Image.open(BytesIO(data), formats=_FORMATS)
        except (Image.DecompressionBombError, Image.DecompressionBombWarning) as error:
            raise ValueError(f"the texture {name} is too large to unpack: {error}; make it smaller") from error
        except Exception as error:  # damaged headers raise everything
            raise Unreadable(f"the texture {name} is no image that is read") from error
        self._pixels += image.width * image.height
        require(
            image.width * image.height <= MAX_PIXELS and self._pixels <= 8 * MAX_PIXELS,
            f"the texture {name} has {image.width} × {image.height} pixels; at most {MAX_PIXELS:,} a texture and "
            f"{8 * MAX_PIXELS:,} together are unpacked: make textures smaller",
        )
        return Texture(image, name, wrap)


@dataclass
class Paint:
    """What colours a part: a linear factor, times a texture, times the colours of corners or faces.

    Args:
        factor: Linear colour (3,) or None for white; a part without factor, texture and colours has no colour at all.
        texture: Looked up at the mean of each face's coordinates.
        coordinates: (vertices, 2), u right, v down.
        corners: Linear colour of every vertex (vertices, 3); a face takes the mean.
        faces: Linear colour of every face (faces, 3).
    """

    factor: np.ndarray | None = None
    texture: Texture | None = None
    coordinates: np.ndarray | None = None
    corners: np.ndarray | None = None
    faces: np.ndarray | None = None

    def albedo(self, faces: np.ndarray, notes: list[str]) -> np.ndarray | None:
        """Linear colours (faces, 3), or None where the file says nothing; `notes` grows by what could not be read."""
        colors = [] if self.factor is None else [np.asarray(self.factor, np.float64)[None, :3]]
        if self.texture is not None and self.coordinates is not None:
            try:
                colors.append(self.texture.linear(np.mean(self.coordinates[faces], axis=1)))
            except Unreadable as problem:
                notes.append(f"{problem}; the plain colour is used")
        if self.corners is not None:
            colors.append(np.mean(self.corners[faces], axis=1))
        if self.faces is not None:
            colors.append(self.faces)
        if not colors:
            return None
        product = np.ones((len(faces), 3))
        for color in colors:
            product = product * color
        return np.clip(np.nan_to_num(product), 0.0, 1.0)
