"""Reports on picks: table, Markdown, CSV, JSON with a schema, and one page with the picture."""

from pinproof.picks.report.page import write_report_page
from pinproof.picks.report.report import PickReport
from pinproof.picks.report.rows import verdict_row

__all__ = ["PickReport", "verdict_row", "write_report_page"]
