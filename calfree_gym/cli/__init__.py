"""`calfree`: a real arm from the command line."""

from calfree_gym.cli.command import main

__all__ = ["main"]
