"""Results as tables: on the screen, and as the page fragment that the documentation includes."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from rich.console import Console
from rich.table import Table
from rich.text import Text

TITLES = {
    "depth": "Depth maps",
    "faces": "Depth and triangle",
    "new-view": "A new light with every call",
    "new-vertices": "New vertices with every call",
    "visibility": "Exact visibility of an image",
    "multi-depth": "Multi-depth map, planes and PCF(9, 2) of an image",
    "gradient": "Gradient of a depth loss, all vertices",
}
Block = tuple[str, list[str], list[list[str]]]


def blocks(results: Mapping[str, Any]) -> Iterator[Block]:
    """Title, heads and rows of every table, the same for screen and page."""
    if results["ratios"]:
        yield _ratio_block(results["ratios"])
    cases: dict[str, list[Mapping[str, Any]]] = {}
    for record in results["records"]:
        cases.setdefault(record["case"], []).append(record)
    for case, records in cases.items():
        yield _time_block(TITLES[case], records)
    for case, records in cases.items():
        if case in ("depth", "visibility", "multi-depth", "gradient"):
            yield _cost_block(f"{TITLES[case]}: compilation and memory", records)
    yield from _agreement_block(results["records"])
    if results["laws"]:
        yield _law_block(results["laws"])


def _where(record: Mapping[str, Any]) -> str:
    return f"{record['mesh']}, {record['rows']}²" + f", {record['projection'][:5]}."


def _names(records: Sequence[Mapping[str, Any]]) -> list[str]:
    return list(dict.fromkeys(name for record in records for name in record["contestants"]))


def _ratio_block(ratios: Sequence[Mapping[str, Any]]) -> Block:
    rows = []
    for entry in ratios:
        row = [TITLES[entry["case"]], entry["mesh"], f"{entry['rows']}²", _number(entry["ours_ms"])]
        for kind in ("ray caster", "rasteriser"):
            peer = entry.get(kind)
            row.append("" if peer is None else f"{peer['ratio']:.2f} ({peer['name']})")
        best = entry["best"]
        gain = entry["ours_ms"] / best["ms"]
        row.append(f"{_number(best['ms'])} ({best['name']})")
        row += [f"{entry[kind]['ratio'] * gain:.2f}" if kind in entry else "" for kind in ("ray caster", "rasteriser")]
        rows.append(row)
    peers = ["fastest ray caster", "fastest rasteriser"]
    heads = ["case", "mesh", "rays", "ours, ms", *(f"{peer} ÷ ours" for peer in peers)]
    heads += ["our fastest, ms", *(f"{peer} ÷ that" for peer in peers)]
    return "Fastest peers, times over ours", heads, rows


def _time_block(title: str, records: Sequence[Mapping[str, Any]]) -> Block:
    names = _names(records)
    rows = [[_where(record), *(_time(record["contestants"].get(name)) for name in names)] for record in records]
    return f"{title}: median ms, × the first", ["mesh, rays, view", *names], rows


def _time(entry: Mapping[str, Any] | None) -> str:
    return "" if entry is None else f"{_number(entry['median_ms'])} (× {entry['ratio']:.2f})"


def _number(value: float) -> str:
    return f"{value:.3g}" if value < 100 else f"{value:.0f}"


def _cost_block(title: str, records: Sequence[Mapping[str, Any]]) -> Block:
    """Compilation, planned temporaries and growth of the process; building of trees, for those who build."""
    rows = []
    for record in records:
        for name, entry in record["contestants"].items():
            if "temporaries_mb" in entry:
                figures = (entry.get(key) for key in ("min_ms", "compile_s", "temporaries_mb", "resident_mb"))
                rows.append([_where(record), name, *("" if x is None else f"{x:.1f}" for x in figures)])
    return title, ["mesh, rays, view", "what", "least ms", "compile s", "planned MB", "process grew MB"], rows


def _agreement_block(records: Sequence[Mapping[str, Any]]) -> Iterator[Block]:
    """The worst agreement of every contestant over all pictures."""
    heads = {
        "depth_median_difference": "depth, median, radii",
        "depth_differs_percent": "depth, % of cells",
        "face_differs_percent": "triangle, % of cells",
        "visibility_differs_percent": "visibility, % of points",
        "gradient_median_difference_percent": "gradient, median %",
    }
    worst: dict[str, dict[str, float]] = {}
    for record in records:
        for name, entry in record["contestants"].items():
            for key in heads:
                if key in entry:
                    mine = worst.setdefault(name, {})
                    mine[key] = max(mine.get(key, 0.0), entry[key])
    if worst:
        rows = [
            [name, *("" if key not in entry else f"{entry[key]:.2g}" for key in heads)] for name, entry in worst.items()
        ]
        yield "Greatest differences from the first contestant", ["", *heads.values()], rows


def _law_block(laws: Mapping[str, Mapping[str, Any]]) -> Block:
    rows = [
        [
            name,
            *(f"{law[key]:.2f}" for key in ("ns_per_triangle", "ns_per_pixel", "ns_per_root_triangle_pixel")),
            *(f"{100 * law[key]:.0f}" for key in ("median_relative_error", "largest_relative_error")),
        ]
        for name, law in laws.items()
    ]
    heads = ["", "ns / triangle", "ns / ray", "ns / √(triangle · ray)", "median error %", "largest error %"]
    return "Law of time of depth maps", heads, rows


def show(results: Mapping[str, Any], console: Console) -> None:
    """All tables on a screen."""
    for title, heads, rows in blocks(results):
        table = Table(title=title, title_justify="left", header_style="bold", box=None, pad_edge=False)
        for index, head in enumerate(heads):
            table.add_column(head, justify="right" if index else "left")
        for row in rows:
            table.add_row(*map(Text, row))
        console.print(table, "")
    for name, reason in results["absent"].items():
        console.print(Text(f"absent: {name}: {reason}"))


def fragment(results: Mapping[str, Any]) -> str:
    """All tables as MyST Markdown, headed by machine, versions and date."""
    machine = results["machine"]
    lines = [
        f"Machine: {machine['processor']}, {machine['cores']} cores, {machine['system']}, device {machine['device']};",
        f"Python {machine['python']}, JAX {machine['jax']}, {machine['dtype']}; {machine['date']}. "
        f"Printed by `{results['command']}` in {results['seconds']:.0f} s.",
        "",
        *(f"- {name}: {version}" for name, version in results["versions"].items()),
        *(f"- {name}: absent ({reason})" for name, reason in results["absent"].items()),
        "",
    ]
    for title, heads, rows in blocks(results):
        head, rule = " | ".join(heads), " | ".join(["---", *["---:"] * (len(heads) - 1)])
        lines += [f"### {title}", "", f"| {head} |", f"| {rule} |", *(f"| {' | '.join(row)} |" for row in rows), ""]
    return "\n".join(lines)
