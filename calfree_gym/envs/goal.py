"""The reward as a function of goals alone, as hindsight relabelling needs it."""

from __future__ import annotations

from typing import Any

import numpy as np

from calfree_gym.envs.shared import StereoArmShared
from calfree_gym.tasks import reach


class GoalRewards(StereoArmShared):
    """What a goal environment has besides: reward and end as pure functions of sensor vectors."""

    def compute_reward(self, achieved_goal: Any, desired_goal: Any, info: Any) -> Any:
        """The reward (...) for sensor vectors (..., 4); pure, and what `step` returns."""
        distances = reach.image_distances(achieved_goal, desired_goal)
        return self._reward(distances, reach.rendezvous(distances, self.arms.tolerance))

    def compute_terminated(self, achieved_goal: Any, desired_goal: Any, info: Any) -> Any:
        """Whether a trial ends (...) at sensor vectors (..., 4); pure, and what `step` returns."""
        distances = reach.image_distances(achieved_goal, desired_goal)
        ended = reach.rendezvous(distances, self.arms.tolerance)
        return ended if self._ends else np.zeros_like(ended)

    def compute_truncated(self, achieved_goal: Any, desired_goal: Any, info: Any) -> Any:
        """False: only the number of motions truncates a trial (see `max_episode_steps`)."""
        return np.zeros(np.shape(achieved_goal)[:-1], bool)
