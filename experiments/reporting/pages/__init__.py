"""What a report is put together from, and how it becomes an HTML or a Markdown page."""

from experiments.reporting.pages.section import Drawing, Section, SummaryRow, summary_row

__all__ = ["Drawing", "Section", "SummaryRow", "summary_row"]
