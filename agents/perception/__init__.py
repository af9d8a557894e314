"""From image points that may be noisy, mistaken, missing or late to points that can be trusted."""

from .gating import linear_deviations_px
from .observation_filter import ObservationFilter, Observing

__all__ = ["ObservationFilter", "Observing", "linear_deviations_px"]
