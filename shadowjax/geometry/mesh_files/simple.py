"""PLY, STL, OFF, 3MF and COLLADA: what they declare is held against what trimesh gives, and concave faces are cut."""

import re
from io import BytesIO
from typing import Any

import numpy as np
from trimesh.exchange.off import load_off
from trimesh.exchange.ply import load_ply
from trimesh.exchange.stl import load_stl

from shadowjax._checks import require
from shadowjax.geometry.mesh_files.colors import Images, Paint, Unreadable, channels_of_text, from_srgb
from shadowjax.geometry.mesh_files.ear_clipping import EarClipper
from shadowjax.geometry.mesh_files.obj import decoded
from shadowjax.geometry.mesh_files.parts import MAX_TRIANGLES, Part, Reading
from shadowjax.geometry.mesh_files.places import Missing, Place, require_text_size, unpack

_INDEX_NAMES = ("vertex_index", "vertex_indices")


def read_ply(data: bytes, place: Place) -> Reading:
    """Read a PLY file, ASCII or binary; colours of faces or vertices and the texture it names are taken for sRGB.

    Raises:
        ValueError: If elements are fewer than declared, or faces differ in size in a binary file.
    """
    head, found, _ = data[: 1 << 16].partition(b"end_header")
    require(data[:3].lower() == b"ply" and bool(found), "it is no PLY: it has no header that begins and ends as one")
    header = decoded(head)
    if re.search(r"^format +ascii", header, re.MULTILINE):
        require_text_size(data)
    _require_rows(header, data)
    notes: list[str] = []
    loaded: dict[str, Any] = load_ply(BytesIO(data), skip_materials=True)
    raw = loaded.get("metadata", {}).get("_ply_raw", {})
    for name in ("vertex", "face"):
        if name in raw and raw[name]["length"]:
            came = _length(raw[name].get("data"))
            require(came == raw[name]["length"], f"it declares {raw[name]['length']:,} {name} elements; {came:,} came")
    if "faces" not in loaded or not len(loaded["faces"]):
        if "tristrips" in raw:
            notes.append("triangle strips are not read from PLY")
        return Reading([], notes)
    vertices, faces = np.asarray(loaded["vertices"]), loaded["faces"]
    polygons = _polygons(raw["face"]["data"])
    visual = loaded.get("visual")
    uv = None if visual is None else visual.uv
    colors = loaded.get("face_colors")
    paint = Paint()
    if any(polygon.shape[1] > 3 for polygon, _ in polygons):
        if np.ndim(faces) == 2 and np.shape(faces)[1] > 3:  # cut here, with the vertices that trimesh made
            polygons = [(np.asarray(faces), np.arange(len(faces)))]
        elif len(vertices) != raw["vertex"]["length"]:
            vertices, uv = np.column_stack([np.ravel(raw["vertex"]["data"][axis]) for axis in "xyz"]), None
            notes.append("faces of many sizes with texture coordinates: the plain colour is used")
        faces, source = _cut(vertices, polygons, notes)
        colors = None if colors is None else np.asarray(colors)[source]
    if colors is not None:
        paint.faces = from_srgb(channels_of_text(colors))
    elif loaded.get("vertex_colors") is not None and len(loaded["vertex_colors"]) == len(vertices):
        paint.corners = from_srgb(channels_of_text(loaded["vertex_colors"]))
    image = re.search(r"^comment +texturefile +(.+?)\s*$", header, re.MULTILINE | re.IGNORECASE)
    if uv is not None and image is not None:
        try:
            paint.texture = Images().open(place.read(image[1]), image[1])
            paint.coordinates = np.stack([uv[:, 0], 1.0 - uv[:, 1]], axis=-1)
        except (Missing, Unreadable) as problem:
            notes.append(f"{problem}; the plain colour is used")
    return Reading([Part(vertices, np.asarray(faces), paint)], notes)


def _require_rows(header: str, data: bytes) -> None:
    """Complain if a PLY declares more elements than it has bytes."""
    counts = {name: int(count) for name, count in re.findall(r"^element +(\S+) +(\d+)", header, re.MULTILINE)}
    for name, most in {"face": MAX_TRIANGLES, "vertex": 3 * MAX_TRIANGLES}.items():
        require(
            counts.get(name, 0) <= most,
            f"it declares {counts.get(name, 0):,} {name} elements; at most {most:,} are read",
        )
    require(
        sum(counts.values()) <= len(data),
        f"its header declares {sum(counts.values()):,} elements, and it holds {len(data):,} bytes: it is cut off",
    )


def _length(data: Any) -> int:
    """How many elements of a PLY came: rows of an array, or of the columns of a table."""
    if isinstance(data, dict):
        return min((len(column) for column in data.values()), default=0)
    return 0 if data is None else len(data)


