"""Files of strangers: each kind of thing that a reader takes for something else, and what is right, in every format."""

import os
import socket

import jax.numpy as jnp
import mesh_bytes
import numpy as np
import pytest
import trimesh
from mesh_bytes import BOX_CORNERS, BOX_FACES, Gltf, box_glb, png

from shadowjax import Mesh, load
from shadowjax.geometry.mesh_files import READERS, ear_clipping
from shadowjax.geometry.mesh_files.ear_clipping import EarClipper


def written(folder, name, data):
    """A file with these bytes."""
    path = folder / name
    path.write_bytes(data if isinstance(data, bytes) else data.encode())
    return path


def area(mesh):
    a, b, c = np.moveaxis(np.asarray(mesh.vertices, float)[np.asarray(mesh.faces)], 1, 0)
    return 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=-1).sum()


def volume(mesh):
    return np.linalg.det(np.asarray(mesh.vertices, float)[np.asarray(mesh.faces)]).sum() / 6


def srgb(value):
    return np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4)


# Faces of many corners.

PENTAGON = np.array([[0, 0, 0], [4, 0, 0], [4, 3, 0], [2, 0.5, 0], [0, 3, 0]])  # area 7
UP = np.array([0.0, 0, 1])
DART = np.array([[0, 0, 0], [2, 1, 0], [0, 4, 0], [1, 1, 0]])  # reflex at the last corner; area 2
COMB = np.array([[0, 0, 0], [7, 0, 0], [7, 5, 0], [6, 1, 0], [5, 5, 0], [4, 1, 0], [3, 5, 0], [2, 1, 0], [0, 5, 0]])
FLAT_STAR = np.stack([*(np.where(np.arange(14) % 2, 0.4, 1.0) * f(np.pi * np.arange(14) / 7) for f in (np.cos, np.sin)),
                      np.zeros(14)], axis=-1)  # fmt: skip
KEYHOLE = np.array([[0, 0, 0], [6, 0, 0], [6, 6, 0], [0, 6, 0], [0, 0, 0], [2, 2, 0], [2, 4, 0], [4, 4, 0], [4, 2, 0],
                    [2, 2, 0]])  # fmt: skip


def enclosed(polygon):
    """Area of a polygon in any plane, by the shoelace formula."""
    return 0.5 * np.linalg.norm(np.cross(polygon, np.roll(polygon, -1, axis=0)).sum(axis=0))


POLYGONS = {"pentagon": PENTAGON, "dart": DART, "comb": COMB, "star": FLAT_STAR, "keyhole": KEYHOLE}
WRITERS = {
    "obj": mesh_bytes.obj, "off": mesh_bytes.off, "ply": mesh_bytes.ply,
    "binary.ply": lambda *shape: mesh_bytes.ply(*shape, binary=True),
}  # fmt: skip


@pytest.mark.parametrize("turn", [np.eye(3), np.array([[0.36, 0.48, -0.8], [-0.8, 0.6, 0.0], [0.48, 0.64, 0.6]])])
@pytest.mark.parametrize("polygon", POLYGONS.values(), ids=POLYGONS)
def test_a_concave_polygon_is_covered_once_from_every_corner_and_side(polygon, turn):
    for corners in (polygon, polygon[::-1]):
        for start in range(len(corners)):
            points = np.roll(corners, start, axis=0) @ turn.T + [5.0, -3.0, 2.0]
            clipper = EarClipper()
            (triangles,) = clipper.cut(points[None])
            a, b, c = np.moveaxis(points[triangles], 1, 0)
            normals = np.cross(b - a, c - a)
            np.testing.assert_allclose(np.linalg.norm(normals, axis=-1).sum() / 2, enclosed(polygon), rtol=1e-12)
            # all turn the polygon's way, so none lies over another
            whole = np.cross(points - points[0], np.roll(points, -1, axis=0) - points[0]).sum(axis=0)
            assert (normals @ whole >= -1e-9).all()
            assert clipper.crossing == 0
            assert set(triangles.reshape(-1).tolist()) == set(range(len(points)))


@pytest.mark.parametrize("ending", WRITERS)
@pytest.mark.parametrize("polygon", [PENTAGON, DART], ids=["pentagon", "dart"])
def test_concave_faces_keep_their_area_in_every_format(tmp_path, polygon, ending):
    for start in range(len(polygon)):
        faces = [list(np.roll(np.arange(len(polygon)), start))]
        mesh = load(written(tmp_path, f"{start}.{ending}", WRITERS[ending](polygon, faces)))
        assert mesh.num_faces == len(polygon) - 2
        np.testing.assert_allclose(area(mesh), enclosed(polygon), rtol=1e-6)


