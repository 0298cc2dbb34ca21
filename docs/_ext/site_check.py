"""After each build: no link or anchor of the site leads nowhere, no table is left as text, nothing widens a page."""

import re
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

from page_widths import too_wide
from sphinx.application import Sphinx
from sphinx.util import logging

LOGGER = logging.getLogger(__name__)
# What keeps a page as wide as its window where no browser can measure it: rules of site.css, by what they keep narrow.
KEPT_NARROW = {
    "words": r"article\.bd-article \{[^}]*overflow-wrap: break-word",
    "names of the API": r"article\.bd-article \.sig \{[^}]*overflow-wrap: anywhere",
    "pictures": r"article\.bd-article img[^{]*\{[^}]*max-width: 100%",
    "formulas": r"\.formula-display[^{]*\{[^}]*overflow-x: auto",
}
SCROLLING = {"pst-scrollable-table-container", "output_area", "cell_output"}  # classes around tables, of the theme


class Page(HTMLParser):
    """Anchors, links and paragraphs of one page."""

    def __init__(self, content: str):
        super().__init__()
        self.anchors: set[str] = set()
        self.links: list[str] = []
        self.paragraphs: list[str] = []
        self.bare_tables = 0
        self._inside = False
        self._divisions: list[set[str]] = []
        self.feed(content)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Note what the element is called and what it leads to."""
        given = dict(attrs)
        self.anchors |= {name for key in ("id", "name") if (name := given.get(key))}
        if tag in ("a", "img", "link", "script", "source"):
            self.links += [link for key in ("href", "src") if (link := given.get(key))]
        if tag == "div":
            self._divisions.append(set((given.get("class") or "").split()))
        scrolls = any(classes & SCROLLING for classes in self._divisions) or "indextable" in (given.get("class") or "")
        if tag == "table" and not scrolls:
            self.bare_tables += 1
        if tag == "p":
            self.paragraphs.append("")
            self._inside = True

    def handle_endtag(self, tag: str) -> None:
        """Paragraphs and divisions end."""
        if tag == "div" and self._divisions:
            self._divisions.pop()
        self._inside = self._inside and tag != "p"

    def handle_data(self, data: str) -> None:
        """Text belongs to the paragraph that is open."""
        if self._inside:
            self.paragraphs[-1] += data


def faults(site: Path) -> Iterator[str]:
    """What is wrong with a built site, each fault in a line that begins with the page."""
    paths = [
        path for path in sorted(site.rglob("*.html")) if path.relative_to(site).parts[0] not in ("_static", "_sources")
    ]
    pages = {path: Page(path.read_text(encoding="utf-8")) for path in paths}
    for path, page in pages.items():
        name = path.relative_to(site)
        if page.bare_tables:
            yield f"{name}: {page.bare_tables} tables outside of anything that scrolls"
        for paragraph in page.paragraphs:
            if re.match(r"\s*\|.*\|\s*$", paragraph, re.DOTALL):
                yield f"{name}: a table is left as text: {' '.join(paragraph.split())[:80]}"
        for link in page.links:
            parts = urlsplit(link)
            if parts.scheme or parts.netloc:
                continue
            target = (path.parent / unquote(parts.path)).resolve() if parts.path else path
            target = target / "index.html" if target.is_dir() else target
            if not target.exists():
                yield f"{name}: a dead link: {link}"
            elif parts.fragment and target in pages and unquote(parts.fragment) not in pages[target].anchors:
                yield f"{name}: a link to a place that is not there: {link}"
    style = site / "_static" / "site.css"
    rules = style.read_text(encoding="utf-8") if style.exists() else ""
    for kind, rule in KEPT_NARROW.items():
        if not re.search(rule, rules):
            yield f"_static/site.css: nothing keeps {kind} within a narrow window: {rule}"


def _check(app: Sphinx, error: Exception | None) -> None:
    if error is not None or app.builder.format != "html":
        return
    site = Path(app.outdir).resolve()
    found = list(faults(site))
    measured = too_wide(site)
    if measured is None:
        LOGGER.info("no browser here: widths of pages are not measured")
    for fault in [*found, *(measured or ())]:
        LOGGER.warning(fault)


def setup(app: Sphinx) -> dict[str, bool]:
    """Check when a build has ended."""
    app.connect("build-finished", _check)
    return {"parallel_read_safe": True}
