"""Names by which specs and programs of earlier versions know `calfree_gym.tasks.safe_reach`."""

from calfree_gym.tasks.safe_reach import SafeReachEnv, SafeReachVectorEnv

make, make_vec = SafeReachEnv, SafeReachVectorEnv

__all__ = ["SafeReachEnv", "SafeReachVectorEnv", "make", "make_vec"]
