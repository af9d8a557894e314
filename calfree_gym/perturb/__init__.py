"""Perturbations in anybody's environment."""

from calfree_gym.perturb.simulation import Adapter
from calfree_gym.perturb.wrapper import Perturb

__all__ = ["Adapter", "Perturb"]
