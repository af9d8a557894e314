"""The agent `recurrent_servo`: a trained network that no longer learns."""

from os import PathLike
from typing import Any, Self

import gymnasium as gym
import numpy as np
import torch
from numpy.typing import NDArray

from ...base.agent import Agent, Callback, foreign, is_of_one
from ...base.checks import check_number
from ...base.observation import POINTS, RawObservation
from ...base.prior_knowledge import PriorKnowledge
from ...base.storage import AgentFile
from .network import KEPT, RecurrentState, chosen, load_network, observation_format, save_network


class RecurrentServo(Agent):
    """A recurrent network, trained over thousands of worlds, that meets this one for the first time.

    It was trained by the analytic gradient of the image distance through simulated robots, whose true image
    points the trainer knew (`python -m agents.neural.recurrent_servo.train`); neither imitation nor a reward.
    The weights kept with the code are of an earlier trainer, which took derivatives from displaced twins.
    Its weights are frozen: `learn` makes motions and changes nothing. What it finds out about a world lives
    in `state` for one trial, and every trial begins from nothing.

    Attributes:
        training: How the network was trained: command, seeds of worlds, CPU minutes, versions.

    Args:
        env: The environment; observations and words must have the shapes of the training, so three motors.
        seed: Of no effect: nothing is drawn.
        weights: File of another network than the one kept with the code.

    Raises:
        ValueError: The environment has another observation format than the network.
    """

    kind = "recurrent_servo"
    prior_knowledge = frozenset(
        {
            PriorKnowledge.TRAINING_WORLDS,
            PriorKnowledge.IMAGE_SCALE,
            PriorKnowledge.NOISE,
            PriorKnowledge.CAMERA_MODEL,
            PriorKnowledge.WORD_LIMIT,
        }
    )

    def __init__(self, env: gym.Env[Any, Any], seed: int = 0, weights: str | None = None) -> None:
        if not isinstance(weights, str | PathLike | None):
            raise ValueError(f"weights is {weights!r}; it must be the name of a file that save wrote")
        super().__init__(env, seed)
        torch.set_num_threads(1)
        self._shapes = observation_format(env.observation_space, env.action_space)
        self.load(KEPT[self.kind] if weights is None else weights)

    def predict(
        self,
        observation: RawObservation,
        state: RecurrentState | None = None,
        episode_start: NDArray[np.bool_] | None = None,
        deterministic: bool = True,
    ) -> tuple[NDArray[np.float32], RecurrentState]:
        """See `Agent`. The state is opaque."""
        is_of_one(observation, self.env.observation_space)
        if state is not None and not isinstance(state, RecurrentState):
            raise foreign(f"is {state!r}")
        registers = np.atleast_2d(observation["observation"])[:, POINTS:]
        begins = self._beginnings.where(registers, None if state is None else len(state.looks), episode_start)
        memory = self._at_beginning(len(begins))
        if state is not None:
            if [old.shape for old in state] != [new.shape for new in memory]:
                raise foreign("is of another network")
            memory = chosen(torch.from_numpy(begins), memory, state)
        points = np.concatenate([observation["achieved_goal"], observation["desired_goal"]], -1)
        rest = np.atleast_2d(observation["observation"])
        with torch.inference_mode():
            words, memory = self._network(
                torch.as_tensor(points, dtype=torch.float64).reshape(-1, POINTS, 2),
                torch.as_tensor(rest[:, :POINTS] > 0.5),
                torch.as_tensor(rest[:, POINTS:], dtype=torch.float64),
                memory,
            )
        self._beginnings.sent(registers, words.numpy())
        shape = np.shape(observation["achieved_goal"])[:-1]
        return words.numpy().astype(np.float32).reshape(*shape, -1), memory

    def learn(self, total_timesteps: int, callback: Callback | None = None) -> Self:
        """Makes motions, trial after trial; the weights stay. See `Agent`."""
        check_number("total_timesteps", total_timesteps, least=0, whole=True)
        target = self.num_timesteps + total_timesteps
        go_on, over, state = True, True, None
        while go_on and self.num_timesteps < target:
            if over:
                observation, _ = self.env.reset()
                state = None
            words, state = self.predict(observation, state)
            observation, _, terminated, truncated, _ = self.env.step(words)
            over = bool(terminated or truncated)
            self._made_a_motion(observation, state, over)
            self.num_timesteps += 1
            go_on = callback is None or callback(self)
        return self

    def save(self, path: AgentFile) -> None:
        """See `Agent`. The weights, how they came about, and the number of motions."""
        save_network(path, self._network, self._shapes, self.training, self.num_timesteps)

    def load(self, path: AgentFile) -> Self:
        self._network, self.training, self.num_timesteps, self._life = load_network(
            path, self._shapes, self.kind
        )
        return self

    def _at_beginning(self, robots: int) -> RecurrentState:
        """What so many robots remember as a trial begins."""
        return self._network.begin(robots)

    def _made_a_motion(self, observation: RawObservation, state: RecurrentState, over: bool) -> None:
        """In `learn`, a motion has led to this observation, with which the trial may be over."""
