"""Findings onto disk: the page and the results beside it."""

from pathlib import Path

from shadowjax import io
from shadowjax.report.findings import Findings, results_json
from shadowjax.report.page import page

PAGE, RESULTS = "index.html", "results.json"


def write_report(findings: Findings, folder: str | Path) -> Path:
    """Write `index.html` and `results.json`; other files of the folder stay as they are.

    Args:
        findings: From `collect`.
        folder: Made if missing.

    Returns:
        The page.

    Raises:
        ValueError: If the folder is a file or cannot be written.
    """
    folder = io.output_folder(folder)
    io.write_json(folder / RESULTS, results_json(findings))
    return io.write_text(folder / PAGE, page(findings))