@pytest.mark.parametrize("ending", ["obj", "off", "ply"])
def test_faces_of_many_sizes_stand_in_one_file(tmp_path, ending):
    vertices = np.concatenate([PENTAGON, DART + UP, [[0, 0, 2], [1, 0, 2], [0, 1, 2]]])
    faces = [list(range(5)), list(range(5, 9)), list(range(9, 12))]
    mesh = load(written(tmp_path, f"mixed.{ending}", WRITERS[ending](vertices, faces)))
    assert mesh.num_faces == 6
    np.testing.assert_allclose(area(mesh), 7 + 2 + 0.5, rtol=1e-6)


def test_a_binary_ply_of_many_sizes_is_refused(tmp_path):
    vertices = np.concatenate([PENTAGON, DART + UP])
    for faces in ([list(range(5)), list(range(5, 9))], [[0, 1, 2, 3], [0, 1, 2, 3, 4], [6, 7, 8]]):
        with pytest.raises(ValueError, match=r"unexpected length|triangulate"):
            load(written(tmp_path, "mixed.ply", mesh_bytes.ply(vertices, faces, binary=True)))


def test_colours_stay_with_the_faces_that_are_cut(tmp_path):
    text = mesh_bytes.ply(np.concatenate([PENTAGON, DART + UP]), [[5, 6, 7, 8], [0, 1, 2, 3, 4]]).decode()
    text = text.replace("vertex_indices\n", "vertex_indices\nproperty uchar red\nproperty uchar green\n"
                        "property uchar blue\n").replace("4 5 6 7 8", "4 5 6 7 8 255 0 0").replace(
                            "5 0 1 2 3 4", "5 0 1 2 3 4 0 0 255")  # fmt: skip
    mesh = load(written(tmp_path, "colours.ply", text))
    assert mesh.face_colors.tolist() == [[1, 0, 0]] * 2 + [[0, 0, 1]] * 3


def test_a_face_that_crosses_itself_is_said(tmp_path):
    bow = np.array([[0, 0, 0], [2, 2, 0], [2, 0, 0], [0, 1, 0]])
    with pytest.warns(UserWarning, match="1 faces cross themselves"):
        load(written(tmp_path, "bow.obj", mesh_bytes.obj(bow, [[0, 1, 2, 3]])))


def test_a_bomb_of_concave_corners_is_refused(monkeypatch):
    monkeypatch.setattr(ear_clipping, "MAX_STEPS", 100_000)
    angles = np.linspace(0, 2 * np.pi, 1000, endpoint=False)
    radius = np.where(np.arange(1000) % 2, 0.99, 1.0)
    star = np.stack([radius * np.cos(angles), radius * np.sin(angles), 0 * angles], axis=-1)
    with pytest.raises(ValueError, match="too many corners; triangulate"):
        EarClipper().cut(star[None])


# OBJ.

OBJ_TRIANGLES = "v 0 0 0\nv 1 0 0\nv 0 1 0\n{first}\nv 5 0 0\nv 6 0 0\nv 5 1 0\n{second}\n"


@pytest.mark.parametrize(
    "indices",
    [("f -3 -2 -1", "f -3 -2 -1"), ("f 1 2 3", "f -3 -2 -1"), ("f -3 -2 3", "f 4 -2 6"), ("f 1 2 3", "f 4 5 6")],
)
def test_negative_indices_count_back_from_where_they_stand(tmp_path, indices):
    mesh = load(written(tmp_path, "back.obj", OBJ_TRIANGLES.format(first=indices[0], second=indices[1])))
    corners = np.asarray(mesh.vertices)[np.asarray(mesh.faces)]
    np.testing.assert_array_equal(corners[:, :, 0], [[0, 1, 0], [5, 6, 5]])


@pytest.mark.parametrize(
    "change",
    [
        lambda text: text.replace("\n", "\r\n"),
        lambda text: text.replace("\n", "\r"),
        lambda text: text.replace(" ", "\t"),
        lambda text: "".join("   " + line + "   # a remark\n" for line in text.splitlines()),
        lambda text: text.replace("f 1 ", "f 1 \\\n  "),
        lambda text: "\ufeff" + text,
        lambda text: "# mtllib none.mtl\n# usemtl gold\n" + text.replace("v ", "v   "),
        lambda text: text.replace("f 1 2 3", "f 1//1 2//1 3//1") + "vn 0 0 1\n",
        lambda text: text.replace("f 1 2 3", "f 1/1 2/1 3/1") + "vt 0 0\n",
        lambda text: text.replace("f 1 2 3", "usemtl unknown\nf 1 2 3") + "o body \xe9\n",
    ],
    ids=["crlf", "cr", "tabs", "indented", "continued", "mark", "remarks", "normals", "textures", "unknown material"],
)
def test_ways_of_writing_an_obj_are_one(tmp_path, change):
    text = change(OBJ_TRIANGLES.format(first="f 1 2 3", second="f 4 5 6"))
    mesh = load(written(tmp_path, "written.obj", text.encode("latin-1") if "\xe9" in text else text))
    assert mesh.num_faces == 2
    corners = np.asarray(mesh.vertices)[np.asarray(mesh.faces)]
    assert sorted(corners[:, :, 0].sum(axis=1).tolist()) == [1, 16]


