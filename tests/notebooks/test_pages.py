"""What pages name exists: tests, files, make targets, techniques."""

import re
from pathlib import Path

import pytest

from shadowjax.techniques import TECHNIQUES

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


def test_techniques_named_by_the_page_on_choosing_exist():
    rows = [line for line in (ROOT / "docs/choose.md").read_text().splitlines() if line.startswith("|")]
    named = {name for row in rows for name in re.findall(r"`([a-z0-9+-]+)`", row.split("|")[2])}
    assert len(named) > 5
    assert named <= set(TECHNIQUES)
