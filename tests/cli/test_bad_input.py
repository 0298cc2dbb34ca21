"""Everything that can be given wrong: exit code 2, one line on standard error, nothing on standard output."""

import os

import numpy as np
import pytest

from shadowjax.cli import main
from shadowjax.cli.main import _plain

RENDER = ["render", "sphere-over-plane", "-o", "{tmp}/x.png", "--width", "8", "--height", "6", "--samples", "1"]
MESH = ["render", "{tmp}/mesh", "-o", "{tmp}/x.png"]

FLAGS = {
    "command": (["rendr"], "did you mean render"),
    "group": (["optimize"], "near-distance, splits"),
    "flag": (["scenes", "--bogus"], "--bogus"),
    "flag value": ([*RENDER[:4], "--width", "wide"], "--width"),
    "scene": (["render", "sphere-over-plan", "-o", "{tmp}/x.png"], "did you mean sphere-over-plane"),
    "mesh file": (["render", "none.glb", "-o", "{tmp}/x.png"], "no such mesh file"),
    "technique": ([*RENDER, "--technique", "pcf-3x33"], "did you mean pcf-3x3"),
    "technique of compare": (["compare", "cubes", "--techniques", "hard", "hrad"], "did you mean hard"),
    "technique twice": (["compare", "cubes", "--techniques", "hard", "hard"], "hard more than once"),
    "technique of report": (["report", "cubes", "--techniques", "no", "--out", "{tmp}/o"], "unknown technique 'no'"),
    "equations": (["report", "cubes", "--equations", "mdms", "--out", "{tmp}/o"], "source of equations"),
    "equation": (["verify", "--only", "nothing"], "no equation is called 'nothing'"),
    "resolution": ([*RENDER, "--resolution", "0"], "--resolution must lie in [1, 16384]; got 0"),
    "width": ([*RENDER, "--width", "-4"], "--width must lie in [1, 16384]; got -4"),
    "samples": ([*RENDER, "--samples", "0"], "--samples must lie in [1, 64]; got 0"),
    "product of sizes": (
        [*RENDER[:4], "--width", "16384", "--height", "16384", "--samples", "64"], "use a smaller --width, --height",
    ),
    "phi": ([*RENDER, "--phi-deg", "90"], "(0, 90); got 90"),
    "phi not finite": ([*RENDER, "--phi-deg", "nan"], "(0, 90); got nan"),
    "near and far": ([*RENDER, "--near", "9", "--far", "2"], "near must be less than far"),
    "near": ([*RENDER, "--near", "-1"], "--near must lie in [1e-12, 1e+12]"),
    "camera at its target": (
        [*RENDER, "--camera-position", "1", "2", "3", "--camera-target", "1", "2", "3"], "must differ",
    ),
    "camera not finite": ([*RENDER, "--camera-position", "nan", "2", "3"], "--camera-position must lie in"),
    "light direction": ([*RENDER, "--light-direction", "0", "0", "0"], "must not be the zero vector"),
    "light direction's length": ([*RENDER, "--light-direction", "1", "2"], "--light-direction"),
    "light given twice": (
        [*RENDER, "--light-direction", "0", "-1", "0", "--light-azimuth-deg", "3"], "not by both",
    ),
    "light elevation": ([*RENDER, "--light-elevation-deg", "91"], "[-90, 90]; got 91"),
    "position of the sun": ([*RENDER, "--light-position", "0", "9", "0"], "choose light spot or point"),
    "kind of light": ([*RENDER, "--light", "torch"], "--light"),
    "caster": ([*RENDER, "--caster", "slow"], "caster must be one of 'brute', 'grid'"),
    "triangles": ([*RENDER, "--num-triangles", "1"], "num_triangles"),
    "ground of a built-in scene": ([*RENDER, "--no-ground"], "for mesh files"),
    "no output": (["render", "cubes"], "-o image.png"),
    "output's ending": (["render", "cubes", "-o", "{tmp}/x.jpg"], "must end in .png"),
    "output folder is a file": (["report", "cubes", "--out", "{tmp}/mesh"], "is a file; give a folder"),
    "folder of the output is a file": (["render", "cubes", "-o", "{tmp}/mesh/x.png"], "is a file"),
    "JSON into a folder": (["compare", "cubes", "--json", "{tmp}"], "is a folder; give the name"),
    "optimise range": (["optimize", "near-distance", "--near", "5", "--far", "2"], "near < far; got 5.0 and 2.0"),
    "optimise phi": (["optimize", "splits", "--phi-deg", "0"], "(0, 90); got 0"),
    "optimise gamma": (["optimize", "near-distance", "--gamma-deg", "91"], "[0, 90]; got 91"),
    "optimise partitions": (["optimize", "splits", "--num-partitions", "0"], "--num-partitions must lie in [1, 64]"),
    "optimise seam limit": (["optimize", "splits", "--seam-limit", "1"], "must lie in (1, 1e+09); got 1.0"),
    "optimise objective": (["optimize", "near-distance", "--objective", "y"], "--objective"),
    "configuration": (["optimize", "splits", "--config", "{tmp}/none.toml"], "no such configuration file"),
}  # fmt: skip


def complaint(words, tmp_path, capsys):
    """The one line that a command complains with."""
    code = main([word.replace("{tmp}", str(tmp_path)) for word in words])
    out, err = capsys.readouterr()
    assert code == 2, err
    assert out == ""
    (line,) = err.splitlines()
    assert line.startswith("shadowjax: ")
    return line


