"""The harness of `make bench`: what it computes from times, what it writes, and that it compares the same pictures."""

import json

import jax.numpy as jnp
import numpy as np
import pytest

from shadowjax import BruteForceCaster
from shadowjax.geometry.light_space import DirectionalSpace
from shadowjax.rays.grid.caster import GridCaster
from tests.benchmarks import peers, timing
from tests.benchmarks.cases import CASES
from tests.benchmarks.fit import law_of_time, laws
from tests.benchmarks.ours import VARIANTS, Shadowjax
from tests.benchmarks.peers.llvmpipe import clip_from_world
from tests.benchmarks.run import Options, run
from tests.benchmarks.scenes import PROJECTIONS, sphere_over_plane, view
from tests.benchmarks.session import agreement
from tests.benchmarks.summary import ratios


class Slow(BruteForceCaster):
    """The brute-force caster with the methods that are measured: it compiles quickly, and has its own shadow test."""

    def depth_on_grid(self, mesh, grid):
        return self.closest_on_grid(mesh, grid).depth

    def faces_on_grid(self, mesh, grid):
        hit = self.closest_on_grid(mesh, grid)
        return hit.depth, hit.face

    def visible(self, mesh, space, points, normals=None):
        return super().visible(mesh, space, points, normals)


@pytest.fixture(scope="module")
def quick(tmp_path_factory):
    """One quick run of every case against the peer that tests always have, and the files that it wrote."""
    folder = tmp_path_factory.mktemp("benchmarks")
    options = Options(quick=True, peers=("embreex",), json=str(folder / "new" / "r.json"), page=str(folder / "p.md"))
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(VARIANTS, "shadowjax", lambda: Shadowjax(Slow))
        run(options)
    return json.loads((folder / "new" / "r.json").read_text()), (folder / "p.md").read_text()


def test_default_variant_is_the_fast_caster(tmp_path):
    results = run(Options(quick=True, only=("depth",), peers=("none",), json=str(tmp_path / "r.json")))
    assert isinstance(VARIANTS["shadowjax"]().caster, GridCaster)
    assert {name for record in results["records"] for name in record["contestants"]} == {"shadowjax"}
    assert results["ratios"] == []


def test_results_are_complete(quick):
    results, _ = quick
    assert results["schema"] == 1
    assert results["command"] == "python -m tests.benchmarks --quick --peers embreex"
    assert results["machine"]["processor"]
    assert set(results["versions"]) == set(results["kinds"]) == {"shadowjax", "embreex"}
    cases = {record["case"] for record in results["records"]}
    assert cases == set(CASES)
    for record in results["records"]:
        assert record["triangles"] == 1282
        assert record["rows"] == record["columns"] == 64
        first = next(iter(record["contestants"].values()))
        for entry in record["contestants"].values():
            assert 0 < entry["min_ms"] <= entry["median_ms"]
            assert entry["rounds"] == 3
            assert entry["ratio"] == pytest.approx(entry["median_ms"] / first["median_ms"])


def test_compilation_and_memory_stand_beside_times(quick):
    results, _ = quick
    for record in results["records"]:
        if record["case"] in ("depth", "faces", "gradient"):
            entry = next(iter(record["contestants"].values()))
            assert entry["compile_s"] > 0
            assert entry["temporaries_mb"] > 0
        if record["case"] in ("depth", "faces"):
            assert record["contestants"]["embreex"]["build_ms"] > 0


def test_both_cast_the_same_pictures(quick):
    """Also after the vertices moved, so a rebuild that did nothing would show."""
    results, _ = quick
    compared = [record for record in results["records"] if "embreex" in record["contestants"]]
    cases = {"depth", "faces", "new-view", "new-vertices", "visibility"}
    assert {record["case"] for record in compared} == cases
    for record in compared:
        entry = record["contestants"]["embreex"]
        if record["case"] == "visibility":
            assert entry["visibility_differs_percent"] < 0.5
            assert 5 < record["lit_percent"] < 95
            continue
        assert entry["depth_median_difference"] < 1e-5
        assert entry["depth_differs_percent"] < 0.1


def test_page_holds_every_table_and_the_machine(quick):
    results, page = quick
    assert f"Printed by `{results['command']}` in {results['seconds']:.0f} s." in page
    assert results["machine"]["processor"] in page
    for title in ("Fastest peers", "Depth maps", "New vertices", "Gradient", "Greatest differences"):
        assert f"### {title}" in page
    rows = [line for line in page.splitlines() if line.startswith("|")]
    assert len(rows) > 20
    assert all(line.endswith("|") for line in rows)


def test_moved_vertices_move_the_picture():
    """The new vertices of a call differ from the last ones by more than the agreement forgives."""
    geometry = sphere_over_plane("1 k")
    push = np.abs(geometry.moved(1) - geometry.moved(2)).max()
    assert 1e-4 * geometry.radius < push < 1e-2 * geometry.radius


