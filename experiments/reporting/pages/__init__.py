"""What a report is put together from, and how it becomes an HTML or a Markdown page."""

from experiments.reporting.pages.section import Drawing, Head, Section, SummaryRow, summary_row

__all__ = ["Drawing", "Head", "Section", "SummaryRow", "summary_row"]
