"""Wavefront OBJ: the text made plain before trimesh reads it, so that every line means what the format says."""

import re
from dataclasses import dataclass
from io import BytesIO

import numpy as np
from trimesh.exchange.obj import load_obj, parse_mtl

from shadowjax._checks import require
from shadowjax.geometry.mesh_files.colors import Images, Paint, Texture, Unreadable, channels_of_text, from_srgb
from shadowjax.geometry.mesh_files.ear_clipping import EarClipper
from shadowjax.geometry.mesh_files.parts import MAX_TRIANGLES, Part, Reading, see_through
from shadowjax.geometry.mesh_files.places import Missing, Place, require_text_size

# A face that trimesh reads right: three corners, each an index from 1 on with those of texture and normal behind it.
_INDEX = r"[1-9]\d*(?:/\d*){0,2}"
_PLAIN = re.compile(rf"^f {_INDEX} +{_INDEX} +{_INDEX} *$", re.MULTILINE)
_FACE = re.compile(r"^f\b", re.MULTILINE)
_MATERIAL_USE = re.compile(r"^usemtl(?: (.*))?$", re.MULTILINE)
_MAX_LIBRARY_BYTES = 8 << 20
_MAX_CORNERS = 100_000
_MAX_MATERIAL_STEPS = 4_000_000_000  # trimesh walks over all vertices once for each material: some seconds


@dataclass
class _Material:
    """A material of a library: linear factor, texture, and whether it lets light through."""

    factor: np.ndarray | None
    texture: Texture | None
    clear: bool


def read_obj(data: bytes, place: Place) -> Reading:
    """Read an OBJ file, with the materials and textures it names.

    Negative indices count back from the vertices so far; faces of more than three corners are cut by ear clipping;
    colours are taken for sRGB. A missing library of materials leaves faces without colour.

    Raises:
        ValueError: If an index is 0 or out of range, or what it names may not be read.
    """
    require_text_size(data)
    faces = data.count(b"\nf")
    require(faces <= MAX_TRIANGLES, f"it holds {faces:,} faces; at most {MAX_TRIANGLES:,} are read: simplify it")
    notes: list[str] = []
    text = _clean(decoded(data))
    materials = _materials(re.findall(r"^mtllib (.*)$", text, re.MULTILINE), place, notes)
    names = list(materials)
    text = re.sub(r"^mtllib.*$", "", text, flags=re.MULTILINE)
    # trimesh gets numbers for names: none is lost, none mistaken, and unknown materials are one.
    numbers = {name: f"m{index}" for index, name in enumerate(names)}
    text = _MATERIAL_USE.sub(lambda use: f"usemtl {numbers.get(_spaced(use.group(1) or ''), 'none')}", text)
    plain = sum(1 for _ in _PLAIN.finditer(text)) == sum(1 for _ in _FACE.finditer(text))
    if not plain or ("//" in text and re.search(r"^f [^/\n]*/\d", text, re.MULTILINE)):
        text = _triangles_only(text, notes)
    others = len(re.findall(r"^(?:p|l|curv2?|surf) ", text, re.MULTILINE))
    if others:
        notes.append(f"{others} points, lines or curved surfaces are left out: only faces are read")
    used, vertices = len(set(_MATERIAL_USE.findall(text))), text.count("\nv ")
    require(used * vertices <= _MAX_MATERIAL_STEPS, f"{used} materials over {vertices:,} vertices are too many")
    library = "".join(f"newmtl m{index}\n" for index in range(len(names)))
    header = "mtllib library\n" if names else ""
    stream = BytesIO((header + text).encode())
    try:
        loaded = load_obj(stream, resolver={"library": library.encode()})  # pyright: ignore[reportArgumentType]
    except IndexError as error:
        raise ValueError(f"face indices must lie in [1, {vertices}], the number of vertices: {error}") from error
    by_number = {number: name for name, number in numbers.items()}
    parts, clear = [], []
    for content in loaded.get("geometry", {}).values():
        visual = content.get("visual")
        number = getattr(getattr(visual, "material", None), "name", "")
        name = by_number.get(str(number))
        if name is not None and materials[name].clear:
            clear.append(name)
        parts.append(_part(content, getattr(visual, "uv", None), None if name is None else materials[name]))
    return Reading(parts, notes + see_through(clear))


def _part(content: dict, uv: np.ndarray | None, material: _Material | None) -> Part:
    """A part as trimesh gives it, painted."""
    vertices, paint = content["vertices"], Paint()
    if material is not None:
        paint.factor, paint.texture = material.factor, material.texture
    if uv is not None and len(uv) == len(vertices):
        paint.coordinates = np.stack([uv[:, 0], 1.0 - uv[:, 1]], axis=-1)
    if content.get("vertex_colors") is not None and paint.factor is None and paint.texture is None:
        paint.corners = from_srgb(channels_of_text(content["vertex_colors"]))
    return Part(vertices, content["faces"], paint)


def decoded(data: bytes) -> str:
    """Text of any encoding: UTF-8, or else Latin-1, in which every byte is a letter; keywords are ASCII in both."""
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        return data.decode("latin-1")


def _clean(text: str) -> str:
    """One statement a line, its words parted by a blank, without comments; trimesh looks for nothing else."""
    if "\r" in text:
        text = text.replace("\r\n", "\n").replace("\r", "\n")
    text = f"\n{text}\n"
    if "\\\n" in text:
        text = text.replace("\\\n", " ")
    if "#" in text:
        text = re.sub(r"^[ \t]*#.*$", "", text, flags=re.MULTILINE)
        text = re.sub(r"^([ \t]*(?:v|vt|vn|f|l|p)[ \t][^#\n]*)#.*$", r"\1", text, flags=re.MULTILINE)
    if "\t" in text:
        text = text.replace("\t", " ")
    if "\n " in text:
        text = re.sub(r"^ +", "", text, flags=re.MULTILINE)
    return re.sub(r"^(v|vt|vn|f) {2,}", r"\1 ", text, flags=re.MULTILINE)


