"""The sensor-control Jacobian J = ∂d/∂c, estimated from motions and from what they did in the images."""

from agents.jacobian.estimator import Estimator, distance_jacobian
from agents.jacobian.kalman import Kalman
from agents.jacobian.least_squares import LocalLeastSquares, RecursiveLeastSquares
from agents.jacobian.rank_one import Broyden, TrustRegion
from agents.jacobian.test_motions import TestMotions

ESTIMATORS: dict[str, type[Estimator]] = {
    "broyden": Broyden,
    "trust_region": TrustRegion,
    "rls": RecursiveLeastSquares,
    "kalman": Kalman,
    "local": LocalLeastSquares,
}
"""Estimators that keep J up to date by every motion, by name. `TestMotions` measures it anew."""

__all__ = ["ESTIMATORS", "Estimator", "Kalman", "TestMotions", "distance_jacobian"]
