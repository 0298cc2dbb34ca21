"""Damaged files: whatever the bytes, there is a mesh of finite numbers, or a ValueError of one line, soon."""

import base64
import json
import random
import re
import time
import warnings

import mesh_bytes
import numpy as np
import pytest
from mesh_bytes import BOX_CORNERS, BOX_FACES, Gltf, box_glb, png

from shadowjax import load

SECONDS = 15
QUADS = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]


def full_glb():
    """A tree with a bit of everything."""
    made = Gltf()
    box, strip = made.box(material=0), made.box(mode=5)
    box["attributes"]["TEXCOORD_0"] = made.array(np.full((8, 2), 0.3))
    box["attributes"]["COLOR_0"] = made.array(np.full((8, 4), 200), "u1", normalized=True)
    made.tree["accessors"][0]["sparse"] = {
        "count": 1,
        "indices": {"bufferView": made.view(b"\x07\x00"), "componentType": 5123},
        "values": {"bufferView": made.view(np.ones(3, "<f4").tobytes())},
    }
    texture = {"baseColorFactor": [0.5, 0.6, 0.7, 1.0], "baseColorTexture": {"index": 0}}
    made.tree |= {
        "images": [{"bufferView": made.view(png(np.full((2, 2, 3), 99)))}], "textures": [{"source": 0, "sampler": 0}],
        "samplers": [{"wrapS": 33071}], "materials": [{"pbrMetallicRoughness": texture, "name": "wood"}],
    }  # fmt: skip
    made.show(box, strip)
    made.tree["nodes"] = [{"children": [1], "scale": [1, 2, 3]}, {"mesh": 0, "rotation": [0, 0.6, 0, 0.8]}]
    return made


def embedded_gltf():
    made = full_glb()
    return made.gltf("data:application/octet-stream;base64," + base64.b64encode(made.blob).decode())


SHADES = np.full((8, 3), 120)
SEEDS = {
    "triangles.obj": mesh_bytes.obj(BOX_CORNERS, BOX_FACES),
    "quads.obj": mesh_bytes.obj(BOX_CORNERS, QUADS, "mtllib looks.mtl\nusemtl red\n") + b"vt 0 0\nf -1/-1 -2/1 -3/1\n",
    "ascii.ply": mesh_bytes.ply(BOX_CORNERS, QUADS, colors=SHADES),
    "binary.ply": mesh_bytes.ply(BOX_CORNERS, BOX_FACES, binary=True, colors=SHADES),
    "binary.stl": mesh_bytes.stl(BOX_CORNERS, BOX_FACES),
    "ascii.stl": mesh_bytes.stl(BOX_CORNERS, BOX_FACES, binary=False),
    "quads.off": mesh_bytes.off(BOX_CORNERS, QUADS),
    "box.glb": box_glb(),
    "full.glb": full_glb().glb(),
    "full.gltf": embedded_gltf(),
}
WORDS = [b"nan", b"inf", b"-1", b"0", b"1e999", b"99999999999999999999", b"4294967295", b"\xff\xfe", b"\0", b"", b"-",
         b"{", b'"', b"\xe9", b"1.5", b"true", b"null", b"[]", b"-inf"]  # fmt: skip


def cut(data, rng):
    return data[: rng.randrange(len(data))]


def flipped(data, rng):
    changed = bytearray(data)
    for _ in range(rng.choice([1, 3, 30])):
        changed[rng.randrange(len(changed))] = rng.randrange(256)
    return bytes(changed)


def swapped(data, rng):
    start, size = rng.randrange(len(data)), 4 * rng.randrange(1, 20)
    part = data[start : start + size]
    words = [part[i : i + 4][::-1] for i in range(0, len(part), 4)]
    return data[:start] + b"".join(words) + data[start + size :]


def worded(data, rng):
    """Some words of a text are others: numbers that are none, or too large, or negative."""
    words = data.split(b" ")
    for _ in range(rng.choice([1, 2, 8])):
        words[rng.randrange(len(words))] = rng.choice(WORDS)
    return b" ".join(words)


