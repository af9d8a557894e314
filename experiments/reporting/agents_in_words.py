"""What agents are called where people read."""


def in_words(label: str, name: str) -> str:
    """What an agent is called in figures and tables; a label of its own stays as it is."""
    return label.replace("_", " ") if label == name else label


def colour(label: str, name: str) -> str:
    """The colour of an agent, as "#rrggbb"."""
    return "#0072B2"
