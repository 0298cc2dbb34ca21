"""The grammar of names: what tokens may be joined, what is refused and why, and that names and objects are one."""

import itertools
import json

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from shapes import above, lights, plate_over_plane

import shadowjax as sj
from shadowjax._registry import Entry
from shadowjax.cli import options
from shadowjax.cli.console import labelled
from shadowjax.cli.main import main, parse
from shadowjax.evaluate.capability import capability
from shadowjax.filters.registry import DEPTH_POLICIES, FILTERS
from shadowjax.partitions.registry import PARTITIONS
from shadowjax.presets.names import as_techniques, costs, make_technique
from shadowjax.rays import BruteForceCaster
from shadowjax.techniques.names import compose, families, token_names, token_table
from shadowjax.techniques.registry import ALONE, LAYER_DEPTHS, OPTIONS, TECHNIQUES, TOKEN_KINDS
from shadowjax.warps.registry import WARP_FITS

PARTS = [*PARTITIONS, "asm"], list(WARP_FITS), [*DEPTH_POLICIES, *LAYER_DEPTHS], list(FILTERS), list(OPTIONS)
FEW = "z2+minimax+2sm-max+pcf-2x2", "log+vsm"
BRUTE = BruteForceCaster()  # compiles fastest


def resolved(name):
    """The technique of a name, or the reason why there is none."""
    try:
        return make_technique(name, 16)
    except ValueError as error:
        return str(error)


def test_no_token_is_in_two_registries_and_none_has_a_sign_of_the_grammar():
    names = [name for kind in TOKEN_KINDS.values() for one in kind for name in one] + list(ALONE)
    assert len(names) == len(set(names)) == len(token_names())
    assert not any(set(name) & set("+=: ,") for name in names)


def test_every_partition_and_warp_resolves_or_is_refused_with_a_reason():
    for partition, warp in itertools.product(PARTS[0], PARTS[1]):
        made = resolved(f"{partition}+{warp}")
        if isinstance(made, str):
            assert partition in ("faces", "cube", "asm") or (partition, warp) == ("z4-seen", "stable")
            assert made.startswith(f"'{partition}+{warp}' cannot be built: ")
            assert len(made.split(": ", 1)[1]) > 40
        else:
            assert made.partition.num_maps == PARTITIONS[partition]().num_maps
            assert not hasattr(made.partition, "warp") or eqx.tree_equal(made.partition.warp, WARP_FITS[warp]())


def test_every_filter_goes_with_every_partition_and_every_warp():
    for filter_ in PARTS[3]:
        expected = FILTERS[filter_]()
        for other in (*PARTS[0][:-1], *PARTS[1]):
            assert eqx.tree_equal(make_technique(f"{other}+{filter_}", 16).filter, expected)
        if filter_ != "hard":
            assert "take asm alone" in resolved(f"asm+{filter_}")


def test_every_depth_and_filter_resolves_or_is_refused_with_a_reason():
    for depths, filter_ in itertools.product(PARTS[2], PARTS[3]):
        made = resolved(f"{filter_}+{depths}")
        if isinstance(made, str):
            assert "take hard or pcf-KxK with them" in made
            assert depths in DEPTH_POLICIES
        elif depths in DEPTH_POLICIES:
            taps = FILTERS[filter_]().num_fetches
            assert made.filter.num_fetches == taps * DEPTH_POLICIES[depths]().num_depths
        else:
            assert made.layer == LAYER_DEPTHS[depths]()


@given(st.permutations(["z3", "minimax", "3sm", "pcf-5x5"]))
@settings(max_examples=12, deadline=None)
def test_order_does_not_matter(tokens):
    assert eqx.tree_equal(resolved("+".join(tokens)), resolved("z3+minimax+3sm+pcf-5x5"))


@given(st.integers(1, 64), st.integers(1, 255), st.integers(4, 9))
@settings(max_examples=12, deadline=None)
def test_numbers_of_families_are_read(slices, taps, depths):
    made = make_technique(f"z{slices}+{depths}sm+pcf-{taps}x{taps}")
    assert made.partition.num_partitions == slices
    assert made.filter.policy.num_depths == depths
    assert made.filter.kernel_size == taps


@given(st.text(st.sampled_from("abz+-= x:3KN"), max_size=12))
@settings(max_examples=100, deadline=None)
def test_any_text_is_a_technique_or_a_clear_complaint(text):
    assert resolved(text)


