"""The report as one page of HTML that needs nothing else: no script, no network, pictures inside."""

import numpy as np

from shadowjax.io import png_bytes
from shadowjax.plotting.pixels import Window, edge_window
from shadowjax.report import sections, theory_sections
from shadowjax.report.advisor import Choice, bytes_text
from shadowjax.report.findings import Findings
from shadowjax.report.html import data_uri, element, figure, pixels, text
from shadowjax.report.stylesheet import STYLE


def page(findings: Findings) -> str:
    """The whole page."""
    window = _window(findings)
    parts = [
        ("views", "Views", sections.views(findings, window)),
        ("techniques", "Techniques", sections.techniques(findings, window)),
        ("table", "Comparison", sections.comparison(findings)),
        ("advice", "Recommendation", sections.advice(findings)),
        ("tones", "Tones", theory_sections.tones(findings)),
        ("cost", "Cost", theory_sections.cost(findings)),
        ("equations", "Equations", theory_sections.equations(findings)),
        ("machine", "Machine", theory_sections.machine(findings)),
    ]
    shown = [(key, title, body) for key, title, body in parts if body]
    links = element("nav", *(element("a", text(title), href=f"#{key}") for key, title, _ in shown))
    exact = f":root {{ --exact: url({data_uri(png_bytes(findings.exact_picture))}); }}"
    ratio = f".exact-picture {{ aspect-ratio: {findings.settings.width} / {findings.settings.height}; }}"
    head = [
        '<meta charset="utf-8">',
        '<meta name="viewport" content="width=device-width, initial-scale=1">',
        element("title", text(f"Shadows of {findings.scene.name} · shadowjax")),
        element("style", STYLE + exact + ratio),
    ]
    body = element("main", _top(findings, links), *(content for _, _, content in shown), _foot(findings))
    return "<!doctype html>\n" + element("html", element("head", *head), element("body", body), lang="en") + "\n"


def _window(findings: Findings) -> Window:
    """The crop that every technique is magnified in: where the exact shadow has its longest edge."""
    height, width = findings.exact_picture.shape[:2]
    mask = np.asarray(findings.comparison.view.pixel_mask)
    return edge_window(findings.exact_values, mask, max(2, height // 9), max(2, width // 9))


def _top(findings: Findings, links: str) -> str:
    """Name of the scene, its picture, the verdict and the facts."""
    scene, settings, advice = findings.scene, findings.settings, findings.advice
    best, title = findings.exact_picture, "by shadow rays"
    shown = None if advice is None else advice.smooth or advice.recommended
    if shown is not None and shown.resolution == settings.resolution:
        best, title = findings.pictures[findings.comparison.names.index(shown.record.technique)], f"with {shown.name}"
    headline = figure(
        pixels(best, f"{scene.name} {title}"),
        f"{scene.name},",
        f"{title}; {settings.width} × {settings.height} pixels.",
    )
    facts = {
        "Scene": scene.description,
        "Triangles": f"{scene.mesh.num_faces:,}",
        "Light": _light_text(findings),
        "Maps": f"{settings.resolution} × {settings.resolution} texels",
        "Techniques": f"{len(findings.comparison.names)}, each against a shadow ray for every pixel",
    }
    if findings.equations:
        good = sum(result.passed for result in findings.equations)
        facts["Equations"] = f"{good} of {len(findings.equations)} verified"
    verdicts = "" if advice is None else _verdict("Recommended for this view", advice.recommended)
    if advice is not None and advice.smooth is not None and advice.smooth is not advice.recommended:
        verdicts += _verdict("For soft edges", advice.smooth)
    listed = "".join(element("dt", text(key)) + element("dd", text(value)) for key, value in facts.items())
    side = element("div", verdicts, element("dl", listed, class_="facts", style="margin-top:18px"))
    return element(
        "header",
        element("p", "shadowjax report", class_="eyebrow"),
        element("h1", text(f"Shadows of {scene.name}, compared with the exact answer")),
        links,
        element("div", headline, side, class_="hero", style="margin-top:22px"),
        class_="top",
    )


def _verdict(occasion: str, choice: Choice) -> str:
    """A recommendation in large type."""
    record = choice.record
    numbers = (
        f"{100 * choice.error:.1f} % light error, {record.tones} tones, {bytes_text(record.map_bytes)} of maps, "
        f"{choice.total_ms:.0f} ms for maps and picture"
    )
    return element(
        "div",
        element("p", text(occasion), class_="eyebrow"),
        element("p", text(choice.name), class_="big"),
        element("p", text(numbers)),
        class_="verdict",
    )


def _light_text(findings: Findings) -> str:
    """The kind of the light and where it comes from."""
    scene = findings.scene
    to_light = np.asarray(scene.lights[0].to_light(scene.mesh.vertices.mean(axis=0))[0], float)
    kind = type(scene.lights[0]).__name__.removesuffix("Light").lower()
    elevation = np.degrees(np.arcsin(np.clip(to_light[1], -1, 1)))
    return f"{kind}, {elevation:.0f}° above the horizon"


def _foot(findings: Findings) -> str:
    return element("footer", text(f"Made by shadowjax {findings.machine['shadowjax']} on {findings.machine['date']}."))
