"""The HTML report and what it says."""

from shadowjax.report.findings import DEFAULT_TECHNIQUES, Findings, Settings, collect
from shadowjax.report.write import write_report

__all__ = ["DEFAULT_TECHNIQUES", "Findings", "Settings", "collect", "write_report"]