def test_what_resolves_builds_and_answers():
    mesh, camera, light = plate_over_plane(), above(), lights()["directional"]
    points, normals = jnp.asarray([[0.1, 0.0, 0.2], [2.9, 0.0, 2.8]]), jnp.asarray([[0.0, 1.0, 0.0]] * 2)
    for name in FEW:
        value = np.asarray(make_technique(name, 32, BRUTE).build(mesh, light, camera).visibility(points, normals))
        assert np.all((value >= 0) & (value <= 1)), name
        assert value[0] < value[1], name


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("pcf3x3", "unknown technique 'pcf3x3'; did you mean pcf-3x3"),
        ("z4+mimimax", "unknown token 'mimimax' in 'z4[+]mimimax'; did you mean minimax"),
        ("PCF-3x3", "did you mean pcf-3x3"),
        ("pcf-3x5", "did you mean pcf-3x3"),
        ("nothing-like-it", "`shadowjax techniques` lists the tokens"),
        ("hard+", "unknown token '' in 'hard[+]'; tokens are joined by single plus signs"),
        ("z4+faces", "two tokens of one kind, partition: z4 and faces; leave one of them out"),
        ("hard+hard", "two tokens of one kind, filter: hard and hard"),
        ("2sm-max+second-depth", "two tokens of one kind, depths"),
        ("exact+hard", "exact has no map, so it stands alone"),
        ("faces+minimax", "every face has a warp of its own"),
        ("cube+log", "so they are uniform: leave the warp out"),
        ("z4-seen+stable", "move with the camera, so no map of theirs is stable"),
        ("3sm+evsm4", "counted test by test, which ExponentialVariance does not do: take hard or pcf-KxK"),
        ("asm+pcf-3x3", "tiles of asm .* pcf-3x3 cannot read them: take asm alone"),
        ("coverage", "coverage needs a filter that averages codes"),
        ("vsm+coverage+second-depth", "coverage follows the first layer"),
        ("z0", "N of partition zN must lie in 1 … 64; got 'z0'"),
        ("pcf-256x256", "K of filter pcf-KxK must lie in 1 … 255"),
        ("3sm+9999999999sm", "unknown token"),
        ("godot-4", "'godot-4' is a preset: its name here is 'preset:godot-4'"),
        ("preset:godot", "did you mean godot-4"),
        ("preset:godot-4+hard", "a preset is whole and stands alone"),
    ],
)
def test_bad_names_say_what_is_wrong(name, message):
    with pytest.raises(ValueError, match=message):
        make_technique(name)


def test_names_of_before_that_are_gone_are_refused():
    for name in ("whole", "z", "z-blended", "z-seen", "z-stable"):
        assert isinstance(resolved(name), str)
        with pytest.raises(ValueError, match="partition must be one of"):
            sj.make_partition(name)


@pytest.fixture(scope="module")
def table():
    """One technique three times: named, as an object, and named in another order."""
    ours = sj.ShadowMapping(
        sj.PercentageCloser(3), 32, partition=sj.Cascades(2, warp=sj.PerspectiveFit("minimax")), caster=BRUTE
    )
    given = {"z2+minimax+pcf-3x3": "z2+minimax+pcf-3x3", "$ours": ours, "turned": "pcf-3x3+minimax+z2"}
    return sj.compare("plate-over-plane", given, resolution=32, width=16, height=12, repeats=1, caster=BRUTE)


def test_names_and_objects_give_the_same_record(table):
    records = [{k: v for k, v in one.to_json().items() if k != "technique" and not k.endswith("_ms")} for one in table]
    assert records[0] == records[1] == records[2]
    assert records[0]["rmse"] > 0
    assert [one.technique for one in table] == ["z2+minimax+pcf-3x3", "$ours", "turned"]
    with pytest.raises(ValueError, match="no technique of this table is called 'theirs'; it has z2"):
        table["theirs"]


def test_tables_are_written_and_shown(table, tmp_path):
    written = json.loads(table.to_json(tmp_path / "t.json").read_text())
    assert written == list(table.to_dict().values()) == [one.to_json() for one in table]
    assert max(map(len, str(table).splitlines())) <= 80
    assert {line.split()[0] for line in str(table).splitlines()[1:]} == {one.technique for one in table}
    assert len(sj.plotting.comparison(table, "a $title").axes) == 3


