"""The sensor-control Jacobian J = ∂d/∂c, estimated from motions and from what they did in the images."""

from .estimator import Estimator, JacobianEstimate, distance_jacobian
from .kalman import Kalman
from .least_squares import LocalLeastSquares, RecursiveLeastSquares
from .rank_one import Broyden, TrustRegion
from .slopes import Slopes
from .test_motions import TestMotions

ESTIMATORS: dict[str, type[Estimator]] = {
    "broyden": Broyden,
    "trust_region": TrustRegion,
    "rls": RecursiveLeastSquares,
    "kalman": Kalman,
    "local": LocalLeastSquares,
}
"""Estimators that keep J up to date by every motion, by name. `TestMotions` measures it anew."""

__all__ = [
    "ESTIMATORS",
    "Estimator",
    "JacobianEstimate",
    "Kalman",
    "Slopes",
    "TestMotions",
    "distance_jacobian",
]