def numbered(data, rng):
    """Some numbers of a text, digit by digit, are others."""
    spans = [match.span() for match in re.finditer(rb"\d+", data[:4000])]
    start, end = rng.choice(spans or [(0, 0)])
    return data[:start] + rng.choice(WORDS) + data[end:]


def shuffled(data, rng):
    lines = data.split(b"\n")
    rng.shuffle(lines)
    return b"\n".join(lines)


def lines_changed(data, rng):
    lines = data.split(b"\n")
    index = rng.randrange(len(lines))
    change = rng.choice([[], [lines[index]] * 3, [b"f 1"], [lines[index] * 2], [b""] * 9])
    return b"\n".join([*lines[:index], *change, *lines[index + 1 :]])


def dressed(data, rng):
    return rng.choice(
        [lambda d: b"\xef\xbb\xbf" + d, lambda d: d.replace(b"\n", b"\r\n"), lambda d: d.replace(b"\n", b"\r"),
         lambda d: d.decode("latin-1").encode("utf-16"), lambda d: b"", lambda d: d + d, lambda d: d + b"\0" * 99,
         lambda d: b"#\xff\n" + d, lambda d: bytes(len(d))]
    )(data)  # fmt: skip


def rewired(data, rng):
    """A leaf of the JSON of a .glb becomes something else; the chunk's length is put right."""
    made = full_glb()
    holders, waiting = [], [made.tree]
    while waiting:
        holder = waiting.pop()
        for key, value in holder.items() if isinstance(holder, dict) else enumerate(holder):
            holders.append((holder, key))
            if isinstance(value, dict | list):
                waiting.append(value)
    for _ in range(rng.choice([1, 1, 2, 5])):
        holder, key = rng.choice(holders)
        if key in holder or isinstance(holder, list):
            holder[key] = rng.choice(
                [-1, 0, 3, 10**9, 2**40, 1e300, True, None, "x", [], {}, [0, 1], [None], {"index": 0}, "../x", 5125]
            )
    try:
        return made.glb()
    except (TypeError, AttributeError):  # what was changed is what the writer needs
        return json.dumps(made.tree).encode()


CHANGES = [cut, flipped, swapped, worded, numbered, shuffled, lines_changed, dressed]


def case(number):
    """Name and bytes of a damaged file; the same for a number, always."""
    rng = random.Random(number)
    name = list(SEEDS)[number % len(SEEDS)]
    data = SEEDS[name]
    for _ in range(rng.choice([1, 1, 2])):
        change = rewired if name == "full.glb" and rng.random() < 0.7 else rng.choice(CHANGES)
        data = change(data, rng) if data else data
    ending = rng.choice([name.split(".")[1]] * 9 + ["obj", "ply", "stl", "off", "glb", "zip"])
    return f"{number}.{ending}", data


def judge(folder, number):
    name, data = case(number)
    path = folder / name
    path.write_bytes(data)
    start = time.process_time()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # what is left out is said
            mesh = load(path)
    except ValueError as error:
        message = str(error)
        assert "\n" not in message
        assert len(message) < 1200
        assert name in message
    else:
        vertices, faces, colors = (np.asarray(a) for a in (mesh.vertices, mesh.faces, mesh.face_colors))
        assert np.isfinite(vertices).all()
        assert np.isfinite(mesh.origin).all()
        assert faces.min() >= 0
        assert faces.max() < len(vertices)
        assert colors.min() >= 0
        assert colors.max() <= 1
    assert time.process_time() - start < SECONDS


@pytest.mark.parametrize("block", range(8))
def test_damaged_files_are_read_or_refused(tmp_path, block):
    for number in range(40 * block, 40 * block + 40):
        judge(tmp_path, number)


@pytest.mark.long
@pytest.mark.parametrize("block", range(40))
def test_many_damaged_files_are_read_or_refused(tmp_path, block):
    for number in range(100_000 + 250 * block, 100_000 + 250 * block + 250):
        judge(tmp_path, number)