def test_law_of_time_is_recovered():
    triangles, pixels = (x.ravel() for x in np.meshgrid([1e3, 1e5, 1e6], [512**2, 2048**2]))
    exact = 1e-6 * (20 * triangles + 4 * pixels + 15 * np.sqrt(triangles * pixels))
    law = law_of_time(triangles, pixels, exact)
    found = [law[f"ns_per_{name}"] for name in ("triangle", "pixel", "root_triangle_pixel")]
    np.testing.assert_allclose(found, [20, 4, 15], rtol=1e-9)
    assert law["largest_relative_error"] < 1e-9
    # One measurement that takes twice as long is reported as an error, not hidden.
    off = law_of_time(triangles, pixels, exact * np.array([1, 1, 1, 1, 1, 2]))
    assert off["largest_relative_error"] > 0.1
    assert off["measurements"] == 6


def _record(case, ours, **others):
    entries = {"us": ours, **others}
    contestants = {name: {"median_ms": time, "ratio": time / ours} for name, time in entries.items()}
    return {"case": case, "mesh": "m", "triangles": 10, "rows": 8, "columns": 8, "contestants": contestants}


def test_ratios_take_the_fastest_peer_of_each_kind():
    kinds = {"us": "this package", "a": "ray caster", "b": "ray caster", "c": "rasteriser"}
    records = [_record("depth", 2.0, a=4.0, b=32.0, c=3.0), _record("depth", 8.0, a=64.0, b=32.0, c=12.0)]
    (entry,) = ratios([*records, _record("gradient", 1.0, loss=2.0)], kinds)
    assert entry["ours_ms"] == pytest.approx(4.0)
    # Geometric means over the two projections: a has √(2 · 8) = 4, b has √(16 · 4) = 8.
    assert entry["ray caster"] == {"name": "a", "ratio": pytest.approx(4.0)}
    assert entry["rasteriser"] == {"name": "c", "ratio": pytest.approx(1.5)}


def test_laws_need_four_depth_maps():
    assert laws([_record("depth", 1.0), _record("faces", 1.0)]) == {}
    assert set(laws([_record("depth", 1.0, a=2.0)] * 4)) == {"us", "a"}


def test_agreement_counts_depths_misses_and_triangles():
    reference = np.array([[1.0, 2.0], [3.0, np.inf]]), np.array([[0, 1], [2, -1]])
    depth = np.array([[1.0, 2.5], [np.inf, np.inf]])
    found = agreement(depth, np.array([[0, 1], [-1, -1]]), reference, radius=2.0)
    assert found == {
        "depth_median_difference": 0.125,
        "depth_differs_percent": 50.0,
        "face_differs_percent": 25.0,
    }


def test_contestants_take_turns(monkeypatch):
    monkeypatch.setattr(timing, "PAUSE_SECONDS", 0)
    seen = []
    times = timing.interleave({name: lambda step, name=name: seen.append((name, step)) for name in "ab"}, 3)
    assert seen == [("a", 1), ("b", 1), ("a", 2), ("b", 2), ("a", 3), ("b", 3)]
    assert times["a"]["rounds"] == 3


def test_absent_peers_are_named(monkeypatch):
    monkeypatch.setitem(peers.PEERS, "ghost", "no_such_file:Ghost")
    present, absent = peers.start(["ghost", "embreex"])
    assert [peer.name for peer in present] == ["embreex"]
    assert "no_such_file" in absent["ghost"]


@pytest.mark.parametrize("projection", PROJECTIONS)
def test_rasteriser_gets_the_same_view(projection):
    """Its matrix puts a world point at the pixel and depth at which the grid sees it."""
    geometry = sphere_over_plane("1 k")
    shown = view(geometry, projection, 32)
    points = geometry.vertices[::50]
    position, distance = shown.grid.locate(jnp.asarray(points))
    clip = np.concatenate([points, np.ones((len(points), 1))], axis=1) @ clip_from_world(shown).T
    device = clip[:, :3] / clip[:, 3:]
    np.testing.assert_allclose(16 * (device[:, :2] + 1), position, atol=1e-3)
    assert np.abs(device[:-1]).max() <= 1
    order = np.argsort(distance) if isinstance(shown.grid.space, DirectionalSpace) else np.argsort(clip[:, 3])
    assert (np.diff(device[order, 2]) >= -1e-6).all()


@pytest.mark.parametrize(
    "bad",
    [{"only": ("no",)}, {"peers": ("no",)}, {"sizes": ("no",)}, {"variants": ("no",)}, {"mesh": ("no.ply",)}],
)
def test_bad_options_say_what_is_known(bad):
    with pytest.raises(ValueError, match="no"):
        run(Options(**bad))
