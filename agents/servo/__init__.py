"""Procedures that seek the rendezvous, written to be read beside the paper."""

from collections.abc import Callable

from agents.agent import Look, Procedure

Servo = Callable[[Look], Procedure]
"""Begins a procedure from a look."""
