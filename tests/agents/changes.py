"""Changes of what is seen, as knowledge bases map them."""


def seen_as(change):
    """From a function of sensor vectors (n, 4) to one of them and their registers, which stay."""
    return lambda sensors, registers: (change(sensors), registers)
