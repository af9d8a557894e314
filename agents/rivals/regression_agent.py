"""An agent that goes by a regression over all its looks, and keeps the latest to begin anew with."""

from collections.abc import Mapping
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from ..base.checks import checked_array
from ..base.observation import POINTS, Observation
from ..base.prior_knowledge import PriorKnowledge
from ..base.procedure import Procedure, ProcedureAgent
from ..base.storage import prefixed, under
from ..memory.pairs import Cameras, HomeView
from ..servo.perception import ObservationFilter, Observing
from .images import ImageRegression
from .looks import RegressionLooks
from .reach import RegressionFindings, RegressionReach


class RegressionAgent(ProcedureAgent):
    """Learns from every look. It knows two changes of the world.

    A camera that twice sees the gripper elsewhere at home than in the last trials has been moved: its points
    are forgotten. Its home views of earlier objects stay, as features of what the other camera saw. Where
    another trial comes no nearer, the looks of earlier trials are forgotten.

    Attributes:
        looks: The latest, to begin anew with.
        images: What they say of image points.
        filter: What is known of observations.
        home: Where the gripper is seen at home.

    Args:
        env: The environment.
        unlearned: Image points before any look.
        seed: Of places and probes that are drawn.
    """

    prior_knowledge = frozenset({PriorKnowledge.IMAGE_SCALE, PriorKnowledge.NOISE})
    KEPT = 4_000
    """So many looks are kept (a guard of memory and time)."""

    def __init__(self, env: gym.Env[Any, Any], unlearned: ImageRegression, seed: int = 0) -> None:
        super().__init__(env, seed)
        self._unlearned, self.images = unlearned, unlearned.copy()
        self.looks = RegressionLooks.none(self._motors)
        self.filter, self.home = ObservationFilter(), HomeView()
        self._trials = 0
        space = env.observation_space["observation"]  # type: ignore[index]
        self._ends = np.stack([space.low[POINTS:], space.high[POINTS:]]).astype(float)

    def new_findings(self) -> RegressionFindings:
        random = np.random.default_rng([self.seed, self._trials])
        filter_ = self.filter.for_next_trial()
        return RegressionFindings(self.images.copy(), self.looks, filter_, random, self._ends)

    def procedure(self, first: Observation, findings: RegressionFindings) -> Procedure:
        """See `ProcedureAgent`."""
        now = yield from self._look(first, findings)
        jumped = self._jumped(findings)
        if jumped.any():  # unless a point was mistaken
            now = yield from self._look((yield np.zeros_like(now.registers)), findings)
            jumped &= self._jumped(findings)
        if jumped.any():
            findings.begin_anew(self._unlearned, findings.looks.without(jumped))
        unlearned = None if jumped.any() else self._unlearned
        yield from RegressionReach(now, findings, unlearned).go()

    def _look(self, first: Observation, findings: RegressionFindings) -> Observing:
        """What can be trusted of a first observation; notes where the gripper is seen at home."""
        now = yield from findings.filter.first(first)
        at_home = now.shows_gripper and not now.registers.any()
        findings.gripper_home = now.gripper if at_home else None
        return now

    def _jumped(self, findings: RegressionFindings) -> Cameras:
        """Which cameras show the gripper elsewhere at home than in the last trials."""
        home = findings.gripper_home
        return np.zeros(2, bool) if home is None else self.home.jumped(home)

    def learn_trial(self, findings: RegressionFindings, last: Observation, ended: bool) -> None:
        """See `ProcedureAgent`. Every look teaches, however the trial ends."""
        self.images, self.filter = findings.images, findings.filter
        self.looks = findings.looks.only(slice(-self.KEPT, None))
        if findings.gripper_home is not None:
            if self._jumped(findings).any():
                self.home.keep_since(self._trials)
            self.home.add(findings.gripper_home, self.filter.noise.px, self._trials)
        self._trials += 1

    def arrays(self) -> dict[str, NDArray[Any]]:
        home = {"home": self.home.sensors, "home_trials": self.home.trials}
        counts = {"trials": np.array([self._trials]), "home_noise_px": np.array([self.home.noise_px])}
        known = self.looks.arrays() | prefixed("images", self.images.arrays())
        return known | self.filter.arrays() | home | counts

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        looks, filter_, home = RegressionLooks.of(arrays, self._motors), ObservationFilter(), HomeView()
        images = self._unlearned.copy()
        images.restore(under("images", arrays), looks)
        filter_.restore(arrays)
        home.sensors = checked_array(arrays, "home", (None, 4))
        home.trials = checked_array(arrays, "home_trials", (len(home.sensors),)).astype(np.int64)
        home.noise_px = float(checked_array(arrays, "home_noise_px", (1,))[0])
        self._trials = int(checked_array(arrays, "trials", (1,))[0])
        self.looks, self.images, self.filter, self.home = looks, images, filter_, home
