"""Names by which specs and programs of earlier versions know `calfree_gym.tasks.insert`."""

from calfree_gym.tasks.insert import InsertEnv, InsertVectorEnv

__all__ = ["InsertEnv", "InsertVectorEnv"]
