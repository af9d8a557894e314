"""Registers the environments for every test."""

import calfree_gym  # noqa: F401
