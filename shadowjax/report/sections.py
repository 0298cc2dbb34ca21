"""The parts of the page that show shadows: views, techniques, the comparison and the advice."""

import numpy as np

from shadowjax import plotting
from shadowjax.evaluate.slope_limits import told
from shadowjax.plotting.pixels import Window, difference_pixels, outlined
from shadowjax.report.advisor import bytes_text
from shadowjax.report.findings import Findings
from shadowjax.report.html import chart, element, figure, pixels, section, table, text


def _percent(fraction: float) -> str:
    return f"{100 * fraction:.2f} %"


def _crop(image: np.ndarray, window: Window, alternative: str) -> str:
    """A part of a picture, one screen block for each pixel."""
    return pixels(image[window], alternative, class_="crisp")


def views(findings: Findings, window: Window) -> str:
    """What the light sees and what the camera sees."""
    light_map = findings.light_map
    depth = plotting.depth_map(np.asarray(light_map.depth), np.asarray(light_map.face) >= 0, unit="world units")
    light = figure(
        chart(depth, "depth map"),
        "Light view.",
        "The depth map that the techniques read: bright is near the light, grey is where its rays meet nothing.",
        class_="paper",
    )
    camera = figure(
        pixels(outlined(findings.exact_picture, window), "camera view with exact shadows"),
        "Camera view with exact shadows.",
        "One shadow ray for every sample: the reference below. The frame marks the edge that is magnified there.",
    )
    return section(
        "views",
        "Two views of one scene",
        "A shadow map answers for the camera what only the light can see.",
        element("div", camera, light, class_="pair"),
    )


def techniques(findings: Findings, window: Window) -> str:
    """Each technique next to the exact shadow, with its signed error and a magnified edge."""
    mask = np.asarray(findings.comparison.view.pixel_mask)
    exact, cards = findings.exact_values, []
    for index, record in enumerate(findings.comparison.records):
        name, test, image = record.technique, findings.pixel_values(index), findings.pictures[index]
        wrong = difference_pixels(test, exact, mask, findings.exact_picture)
        bound = "a continuum" if record.tones_bound is None else f"of {record.tones_bound}"
        header = element(
            "header",
            element("h3", text(name)),
            element("span", text(f"light error {_percent(record.light_rmse)}")),
            element("span", text(f"RMS error of visibility {record.rmse:.4f}")),
            element("span", text(f"false light {_percent(record.false_lit)}")),
            element("span", text(f"false shadow {_percent(record.false_shadow)}")),
            element("span", text(f"{record.tones} tones, {bound}")),
        )
        truth = element("div", role="img", aria_label="exact picture", class_="exact-picture")
        crops = [
            figure(_crop(findings.exact_picture, window, "exact, magnified"), "Exact", "magnified"),
            figure(_crop(image, window, f"{name}, magnified"), name, "magnified"),
        ]
        row = element(
            "div",
            figure(truth, "Exact"),
            figure(pixels(image, f"picture with {name}"), name),
            figure(pixels(wrong, f"error of {name}"), "Difference"),
            element("div", *crops, class_="crops"),
            class_="row",
        )
        cards.append(element("article", header, row, class_="card"))
    key = element(
        "p",
        element("span", '<i style="background:#cc4d00"></i>false light: lit, should be dark', class_="key"),
        element("span", '<i style="background:#0d54a8"></i>false shadow: dark, should be lit', class_="key"),
        class_="note",
    )
    return section(
        "techniques",
        "Techniques next to the exact shadow",
        "Look at the magnified edge: a hard test shows the map's texels as steps, a filter spreads each step over its "
        "tones, and more depths in a texel smooth it with fewer taps. The difference shows which side pays for it.",
        key,
        *cards,
    )


def comparison(findings: Findings) -> str:
    """The records as a table."""
    columns = (
        "technique", "light error", "RMS error", "false light", "false shadow", "umbra light", "edges off by", "SSIM",
        "FLIP", "tones", "memory", "build", "lookup",
    )  # fmt: skip
    rows = [
        (
            r.technique, _percent(r.light_rmse), f"{r.rmse:.4f}", _percent(r.false_lit), _percent(r.false_shadow),
            _percent(r.bleed), f"{r.edge_distance:.2f} px", "–" if r.ssim is None else f"{r.ssim:.3f}",
            "–" if r.flip is None else f"{r.flip:.3f}",
            f"{r.tones} / {'∞' if r.tones_bound is None else r.tones_bound}",
            bytes_text(r.stored_bytes), f"{r.build_ms:.1f} ms", f"{r.visibility_ms:.1f} ms",
        )
        for r in findings.comparison.records
    ]  # fmt: skip
    advice = findings.advice
    chosen = []
    if advice is not None and advice.recommended.resolution == findings.settings.resolution:
        chosen = [findings.comparison.names.index(advice.recommended.record.technique)]
    said = told([(r.technique, r.slope_limit) for r in findings.comparison.records])
    return section(
        "table",
        "Comparison",
        f"Over the {findings.receivers:,} samples where a surface faces the light. Light error weighs visibility by "
        "the cosine of incidence, as a picture does; the other errors count every sample alike. Umbra light is what "
        "leaks into full shadow away from its edges. Times are warm medians of three on this machine.",
        table(columns, rows, numeric=range(1, len(columns)), strong=chosen),
        *([] if said is None else [element("p", text(f"{said}."), class_="note")]),
    )


def advice(findings: Findings) -> str:
    """What to take, and the chart it was read from."""
    advice = findings.advice
    if advice is None:
        return ""
    points = {
        choice.name: (choice.record.map_bytes / 2**10, 100 * choice.error)
        for choice in findings.choices
        if choice.record.map_bytes > 0
    }
    drawn = plotting.scatter(
        points,
        "map memory (KiB)",
        "RMS error of received light (%)",
        front=_memory_front(findings),
        chosen=advice.recommended.name,
        log_x=True,
        width=6.2,
        height=4.9,
    )
    reasons = element("ul", *(element("li", text(reason)) for reason in advice.reasons))
    return section(
        "advice",
        f"Recommendation: {advice.recommended.name}",
        "The rule: of all that come within 10 % of the lowest error of received light, take the one with the least "
        "memory, then the least time. It holds for this view of this scene on this machine.",
        element(
            "div",
            element("div", reasons),
            figure(
                chart(drawn, "error against memory"),
                "Error against memory.",
                "Down and to the left is better; no point lies below and left of the line. Orange is recommended.",
                class_="paper",
            ),
            class_="pair",
        ),
        figure(
            chart(
                plotting.pareto(findings.comparison.records, "All techniques at one size of map"), "error, memory, time"
            ),
            "Error against memory and against time.",
            "The line joins techniques that no other beats in error and that cost; the rest are grey. Dashed lines "
            "are the times of exact answers without a map.",
            class_="paper",
        ),
    )


def _memory_front(findings: Findings) -> list[str]:
    """Names of the choices that nothing beats in error and memory, time left aside."""
    mapped = [choice for choice in findings.choices if choice.record.map_bytes > 0]
    ordered = sorted(mapped, key=lambda choice: (choice.record.map_bytes, choice.error))
    front, best = [], float("inf")
    for choice in ordered:
        if choice.error < best:
            front.append(choice.name)
            best = choice.error
    return front