@pytest.mark.parametrize(
    ("face", "message"),
    [
        ("f 0 1 2", "index 0"), ("f 1 2 9", r"\[1, 3\]"), ("f -4 1 2", "index -4"), ("f 1 2 3 9", "got 9"),
        ("f a b c", "cannot be read"), ("f 1 2", "1 2|no triangles"),
    ],
)  # fmt: skip
def test_indices_that_point_at_nothing_are_refused(tmp_path, face, message):
    path = written(tmp_path, "bad.obj", f"v 0 0 0\nv 1 0 0\nv 0 1 0\n{face}\n")
    with pytest.raises(ValueError, match=message):
        load(path)


MATERIALS = """newmtl red
Kd 0.5 0 0
newmtl {clear}
Kd 0 0.5 0
{alpha}
newmtl  two   words
Kd 0 0 0.5
newmtl painted
Kd 0.5 1 1
map_Kd -s 1 1 1 wood.png
"""
QUADS = """mtllib {library}
v 0 0 0
v 1 0 0
v 0 1 0
vt 0.75 0.25
usemtl red
f 1 2 3
usemtl two words
f 2 1 3
usemtl nowhere
f 3 1 2
usemtl painted
f 1/1 2/1 3/1
usemtl {clear}
f 3 2 1
"""


def test_materials_of_an_obj(tmp_path):
    written(tmp_path, "looks.mtl", MATERIALS.format(clear="green", alpha="d 1.0"))
    written(tmp_path, "wood.png", png([[[0, 0, 0], [0, 0, 0]], [[0, 0, 0], [128, 255, 64]]]))
    mesh = load(written(tmp_path, "looks.obj", QUADS.format(clear="green", library="looks.mtl")))
    half = float(srgb(0.5))
    texel = srgb(np.array([128, 255, 64]) / 255) * [half, 1, 1]
    expected = [[half, 0, 0], [0, 0, half], [0.75] * 3, texel.tolist(), [0, half, 0]]
    got = np.asarray(mesh.face_colors, float)
    np.testing.assert_allclose(got[np.lexsort(got.T)], np.array(expected)[np.lexsort(np.array(expected).T)], rtol=1e-6)


@pytest.mark.parametrize("alpha", ["d 0.4", "Tr 0.6", "map_d holes.png"])
def test_transparent_materials_of_an_obj_are_named(tmp_path, alpha):
    written(tmp_path, "looks.mtl", MATERIALS.format(clear="stained glass", alpha=alpha))
    written(tmp_path, "wood.png", png([[[0, 0, 0]]]))
    with pytest.warns(UserWarning, match="cast whole shadows: stained glass"):
        load(written(tmp_path, "looks.obj", QUADS.format(clear="stained glass", library="looks.mtl")))


def test_a_missing_library_leaves_the_documented_grey(tmp_path):
    text = QUADS.format(clear="green", library="nowhere.mtl")
    mesh = load(written(tmp_path, "looks.obj", text))
    np.testing.assert_array_equal(mesh.face_colors, np.full((5, 3), np.float32(0.75), mesh.face_colors.dtype))


def test_points_and_lines_of_an_obj_are_said(tmp_path):
    with pytest.warns(UserWarning, match="2 points, lines"):
        load(written(tmp_path, "more.obj", mesh_bytes.obj(BOX_CORNERS, BOX_FACES) + b"l 1 2\np 1\n"))


# glTF: what stands in the scene.


def fan(count=10):
    """Corners of a flat fan of count − 2 triangles about its first corner; a regular polygon has a known area."""
    angles = 2 * np.pi * np.arange(count - 1) / (count - 2)
    rim = np.stack([np.cos(angles), 0 * angles, -np.sin(angles)], axis=-1)
    return np.concatenate([[[0, 0, 0]], rim])