def test_many_ways_to_give_techniques():
    hard = sj.ShadowMapping(sj.Hard(), 8)
    assert list(as_techniques("hard")) == ["hard"]
    assert list(as_techniques([hard, hard, "hard", sj.Exact()])) == [
        "SingleMap+UniformFit+Hard 1", "SingleMap+UniformFit+Hard 2", "hard", "Exact",
    ]  # fmt: skip
    assert as_techniques({"mine": hard})["mine"] is hard
    for wrong, message in ((["hard", "hard"], "more than once"), ([], "at least one"), ({}, "at least one")):
        with pytest.raises(ValueError, match=message):
            as_techniques(wrong)
    with pytest.raises(ValueError, match="must be a"):
        as_techniques([1.5])


def test_costs_are_those_of_the_parts():
    assert costs("z4+minimax+evsm4")[:4] == (4, 16, 4, None)
    assert costs("2sm-max+pcf-3x3")[:4] == (2, 18, 1, 19)
    assert costs("exact")[:4] == (0, 0, 0, 2)
    assert costs("asm")[:4] == (1, 1, None, 2)
    soft = sj.JitteredLights.create(make_technique("z4+minimax+pcf-3x3"), 0.1, 5)
    assert costs(soft) == (1, 45, 20, 46, "JitteredLights+Cascades+PerspectiveFit+PercentageCloser")
    assert soft.resized(0.5).map_resolution == soft.map_resolution // 2
    with pytest.raises(ValueError, match="a search needs shadow maps of one resolution each; got JitteredLights"):
        soft.as_shadow_mapping("a search needs")
    rows = {row.token: row for row in token_table()}
    assert list(rows) == token_names()
    assert rows["z4"].maps == 4
    assert (rows["3sm"].planes, rows["pcf-4x4"].fetches) == (3, 16)
    assert {key.lower() for key in families()} >= {"zn", "pcf-kxk"}


def test_a_new_filter_is_one_line_in_a_registry(monkeypatch, capsys):
    monkeypatch.setitem(FILTERS.entries, "mine", Entry(lambda: sj.PercentageCloser(7), "seven taps"))
    made = make_technique("z2+minimax+mine", 8)
    assert (made.filter.kernel_size, made.partition.num_partitions) == (7, 2)
    assert capability("mine", "vertices") == "values"
    assert main(["techniques"]) == 0
    assert "seven taps" in capsys.readouterr().out


def test_defaults_are_built_of_the_registries():
    assert {*FILTERS, *DEPTH_POLICIES, *LAYER_DEPTHS, *ALONE} <= set(TECHNIQUES)
    assert compose("hard").caster == sj.Exact().caster != BruteForceCaster()


def test_labels_and_tables_of_toml_reach_the_same_names(tmp_path, capsys):
    (tmp_path / "t.toml").write_text("[techniques]\nours = 'z4+minimax+evsm4'\ntheirs = 'pcf-3x3'\n")
    words = ["ours=z4+minimax+evsm4", "theirs=pcf-3x3"]
    chosen = [
        parse(options.Compare, "compare", given)
        for given in (["--config", str(tmp_path / "t.toml")], ["--techniques", *words])
    ]
    assert labelled(chosen[0].techniques) == labelled(chosen[1].techniques)
    assert labelled(chosen[0].techniques) == {"ours": "z4+minimax+evsm4", "theirs": "pcf-3x3"}
    assert main(["techniques", *words, "--json", "-"]) == 0
    rows = json.loads(capsys.readouterr().out)
    assert [(row["technique"], row["maps"], row["planes"]) for row in rows] == [("ours", 4, 4), ("theirs", 1, 1)]


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["techniques", "z4+mimimax"], "unknown token 'mimimax' in 'z4+mimimax'; did you mean minimax"),
        (["techniques", "=hard"], "a technique is NAME or LABEL=NAME; got '=hard'"),
        (["techniques", "a=hard", "a=vsm"], "give each technique once; got a more than once"),
        (["compare", "--techniques", "faces+psm"], "every face has a warp of its own"),
        (["render", "--technique", "3sm+vsm", "-o", "x.png"], "take hard or pcf-KxK with them"),
        (["optimize", "bias", "--technique", "exact"], "needs shadow maps of one resolution each; got Exact"),
    ],
)
def test_commands_refuse_bad_names_in_one_line(words, message, capsys, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    assert main(words) == 2
    shown = capsys.readouterr()
    assert shown.out == ""
    assert message in shown.err
    assert len([line for line in shown.err.splitlines() if line.startswith("shadowjax: ")]) == 1
