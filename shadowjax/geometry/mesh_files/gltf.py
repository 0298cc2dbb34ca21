"""glTF and GLB: the tree reduced to plain triangles, read by trimesh, placed and coloured as the format says."""

import importlib.util
import json
from collections import defaultdict
from io import BytesIO
from typing import Any

import numpy as np
from trimesh.exchange.gltf import load_gltf

from shadowjax._checks import require
from shadowjax.geometry.mesh_files.colors import Paint, channels
from shadowjax.geometry.mesh_files.gltf_materials import Materials
from shadowjax.geometry.mesh_files.gltf_tree import Tree, unpack_tree
from shadowjax.geometry.mesh_files.parts import MAX_TRIANGLES, Part, Reading, see_through
from shadowjax.geometry.mesh_files.places import MAX_BYTES, Place

TRIANGLES, STRIP, FAN = 4, 5, 6
_DRACO = "KHR_draco_mesh_compression"
# What a file may require: what is read here, and what changes only looks that are not drawn here.
_READ = {"KHR_mesh_quantization", "KHR_texture_transform", "EXT_texture_webp", _DRACO}
_LOOKS = ("KHR_materials_", "KHR_lights_", "KHR_xmp", "EXT_lights_", "KHR_animation_", "KHR_texture_", "EXT_texture_")
_REQUIRED_LOOKS = ("KHR_materials_", "KHR_lights_", "KHR_xmp")
_BOUND_SLACK = 0.01  # of the extent that is declared: what quantisation may move


def read_gltf(data: bytes, place: Place) -> Reading:
    """Read a .glb or .gltf file.

    Triangles, strips and fans are read, in the nodes of the scene that the file shows. Sparse and normalised numbers,
    texture transforms and vertex colours are; skins, morphs and cameras are not. Colours are linear but in textures,
    which are sRGB; factor, texture and vertex colour multiply.

    Raises:
        ValueError: If the file requires an extension that is not read, or declares what does not fit what came.
    """
    tree = unpack_tree(data, place)
    notes = _extensions(tree)
    plain = _Plain(tree, Materials(tree, place, notes), notes)
    if not plain.paints:
        return Reading([], notes)
    text = json.dumps(plain.tree.json).encode()
    loaded = load_gltf(BytesIO(text), resolver=_Buffers(plain.tree.buffers))  # pyright: ignore[reportArgumentType]
    geometry, placements = loaded["geometry"], _placements(loaded["graph"])
    require(len(geometry) == len(plain.paints), f"{len(geometry)} of {len(plain.paints)} primitives came")
    parts = []
    for (name, content), paint, transform, bounds in zip(
        geometry.items(), plain.paints, plain.transforms, plain.bounds, strict=True
    ):
        vertices, visual = np.asarray(content["vertices"]), content.get("visual")
        _require_bounds(vertices, bounds)
        color = content.get("vertex_colors") if visual is None else visual.vertex_attributes.get("color")
        if visual is not None and visual.uv is not None:
            uv = np.asarray(visual.uv, np.float64)
            paint.coordinates = np.stack([uv[:, 0], 1.0 - uv[:, 1]], axis=-1) @ transform[:, :2].T + transform[:, 2]
        if color is not None:
            paint.corners = channels(color)
        parts.append(Part(vertices, np.asarray(content["faces"]), paint, placements.get(name, ())))
    return Reading(parts, notes + see_through(plain.clear))


class _Buffers:
    """Answers trimesh with the buffers that were unpacked, and with nothing else."""

    def __init__(self, buffers: list[bytes]) -> None:
        self._buffers = buffers

    def __getitem__(self, name: str) -> bytes:
        return self._buffers[int(name)]


def _extensions(tree: Tree) -> list[str]:
    """Notes on extensions that are left out.

    Raises:
        ValueError: If the file requires one that is not read; its name is in the message.
    """
    decoder = importlib.util.find_spec("DracoPy") is not None
    required = [str(name) for name in tree.json.get("extensionsRequired", [])]
    unknown = [name for name in required if name not in _READ and not name.startswith(_REQUIRED_LOOKS)]
    require(
        not unknown,
        f"it requires the glTF extension {', '.join(unknown)[:200]}, which is not read; save it without",
    )
    compressed = any(
        _DRACO in primitive.get("extensions", {})
        and "bufferView" not in tree.item("accessors", primitive["attributes"]["POSITION"])
        for mesh in tree.items("meshes")
        for primitive in mesh.get("primitives", [])
    )
    require(
        decoder or not (_DRACO in required or compressed),
        f"it requires the glTF extension {_DRACO}: its decoder comes with pip install 'shadowjax[meshes]'",
    )
    used = set(map(str, tree.json.get("extensionsUsed", []))) | {
        name for node in tree.items("nodes") for name in node.get("extensions", {})
    }
    left = sorted(name for name in used if name not in _READ and not name.startswith(_LOOKS))
    notes = [f"the glTF extensions {', '.join(left)} are left out"] if left else []
    if any("skin" in node for node in tree.items("nodes")) and tree.items("skins"):
        notes.append("skins are not applied: bodies stand as they were modelled")
    return notes