@pytest.mark.parametrize("indexed", [False, True])
def test_fans_and_strips_are_read_beside_triangles(tmp_path, indexed):
    made, points = Gltf(), fan()
    ribbon = np.array([[i // 2, 3, i % 2] for i in range(8)], float)
    more = {"indices": made.array(np.arange(10), "u1")} if indexed else {}
    strip_more = {"indices": made.array(np.arange(8), "u2")} if indexed else {}
    mesh = load(written(tmp_path, "modes.glb", made.show(
        made.box(mode=4), {"attributes": {"POSITION": made.array(points)}, "mode": 6, **more},
        {"attributes": {"POSITION": made.array(ribbon)}, "mode": 5, **strip_more},
    ).glb()))  # fmt: skip
    assert mesh.num_faces == 12 + 8 + 6
    polygon = 8 * 0.5 * np.sin(2 * np.pi / 8)
    np.testing.assert_allclose(area(mesh), 6 + polygon + 3, rtol=1e-6)
    a, b, c = np.moveaxis(np.asarray(mesh.vertices, float)[np.asarray(mesh.faces)], 1, 0)
    up = np.cross(b - a, c - a)[12:, 1]
    assert (up[:8] > 0).all()  # the fan turns one way, and so does the strip
    assert len(set(np.sign(up[8:]).tolist())) == 1


@pytest.mark.parametrize("mode", [0, 1, 2, 3])
def test_points_and_lines_of_a_gltf_are_said(tmp_path, mode):
    made = Gltf()
    data = made.show(made.box(), {"attributes": {"POSITION": made.array(BOX_CORNERS)}, "mode": mode}).glb()
    with pytest.warns(UserWarning, match="1 primitives of points, lines"):
        assert load(written(tmp_path, "lines.glb", data)).num_faces == 12
    made = Gltf()
    data = made.show({"attributes": {"POSITION": made.array(BOX_CORNERS)}, "mode": mode}).glb()
    with pytest.raises(ValueError, match="no triangles"):
        load(written(tmp_path, "only.glb", data))


def test_mirrors_nested_in_turns_keep_normals_outward(tmp_path):
    made = Gltf()
    made.show(made.box())
    made.tree["nodes"] = [
        {"children": [1, 2], "scale": [1, 1, -2], "translation": [5, 0, 0]},
        {"mesh": 0, "scale": [-1, 1, 1], "rotation": [0, 0.6, 0, 0.8]},
        {"mesh": 0, "matrix": [0, 1, 0, 0, 1, 0, 0, 0, 0, 0, 1, 0, 9, 9, 9, 1], "camera": 0, "name": "0"},
    ]
    made.tree["cameras"] = [{"type": "perspective", "perspective": {"yfov": 1, "znear": 1}}]
    mesh = load(written(tmp_path, "mirror.glb", made.glb()))
    assert mesh.num_faces == 24
    np.testing.assert_allclose(volume(mesh), 4.0, rtol=1e-5)


def test_only_the_scene_shown_is_read_and_a_file_without_scenes_shows_all(tmp_path):
    made = Gltf()
    made.show(made.box())
    made.tree |= {"scene": 1, "scenes": [{"nodes": [0]}, {"nodes": [1]}]}
    made.tree["nodes"] = [{"mesh": 0}, {"mesh": 0, "translation": [9, 0, 0]}]
    mesh = load(written(tmp_path, "second.glb", made.glb()))
    assert (mesh.num_faces, np.asarray(mesh.vertices)[:, 0].min()) == (12, 9)
    del made.tree["scene"], made.tree["scenes"]
    assert load(written(tmp_path, "none.glb", made.glb())).num_faces == 24
    del made.tree["nodes"]
    assert load(written(tmp_path, "no_nodes.glb", made.glb())).num_faces == 12


@pytest.mark.parametrize(
    "nodes",
    [
        [{"children": [1]}, {"children": [0], "mesh": 0}], [{"children": [1, 1]}, {"mesh": 0}],
        [{"children": [0], "mesh": 0}], [{"children": [9], "mesh": 0}],
    ],
)  # fmt: skip
def test_nodes_that_are_no_tree_are_refused(tmp_path, nodes):
    made = Gltf()
    made.show(made.box())
    made.tree["nodes"] = nodes
    with pytest.raises(ValueError, match=r"must form a tree|nodes; it points"):
        load(written(tmp_path, "circle.glb", made.glb()))


def test_a_deep_chain_of_nodes_is_multiplied_out(tmp_path):
    made = Gltf()
    made.show(made.box())
    made.tree["nodes"] = [{"children": [i + 1], "translation": [0.5, 0, 0]} for i in range(3000)] + [{"mesh": 0}]
    mesh = load(written(tmp_path, "deep.glb", made.glb()))
    np.testing.assert_allclose(np.asarray(mesh.vertices)[:, 0] + mesh.origin[0], 1500 + BOX_CORNERS[:, 0], rtol=1e-6)


@pytest.mark.parametrize(
    "name", ["EXT_mesh_gpu_instancing", "EXT_meshopt_compression", "KHR_texture_basisu", "VENDOR_of_tomorrow"]
)
def test_a_required_extension_that_is_not_read_is_named(tmp_path, name):
    made = Gltf(extensionsRequired=[name], extensionsUsed=[name])
    with pytest.raises(ValueError, match=f"requires the glTF extension {name}"):
        load(written(tmp_path, "asks.glb", made.show(made.box()).glb()))


def test_draco_without_its_decoder_is_refused_even_where_it_is_not_required(tmp_path, monkeypatch):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    for required in ([], ["KHR_draco_mesh_compression"]):
        made = Gltf(extensionsUsed=["KHR_draco_mesh_compression"], extensionsRequired=required)
        box = made.box(extensions={"KHR_draco_mesh_compression": {"bufferView": 0, "attributes": {"POSITION": 0}}})
        for index in (box["attributes"]["POSITION"], box["indices"]):
            del made.tree["accessors"][index]["bufferView"]
        with pytest.raises(ValueError, match=r"KHR_draco_mesh_compression.*pip install 'shadowjax\[meshes\]'"):
            load(written(tmp_path, "pressed.glb", made.show(box).glb()))


def test_an_extension_that_is_only_used_is_said(tmp_path):
    made = Gltf()
    instancing = {"EXT_mesh_gpu_instancing": {"attributes": {}}}
    with pytest.warns(UserWarning, match="EXT_mesh_gpu_instancing are left out"):
        load(written(tmp_path, "used.glb", made.show(made.box(), extensions=instancing).glb()))


# glTF: numbers.


def test_quantised_positions_are_what_they_stand_for(tmp_path):
    made = Gltf(extensionsRequired=["KHR_mesh_quantization"])
    whole = np.round(BOX_CORNERS * 32767)
    positions = made.array(whole, "i2", normalized=True, min=[0] * 3, max=[32767] * 3)
    box = made.box()
    box["attributes"]["POSITION"] = positions
    mesh = load(written(tmp_path, "short.glb", made.show(box, scale=[2, 2, 2]).glb()))
    np.testing.assert_allclose(mesh.vertices, 2 * BOX_CORNERS, atol=1e-6)
    made.tree["accessors"][positions]["normalized"] = False
    assert np.asarray(load(written(tmp_path, "whole.glb", made.glb())).vertices).max() == 65534


@pytest.mark.parametrize("base", [True, False])
def test_sparse_positions_are_put_in(tmp_path, base):
    made = Gltf()
    box = made.box()
    accessor = made.tree["accessors"][box["attributes"]["POSITION"]]
    rows = [1, 7] if base else list(range(8))
    wanted = BOX_CORNERS.copy()
    wanted[[1, 7], 2] = 5.0
    accessor["sparse"] = {
        "count": len(rows),
        "indices": {"bufferView": made.view(np.array(rows, "<u2").tobytes()), "componentType": 5123},
        "values": {"bufferView": made.view(wanted[rows].astype("<f4").tobytes())},
    }
    accessor["max"] = [1.0, 1.0, 5.0]
    if not base:
        del accessor["bufferView"]
    mesh = load(written(tmp_path, "sparse.glb", made.show(box).glb()))
    np.testing.assert_array_equal(mesh.vertices, wanted)


def test_interleaved_numbers_are_taken_apart(tmp_path):
    made = Gltf()
    both = np.concatenate([BOX_CORNERS, BOX_CORNERS + 100], axis=1).astype("<f4")
    box = made.box()
    view = made.view(both.tobytes())
    made.tree["bufferViews"][view]["byteStride"] = 24
    made.tree["accessors"][box["attributes"]["POSITION"]] |= {"bufferView": view, "byteOffset": 0}
    np.testing.assert_array_equal(load(written(tmp_path, "strided.glb", made.show(box).glb())).vertices, BOX_CORNERS)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda tree: tree["accessors"][0].update(count=10**9), "declares 1,000,000,000 elements"),
        (lambda tree: tree["accessors"][0].update(count=9), r"declares 9 elements, 108 bytes.*holds 96"),
        (lambda tree: tree["accessors"][0].update(count=-1), "whole number"),
        (lambda tree: [tree["accessors"][0].pop("bufferView"), tree["accessors"][0].update(count=10**8)], "elements"),
        (lambda tree: tree["accessors"][0].update(max=[2.0, 1.0, 1.0]), "do not fill the bounds"),
        (lambda tree: tree["accessors"][0].update(max=[1.0, 0.5, 1.0]), "do not fill the bounds"),
        (lambda tree: tree["accessors"][0].update(type="VEC2"), "three coordinates|cannot be read"),
        (lambda tree: tree["bufferViews"][0].update(byteLength=10**12), "declares bytes 0 to 1000000000000"),
        (lambda tree: tree.update(buffers=[{"byteLength": 10**6}]), "declares 1,000,000 bytes"),
        (lambda tree: tree["meshes"][0]["primitives"][0].update(indices=7), r"points at accessors\[7\]"),
        (lambda tree: tree["nodes"][0].update(matrix=[float("nan")] * 16), "cannot be read|NaN"),
        (lambda tree: tree["nodes"][0].update(scale=[0, 0, 0]), "lie in one point"),
        (lambda tree: tree["asset"].update(version="1.0"), "only glTF 2"),
        (lambda tree: tree.update(nodes=[{"mesh": 0}] * 2, meshes=5), "meshes are not a list"),
    ],
)
def test_what_a_gltf_declares_is_held_against_what_came(tmp_path, change, message):
    made = Gltf()
    made.show(made.box())
    change(made.tree)
    with pytest.raises(ValueError, match=message) as caught:
        load(written(tmp_path, "claims.glb", made.glb()))
    assert "\n" not in str(caught.value)


