"""The page: one file that needs nothing else, every name harmless, every part there."""

import dataclasses
import json
import re
from html.parser import HTMLParser

import equinox as eqx
import pytest

from shadowjax.report import theory_sections, write_report
from shadowjax.report.html import data_uri, element, table, text
from shadowjax.report.page import page

EVIL = '<script>alert("x")</script>&\'"'
VOID = {"meta", "img", "br"}


class Balance(HTMLParser):
    """Checks that every element that is opened is closed, in order; collects tags, images and addresses."""

    def __init__(self):
        super().__init__()
        self.open, self.tags, self.addresses, self.alternatives = [], [], [], []

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        given = dict(attrs)
        self.addresses += [given[key] for key in ("src", "href") if key in given]
        if tag == "img":
            self.alternatives.append(given["alt"])
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag


@pytest.fixture(scope="module")
def html(findings):
    return page(findings)


def parsed(html):
    reader = Balance()
    reader.feed(html)
    assert reader.open == []
    return reader


def test_page_is_well_formed_and_stands_alone(html):
    reader = parsed(html)
    assert not {"script", "link", "iframe", "object"} & set(reader.tags)
    assert all(address.startswith(("data:image/png;base64,", "#")) for address in reader.addresses)
    assert not re.search(r"url\((?!data:image/png;base64,)", html)
    assert all(reader.alternatives)
    ids = set(re.findall(r'id="([^"]+)"', html))
    assert {address[1:] for address in reader.addresses if address.startswith("#")} <= ids


def test_page_shows_every_part(findings, html):
    for title in ("Two views", "Techniques next to the exact", "Comparison", "Tones", "Cost", "Equations", "Machine"):
        assert title in html
    for name in findings.settings.techniques:
        assert f"<h3>{name}</h3>" in html
    assert "shadowjax report sphere-over-plane" in html
    assert findings.machine["processor"].split("@")[0] in html or text(findings.machine["processor"]) in html
    # a card holds picture, difference and two crops; the exact picture is held once, by the style sheet
    assert html.count('class="exact-picture"') == 4
    assert html.count("--exact: url(") == 1


def test_page_escapes_names(findings):
    scene = eqx.tree_at(lambda s: s.mesh, findings.scene, findings.scene.mesh)
    object.__setattr__(scene, "name", EVIL)
    object.__setattr__(scene, "description", EVIL)
    html = page(dataclasses.replace(findings, scene=scene, command=EVIL))
    assert "script" not in parsed(html).tags
    assert html.count("&lt;script&gt;") >= 4


def test_a_failed_equation_is_shown(findings):
    broken = (dataclasses.replace(findings.equations[0], passed=False), *findings.equations[1:])
    changed = dataclasses.replace(findings, equations=broken)
    assert not changed.passed
    assert "FAILED" in theory_sections.equations(changed)
    assert "FAILED" not in theory_sections.equations(findings)


def test_parts_without_content_are_left_out(findings):
    html = page(dataclasses.replace(findings, equations=(), advice=None, costs=(), crossovers=()))
    for key in ("equations", "advice", "cost"):
        assert f'id="{key}"' not in html
        assert f'href="#{key}"' not in html


def test_writing_keeps_other_files(findings, tmp_path):
    (tmp_path / "mine.txt").write_text("keep")
    first = write_report(findings, tmp_path).read_bytes()
    assert write_report(findings, tmp_path).read_bytes() == first
    assert sorted(path.name for path in tmp_path.iterdir()) == ["index.html", "mine.txt", "results.json"]


def test_elements_escape_attributes_and_text():
    assert element("p", text(EVIL), title=EVIL) == (
        '<p title="&lt;script&gt;alert(&quot;x&quot;)&lt;/script&gt;&amp;&#x27;&quot;">'
        "&lt;script&gt;alert(&quot;x&quot;)&lt;/script&gt;&amp;&#x27;&quot;</p>"
    )
    assert "<script" not in table((EVIL,), [(EVIL,)], caption=EVIL)
    assert data_uri(b"\x00\x01") == "data:image/png;base64,AAE="


def test_names_that_steer_a_screen_are_spelled_out(findings, tmp_path):
    name = "a\x1b[31m\n\u202e<b>\udcff&.obj"
    named = dataclasses.replace(findings, scene=dataclasses.replace(findings.scene, name=name), command=name)
    shown = write_report(named, tmp_path).read_text(encoding="utf-8")
    assert all(sign.isprintable() or sign == "\n" for sign in shown)
    assert "a\\x1b[31m" in shown
    assert "<b>" not in shown
    results = (tmp_path / "results.json").read_text(encoding="utf-8")
    assert results.replace("\n", "").isprintable()
    assert json.loads(results)["scene"]["name"] == name
