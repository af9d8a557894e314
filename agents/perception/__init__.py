"""From image points that may be noisy, mistaken, missing or late to points that can be trusted."""

from .observation_filter import ObservationFilter, Observing

__all__ = ["ObservationFilter", "Observing"]
