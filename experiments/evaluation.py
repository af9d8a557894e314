"""Scoring an agent on held-out trials, without changing it."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Protocol

import gymnasium
import numpy as np
from gymnasium.vector import VectorEnv

from agents.base.checks import check_number
from agents.base.observation import STANDARD_KEYS
from agents.base.random_state import random_state_preserved
from calfree_gym.image import LOOK_SECONDS

THRESHOLDS_PX = (2, 4, 8, 16)


class Predictor(Protocol):
    """The part of an agent that evaluation needs."""

    def predict(
        self,
        observation: Any,
        state: Any = None,
        episode_start: Any = None,
        deterministic: bool = True,
    ) -> tuple[Any, Any]:
        """Returns the control words and the state to pass to the next call."""


@dataclass(frozen=True, slots=True)
class TrialRecord:
    """What one trial came to, by the noise-free truth but for `rendezvous`.

    Attributes:
        trial: Index of the trial, from 0.
        motions: Motions made, test motions and words of zero included.
        robot_seconds: What a real arm would have needed, the way home included, where each look takes
            `LOOK_SECONDS`; see `robot_seconds_at` for others.
        success: Whether the true error at the end is within the tolerance, whatever the noise; of a grasp,
            whether the object was lifted by 50 mm for a second.
        rendezvous: Whether the last observation showed gripper and object within the tolerance.
        error_px: True image error at the end: the larger of both cameras', in pixels of 512.
        distance_mm: True distance of gripper and object at the end, of a base from its dock, in millimetres.
        motions_to: For 2, 4, 8 and 16 px: the first motion within it, or None if there was none.
        expected_px: How far off the agent expected to be after its first motion, where it told so before.
    """

    trial: int
    motions: int
    robot_seconds: float
    success: bool
    rendezvous: bool
    error_px: float
    distance_mm: float
    motions_to: Mapping[int, int | None]
    expected_px: float | None = None

    def motions_per_reach(self, cap: int) -> int:
        """Its motions; those of a trial without a rendezvous count as the cap."""
        return self.motions if self.rendezvous else cap

    def __getitem__(self, name: str) -> Any:
        if name not in self.__slots__:
            raise KeyError(f"no field {name!r}; allowed: {', '.join(self.__slots__)}")
        return getattr(self, name)


def robot_seconds_at(look_seconds: float, robot_seconds: Any, motions: Any) -> Any:
    """Robot seconds of trials, had a look taken this long instead of `LOOK_SECONDS`.

    A look, in which the arm settles and both images are evaluated, follows each motion and the way home.

    Args:
        look_seconds: In seconds.
        robot_seconds: Of records; a number or an array.
        motions: Of the same records.
    """
    return robot_seconds + (motions + 1) * (look_seconds - LOOK_SECONDS)


class TrialMeter:
    """Turns the infos of one trial's motions into its TrialRecord."""

    def __init__(self, env: gymnasium.Env[Any, Any], trial: int, info: Mapping[str, Any]):
        self._env: Any = env.unwrapped
        self._trial = trial
        self._truth = info["truth"]
        self._rendezvous = False
        self._robot_seconds = 0.0
        self._motions_to: dict[int, int | None] = dict.fromkeys(THRESHOLDS_PX)
        self.motions = 0

    def add(self, info: Mapping[str, Any]) -> None:
        """Counts one motion, given the info that `step` returned."""
        self.motions += 1
        self._truth = info["truth"]
        self._rendezvous = bool(info["is_success"])
        self._robot_seconds += float(info["robot_seconds"])
        for threshold, first in self._motions_to.items():
            if first is None and self._truth["error_px"] <= threshold:
                self._motions_to[threshold] = self.motions

    def record(self) -> TrialRecord:
        """The record of the trial as it stands."""
        error_px = float(self._truth["error_px"])
        return TrialRecord(
            trial=self._trial,
            motions=self.motions,
            robot_seconds=self._robot_seconds + self._env.home_seconds,
            success=self._env.is_solved(self._truth),
            rendezvous=self._rendezvous,
            error_px=error_px,
            distance_mm=float(self._truth.get("distance_mm", self._truth.get("offset_mm"))),
            motions_to=dict(self._motions_to),
        )


def evaluate(agent: Predictor, env: gymnasium.Env[Any, Any], trials: int, seed: int) -> list[TrialRecord]:
    """Lets an agent make some trials, and changes nothing in it.

    The agent itself is evaluated, not a copy of its buffers and networks: `predict` changes no
    knowledge, and global random states are restored afterwards.

    Args:
        agent: Anything with `predict`; its state is threaded through each trial. Where it has `expected_px`,
            that is asked with the first observation.
        env: A reach environment with a time limit. It is reset with `seed` once, then without.
        trials: How many trials to make.
        seed: Seeds the objects and the noise (and the world, where `env` draws worlds).

    Returns:
        One record a trial, in order.

    Raises:
        ValueError: `trials` is no whole number, or `env` is a batched one, tells no truth, or is not like the
            one that the agent was made for; says what differs.
    """
    check_number("trials", trials, least=0, whole=True)
    _check_environment(agent, env)
    with random_state_preserved():
        return [_make_trial(agent, env, trial, seed if trial == 0 else None) for trial in range(trials)]


def _check_environment(agent: Predictor, env: Any) -> None:
    if isinstance(env, VectorEnv):
        raise ValueError(f"evaluate makes trials in one environment; this is a batch of {env.num_envs}")
    own = getattr(agent, "env", None)
    if own is None:
        return
    made_for, here = _shapes(own), _shapes(env)
    names = ("action", *STANDARD_KEYS, *getattr(agent, "privileged", ()))
    differing = [name for name in names if made_for.get(name) != here.get(name)]
    if differing:
        listed = ", ".join(f"{name} is {here.get(name)}, not {made_for.get(name)}" for name in differing)
        raise ValueError(f"the agent was made for an environment of other shapes; in this one {listed}")


def _shapes(env: Any) -> dict[str, Any]:
    """Shapes of an action and of what is observed, of one arm where `env` is a batch."""
    action = getattr(env, "single_action_space", env.action_space)
    observed = getattr(env, "single_observation_space", env.observation_space)
    spaces = {"action": action, **getattr(observed, "spaces", {})}
    return {name: space.shape for name, space in spaces.items()}


def _make_trial(agent: Predictor, env: gymnasium.Env[Any, Any], trial: int, seed: int | None) -> TrialRecord:
    observation, info = env.reset(seed=seed)
    if "truth" not in info:
        raise ValueError("evaluate scores by info['truth']: make the environment with truth=True")
    meter = TrialMeter(env, trial, info)
    tell = getattr(agent, "expected_px", None)
    expected = tell(observation) if tell else None
    state, starts, over = None, np.array([True]), False
    while not over:
        words, state = agent.predict(observation, state=state, episode_start=starts, deterministic=True)
        starts = np.array([False])
        observation, _, terminated, truncated, info = env.step(words)
        meter.add(info)
        over = terminated or truncated
    return replace(meter.record(), expected_px=expected)
