"""Materials of glTF: base colour factors, which are linear, and base colour textures, which are sRGB."""

import math
from typing import Any

import numpy as np

from shadowjax.geometry.mesh_files.colors import Images, Paint, Texture, Unreadable
from shadowjax.geometry.mesh_files.gltf_tree import Tree, image_bytes
from shadowjax.geometry.mesh_files.places import Missing, Place

_WRAPS: dict[Any, str] = {33071: "clamp", 33648: "mirror"}


class Materials:
    """The colours of the materials of one file; each texture is opened once."""

    def __init__(self, tree: Tree, place: Place, notes: list[str]) -> None:
        self._tree, self._place, self._notes = tree, place, notes
        self._images, self._textures = Images(), {}

    def paint(self, index: Any) -> tuple[Paint, np.ndarray, int]:
        """Paint of a material, the (2, 3) transform of its texture coordinates, and their channel.

        A primitive without a material has no colour of its own; a material without a factor is white.
        """
        identity = np.eye(2, 3)
        if index is None:
            return Paint(), identity, 0
        material = self._tree.item("materials", index)
        surface = material.get("pbrMetallicRoughness", {})
        factor, info = surface.get("baseColorFactor"), surface.get("baseColorTexture")
        glossy = material.get("extensions", {}).get("KHR_materials_pbrSpecularGlossiness")
        if glossy is not None:
            factor, info = glossy.get("diffuseFactor"), glossy.get("diffuseTexture")
        paint = Paint(np.clip(np.array((factor or [1.0, 1.0, 1.0])[:3], np.float64), 0.0, 1.0))
        if info is None:
            return paint, identity, 0
        paint.texture = self._texture(info["index"])
        moved = info.get("extensions", {}).get("KHR_texture_transform", {})
        return paint, _transform(moved), moved.get("texCoord", info.get("texCoord", 0))

    def clear_name(self, index: Any) -> str | None:
        """Name of a material that lets light through, wholly or in holes; None if it does not."""
        if index is None:
            return None
        material = self._tree.item("materials", index)
        glass = material.get("extensions", {}).get("KHR_materials_transmission", {}).get("transmissionFactor", 0)
        if material.get("alphaMode", "OPAQUE") == "OPAQUE" and not glass:
            return None
        return str(material.get("name") or f"material {index}")

    def _texture(self, index: Any) -> Texture | None:
        """A texture, opened; None, with a note, where it cannot be."""
        if index not in self._textures:
            self._textures[index] = None
            name = f"number {index}"
            try:
                texture = self._tree.item("textures", index)
                webp = texture.get("extensions", {}).get("EXT_texture_webp", {})
                image = self._tree.item("images", webp.get("source", texture.get("source")))
                name = str(image.get("name") or (image.get("uri") if "bufferView" not in image else None) or name)
                sampler = self._tree.item("samplers", texture["sampler"]) if "sampler" in texture else {}
                wrap = (_WRAPS.get(sampler.get("wrapS"), "repeat"), _WRAPS.get(sampler.get("wrapT"), "repeat"))
                data = image_bytes(self._tree, image, self._place)
                self._textures[index] = self._images.open(data, name[:60], wrap)
            except (Missing, Unreadable) as problem:
                self._notes.append(f"{problem}; the plain colour is used")
        return self._textures[index]


def _transform(moved: dict[str, Any]) -> np.ndarray:
    """(2, 3) matrix of KHR_texture_transform on coordinates u right, v down: scaled, turned, then moved."""
    (x, y), (u, v), angle = moved.get("offset", (0, 0)), moved.get("scale", (1, 1)), moved.get("rotation", 0)
    # Translation · rotation · scale, as the extension orders them, in one matrix.
    cosine, sine = math.cos(angle), math.sin(angle)
    return np.array([[cosine * u, sine * v, x], [-sine * u, cosine * v, y]], np.float64)