def _polygons(data: Any) -> list[tuple[np.ndarray, np.ndarray]]:
    """Faces of a PLY by number of corners: indices (polygons, corners) and the numbers of the faces."""
    if isinstance(data, dict):
        column = next(data[name] for name in _INDEX_NAMES if name in data)
    else:
        names = data.dtype.names
        name = next((name for name in _INDEX_NAMES if name in names), names[0])
        column = data[name]["f1"]
        sizes = data[name]["f0"]
        require(
            bool((sizes == column.shape[1]).all()) if column.ndim == 2 else bool((sizes == 1).all()),
            "its faces differ in their numbers of corners, which is not read from a binary PLY; triangulate it",
        )
    if column.dtype != object:
        return [(column.reshape(len(column), -1), np.arange(len(column)))]
    sizes = np.array([np.size(row) for row in column])
    return [
        (np.array([np.ravel(column[index]) for index in np.flatnonzero(sizes == size)]), np.flatnonzero(sizes == size))
        for size in np.unique(sizes)
    ]


def _cut(
    vertices: np.ndarray, polygons: list[tuple[np.ndarray, np.ndarray]], notes: list[str]
) -> tuple[np.ndarray, np.ndarray]:
    """Triangles (faces, 3) of polygons, and the number of the polygon that each comes from."""
    clipper, faces, sources = EarClipper(), [np.zeros((0, 3), np.int64)], [np.zeros(0, np.int64)]
    short = 0
    for corners, numbers in polygons:
        size = corners.shape[1]
        if size < 3:
            short += len(corners)
            continue
        indices = corners.astype(np.int64)
        low, high = int(indices.min()), int(indices.max())
        require(
            low >= 0 and high < len(vertices),
            f"face indices must lie in [0, {len(vertices)}), the number of vertices; got {low} … {high}",
        )
        cut = clipper.cut(np.asarray(vertices, np.float64)[indices])
        faces.append(np.take_along_axis(indices[:, None, :], cut, axis=2).reshape(-1, 3))
        sources.append(np.repeat(numbers, size - 2))
    if short:
        notes.append(f"{short} faces with fewer than three corners are left out")
    notes += clipper.notes()
    order = np.argsort(np.concatenate(sources), kind="stable")
    return np.concatenate(faces)[order], np.concatenate(sources)[order]


def read_stl(data: bytes, place: Place) -> Reading:
    """Read an STL file, ASCII or binary; it has no colours.

    Raises:
        ValueError: If a binary file is not as long as its number of triangles says, or an ASCII facet has no triangle.
    """
    text = data[:5].lower() == b"solid"
    count = int.from_bytes(data[80:84], "little")
    binary = len(data) == 84 + 50 * count and len(data) >= 84
    require(
        text or binary,
        f"it declares {count:,} triangles, {84 + 50 * count:,} bytes, and holds {len(data):,} bytes"
        if len(data) >= 84
        else f"its {len(data)} bytes are too few for an STL",
    )
    require(not binary or count <= MAX_TRIANGLES, f"it holds {count:,} triangles; at most {MAX_TRIANGLES:,} are read")
    facets = 0
    if not binary:
        require_text_size(data)
        facets = data.lower().count(b"endfacet")
        require(
            data.lower().count(b"facet") == 2 * facets, "a facet of its text begins and does not end: it is cut off"
        )
        corners = data.lower().count(b"vertex")
        require(corners == 3 * facets, f"its text has {facets:,} facets and {corners:,} corners, not three for each")
    loaded: dict[str, Any] = load_stl(BytesIO(data))  # pyright: ignore[reportArgumentType]
    contents = [loaded] if "vertices" in loaded else list(loaded.get("geometry", {}).values())
    parts = [Part(np.asarray(one["vertices"]), np.asarray(one["faces"])) for one in contents]
    came = sum(len(part.faces) for part in parts)
    require(binary or came == facets, f"its text has {facets:,} facets; {came:,} triangles came")
    return Reading(parts)


