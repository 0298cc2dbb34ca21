"""What pages name exists: tests, files, make targets, techniques."""

import re
from pathlib import Path

import pytest

from shadowjax.presets.names import make_technique
from shadowjax.techniques.base import Technique

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]
PAGES = [page for page in PAGES if "_build" not in page.parts]
TEST_FILES = (ROOT / "tests").rglob("test_*.py")
TEST_NAMES = {name for path in TEST_FILES for name in re.findall(r"^def (test_\w+)", path.read_text(), re.M)}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_tests_named_by_a_page_exist(page):
    named = set(re.findall(r"`(test_\w+)`", page.read_text()))
    assert named <= TEST_NAMES, f"no such tests: {sorted(named - TEST_NAMES)}"


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_links_between_files_lead_somewhere(page):
    links = re.findall(r"\]\(([^)#\s]+)\)", page.read_text())
    local = [link for link in links if "://" not in link]
    missing = [link for link in local if not (page.parent / link).exists()]
    assert not missing


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_make_targets_named_by_a_page_exist(page):
    targets = set(re.findall(r"^([a-z]+):", (ROOT / "Makefile").read_text(), re.M))
    named = set(re.findall(r"(?:`|\$ )make ([a-z]+)", page.read_text()))
    assert named <= targets


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_tables_have_heads(page):
    """A blank line within a table turns the rows below it into text."""
    text = re.sub(r"^```.*?^```", "", page.read_text(), flags=re.M | re.S)
    for block in re.findall(r"(?:^\|.*\|[ \t]*\n)+", text, re.M):
        rows = block.splitlines()
        assert len(rows) >= 2, rows
        assert re.fullmatch(r"\|(?:\s*:?-+:?\s*\|)+\s*", rows[1]), f"no head above {rows[0]}"
        assert {row.count("|") - row.count("\\|") >= 3 for row in rows} == {True}


def test_the_check_of_the_site_finds_what_is_wrong(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(ROOT / "docs" / "_ext")
    from page_widths import too_wide
    from site_check import faults

    style = tmp_path / "_static" / "site.css"
    style.parent.mkdir()
    style.write_text((ROOT / "docs/_static/site.css").read_text())
    table = "<table><tr><td>1</td></tr></table>"
    good = (
        f'<div class="pst-scrollable-table-container">{table}</div><a id="here" href="#here">x</a><p>|x| is a norm</p>'
    )
    (tmp_path / "index.html").write_text(f'<article>{good}<a href="b.html#there">b</a><a href="https://x.y">x</a>')
    (tmp_path / "b.html").write_text('<article><p id="there">x</p></article>')
    assert list(faults(tmp_path)) == []
    (tmp_path / "b.html").write_text(
        f'<article>{table}<p>| a | b |\n| c | d |</p><a href="index.html#nowhere">x</a><img src="none.png">'
        f'<div style="width:900px">wide</div></article>'
    )
    found = list(faults(tmp_path))
    assert len(found) == 5
    for told in (
        "outside of anything",
        "left as text: | a | b |",
        "#nowhere",
        "none.png",
        "index.html: a link to a place",
    ):
        assert any(told in fault for fault in found), told
    style.write_text("body { color: black }")
    assert sum("within a narrow window" in fault for fault in faults(tmp_path)) == 4
    wide = too_wide(tmp_path)
    assert wide is None or [fault.split(":")[0] for fault in wide] == ["b.html"]


def test_techniques_named_by_the_page_on_choosing_exist():
    rows = [line for line in (ROOT / "docs/choose.md").read_text().splitlines() if line.startswith("|")]
    named = {name for row in rows for name in re.findall(r"`([a-z0-9+-]+)`", row.split("|")[2])}
    assert len(named) > 5
    for name in named:
        assert isinstance(make_technique(name, 16), Technique)
