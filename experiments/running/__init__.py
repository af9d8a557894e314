"""Carrying a comparison out: one process a run, each in a folder of its own."""
