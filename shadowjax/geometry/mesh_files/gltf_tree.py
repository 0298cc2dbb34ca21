"""The JSON tree of a glTF file with its binary buffers: unpacked, and held against what it declares, before use."""

import base64
import binascii
import json
from typing import Any

import numpy as np

from shadowjax._checks import require
from shadowjax.geometry.mesh_files.places import MAX_BYTES, Place, require_text_size

_MAGIC, _JSON, _BIN = b"glTF", 0x4E4F534A, 0x004E4942
DTYPES = {5120: np.int8, 5121: np.uint8, 5122: np.int16, 5123: np.uint16, 5125: np.uint32, 5126: np.float32}
_LISTS = (
    "accessors", "buffers", "bufferViews", "images", "materials", "meshes", "nodes", "samplers", "scenes", "skins",
    "textures",
)  # fmt: skip
_MAX_OBJECTS = 1_000_000
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}


class Tree:
    """A glTF file in memory.

    Args:
        json: Its tree.
        buffers: Content of every buffer.

    Raises:
        ValueError: If a list at the root of the tree holds something else than objects.
    """

    def __init__(self, json: dict[str, Any], buffers: list[bytes]) -> None:
        self.json, self.buffers = json, buffers
        for name in _LISTS:
            found = json.get(name, [])
            objects = isinstance(found, list) and all(isinstance(one, dict) for one in found)
            require(objects, f"its {name} are not a list of objects")

    def items(self, name: str) -> list[dict[str, Any]]:
        """The objects of a list at the root of the tree; none where it is missing."""
        return self.json.get(name, [])

    def item(self, name: str, index: Any) -> dict[str, Any]:
        """One object of a list at the root of the tree.

        Raises:
            ValueError: If the index points at none.
        """
        found = self.items(name)
        require(
            isinstance(index, int) and 0 <= index < len(found), f"it points at {name}[{index}], of {len(found)} there"
        )
        return found[index]

    def view(self, index: Any) -> tuple[bytes, int | None]:
        """Bytes of a buffer view and its stride.

        Raises:
            ValueError: If the view lies outside its buffer.
        """
        view = self.item("bufferViews", index)
        which, start, length = whole(view, "buffer"), whole(view, "byteOffset", 0), whole(view, "byteLength")
        require(which < len(self.buffers), f"bufferViews[{index}] has no buffer")
        held = len(self.buffers[which])
        require(
            start + length <= held,
            f"bufferViews[{index}] declares bytes {start} to {start + length} of a buffer that holds {held}",
        )
        return self.buffers[which][start : start + length], whole(view, "byteStride", 0) or None

    def shape(self, index: Any) -> tuple[int, int, np.dtype]:
        """Count, width and number type that an accessor declares.

        Raises:
            ValueError: If they make no sense or cannot be held.
        """
        accessor = self.item("accessors", index)
        count, kind, form = whole(accessor, "count"), accessor.get("componentType"), accessor.get("type")
        if kind not in DTYPES or form not in WIDTHS:
            raise ValueError(f"accessors[{index}] has the unknown type {form} of {kind}"[:120])
        dtype, width = np.dtype(DTYPES[kind]), WIDTHS[form]
        size = count * width * dtype.itemsize
        require(
            size <= MAX_BYTES,
            f"accessors[{index}] declares {count:,} elements; at most {MAX_BYTES >> 20} MiB are read",
        )
        return count, width, dtype

    def fits(self, index: Any) -> None:
        """Complain if an accessor declares more elements than its buffer view holds.

        Raises:
            ValueError: Then.
        """
        accessor = self.item("accessors", index)
        count, width, dtype = self.shape(index)
        if "bufferView" not in accessor:
            return
        data, stride = self.view(accessor["bufferView"])
        row = width * dtype.itemsize
        needed = whole(accessor, "byteOffset", 0) + (max(count - 1, 0) * (stride or row) + row if count else 0)
        require(
            needed <= len(data),
            f"accessors[{index}] declares {count:,} elements, {needed:,} bytes; its buffer view holds {len(data):,}",
        )

    def values(self, index: Any) -> np.ndarray:
        """The elements (count, width) of an accessor: sparse values put in, normalised integers as floats.

        Raises:
            ValueError: If it declares more than there is.
        """
        accessor = self.item("accessors", index)
        count, width, dtype = self.shape(index)
        self.fits(index)
        if "bufferView" in accessor:
            found = self._rows(accessor["bufferView"], whole(accessor, "byteOffset", 0), count, width, dtype).copy()
        else:
            found = np.zeros((count, width), dtype)
        sparse = accessor.get("sparse")
        if sparse is not None:
            changed = whole(sparse, "count")
            require(changed <= count, f"accessors[{index}] changes {changed} of {count} elements")
            at, by = sparse["indices"], sparse["values"]
            rows = self._rows(
                at["bufferView"], whole(at, "byteOffset", 0), changed, 1, np.dtype(DTYPES[at["componentType"]])
            )[:, 0]
            require(not changed or int(rows.max()) < count, f"accessors[{index}] changes elements beyond its {count}")
            found[rows] = self._rows(by["bufferView"], whole(by, "byteOffset", 0), changed, width, dtype)
        if accessor.get("normalized") and dtype.kind in "iu":
            # Signed integers have one value below −max, which glTF counts as −1 too.
            return np.maximum(found.astype(np.float32) / np.float32(np.iinfo(dtype).max), np.float32(-1))
        return found

    def _rows(self, view: Any, offset: int, count: int, width: int, dtype: np.dtype) -> np.ndarray:
        data, stride = self.view(view)
        stride = stride or width * dtype.itemsize
        row = width * dtype.itemsize
        require(not count or offset + (count - 1) * stride + row <= len(data), f"bufferViews[{view}] is too short")
        if not count:
            return np.zeros((0, width), dtype)
        raw = np.frombuffer(data, np.uint8, offset=offset)
        # A view of `count` rows `stride` bytes apart, without copying what lies between.
        rows = np.lib.stride_tricks.as_strided(raw, (count, row), (stride, 1), writeable=False)
        return np.ascontiguousarray(rows).view(dtype.newbyteorder("<")).astype(dtype).reshape(count, width)

    def add(self, values: np.ndarray, like: dict[str, Any] | None = None) -> int:
        """Append an array (count, width) as a buffer with its view and accessor; the accessor's index."""
        kinds = {np.dtype(dtype): kind for kind, dtype in DTYPES.items()}
        forms = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4"}
        data = np.ascontiguousarray(values).astype(values.dtype.newbyteorder("<")).tobytes()
        self.buffers.append(data)
        self.json.setdefault("bufferViews", []).append({"buffer": len(self.buffers) - 1, "byteLength": len(data)})
        accessor = {
            "bufferView": len(self.json["bufferViews"]) - 1, "count": len(values), "type": forms[values.shape[1]],
            "componentType": kinds[values.dtype],
        }  # fmt: skip
        bounds = {key: like[key] for key in ("min", "max") if like and key in like}
        self.json["accessors"].append(accessor | bounds)
        return len(self.json["accessors"]) - 1


