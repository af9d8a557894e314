"""Claims of the paper: what was measured, and the verdicts."""