def _require_bounds(vertices: np.ndarray, bounds: np.ndarray | None) -> None:
    """Complain if positions leave the bounds (2, 3) that the file declares: something was read wrong."""
    if bounds is None or not len(vertices):
        return
    slack = _BOUND_SLACK * float(np.max(bounds[1] - bounds[0])) + 1e-6 * float(np.max(np.abs(bounds)))
    lower, upper = vertices.min(axis=0), vertices.max(axis=0)
    inside = np.all(lower >= bounds[0] - slack) and np.all(upper <= bounds[1] + slack)
    filled = np.all(lower <= bounds[0] + slack) and np.all(upper >= bounds[1] - slack)
    require(
        bool(inside and filled),
        f"positions from {_triple(lower)} to {_triple(upper)} do not fill the bounds {_triple(bounds[0])} to "
        f"{_triple(bounds[1])} that it declares: it is damaged, or was written wrong",
    )


def _triple(values: np.ndarray) -> str:
    return "(" + ", ".join(f"{value:.6g}" for value in values) + ")"


def _placements(graph: Any) -> dict[str, list[np.ndarray]]:
    """World matrices of every geometry, from trimesh's list of edges, in which parents come before children."""
    world, placements = {"world": np.eye(4)}, defaultdict(list)
    for edge in graph:
        matrix = world[edge["frame_from"]] @ edge["matrix"]
        world[edge["frame_to"]] = matrix
        if "geometry" in edge:
            placements[edge["geometry"]].append(matrix)
    return placements