# glTF: colours.


def albedo(folder, made, primitive, **tree):
    """The one colour of a file of one primitive."""
    made.tree |= tree
    mesh = load(written(folder, "colour.glb", made.show(primitive).glb()))
    colors = np.unique(np.asarray(mesh.face_colors, float), axis=0)
    assert len(colors) == 1
    return colors[0]


def image(made, pixels):
    """Index of an image in the buffer."""
    made.tree.setdefault("images", []).append({"bufferView": made.view(png(pixels)), "mimeType": "image/png"})
    return len(made.tree["images"]) - 1


def test_factors_are_linear_and_multiply_textures_which_are_not(tmp_path):
    made = Gltf()
    factor = {"pbrMetallicRoughness": {"baseColorFactor": [0.5, 0.25, 0.1, 1]}}
    np.testing.assert_allclose(
        albedo(tmp_path, made, made.box(material=0), materials=[factor]), [0.5, 0.25, 0.1], rtol=1e-6
    )
    made = Gltf()
    box = made.box(material=0)
    box["attributes"]["TEXCOORD_0"] = made.array(np.full((8, 2), [0.75, 0.25]))
    source = image(made, [[[9, 9, 9], [128, 20, 255]], [[9, 9, 9], [9, 9, 9]]])
    factor["pbrMetallicRoughness"]["baseColorTexture"] = {"index": 0}
    expected = srgb(np.array([128, 20, 255]) / 255) * [0.5, 0.25, 0.1]
    got = albedo(tmp_path, made, box, materials=[factor], textures=[{"source": source}])
    np.testing.assert_allclose(got, expected, rtol=1e-6)
    box["attributes"]["COLOR_0"] = made.array(np.full((8, 4), [51, 255, 0, 255]), "u1", normalized=True)
    np.testing.assert_allclose(albedo(tmp_path, made, box), expected * [0.2, 1, 0], rtol=1e-6)