@pytest.mark.parametrize(("words", "message"), FLAGS.values(), ids=FLAGS)
def test_flags(words, message, tmp_path, capsys):
    (tmp_path / "mesh").write_text("not a mesh")
    assert message in complaint(words, tmp_path, capsys)
    assert not (tmp_path / "x.png").exists()


def obj(vertices, faces):
    lines = [f"v {x} {y} {z}" for x, y, z in vertices] + ["f " + " ".join(map(str, face)) for face in faces]
    return "\n".join(lines)


TRIANGLE = [(0, 0, 0), (1, 0, 0), (0, 1, 0)]
PLY = """ply
format ascii 1.0
element vertex 3
property float x
property float y
property float z
element face 1
property list uchar int vertex_indices
end_header
0 0 0
1 0 0
0 1 0
3 0 1 7
"""
FILES = {
    "empty.obj": ("", "holds no triangles"),
    "points.obj": (obj(TRIANGLE, []), "holds no triangles"),
    "points.xyz": ("0 0 0\n1 0 0\n0 1 0\n", "no triangles"),
    "nan.obj": (obj([(0, 0, float("nan")), *TRIANGLE[1:]], [(1, 2, 3)]), "vertices must be finite"),
    "infinite.obj": (obj([(0, 0, float("inf")), *TRIANGLE[1:]], [(1, 2, 3)]), "vertices must be finite"),
    "index.ply": (PLY, "index.ply"),
    "index.obj": (obj(TRIANGLE, [(1, 2, 9)]), "index.obj"),
    "rubbish.glb": ("this is no mesh", "cannot be read as a mesh"),
    "rubbish.stl": ("\x00\x01", "rubbish.stl"),
    "one-point.obj": (obj([(1, 1, 1)] * 3, [(1, 2, 3)]), "lie in one point"),
    "strange.zzz": ("x", "no mesh reader knows"),
}


@pytest.mark.parametrize("name", FILES)
def test_mesh_files(name, tmp_path, capsys):
    content, message = FILES[name]
    (tmp_path / name).write_text(content)
    words = ["render", "{tmp}/" + name, "-o", "{tmp}/x.png", "--width", "8", "--height", "6"]
    assert message in complaint(words, tmp_path, capsys)


def test_a_folder_is_no_mesh(tmp_path, capsys):
    (tmp_path / "meshes.obj").mkdir()
    assert "is a folder" in complaint(["render", "{tmp}/meshes.obj", "-o", "{tmp}/x.png"], tmp_path, capsys)


@pytest.mark.skipif(os.name != "posix" or os.geteuid() == 0, reason="needs a user whom permissions bind")
def test_a_folder_that_cannot_be_written(tmp_path, capsys):
    tmp_path.chmod(0o500)
    try:
        assert "cannot" in complaint(["report", "cubes", "--out", "{tmp}/o"], tmp_path, capsys)
    finally:
        tmp_path.chmod(0o700)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("nera = 1", "did you mean 'near'"),
        ("near = 'x'", "c.toml: Error parsing --near"),
        ("[near]\na = 1", "must be a value, not a table"),
        ("near = = 1", "is not valid TOML"),
        ("config = 'c.toml'", "unknown option 'config'"),
    ],
)
def test_configuration_files(content, message, tmp_path, capsys):
    (tmp_path / "c.toml").write_text(content)
    words = ["optimize", "near-distance", "--config", "{tmp}/c.toml"]
    assert message in complaint(words, tmp_path, capsys)


def test_zero_area_faces_are_harmless(tmp_path, capsys):
    sliver = obj([*TRIANGLE, (0.5, 0.5, 1.0)], [(1, 2, 3), (1, 1, 2), (1, 2, 2), (2, 3, 4), (4, 4, 4)])
    (tmp_path / "sliver.obj").write_text(sliver)
    words = ["render", str(tmp_path / "sliver.obj"), "-o", str(tmp_path / "x.png"), "--technique", "hard"]
    assert main([*words, "--width", "32", "--height", "24", "--resolution", "24", "--samples", "1"]) == 0
    from PIL import Image

    assert np.asarray(Image.open(tmp_path / "x.png")).std() > 10


def test_memory_is_one_line_too(monkeypatch, capsys, tmp_path):
    from shadowjax.cli import commands

    def exhausted(_):
        raise RuntimeError("RESOURCE_EXHAUSTED: Out of memory allocating 99 bytes")

    monkeypatch.setattr(commands, "run", exhausted)
    assert "lower --resolution" in complaint(["scenes"], tmp_path, capsys)


def test_a_fault_of_our_own_is_not_hidden(monkeypatch):
    from shadowjax.cli import commands

    def broken(_):
        raise RuntimeError("a bug")

    monkeypatch.setattr(commands, "run", broken)
    with pytest.raises(RuntimeError, match="a bug"):
        main(["scenes"])


BOX = """\x1b[31m╭─ Value error ─────────╮\x1b[0m
│ Error parsing --near: │
│ no number.            │
│ ───────────────────── │
│ Argument helptext     │
╰───────────────────────╯
"""
PLAIN_BOX = """ Value error
 ---------------------
  Error parsing --near:
  no number.
  ---------------------
  Argument helptext
"""


@pytest.mark.parametrize("box", [BOX, PLAIN_BOX])
def test_boxes_become_lines(box):
    assert _plain(box) == "Error parsing --near: no number"
    assert _plain("") == "the command line cannot be read"