def _spaced(name: str) -> str:
    return " ".join(name.split())


def _materials(libraries: list[str], place: Place, notes: list[str]) -> dict[str, _Material]:
    """Materials of all libraries by name; a missing library has none."""
    found, images = {}, Images()
    for library in libraries:
        try:
            texts = [_library(place.read(library))]  # names with blanks exist, and so do several names in one line
        except Missing:
            texts = []
            for name in library.split():
                try:
                    texts.append(_library(place.read(name)))
                except Missing:
                    continue
        for text in texts:
            # Names of textures are kept from trimesh, which would open them.
            rest = re.sub(r"(?im)^\s*map_kd\b.*$", "", text)
            maps = _texture_names(text)
            for name, values in parse_mtl(rest, resolver=None).items():
                factor = np.atleast_1d(np.asarray(values.get("kd", np.nan), np.float64))
                factor = np.broadcast_to(factor, (3,)) if len(factor) == 1 else factor[:3]
                known = len(factor) == 3 and bool(np.isfinite(factor).all())
                found[_spaced(name)] = _Material(
                    from_srgb(np.clip(factor, 0.0, 1.0)) if known else None,
                    _texture(maps.get(_spaced(name)), place, images, notes),
                    _lets_through(values),
                )
    return found


def _library(data: bytes) -> str:
    require(len(data) <= _MAX_LIBRARY_BYTES, f"its material library holds {len(data) >> 20} MiB; at most 8 are read")
    return decoded(data)


def _texture_names(text: str) -> dict[str, str]:
    """File of the diffuse texture of each material, without the options before it."""
    names, current = {}, ""
    for line in text.splitlines():
        key, _, value = line.strip().partition(" ")
        if key.lower() == "newmtl":
            current = _spaced(value)
        elif key.lower() == "map_kd":
            names[current] = value.split()[-1] if value.strip().startswith("-") else value.strip()
    return names


def _texture(name: str | None, place: Place, images: Images, notes: list[str]) -> Texture | None:
    if not name:
        return None
    try:
        return images.open(place.read(name), name)
    except (Missing, Unreadable) as problem:
        notes.append(f"{problem}; the plain colour is used")
        return None


def _lets_through(values: dict) -> bool:
    """Whether a material is transparent by its dissolve, its transparency or a map of either."""

    def number(key: str, default: float) -> float:
        try:
            return float(values[key][-1])
        except (KeyError, IndexError, ValueError, TypeError):
            return default

    return number("d", 1.0) < 1 or number("tr", 0.0) > 0 or "map_d" in values


def _triangles_only(text: str, notes: list[str]) -> str:
    """The text with every face as triangles of absolute indices of vertex and texture coordinate; normals go."""
    lines = text.split("\n")
    vertex_lines: list[str] = []
    num_textures = 0
    faces: dict[int, list[tuple[int, list[int], list[int]]]] = {}
    for number, line in enumerate(lines):
        if line.startswith("v "):
            vertex_lines.append(line)
        elif line.startswith("vt "):
            num_textures += 1
        elif line.startswith("f ") or line == "f":
            require(line.count(" ") <= _MAX_CORNERS, f"a face has more than {_MAX_CORNERS:,} corners; triangulate it")
            corners = [corner.split("/") for corner in line.split()[1:]]
            if len(corners) < 3:
                notes.append(f"a face with {len(corners)} corners is left out")
                lines[number] = ""
                continue
            places = [_absolute(corner[0], len(vertex_lines), line) for corner in corners]
            textures = [_absolute(c[1], num_textures, line) for c in corners if len(c) > 1 and c[1]]
            faces.setdefault(len(corners), []).append((number, places, textures))
    if any(count > 3 for count in faces):
        positions = np.array([line.split()[1:4] for line in vertex_lines], np.float64)
    else:
        positions = np.zeros((len(vertex_lines), 3))
    textured = any(entry[2] for same in faces.values() for entry in same)
    clipper = EarClipper()
    for count, same in faces.items():
        indices = np.array([places for _, places, _ in same]) - 1
        require(
            bool((indices < len(positions)).all()),
            f"face indices must lie in [1, {len(positions)}], the number of vertices; got {int(indices.max()) + 1}",
        )
        for (number, places, textures), cut in zip(same, clipper.cut(positions[indices]).tolist(), strict=True):
            if textured:
                # Where a face has no texture coordinates and others have, it gets one that is added below.
                seconds = textures if len(textures) == count else [num_textures + 1] * count
                words = [f"{place}/{second}" for place, second in zip(places, seconds, strict=True)]
            else:
                words = [str(place) for place in places]
            lines[number] = "\n".join(f"f {words[a]} {words[b]} {words[c]}" for a, b, c in cut)
    if textured:
        lines.append("vt 0 0\n")
    notes += clipper.notes()
    return "\n".join(lines)


def _absolute(word: str, so_far: int, line: str) -> int:
    """Index from 1 on of a word that may count back from the last one so far."""
    index = int(word)
    require(index != 0 and index >= -so_far, f"index {index} of the line {line[:60]!r} points at nothing")
    return index if index > 0 else so_far + 1 + index
