"""What the user is told in one message."""


class ConfigError(ValueError):
    """An input that cannot be used; the message is for the person who gave it."""
