"""What stands at the head of a report, on the terminal and in README: one table and what it comes to."""

from experiments.reporting.head.sentences import sentences
from experiments.reporting.head.table import head_part, head_table, table_of

__all__ = ["head_part", "head_table", "sentences", "table_of"]
