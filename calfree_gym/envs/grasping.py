"""Names by which specs and programs of earlier versions know `calfree_gym.tasks.grasp`."""

from calfree_gym.tasks.grasp import GraspEnv, GraspVectorEnv

make, make_vec = GraspEnv, GraspVectorEnv

__all__ = ["GraspEnv", "GraspVectorEnv", "make", "make_vec"]
