"""In place of torch, gigabytes of which `lerobot.robots` uses but names of types; first on the path."""


class Tensor:
    """A type."""


device = dtype = Tensor


def set_num_threads(count):
    """There is none."""


def __getattr__(name):
    if name.startswith("__"):
        raise AttributeError(name)
    return type(name, (), {})
