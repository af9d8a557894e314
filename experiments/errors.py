"""Errors that the user sees as one message, without a traceback."""


class ConfigError(ValueError):
    """An input that cannot be used; the message is for the person who gave it."""
