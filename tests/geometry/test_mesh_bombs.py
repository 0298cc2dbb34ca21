"""Files that would unfold to gigabytes or minutes: refused in one line, within 15 s of processor time and 1 GiB."""

import struct
import subprocess
import sys
import zipfile
import zlib

import mesh_bytes
import numpy as np
import pytest
from mesh_bytes import BOX_CORNERS, BOX_FACES, Gltf

from shadowjax import load

SECONDS, MEBIBYTES = 15, 1024
ASCII_PLY = mesh_bytes.ply(BOX_CORNERS, BOX_FACES)


def zipped(name, size):
    def write(path):
        archive = zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=1)
        with archive, archive.open(name, "w", force_zip64=True) as stream:
            for _ in range(size >> 20):
                stream.write(b"\n" * (1 << 20))

    return write


def black(side):
    """A PNG of so many black pixels that only its header and some of its rows are there."""

    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    head = chunk(b"IHDR", struct.pack(">IIBBBBB", side, side, 8, 0, 0, 0, 0))
    rows = chunk(b"IDAT", zlib.compress(bytes(side + 1) * 8))
    return b"\x89PNG\r\n\x1a\n" + head + rows + chunk(b"IEND", b"")


def textured(side):
    made = Gltf()
    box = made.box(material=0)
    box["attributes"]["TEXCOORD_0"] = made.array(np.zeros((8, 2)))
    made.tree |= {"images": [{"bufferView": made.view(black(side))}], "textures": [{"source": 0}]}
    made.tree["materials"] = [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}]
    return made.show(box).glb()


def aliased(parts):
    made = Gltf()
    view = made.view(bytes(6 << 20))
    box = made.box()
    positions = [
        {"bufferView": view, "componentType": 5126, "count": 500_000, "type": "VEC3"} for _ in range(parts)
    ]  # fmt: skip
    first = len(made.tree["accessors"])
    made.tree["accessors"] += positions
    more = [{"attributes": {"POSITION": first + index}, "indices": box["indices"]} for index in range(parts)]
    return made.show(box, *more).glb()


def instances(count):
    made = Gltf()
    made.show({**made.box(), "indices": made.array(np.zeros(15_000), "u2")})  # 5,000 triangles
    made.tree |= {"nodes": [{"mesh": 0}] * count, "scenes": [{"nodes": list(range(count))}]}
    return made.glb()


def concave(corners, copies):
    angles = np.linspace(0, 2 * np.pi, corners, endpoint=False)
    radius = np.where(np.arange(corners) % 2, 0.99, 1.0)
    points = np.stack([radius * np.cos(angles), radius * np.sin(angles), 0 * angles], axis=-1)
    return mesh_bytes.obj(points, [range(corners)] * copies)


BOMBS = {
    "newlines.zip": (zipped("n.obj", 300 << 20), "unpacked holds 300 MiB"),
    "texture.glb": (textured(13_000), "texture number 0 is too large|13000 × 13000"),
    "aliased.glb": (aliased(60), "need more than 256 MiB"),
    "instances.glb": (instances(1008), "5,040,000 triangles"),
    "objects.gltf": (b'{"asset":{"version":"2.0"},"nodes":[' + b"{}," * 1_100_000 + b"{}]}", "objects"),
    "corners.obj": (b"v 0 0 0\nf" + b" 1" * 500_000, "more than 100,000 corners"),
    "line.obj": (b"v " + b"1 " * 1_200_000, "a line of"),
    "lines.obj": (b"\n" * 6_100_000, "6,100,000 lines"),
    "lines.ply": (ASCII_PLY + b"0\f" * 6_100_000, "lines"),
    "lines.off": (b"OFF\n3 1 0\n" + b"0\r" * 6_100_000, "lines"),
    "corners.stl": (b"solid x\n" + b"vertex \n" * 1_000_000, "0 facets and 1,000,000 corners"),
}
HUGE = {
    "concave.obj": concave(5000, 60),
    "newlines.zip": zipped("n.obj", 1 << 30),
    "model.3mf": zipped("3D/3dmodel.model", 1 << 30),
    "vertices.obj": b"v 0 0 0\n" * 5_900_000 + b"f 1 2 3\n",
    "spaces.obj": b" " * (127 << 20),
    "remark.obj": b"v 0 0 0 " + b"#" * (120 << 20),
    "lines.ply": ASCII_PLY + b"0\n" * 60_000_000,
    "corners.stl": b"solid x\n" + b"vertex\n" * 17_000_000,
    "facets.stl": b"solid x\n" + b"facet normal vertex vertex vertex endfacet\n" * 3_000_000,
    "numbers.gltf": b'{"asset":{"version":"2.0"},"extras":[' + b"1," * 60_000_000 + b"1]}",
    "deep.gltf": b'{"asset":{"version":"2.0"},"extras":' + b"[" * 900_000,
    "aliased.glb": aliased(3000),
}


def put(path, content):
    if callable(content):
        content(path)
    else:
        path.write_bytes(content)
    return path


@pytest.mark.parametrize("name", BOMBS)
def test_what_would_unfold_is_refused(tmp_path, name):
    content, message = BOMBS[name]
    with pytest.raises(ValueError, match=message) as caught:
        load(put(tmp_path / name, content))
    assert "\n" not in str(caught.value)


MEASURE = """
import resource, sys, time, warnings
from shadowjax import load
warnings.simplefilter("ignore")
try:
    load(sys.argv[1])
except ValueError as error:
    assert "\\n" not in str(error)
usage = resource.getrusage(resource.RUSAGE_SELF)
print(usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1024)
"""


@pytest.mark.long
@pytest.mark.parametrize("name", HUGE)
def test_the_largest_are_refused_in_bounded_time_and_memory(tmp_path, name):
    path = put(tmp_path / name, HUGE[name])
    done = subprocess.run(
        [sys.executable, "-c", MEASURE, path], capture_output=True, text=True, timeout=120, check=True
    )
    seconds, mebibytes = map(float, done.stdout.split())
    assert seconds < SECONDS
    assert mebibytes < MEBIBYTES
