"""The HTML report and what it says."""

from shadowjax.report.findings import DEFAULT_TECHNIQUES, Findings, Settings, collect
from shadowjax.report.write import check_report, write_report

__all__ = ["DEFAULT_TECHNIQUES", "Findings", "Settings", "check_report", "collect", "write_report"]
