"""The HTML report and what it says."""

from shadowjax.report.findings import DEFAULT_TECHNIQUES, Findings, ReportSettings, collect
from shadowjax.report.write import check_report, write_report

__all__ = ["DEFAULT_TECHNIQUES", "Findings", "ReportSettings", "check_report", "collect", "write_report"]
