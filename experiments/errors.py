"""Errors that the user sees as one message, without a traceback."""

import re


class ConfigError(ValueError):
    """An input that cannot be used; the message is for the person who gave it."""

    def __str__(self) -> str:
        return printable(super().__str__())


def printable(text: str) -> str:
    """A text without what a terminal would obey: names and logs are of whoever wrote them."""
    return re.sub(r"[\x00-\x08\x0b-\x1f\x7f-\x9f]", "\N{REPLACEMENT CHARACTER}", text)