class _Plain:
    """The part of a tree that trimesh reads right: triangles of the scene shown, dense numbers, no materials.

    Attributes:
        tree: For trimesh.
        paints: Colour of each primitive, in the order in which trimesh gives them; so are the next two.
        transforms: (2, 3) matrices of texture coordinates.
        bounds: Declared bounds of positions, (2, 3) or None.
        clear: Names of the materials in use that let light through.
    """

    def __init__(self, tree: Tree, materials: Materials, notes: list[str]) -> None:
        self._old, self._materials, self._bytes = tree, materials, 0
        nodes, roots, uses = _shown(tree)
        json = {"asset": {"version": "2.0"}, "bufferViews": [], "accessors": [], "meshes": []}
        self.tree = Tree(json, list(tree.buffers))
        self._accessors: dict[tuple[int, str], int] = {}
        self._views: dict[int, int] = {}
        self.paints: list[Paint] = []
        self.transforms: list[np.ndarray] = []
        self.bounds: list[np.ndarray | None] = []
        self.clear: list[str] = []
        dropped = triangles = 0
        for index, mesh in enumerate(tree.items("meshes")):
            kept = []
            for primitive in mesh["primitives"] if index in uses else []:
                mode = primitive.get("mode", TRIANGLES)
                if mode not in (TRIANGLES, STRIP, FAN) or "POSITION" not in primitive["attributes"]:
                    dropped += 1
                    continue
                corners = tree.shape(primitive.get("indices", primitive["attributes"]["POSITION"]))[0]
                triangles += uses[index] * (corners // 3 if mode == TRIANGLES else max(corners - 2, 0))
                require(
                    triangles <= MAX_TRIANGLES,
                    f"it holds {triangles:,} triangles and more; at most {MAX_TRIANGLES:,} are read: simplify it",
                )
                kept.append(self._primitive(primitive, mode))
            json["meshes"].append({"name": f"m{index}", "primitives": kept})
        for node in nodes:
            if "mesh" in node and not json["meshes"][node["mesh"]]["primitives"]:
                del node["mesh"]
        json |= {"nodes": nodes, "scenes": [{"nodes": roots}], "scene": 0, "materials": [{}]}
        json["buffers"] = [
            {"uri": str(index), "byteLength": len(buffer)} for index, buffer in enumerate(self.tree.buffers)
        ]
        if dropped:
            notes.append(f"{dropped} primitives of points, lines or nothing are left out: only triangles are read")

    def _primitive(self, primitive: dict[str, Any], mode: int) -> dict[str, Any]:
        """A primitive as triangles, and its paint noted."""
        attributes = primitive["attributes"]
        paint, transform, channel = self._materials.paint(primitive.get("material"))
        name = self._materials.clear_name(primitive.get("material"))
        if name is not None and name not in self.clear:
            self.clear.append(name)
        made: dict[str, Any] = {"attributes": {"POSITION": self._accessor(attributes["POSITION"], "position")}}
        if paint.texture is not None and f"TEXCOORD_{channel}" in attributes:
            made["attributes"]["TEXCOORD_0"] = self._accessor(attributes[f"TEXCOORD_{channel}"], "coordinate")
            made["material"] = 0
        if "COLOR_0" in attributes:
            made["attributes"]["COLOR_0"] = self._accessor(attributes["COLOR_0"], "color")
        draco = primitive.get("extensions", {}).get(_DRACO)
        if draco is not None and importlib.util.find_spec("DracoPy") is not None:
            made["extensions"] = {_DRACO: draco | {"bufferView": self._view(draco["bufferView"])}}
            made["indices"] = self._accessor(primitive["indices"], "index")
        elif mode != TRIANGLES:
            made["indices"] = self.tree.add(self._cut(primitive, mode))
        elif "indices" in primitive:
            made["indices"] = self._accessor(primitive["indices"], "index")
        self.paints.append(paint)
        self.transforms.append(transform)
        self.bounds.append(self._declared_bounds(attributes["POSITION"]))
        return made

    def _cut(self, primitive: dict[str, Any], mode: int) -> np.ndarray:
        """Corners (3 · triangles, 1) of a strip or a fan; triangles that use a corner twice are left out."""
        if "indices" in primitive:
            corners = self._old.values(primitive["indices"])[:, 0]
        else:
            corners = np.arange(self._old.shape(primitive["attributes"]["POSITION"])[0])
        corners = corners.astype(np.uint32)
        if mode == FAN:
            cut = np.stack([np.broadcast_to(corners[:1], corners[2:].shape), corners[1:-1], corners[2:]], axis=-1)
        else:
            cut = np.stack([corners[:-2], corners[1:-1], corners[2:]], axis=-1)
            # Every second triangle of a strip turns the other way.
            cut[1::2] = cut[1::2, [1, 0, 2]]
        good = (cut[:, 0] != cut[:, 1]) & (cut[:, 1] != cut[:, 2]) & (cut[:, 2] != cut[:, 0])
        return cut[good].reshape(-1, 1)

    def _accessor(self, index: Any, role: str) -> int:
        """An accessor of the new tree with the numbers of one of the old; integers that stand for others become so."""
        found = self._accessors.get((index, role))
        if found is not None:
            return found
        accessor, (count, width, dtype) = self._old.item("accessors", index), self._old.shape(index)
        self._old.fits(index)
        self._take(count * width * dtype.itemsize)
        floats = role in ("position", "coordinate") and dtype.kind != "f" and "bufferView" in accessor
        if "sparse" in accessor or floats:
            values = self._old.values(index)
            made = self.tree.add(values.astype(np.float32) if floats else values)
        else:
            copy = {key: accessor[key] for key in ("componentType", "count", "type", "byteOffset") if key in accessor}
            if "bufferView" in accessor:
                copy["bufferView"] = self._view(accessor["bufferView"])
            self.tree.json["accessors"].append(copy)
            made = len(self.tree.json["accessors"]) - 1
        self._accessors[index, role] = made
        return made

    def _view(self, index: Any) -> int:
        """A view of the new tree like one of the old."""
        if index not in self._views:
            data, _ = self._old.view(index)
            self._take(len(data))
            self._views[index] = len(self.tree.json["bufferViews"])
            self.tree.json["bufferViews"].append(dict(self._old.item("bufferViews", index)))
        return self._views[index]

    def _take(self, size: int) -> None:
        self._bytes += size
        require(self._bytes <= MAX_BYTES, f"its numbers need more than {MAX_BYTES >> 20} MiB; simplify the mesh")

    def _declared_bounds(self, index: Any) -> np.ndarray | None:
        """Bounds (2, 3) of an accessor of positions, in the numbers it stands for."""
        accessor = self._old.item("accessors", index)
        lower, upper = accessor.get("min"), accessor.get("max")
        if lower is None or upper is None:
            return None
        bounds = np.array([lower, upper], np.float64)
        require(bounds.shape == (2, 3), f"accessors[{index}] has bounds of {bounds.shape[-1]} numbers, not three")
        dtype = self._old.shape(index)[2]
        if accessor.get("normalized") and dtype.kind in "iu":
            bounds = np.maximum(bounds / np.iinfo(dtype).max, -1.0)
        return bounds


def _shown(tree: Tree) -> tuple[list[dict[str, Any]], list[int], dict[int, int]]:
    """Nodes reduced to transforms, children and meshes; roots of the scene shown; how often it uses each mesh.

    A file without scenes shows all its nodes; one without nodes shows every mesh once.

    Raises:
        ValueError: If a node is reached twice: trees have no circles and no second parents.
    """
    keys = ("matrix", "translation", "rotation", "scale", "children", "mesh")
    nodes: list[dict[str, Any]] = [{key: node[key] for key in keys if key in node} for node in tree.items("nodes")]
    if not nodes:
        nodes = [{"mesh": index} for index in range(len(tree.items("meshes")))]
    scenes = tree.items("scenes")
    if scenes:
        roots = tree.item("scenes", tree.json.get("scene", 0)).get("nodes", [])
    else:
        below = {child for node in nodes for child in node.get("children", [])}
        roots = [index for index in range(len(nodes)) if index not in below]
    reached, waiting, uses = set(), list(roots), defaultdict(int)
    while waiting:
        index = waiting.pop()
        require(isinstance(index, int) and 0 <= index < len(nodes), f"it has {len(nodes)} nodes; it points at {index}")
        require(index not in reached, f"nodes[{index}] stands in the scene twice: nodes must form a tree")
        reached.add(index)
        waiting += nodes[index].get("children", [])
        if "mesh" in nodes[index]:
            tree.item("meshes", nodes[index]["mesh"])
            uses[nodes[index]["mesh"]] += 1
    return nodes, list(roots), uses