@pytest.mark.parametrize(("kind", "most"), [("f4", 1.0), ("u2", 65535), ("u1", 255)])
def test_colours_of_corners_are_linear(tmp_path, kind, most):
    made = Gltf()
    box = made.box()
    box["attributes"]["COLOR_0"] = made.array(np.full((8, 3), 0.4 * most), kind, normalized=kind != "f4")
    np.testing.assert_allclose(albedo(tmp_path, made, box), 0.4, rtol=1e-4)


def test_texture_coordinates_of_any_channel_are_moved_and_wrapped(tmp_path):
    pixels = np.arange(16).reshape(4, 4, 1) * [10, 1, 0]

    def lookup(coordinates, info=None, sampler=None, kind="f4"):
        made = Gltf()
        box = made.box(material=0)
        box["attributes"]["TEXCOORD_0"] = made.array(np.zeros((8, 2)))
        box["attributes"]["TEXCOORD_1"] = made.array(np.full((8, 2), coordinates), kind, normalized=kind != "f4")
        texture = {"index": 0, "texCoord": 1, **(info or {})}
        got = albedo(
            tmp_path, made, box, materials=[{"pbrMetallicRoughness": {"baseColorTexture": texture}}],
            textures=[{"source": image(made, pixels), **({"sampler": 0} if sampler else {})}], samplers=[sampler or {}],
        )  # fmt: skip
        (where,) = np.argwhere(np.abs(srgb(pixels / 255) - got).max(axis=-1) < 1e-6)
        return where.tolist()

    assert lookup([0.3, 0.6]) == [2, 1]
    assert lookup([1.3, -0.4]) == [2, 1]
    assert lookup([1.3, -0.4], sampler={"wrapS": 33071, "wrapT": 33071}) == [0, 3]
    assert lookup([1.3, -0.4], sampler={"wrapS": 33648, "wrapT": 33648}) == [1, 2]
    assert lookup([round(0.3 * 65535), round(0.6 * 65535)], kind="u2") == [2, 1]
    moved = {"extensions": {"KHR_texture_transform": {"offset": [0.25, 0], "scale": [2, 0.5], "texCoord": 1}}}
    assert lookup([0.3, 0.6], moved) == [1, 3]


@pytest.mark.parametrize("mode", ["MASK", "BLEND"])
def test_cut_out_materials_are_named(tmp_path, mode):
    made = Gltf(materials=[{"name": "leaves", "alphaMode": mode}, {"name": "unused", "alphaMode": mode}])
    with pytest.warns(UserWarning, match="cast whole shadows: leaves$"):
        load(written(tmp_path, "leaves.glb", made.show(made.box(material=0)).glb()))


def test_without_a_material_the_documented_grey_is_used(tmp_path):
    made = Gltf()
    box = made.box()
    box["attributes"]["TEXCOORD_0"] = made.array(np.zeros((8, 2)))
    np.testing.assert_array_equal(albedo(tmp_path, made, box), np.float32(0.75))


def test_a_texture_that_is_broken_or_missing_is_said(tmp_path):
    for uri in ("nowhere.png", "broken.png"):
        written(tmp_path, "broken.png", png(np.zeros((40, 40, 3)))[:60])
        made = Gltf(images=[{"uri": uri}], textures=[{"source": 0}])
        box = made.box(material=0)
        box["attributes"]["TEXCOORD_0"] = made.array(np.zeros((8, 2)))
        made.tree["materials"] = [
            {"pbrMetallicRoughness": {"baseColorFactor": [0.5] * 4, "baseColorTexture": {"index": 0}}}
        ]
        with pytest.warns(UserWarning, match=f"{uri}.*the plain colour is used"):
            np.testing.assert_array_equal(albedo(tmp_path, made, box), 0.5)