def read_off(data: bytes, place: Place) -> Reading:
    """Read an OFF file in text; colours are left out.

    Raises:
        ValueError: If it has fewer vertices or faces than declared, or is of a kind with other coordinates.
    """
    require_text_size(data)
    text = re.sub(r"#.*", "", decoded(data).replace("\r\n", "\n").replace("\r", "\n")).strip()
    keyword = re.match(r"(?:ST)?C?N?OFF\b(?!\s*BINARY)", text)
    require(keyword is not None, "it is no OFF in text with three coordinates; save it as such")
    lines = [line for line in map(str.strip, text[keyword.end() if keyword else 0 :].split("\n")) if line]
    require(len(lines) > 0 and len(lines[0].split()) >= 2, "it has no line with the numbers of vertices and faces")
    num_vertices, num_faces = (int(word) for word in lines[0].split()[:2])
    rows = lines[1 + num_vertices : 1 + num_vertices + num_faces]
    require(
        0 <= num_vertices < len(lines) and len(rows) == num_faces,
        f"it declares {num_vertices:,} vertices and {num_faces:,} faces; it has {len(lines) - 1:,} lines of them",
    )
    if not rows:
        return Reading([])
    faces, by_size = [row.split() for row in rows], {}
    for number, words in enumerate(faces):
        size = int(words[0])
        require(size >= 0 and len(words) > size, f"face {number} says {size} corners and lists {len(words) - 1}")
        by_size.setdefault(size, []).append((number, words[1 : size + 1]))
    # Coordinates alone go to trimesh, with one face: what it does with larger ones is done here.
    points = "\n".join(lines[1 : 1 + num_vertices])
    vertices = load_off(BytesIO(f"OFF\n{num_vertices} 1 0\n{points}\n3 0 0 0\n".encode()))["vertices"]
    polygons = [
        (np.array([words for _, words in same], np.int64).reshape(len(same), -1), np.array([n for n, _ in same]))
        for same in by_size.values()
    ]
    notes: list[str] = []
    return Reading([Part(vertices, _cut(vertices, polygons, notes)[0])], notes)


def read_3mf(data: bytes, place: Place) -> Reading:
    """Read a 3MF file through trimesh, which needs lxml and networkx; colours are left out."""
    from trimesh.exchange.threemf import load_3MF

    models = [content for name, content in unpack(data).items() if name.lower().endswith(".model")]
    require_text_size(b"".join(models), lines=False)
    _require_flat_components(models)
    return _scene(load_3MF(BytesIO(data)))


def _require_flat_components(models: list[bytes]) -> None:
    """Complain about bodies of bodies of bodies, whose number may double at every level."""
    components = sum(len(re.findall(rb"<(?:\w+:)?component\b", model)) for model in models)
    items = sum(len(re.findall(rb"<(?:\w+:)?item\b", model)) for model in models)
    objects = sum(len(re.findall(rb"<(?:\w+:)?components\b", model)) for model in models)
    require(
        objects <= 12 or components <= 2 * objects or items * components <= 10_000,
        f"its {components:,} components are nested in {objects:,} assemblies: too many; join the bodies",
    )


def read_dae(data: bytes, place: Place) -> Reading:
    """Read a COLLADA file through trimesh, which needs pycollada.

    Raises:
        ValueError: If a face is concave, which the reader would cut wrong.
    """
    import collada.common  # pyright: ignore[reportMissingImports]
    import collada.polylist  # pyright: ignore[reportMissingImports]
    from trimesh.exchange.dae import load_collada

    require_text_size(data, lines=False)
    clipper = EarClipper()
    document = collada.Collada(BytesIO(data), ignore=[collada.common.DaeError])
    for geometry in document.geometries:
        for primitive in geometry.primitives:
            if isinstance(primitive, collada.polylist.Polylist) and primitive.vertex is not None:
                for start, end in primitive.polyindex:
                    corners = primitive.vertex[primitive.vertex_index[start:end]][None]
                    if corners.shape[1] > 3:
                        fan = np.arange(1, corners.shape[1] - 1)
                        same = np.array_equal(clipper.cut(corners)[0][:, 1], fan)
                        require(same, "it has concave faces, which are not read from COLLADA; triangulate it")
    return _scene(load_collada(BytesIO(data), resolver=None))


def _scene(loaded: dict[str, Any]) -> Reading:
    """Parts of trimesh's description of a scene: its geometry at every place of its graph."""
    placements: dict[str, list[np.ndarray]] = {}
    for edge in loaded["graph"]:
        placements.setdefault(edge["geometry"], []).append(np.asarray(edge.get("matrix", np.eye(4)), np.float64))
    parts = []
    for name, content in loaded["geometry"].items():
        paint, color = Paint(), content.get("vertex_colors")
        visual = content.get("visual")
        main = getattr(getattr(visual, "material", None), "baseColorFactor", None)
        if color is not None and len(color) == len(content["vertices"]):
            paint.corners = from_srgb(channels_of_text(color))
        elif main is not None:
            paint.factor = from_srgb(channels_of_text(np.atleast_2d(main)))[0]
        vertices, faces = np.asarray(content["vertices"]), np.asarray(content["faces"])
        parts.append(Part(vertices, faces, paint, placements.get(name, ())))
    return Reading(parts)
