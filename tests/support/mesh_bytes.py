"""Mesh files as bytes, made by hand: what the formats say, and nothing a library would add or mend."""

import json
import struct
from io import BytesIO

import numpy as np
from PIL import Image

BOX_CORNERS = np.array([[x, y, z] for x in (0.0, 1) for y in (0.0, 1) for z in (0.0, 1)])
BOX_FACES = np.array(
    [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1], [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4],
     [1, 5, 7], [1, 7, 3]]
)  # fmt: skip
_KINDS = {"f4": 5126, "u4": 5125, "u2": 5123, "u1": 5121, "i2": 5122, "i1": 5120}
_FORMS = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4"}


class Gltf:
    """Builds a glTF tree with one buffer."""

    def __init__(self, **tree):
        self.blob = b""
        self.tree = {"asset": {"version": "2.0"}, "bufferViews": [], "accessors": [], **tree}

    def view(self, data):
        """Append bytes; the index of their view."""
        self.blob += bytes(-len(self.blob) % 4)
        self.tree["bufferViews"].append({"buffer": 0, "byteOffset": len(self.blob), "byteLength": len(data)})
        self.blob += data
        return len(self.tree["bufferViews"]) - 1

    def array(self, values, kind="f4", **more):
        """Append an array; the index of its accessor."""
        values = np.atleast_2d(np.asarray(values).T).T.astype("<" + kind)
        self.tree["accessors"].append(
            {"bufferView": self.view(values.tobytes()), "componentType": _KINDS[kind], "count": len(values),
             "type": _FORMS[values.shape[1]], **more}
        )  # fmt: skip
        return len(self.tree["accessors"]) - 1

    def box(self, **primitive):
        """A primitive of the unit box."""
        attributes = {"POSITION": self.array(BOX_CORNERS, min=[0.0] * 3, max=[1.0] * 3)}
        return {"attributes": attributes, "indices": self.array(BOX_FACES.reshape(-1), "u2"), **primitive}

    def show(self, *primitives, **node):
        """One mesh in one node of one scene."""
        self.tree |= {
            "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0, **node}],
            "meshes": [{"primitives": list(primitives)}],
        }  # fmt: skip
        return self

    def glb(self):
        """The bytes of a .glb file."""
        tree = self.tree | ({"buffers": [{"byteLength": len(self.blob)}]} if "buffers" not in self.tree else {})
        text = json.dumps(tree).encode()
        text += b" " * (-len(text) % 4)
        blob = self.blob + bytes(-len(self.blob) % 4)
        chunks = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(blob), b"BIN\0") + blob
        return b"glTF" + struct.pack("<II", 2, 12 + len(chunks)) + chunks

    def gltf(self, address):
        """The bytes of a .gltf file whose buffer lies at an address."""
        return json.dumps(self.tree | {"buffers": [{"byteLength": len(self.blob), "uri": address}]}).encode()


def box_glb(**primitive):
    """A .glb file of the unit box."""
    made = Gltf()
    return made.show(made.box(**primitive)).glb()


def png(pixels):
    """A PNG of pixels (rows, columns, 3 or 4) in whole numbers up to 255."""
    stream = BytesIO()
    Image.fromarray(np.asarray(pixels, np.uint8)).save(stream, "PNG")
    return stream.getvalue()


def obj(vertices, faces, more=""):
    """An OBJ file of faces of any size, indices from 0."""
    lines = [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in vertices]
    lines += ["f " + " ".join(str(index + 1) for index in face) for face in faces]
    return (more + "\n".join(lines) + "\n").encode()


def off(vertices, faces):
    """An OFF file."""
    lines = ["OFF", f"{len(vertices)} {len(faces)} 0"]
    lines += [f"{x:.9g} {y:.9g} {z:.9g}" for x, y, z in vertices]
    lines += [" ".join(map(str, [len(face), *face])) for face in faces]
    return ("\n".join(lines) + "\n").encode()


def ply(vertices, faces, binary=False, colors=None):
    """A PLY file, ASCII or little-endian, with colours (vertices, 3) of whole numbers or none."""
    shades = ["property uchar red", "property uchar green", "property uchar blue"] if colors is not None else []
    header = [
        "ply", f"format {'binary_little_endian' if binary else 'ascii'} 1.0", f"element vertex {len(vertices)}",
        "property float x", "property float y", "property float z", *shades, f"element face {len(faces)}",
        "property list uchar int vertex_indices", "end_header", "",
    ]  # fmt: skip
    rows = [(*point, *(colors[i] if colors is not None else ())) for i, point in enumerate(np.asarray(vertices))]
    if binary:
        body = b"".join(struct.pack("<3f", *row[:3]) + bytes(map(int, row[3:])) for row in rows)
        body += b"".join(struct.pack(f"<B{len(face)}i", len(face), *face) for face in faces)
    else:
        body = "".join(" ".join(f"{value:.9g}" for value in row) + "\n" for row in rows).encode()
        body += "".join(" ".join(map(str, [len(face), *face])) + "\n" for face in faces).encode()
    return "\n".join(header).encode() + body


def stl(vertices, faces, binary=True):
    """An STL file of triangles."""
    corners = np.asarray(vertices, float)[np.asarray(faces)]
    if binary:
        rows = b"".join(struct.pack("<12fH", 0, 0, 0, *triangle.reshape(-1), 0) for triangle in corners)
        return b"made by hand".ljust(80) + struct.pack("<I", len(corners)) + rows
    facets = [
        "facet normal 0 0 0\nouter loop\n"
        + "".join(f"vertex {x:.9g} {y:.9g} {z:.9g}\n" for x, y, z in triangle)
        + "endloop\nendfacet\n"
        for triangle in corners
    ]
    return ("solid box\n" + "".join(facets) + "endsolid box\n").encode()
