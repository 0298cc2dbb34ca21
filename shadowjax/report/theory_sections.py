"""The parts of the page that show theory against measurement: tones, cost, equations; and the machine."""

import numpy as np

from shadowjax import plotting
from shadowjax.ledger.equation import ledger
from shadowjax.report.findings import Findings
from shadowjax.report.html import Markup, badge, chart, element, figure, section, table, text


def tones(findings: Findings) -> str:
    """Bounds, predictions and counts of tones."""
    valid = np.asarray(findings.comparison.view.valid)
    rows = [
        (
            row.technique,
            "continuum" if row.bound is None else row.bound,
            "–" if row.along_axis is None else row.along_axis,
            "–" if row.straight_edge is None else row.straight_edge,
            row.counted,
        )
        for row in findings.tones
    ]
    histograms = plotting.tone_histogram(
        {
            name: np.asarray(visibility)[valid]
            for name, visibility in zip(findings.comparison.names, findings.comparison.visibilities, strict=True)
        },
        {row.technique: row.bound for row in findings.tones},
    )
    return section(
        "tones",
        "Tones",
        "A filter of k taps over n depths gives nk + 1 tones at most. A straight shadow edge reaches fewer of them: "
        "the middle columns come from all windows that a straight edge can make. Curved and crossing edges reach more.",
        table(
            ("technique", "bound nk + 1", "edge along an axis", "any straight edge", "counted here"),
            rows,
            numeric=range(1, 5),
        ),
        figure(
            chart(histograms, "histograms of tones"),
            "How often each tone between dark and lit occurs.",
            "A bar for each tone; the axis holds visibilities, and fully lit or dark pixels are left out.",
            class_="paper",
        ),
    )


def cost(findings: Findings) -> str:
    """Fetches by the source's model, next to measured times."""
    if not findings.costs:
        return ""
    records = {record.technique: record for record in findings.comparison.records}
    rows = [
        (
            row.technique, row.build_per_texel, f"{row.build_fetches:,}", row.taps, f"{row.lookup_fetches:,}",
            f"{row.build_fetches + row.lookup_fetches:,}", f"{records[row.technique].build_ms:.1f} ms",
            f"{records[row.technique].visibility_ms:.1f} ms",
        )
        for row in findings.costs
    ]  # fmt: skip
    parts = [
        table(
            (
                "technique",
                "q reads a texel",
                "h·w·q to build",
                "k taps",
                "f·k to look up",
                "fetches",
                "build",
                "lookup",
            ),
            rows,
            numeric=range(1, 8),
            caption="Reads a texel are counted on the policy's own arrays. A texel's depths lie side by side and count "
            "as one fetch. Build time is mostly the casting of rays, which all techniques share.",
        )
    ]
    if findings.crossovers:
        crossings = [
            (
                f"{c.multi_depth} against {c.plain}",
                f"{c.fragments:,.0f}",
                f"{c.size_ratio:.2f}",
                c.here,
            )
            for c in findings.crossovers
        ]
        parts.append(
            table(
                ("pair", "receivers at the crossover", "picture / map area", "fewer fetches here"),
                crossings,
                numeric=(1, 2, 3),
                caption=f"This picture has {findings.receivers:,} receivers.",
            )
        )
    return section(
        "cost",
        "Cost",
        "A multi-depth map costs q reads for each of its h·w texels once, and saves taps at each of the f receivers: "
        "it pays above q·h·w/r receivers, r being the taps saved (mdsm, eqs 5.3 to 5.7).",
        *parts,
    )


def equations(findings: Findings) -> str:
    """What the ledger of equations says, checked while the report was made."""
    results = findings.equations
    if not results:
        return ""
    known, failed = ledger(), [result for result in results if not result.passed]
    kinds = {"holds": "good", "conditional": "note", "erratum": "bad"}
    counts = {verdict: sum(result.verdict == verdict for result in results) for verdict in kinds}
    checks = sum(len(result.checks) for result in results)
    summary = (
        f"{len(results) - len(failed)} of {len(results)} equations passed {checks} checks: {counts['holds']} hold as "
        f"printed, {counts['conditional']} hold under a condition, {counts['erratum']} are wrong as printed and are "
        "corrected here."
    )
    rows = [
        (
            Markup(element("code", text(result.id))),
            result.source,
            badge(result.verdict, kinds[result.verdict]),
            badge("passed", "good") if result.passed else badge("FAILED", "bad"),
        )
        for result in results
    ]
    errata = [
        (known[result.id].source, correction.printed, correction.corrected)
        for result in results
        if (correction := known[result.id].correction) is not None
    ]
    parts = []
    if failed:
        parts.append(element("p", badge("some equations failed", "bad").html))
    if errata:
        parts.append(
            element(
                "details",
                element("summary", text(f"Errata: {len(errata)} statements that are wrong as printed")),
                table(("source", "as printed", "as it should read"), errata),
            )
        )
    listing = element(
        "details",
        element("summary", text(f"All {len(results)} equations")),
        table(("equation", "source", "verdict", "check"), rows),
    )
    sources = ", ".join(findings.settings.equations)
    return section(
        "equations",
        "Equations behind the techniques",
        summary,
        *parts,
        listing,
        element(
            "p",
            text(
                "Each closed form is compared with an independent derivation or with a measurement on the package's "
                f"own arrays. Sources checked here: {sources}; the command "
            ),
            element("code", "shadowjax verify"),
            text(f" checks all {len(known)}."),
            class_="note",
        ),
    )


def machine(findings: Findings) -> str:
    """What it ran on, and how to run it again."""
    listed = "".join(element("dt", text(key)) + element("dd", text(value)) for key, value in findings.machine.items())
    return section(
        "machine",
        "Machine, versions, and how to make this page again",
        "Times belong to this machine; everything else is the same wherever it runs, up to rounding.",
        element("pre", element("code", text(findings.command))),
        element("dl", listed, class_="facts"),
    )