def whole(holder: Any, name: str, default: int | None = None) -> int:
    """A size that the tree declares: a whole number that is not negative.

    Raises:
        ValueError: If it is something else, or is missing and has no default.
    """
    value = holder.get(name, default)
    if not isinstance(value, int) or isinstance(value, bool) or value < 0:
        raise ValueError(f"{name} must be a whole number from 0 on; got {value!r}"[:120])
    return value


def unpack_tree(data: bytes, place: Place) -> Tree:
    """The tree and buffers of a .glb or .gltf file, which its first bytes distinguish.

    Raises:
        ValueError: If a size that is declared does not fit what is there, or a buffer may not be read.
    """
    binary = None
    text = data
    if data[:4] == _MAGIC:
        text, binary = _chunks(data)
    require_text_size(text, lines=False)
    # Each is an object of Python, many times as large as its text; addresses that hold data have none.
    require(
        text.count(b"{") + text.count(b"[") <= _MAX_OBJECTS and text.count(b",") <= 8 * _MAX_OBJECTS,
        f"its JSON has more than {_MAX_OBJECTS:,} objects; join parts",
    )
    try:
        tree = json.loads(text.decode("utf-8-sig"))
    except RecursionError:
        raise ValueError("its JSON is nested too deep") from None
    except ValueError as error:
        raise ValueError(f"its JSON cannot be read: {error}") from error
    require(isinstance(tree, dict) and isinstance(tree.get("asset"), dict), "it is no glTF: its JSON has no asset")
    version = str(tree["asset"].get("version", ""))
    require(version.split(".")[0] == "2", f"only glTF 2 is read; the file says version {version[:20]!r}")
    result = Tree(tree, [])
    for index, buffer in enumerate(result.items("buffers")):
        declared = whole(buffer, "byteLength")
        if "uri" in buffer:
            content = _from_address(buffer["uri"], place)
        else:
            require(index == 0 and binary is not None, f"buffers[{index}] has no content")
            content = binary or b""
        require(
            declared <= len(content),
            f"buffers[{index}] declares {declared:,} bytes and holds {len(content):,}: cut off",
        )
        result.buffers.append(content)
    return result


def _chunks(data: bytes) -> tuple[bytes, bytes | None]:
    """JSON and binary chunk of a .glb file."""
    require(len(data) >= 20, "it is cut off: a .glb file begins with 20 bytes of sizes")
    # After four bytes of magic: version, length of the file, then length and kind of the first chunk.
    version, length, first, kind = np.frombuffer(data[4:20], "<u4").tolist()
    require(version == 2, f"only glTF 2 is read; the file says version {version}")
    require(length <= len(data), f"it declares {length:,} bytes and holds {len(data):,}: cut off")
    require(kind == _JSON and 20 + first <= len(data), "its first chunk is no whole JSON")
    at, binary = 20 + first, None
    while at + 8 <= length:
        size, kind = np.frombuffer(data[at : at + 8], "<u4").tolist()
        require(at + 8 + size <= len(data), f"a chunk declares {size:,} bytes and the file ends before: cut off")
        if kind == _BIN and binary is None:
            binary = data[at + 8 : at + 8 + size]
        at += 8 + size
    return data[20 : 20 + first], binary


def _from_address(address: Any, place: Place) -> bytes:
    """What a data address holds, or the file of that name."""
    require(isinstance(address, str), "an address is no text")
    if not address.startswith("data:"):
        return place.read(address)
    head, _, payload = address.partition(",")
    require(head.endswith(";base64"), "a data address is not in base64")
    try:
        return base64.b64decode(payload)
    except (binascii.Error, ValueError) as error:
        raise ValueError(f"a data address cannot be decoded: {error}") from error


def image_bytes(tree: Tree, image: dict[str, Any], place: Place) -> bytes:
    """The encoded bytes of an image of the tree."""
    return tree.view(image["bufferView"])[0] if "bufferView" in image else _from_address(image.get("uri"), place)
