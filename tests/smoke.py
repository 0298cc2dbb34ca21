"""A walk through the whole package in two minutes, without pytest: does it work with the versions installed here?"""

import contextlib
import importlib
import importlib.metadata
import io
import json
import pkgutil
import tempfile
import time
from pathlib import Path

import numpy as np
import trimesh
from PIL import Image

import shadowjax as sj
from shadowjax.cli import main
from tests.lowest_versions import lowest
from tests.support import mesh_bytes

SMALL = ["--width", "32", "--height", "24", "--samples", "1", "--resolution", "32"]


def modules(folder: Path) -> None:
    """Every module and every public name can be imported."""
    for module in pkgutil.walk_packages(sj.__path__, "shadowjax."):
        if not module.name.endswith("__main__"):
            importlib.import_module(module.name)
    for name in sj.__all__:
        getattr(sj, name)


def files(folder: Path) -> None:
    """A box of every format keeps its area."""
    corners, faces = mesh_bytes.BOX_CORNERS, mesh_bytes.BOX_FACES
    box = trimesh.Trimesh(corners, faces, process=False)
    made = {
        "obj": mesh_bytes.obj(corners, faces), "off": mesh_bytes.off(corners, faces), "glb": mesh_bytes.box_glb(),
        "ply": mesh_bytes.ply(corners, faces), "stl": mesh_bytes.stl(corners, faces),
        "dae": box.export(file_type="dae"), "3mf": box.export(file_type="3mf"),
    }  # fmt: skip
    for ending, data in made.items():
        path = folder / f"box.{ending}"
        path.write_bytes(data)
        assert np.isclose(float(sj.load(path).areas().sum()), 6.0), ending
    pentagon = np.array([[0, 0, 0], [4, 0, 0], [4, 3, 0], [2, 0.5, 0], [0, 3, 0]])
    (folder / "concave.obj").write_bytes(mesh_bytes.obj(pentagon, [range(5)]))
    assert np.isclose(float(sj.load(folder / "concave.obj").areas().sum()), 7.0)
    (folder / "outside.gltf").write_bytes(mesh_bytes.Gltf().gltf("../outside.bin"))
    assert main(["render", str(folder / "outside.gltf"), "-o", str(folder / "none.png")]) == 2


def pictures(folder: Path) -> None:
    """Families of techniques draw pictures of a file and of a scene."""
    for technique in ("pcf-3x3", "vsm", "exact"):
        path = folder / f"{technique}.png"
        assert main(["render", str(folder / "box.glb"), "-o", str(path), "--technique", technique, *SMALL]) == 0
        assert np.asarray(Image.open(path)).std() > 10


def numbers(folder: Path) -> None:
    """Comparison, equations, optimisers and lists answer in JSON."""
    target = str(folder / "out.json")
    for words in (
        ["compare", "plate-over-plane", "--techniques", "hard", "--pareto", str(folder / "pareto.png"), *SMALL],
        ["verify", "--only", "mdsm.Eq4"], ["optimize", "near-distance"], ["optimize", "splits"], ["presets"],
        ["scenes"],
    ):  # fmt: skip
        assert main([*words, "--json", target]) == 0, words
        assert json.loads(Path(target).read_text(encoding="utf-8")), words


if __name__ == "__main__":
    for line in lowest():
        name, version = line.split("==")
        print(f"{name} {importlib.metadata.version(name)} (lowest allowed: {version})")
    with tempfile.TemporaryDirectory() as folder:
        for step in (modules, files, pictures, numbers):
            start = time.perf_counter()
            with contextlib.redirect_stdout(io.StringIO()):
                step(Path(folder))
            print(f"{step.__name__}: {time.perf_counter() - start:.0f} s", flush=True)
