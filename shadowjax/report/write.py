"""Findings onto disk: the page and the results next to it."""

from pathlib import Path

from shadowjax import io
from shadowjax.report.findings import Findings, results_json
from shadowjax.report.page import page

PAGE, RESULTS = "index.html", "results.json"


def check_report(folder: str | Path) -> None:
    """Complain about a folder that `write_report` could not write into, before the work; the folder is made if missing.

    Raises:
        ValueError: If the folder is a file or cannot be written, or one of the two files in it cannot.
    """
    folder = io.output_folder(folder)
    for name in (RESULTS, PAGE):
        io.check_output(folder / name)


def write_report(findings: Findings, folder: str | Path) -> Path:
    """Write `index.html` and `results.json`, both or neither; other files of the folder stay as they are.

    Args:
        findings: From `collect`.
        folder: Made if missing.

    Returns:
        The page.

    Raises:
        ValueError: If the folder is a file or cannot be written.
    """
    target = Path(folder) / PAGE
    results = io.json_text(results_json(findings))
    io.write_files({Path(folder) / RESULTS: results.encode(), target: page(findings).encode()})
    return target
