"""What a report finds, against what is known without it."""

import json

import numpy as np

from shadowjax.evaluate import metrics
from shadowjax.filters.multi_depth import MultiDepth, Neighbourhood, Ring
from shadowjax.filters.pcf import BilinearPercentageCloser, PercentageCloser
from shadowjax.io import json_text
from shadowjax.report.findings import results_json, window_filter


def test_records_are_those_of_the_pictures(findings):
    mask = np.asarray(findings.comparison.view.pixel_mask)
    for index, record in enumerate(findings.comparison.records):
        values = findings.pixel_values(index)
        np.testing.assert_allclose(record.rmse, float(metrics.rmse(values, findings.exact_values, mask)), rtol=1e-6)
        assert ((values >= 0) & (values <= 1)).all()
        assert (values[~mask] == 1).all()
    assert findings.comparison.records[3].rmse == 0  # the exact technique is the truth


def test_pictures_differ_only_where_shadows_do(findings):
    mask = np.asarray(findings.comparison.view.pixel_mask)
    for index, picture in enumerate(findings.pictures):
        same = findings.pixel_values(index) == findings.exact_values
        np.testing.assert_array_equal(picture[same | ~mask], findings.exact_picture[same | ~mask])
        assert np.isfinite(picture).all()


def test_tones_keep_their_bound(findings):
    rows = {row.technique: row for row in findings.tones}
    assert (rows["hard"].bound, rows["hard"].straight_edge, rows["hard"].counted) == (2, 2, 2)
    assert rows["pcf-2x2"].bound == 5
    assert rows["3sm"].bound == 4
    assert rows["exact"].straight_edge is None
    for row in rows.values():
        assert row.counted <= row.bound
        if row.straight_edge is not None:
            assert row.along_axis <= row.straight_edge <= row.bound


def test_costs_follow_the_source(findings):
    f, texels = findings.receivers, 24 * 24
    rows = {row.technique: (row.build_fetches, row.lookup_fetches) for row in findings.costs}
    assert rows == {"hard": (0, f), "pcf-2x2": (0, 4 * f), "3sm": (9 * texels, f)}
    (crossover,) = findings.crossovers
    assert (crossover.multi_depth, crossover.plain) == ("3sm", "pcf-2x2")
    assert crossover.fragments == 9 * texels / 3
    assert crossover.size_ratio == 3
    here = rows["3sm"], rows["pcf-2x2"]
    assert (crossover.here == "3sm") == (sum(here[0]) < sum(here[1]))


def test_filters_that_windows_treat():
    assert window_filter(PercentageCloser(3)) == (9, "1-SM")
    assert window_filter(PercentageCloser(3, width_world=1.0)) is None
    assert window_filter(BilinearPercentageCloser(3)) is None
    assert window_filter(MultiDepth(Neighbourhood("min"), 2)) == (4, "2-SM min")
    assert window_filter(MultiDepth(Neighbourhood("min", 5))) is None
    assert window_filter(MultiDepth(Ring(4))) is None


def test_equations_are_those_asked_for_and_pass(findings):
    assert findings.equations
    assert {result.id.split(".")[0] for result in findings.equations} == {"asm"}
    assert findings.passed


def test_results_are_plain_json(findings):
    content = json.loads(json_text(results_json(findings)))
    assert set(content) == {
        "scene", "settings", "records", "tones", "cost", "choices", "recommendation", "equations", "machine", "command",
    }  # fmt: skip
    assert [record["technique"] for record in content["records"]] == ["hard", "pcf-2x2", "3sm", "exact"]
    assert list(content["records"][0])[:10] == [
        "technique", "rmse", "mean_abs_error", "false_lit", "false_shadow", "tones", "tones_bound", "map_bytes",
        "build_ms", "visibility_ms",
    ]  # fmt: skip
    assert content["recommendation"]["technique"] in ("hard", "pcf-2x2", "3sm")
    assert {"processor", "cores", "dtype", "jax", "date"} <= set(content["machine"])


def test_exact_against_itself_and_soft_against_exact(findings):
    hard, soft, _, exact = findings.comparison.records
    assert (exact.rmse, exact.false_lit, exact.false_shadow, exact.edge_distance, exact.map_bytes) == (0, 0, 0, 0, 0)
    assert hard.tones == 2
    assert 2 < soft.tones <= soft.tones_bound == 5
    for one in (hard, soft):
        np.testing.assert_allclose(one.mean_abs_error, one.false_lit + one.false_shadow, rtol=1e-6)
        assert one.map_bytes == 24 * 24 * findings.scene.mesh.vertices.dtype.itemsize
        assert min(one.build_ms, one.visibility_ms) > 0
