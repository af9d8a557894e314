"""Errors that the user sees as one message, without a traceback."""

from calfree_gym.errors import printable


class ConfigError(ValueError):
    """An input that cannot be used; the message is for the person who gave it."""

    def __str__(self) -> str:
        return printable(super().__str__())