def test_colours_of_a_ply_are_srgb(tmp_path):
    shades = np.full((8, 3), [188, 51, 0])
    for binary in (False, True):
        data = mesh_bytes.ply(BOX_CORNERS, BOX_FACES, binary, shades)
        mesh = load(written(tmp_path, "colours.ply", data))
        np.testing.assert_allclose(mesh.face_colors[0], srgb(np.array([188, 51, 0]) / 255), rtol=1e-6)


# What files name, and what they are.


@pytest.mark.parametrize(
    ("address", "message"),
    [
        ("../outside.bin", "outside its own folder"),
        ("{tmp}/outside.bin", "outside its own folder"),
        ("http://example.org/a.bin", "addresses are not followed"),
        ("file:///etc/hostname", "addresses are not followed"),
        ("%2e%2e/outside.bin", "outside its own folder"),
        ("..\\outside.bin", "outside its own folder"),
        ("link.bin", "outside its own folder"),
        ("pipe", "is a pipe"),
        ("deep", "is a folder"),
        ("missing.bin", "missing.bin is missing"),
        ("", "no name"),
        ("data:;base64,AAAA", "declares 168 bytes and holds 3"),
    ],
)
def test_only_regular_files_of_the_folder_are_followed(tmp_path, address, message):
    folder = tmp_path / "deep"
    (folder / "deep").mkdir(parents=True)
    made = Gltf()
    made.show(made.box())
    written(tmp_path, "outside.bin", made.blob)
    (folder / "link.bin").symlink_to(tmp_path / "outside.bin")
    os.mkfifo(folder / "pipe")
    with pytest.raises(ValueError, match=message) as caught:
        load(written(folder, "box.gltf", made.gltf(address.format(tmp=tmp_path))))
    assert "\n" not in str(caught.value)
    written(folder / "deep", "inside.bin", made.blob)
    assert load(written(folder, "box.gltf", made.gltf("deep/inside.bin"))).num_faces == 12


@pytest.mark.parametrize(("ending", "text"), [("obj", "mtllib pipe\n"), ("ply", "comment TextureFile pipe\n")])
def test_a_pipe_is_not_waited_for(tmp_path, ending, text):
    os.mkfifo(tmp_path / "pipe")
    if ending == "obj":
        data = mesh_bytes.obj(BOX_CORNERS, BOX_FACES, text)
    else:
        lines = mesh_bytes.ply(BOX_CORNERS, BOX_FACES).decode()
        lines = lines.replace("property float z\n", "property float z\nproperty float s\nproperty float t\n")
        head, body = lines.replace("element vertex", text + "element vertex").split("end_header\n")
        rows = [line + " 0 0" if index < 8 else line for index, line in enumerate(body.splitlines())]
        data = (head + "end_header\n" + "\n".join(rows) + "\n").encode()
    with pytest.raises(ValueError, match="pipe is a pipe"):
        load(written(tmp_path, f"asks.{ending}", data))


def test_what_is_no_regular_file_is_refused(tmp_path, monkeypatch):
    os.mkfifo(tmp_path / "pipe.obj")
    monkeypatch.chdir(tmp_path)  # names of sockets are short
    with socket.socket(socket.AF_UNIX) as listener:
        listener.bind("socket.obj")
        (tmp_path / "device.obj").symlink_to("/dev/zero")
        (tmp_path / "loop.obj").symlink_to("loop.obj")
        for name, kind in {"pipe": "a pipe", "socket": "a socket", "device": "a device", "loop": "no such"}.items():
            with pytest.raises(ValueError, match=kind):
                load(tmp_path / f"{name}.obj")


