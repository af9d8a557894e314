"""Perturbations in anybody's environment, and what they cost a policy."""

from calfree_gym.perturb.paired import Paired, paired
from calfree_gym.perturb.simulation import Adapter
from calfree_gym.perturb.stereo_points import FixedCamera, StereoPoints, Words
from calfree_gym.perturb.wrapper import Perturb

__all__ = ["Adapter", "FixedCamera", "Paired", "Perturb", "StereoPoints", "Words", "paired"]