@pytest.mark.parametrize(
    ("name", "data", "message"),
    [
        ("short.stl", mesh_bytes.stl(BOX_CORNERS, BOX_FACES)[:-7], "declares 12 triangles, 684 bytes, and holds 677"),
        ("long.stl", mesh_bytes.stl(BOX_CORNERS, BOX_FACES) + b"12", "holds 686"),
        ("cut.stl", mesh_bytes.stl(BOX_CORNERS, BOX_FACES, binary=False)[:-80], "cut off|facets"),
        ("cut.off", mesh_bytes.off(BOX_CORNERS, BOX_FACES)[:-20], "declares 8 vertices and 12 faces"),
        ("huge.off", b"OFF\n9999999999 5 0\n0 0 0\n", "declares 9,999,999,999 vertices"),
        ("four.off", b"4OFF\n3 1 0\n0 0 0 1\n1 0 0 1\n0 1 0 1\n3 0 1 2\n", "three coordinates"),
        ("cut.ply", mesh_bytes.ply(BOX_CORNERS, BOX_FACES)[:-20], "declares 12 face elements|cannot be read"),
        ("cut.ply", mesh_bytes.ply(BOX_CORNERS, BOX_FACES, binary=True)[:-5], "unexpected length"),
        ("huge.ply", mesh_bytes.ply(BOX_CORNERS, BOX_FACES).replace(b"vertex 8", b"vertex 8888888888"), "declares 8"),
        ("headless.ply", b"ply\nformat ascii 1.0\n" + b"x" * 99, "no header"),
        ("cut.glb", box_glb()[:-30], r"declares [\d,]+ bytes and holds"),
        ("deep.gltf", b'{"asset":' + b"[" * 200_000, "nested too deep|cannot be read"),
        ("flat.obj", b"v 0 0 0\nv 1 1 1\nv 2 2 2\nf 1 2 3\nf 3 2 1\n", "none of its 2 triangles has an area"),
        ("point.stl", mesh_bytes.stl(np.ones((3, 3)), [[0, 1, 2]]), "lie in one point"),
        ("far.obj", mesh_bytes.obj(1e30 * BOX_CORNERS, BOX_FACES), "scale it down"),
        ("inf.obj", mesh_bytes.obj(BOX_CORNERS, BOX_FACES).replace(b"v 1 1 1", b"v 1 1 1e999"), "infinite"),
    ],
)
def test_what_other_files_declare_is_held_against_what_came(tmp_path, name, data, message):
    with pytest.raises(ValueError, match=message) as caught:
        load(written(tmp_path, name, data), dtype=jnp.float32)
    assert "\n" not in str(caught.value)


def test_the_list_of_endings_names_what_is_read(tmp_path):
    with pytest.raises(ValueError, match="no mesh reader knows") as caught:
        load(written(tmp_path, "mesh.xyz", "0 0 0\n"))
    listed = set(str(caught.value).split("use one of ")[1].replace(" need pip install 'shadowjax[meshes]'", "")
                 .replace(";", ",").replace(" and ", ", ").split(", "))  # fmt: skip
    assert listed == {*READERS, ".zip"}
    for ending in ("xyz", "dxf", "bz2", "tar.gz", "svg", "step", "txt", ""):
        with pytest.raises(ValueError, match="no mesh reader knows"):
            load(written(tmp_path, f"mesh.{ending}", "0 0 0\n"))
    made = {
        ".obj": mesh_bytes.obj(BOX_CORNERS, BOX_FACES), ".off": mesh_bytes.off(BOX_CORNERS, BOX_FACES),
        ".ply": mesh_bytes.ply(BOX_CORNERS, BOX_FACES), ".stl": mesh_bytes.stl(BOX_CORNERS, BOX_FACES),
        ".glb": box_glb(), ".gltf": trimesh.creation.box().export(file_type="glb"),
    }  # fmt: skip
    for ending, data in made.items():
        assert load(written(tmp_path, f"box{ending.upper()}", data)).num_faces == 12


@pytest.mark.parametrize("ending", [".3mf", ".dae"])
def test_formats_of_the_extra_load_or_name_it(tmp_path, ending):
    try:
        data = trimesh.creation.box().export(file_type=ending[1:])
    except Exception:
        with pytest.raises(ValueError, match=r"pip install 'shadowjax\[meshes\]'"):
            load(written(tmp_path, f"box{ending}", b"anything"))
        return
    mesh = load(written(tmp_path, f"box{ending}", data))
    np.testing.assert_allclose(volume(mesh), 1.0, rtol=1e-6)


def test_an_archive_is_read_within_itself(tmp_path):
    import zipfile

    with zipfile.ZipFile(tmp_path / "both.zip", "w") as archive:
        archive.writestr("models/box.obj", mesh_bytes.obj(BOX_CORNERS, BOX_FACES, "mtllib looks.mtl\nusemtl red\n"))
        archive.writestr("models/looks.mtl", "newmtl red\nKd 1 0 0\n")
        archive.writestr("box.glb", box_glb())
        archive.writestr("__MACOSX/._box.glb", b"resource")
        archive.writestr("readme.txt", b"hello")
    mesh = load(tmp_path / "both.zip")
    assert mesh.num_faces == 24
    assert sorted(map(tuple, np.unique(mesh.face_colors, axis=0).tolist())) == [(0.75,) * 3, (1, 0, 0)]
    with zipfile.ZipFile(tmp_path / "empty.zip", "w") as archive:
        archive.writestr("readme.txt", b"hello")
    with pytest.raises(ValueError, match="holds no mesh file"):
        load(tmp_path / "empty.zip")


def test_unused_vertices_do_not_count(tmp_path):
    data = mesh_bytes.ply(np.concatenate([BOX_CORNERS, [[1e6, 0, 0], [np.nan, 0, 0]]]), BOX_FACES)
    mesh = load(written(tmp_path, "stray.ply", data))
    assert (mesh.num_vertices, float(mesh.vertices.max())) == (8, 1.0)
    assert isinstance(mesh, Mesh)
