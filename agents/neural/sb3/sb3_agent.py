"""Any algorithm of stable-baselines3 or sb3_contrib behind the surface of every agent."""

import copy
import json
import math
import warnings
from collections.abc import Mapping, Sequence
from contextlib import nullcontext
from typing import Any, Self

import gymnasium as gym
import numpy as np
import torch
from gymnasium.spaces import flatten_space
from gymnasium.vector import VectorEnv
from numpy.typing import NDArray
from stable_baselines3 import HerReplayBuffer
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.logger import Logger
from stable_baselines3.common.on_policy_algorithm import OnPolicyAlgorithm
from stable_baselines3.common.save_util import recursive_getattr, recursive_setattr
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor
from stable_baselines3.common.utils import set_random_seed, should_collect_more_steps
from stable_baselines3.common.vec_env import DummyVecEnv, VecEnv, VecEnvWrapper

from calfree_gym.sb3 import as_sb3_env
from calfree_gym.wrappers import ScaledWords, VectorScaledWords, scaled_words

from ...base.agent import Agent, Callback, foreign, is_of_one
from ...base.checks import check_number, check_numbers
from ...base.observation import RawObservation
from ...base.prior_knowledge import PriorKnowledge
from ...base.random_state import OwnRandomState
from ...base.registration import Settings, named_settings
from ...base.storage import AgentFile
from .algorithms import algorithm_of, built_settings, policy_name, settings_of
from .files import Saved, check_tensor, optimizer_state, read, write

GOALS = ("achieved_goal", "desired_goal")


def flattened(observation: Mapping[str, NDArray[Any]]) -> NDArray[np.float32]:
    """All arrays (..., n) of an observation side by side, by the order of their keys' names."""
    return np.concatenate([observation[key] for key in sorted(observation)], axis=-1)


class FlatObservations(VecEnvWrapper):
    """A `VecEnv` with observations as one array: what all algorithms take, and replay buffers sample fast."""

    def __init__(self, venv: VecEnv) -> None:
        super().__init__(venv, flatten_space(venv.observation_space))

    def reset(self) -> NDArray[np.float32]:
        """Begins a trial in every row."""
        return flattened(self.venv.reset())  # type: ignore[arg-type]

    def step_wait(self) -> Any:
        """Executes one motion in every row."""
        observations, rewards, dones, infos = self.venv.step_wait()
        for row in np.flatnonzero(dones):
            infos[row]["terminal_observation"] = flattened(infos[row]["terminal_observation"])
        return flattened(observations), rewards, dones, infos  # type: ignore[arg-type]


class ImageDistance(BaseFeaturesExtractor):
    """Adds tanh(s d) to a network's inputs, d the image distance, for each of some scales s.

    A network that gets gripper and object points apart must first learn to subtract. A rendezvous is 1/64 of
    an image unit: with a large s, small distances fill the range of the input.

    Args:
        space: Of flat observations, or a goal environment's `Dict`.
        goals: Numbers in each goal; flat observations begin with both.
        scales: s.
    """

    def __init__(self, space: gym.Space[Any], goals: int, scales: Sequence[float]) -> None:
        inputs = int(np.prod(flatten_space(space).shape or ()))
        super().__init__(space, inputs + goals * len(scales))
        self._goals = goals
        self._scales = tuple(scales)

    def forward(self, observations: torch.Tensor | dict[str, torch.Tensor]) -> torch.Tensor:
        """Features (n, features) from observations (n, ...)."""
        if isinstance(observations, dict):
            observations = torch.cat([observations[key] for key in sorted(observations)], 1)
        goals = self._goals
        distance = observations[:, :goals] - observations[:, goals : 2 * goals]
        return torch.cat([observations, *(torch.tanh(scale * distance) for scale in self._scales)], 1)


class Sb3Agent(Agent):
    """A learner of stable-baselines3: the one adapter for all its algorithms.

    Args:
        env: The environment, whose reward is what is learned from; or a batched one with SAME_STEP autoreset,
            whose motions are summed. Its rows should stand in one world, which is not checked: where `world`
            names a distribution of different worlds, each row has its own, and a policy without memory
            learns none of them. What it tells (`tell`) is learned from, too.
        seed: Of the networks and the exploration; the caller's global generators stay as they are.
        algorithm: A dotted name, such as "sb3_contrib.CrossQ".
        word_limit: The largest word, see `calfree_gym.wrappers.ScaledWords`.
        word_curvature: Above 1, small words get finer.
        distance_scales: The networks' inputs also are tanh(s d) for each of these scales s, d the image
            distance; without any, the bare observation.
        net_arch: Hidden layers of each network.
        rows: How many arms it should learn from at once. Where it learns from a single environment and by
            rollouts, these are so many times longer.
        **settings: Of the algorithm. From plain values: `replay_buffer_class` by name, `action_noise` as a
            standard deviation, `policy_kwargs: {activation_fn: SiLU}`.
    """

    prior_knowledge = frozenset({PriorKnowledge.REWARD, PriorKnowledge.WORD_LIMIT})

    def __init__(
        self,
        env: gym.Env[Any, Any] | VectorEnv[Any, Any, Any],
        seed: int = 0,
        algorithm: str = "stable_baselines3.SAC",
        word_limit: float = 0.25,
        word_curvature: float = 1.0,
        distance_scales: Sequence[float] = (1.0,),
        net_arch: Sequence[int] = (128, 128),
        rows: int = 1,
        **settings: Any,
    ) -> None:
        super().__init__(env, seed)  # type: ignore[arg-type]
        learner = algorithm_of(algorithm)
        self.rows = check_number("rows", rows, least=1, whole=True)
        check_number("word_limit", word_limit, above=0, most=1)
        check_number("word_curvature", word_curvature, above=0)
        widths = check_numbers("net_arch", net_arch, least=1, whole=True)
        scales = check_numbers("distance_scales", distance_scales, above=0)
        self._words = {"limit": word_limit, "curvature": word_curvature}
        rows_of_env = self._as_vec_env(env)
        self._space: gym.spaces.Dict[Any] = rows_of_env.observation_space  # type: ignore[assignment]
        spaces: Mapping[str, Any] = self._space.spaces
        (motors,) = rows_of_env.action_space.shape or ()
        built = built_settings(settings, motors)
        self._by_key = built.get("replay_buffer_class") is HerReplayBuffer
        if self._by_key:
            self.prior_knowledge |= {PriorKnowledge.MOUNT}
            _warn_of_moving_goals(env)
            first = {**settings_of(learner), **built}.get("learning_starts", 0)
            built["learning_starts"] = max(first, _whole_trials(env))
        if issubclass(learner, OnPolicyAlgorithm) and "n_steps" in built and rows_of_env.num_envs == 1:
            built["n_steps"] *= self.rows
        built["policy_kwargs"] |= {
            "net_arch": widths,
            "features_extractor_class": ImageDistance,
            "features_extractor_kwargs": {
                "goals": spaces[GOALS[0]].shape[0],
                "scales": scales,
            },
        }
        about = {
            "algorithm": algorithm,
            "observation": {key: list(spaces[key].shape) for key in sorted(spaces)},
            "words": {"motors": motors, "limit": word_limit, "curvature": word_curvature},
            "networks": {
                "net_arch": widths,
                "distance_scales": scales,
                **(settings.get("policy_kwargs") or {}),
            },
        }
        self._about: dict[str, Any] = json.loads(json.dumps(about, default=_plain))  # as files tell it
        torch.set_num_threads(1)
        self._random_state, self._of_predictions = OwnRandomState(), OwnRandomState()
        with self._of_predictions.swapped_in():
            set_random_seed(seed)
        with self._random_state.swapped_in():
            set_random_seed(seed)  # given to the learner, it would draw another world too
            try:
                self._model: Any = learner(
                    policy=policy_name(learner, not self._by_key),
                    env=rows_of_env if self._by_key else FlatObservations(rows_of_env),
                    device="cpu",
                    **built,
                )
            except AssertionError as error:
                raise ValueError(f"{algorithm}: {error}") from error
        self._model.action_space.seed(seed)
        self._model.set_logger(Logger(folder=None, output_formats=[]))  # else it logs to a folder of its own
        self._warm_up = getattr(self._model, "learning_starts", 0)

    @classmethod
    def settings(cls, given: Settings) -> Settings:
        """See `Agent`. The adapter's own, and those of the algorithm that is given."""
        own = named_settings(cls)
        return settings_of(algorithm_of((own | given)["algorithm"])) | own

    def _as_vec_env(self, env: Any) -> VecEnv:
        if isinstance(env, VectorEnv):
            return as_sb3_env(VectorScaledWords(env, **self._words))
        scaled = ScaledWords(env, **self._words)
        return DummyVecEnv([lambda: scaled])

    def predict(
        self,
        observation: RawObservation,
        state: Any = None,
        episode_start: NDArray[np.bool_] | None = None,
        deterministic: bool = True,
    ) -> tuple[NDArray[np.float32], Any]:
        """See `Agent`. The state is that of recurrent networks, else None."""
        is_of_one(observation, self._space)
        if hasattr(self._model.policy, "lstm_actor"):
            self._check_memory(observation, state, episode_start)
        known = {key: observation[key] for key in self._space}
        inputs = known if self._by_key else flattened(known)
        with nullcontext() if deterministic else self._of_predictions.swapped_in():
            actions, state = self._model.predict(inputs, state, episode_start, deterministic=deterministic)
        words = scaled_words(actions, **self._words)
        if state is not None and (registers := self._registers(observation)).size:
            self._beginnings.sent(registers, words)
        return words, state

    def _check_memory(
        self, observation: RawObservation, state: Any, episode_start: NDArray[np.bool_] | None
    ) -> None:
        """Raises ValueError where networks would go on with another memory than that of this trial."""
        if state is not None and not (isinstance(state, tuple) and all(np.ndim(part) == 3 for part in state)):
            raise foreign(f"is {state!r}")
        registers = self._registers(observation)
        if registers.size:
            self._beginnings.where(registers, None if state is None else np.shape(state[0])[1], episode_start)

    def _registers(self, observation: RawObservation) -> NDArray[np.float64]:
        """Registers (n, m) where they stand behind the flags at the end, as in reaching; else (n, 0)."""
        observed = np.atleast_2d(np.asarray(observation["observation"], float))
        motors, flags = self._model.action_space.shape[0], np.shape(observation["achieved_goal"])[-1]
        return observed[:, flags:] if observed.shape[1] == flags + motors else observed[:, :0]

    def learn(self, total_timesteps: int, callback: Callback | None = None) -> Self:
        """See `Agent`. Rows make whole steps: the motions are rounded down to a multiple of their number.

        Updates come after each whole rollout, or `train_freq`. Motions after the last whole one teach nothing
        on-policy. Off-policy they go into the replay buffer, but for the last of each row, and bring about
        no update. Where `callback` ends it, that is as after a broken rollout.

        Raises:
            ValueError: Fewer motions than the environment has rows.
        """
        rows = self._model.n_envs
        check_number("total_timesteps", total_timesteps, least=0, whole=True)
        if not total_timesteps:
            return self
        if total_timesteps < rows:
            raise ValueError(f"learn got {total_timesteps} motions; its {rows} rows make {rows} at once")
        total_timesteps -= total_timesteps % rows
        self._model._last_obs = None  # each call starts with a new trial
        if self._by_key:
            with warnings.catch_warnings(action="ignore"):
                self._model.replay_buffer.truncate_last_trajectory()
        elif (buffer := getattr(self._model, "replay_buffer", None)) is not None and buffer.size():
            buffer.dones[buffer.pos - 1] = buffer.timeouts[buffer.pos - 1] = 1  # the trial was broken off
        with self._random_state.swapped_in():
            self._model.learn(
                total_timesteps,
                callback=_Translated(self, self.num_timesteps + total_timesteps, callback),
                reset_num_timesteps=self.num_timesteps == 0,
            )
        return self

    def save(self, path: AgentFile) -> None:
        """See `Agent`. The replay buffer is left out: learning goes on as from new, with trained networks."""
        _, variables = self._model._get_torch_save_params()
        write(
            path,
            Saved(
                self._about,
                self.num_timesteps,
                getattr(self._model, "_n_updates", 0),
                self._model.get_parameters(),
                {name: recursive_getattr(self._model, name).detach() for name in variables},
            ),
        )

    def load(self, path: AgentFile, trusted: bool = False) -> Self:
        """See `Agent`. Nothing is unpickled unless the file is trusted.

        Args:
            path: As for `Agent.load`; or of a file that stable-baselines3 has saved, of which networks,
                optimisers' moments and counts are taken. It does not tell how words were scaled.
            trusted: Whether tensors may be unpickled, which executes what the file says.
        """
        saved = read(path, trusted)
        for what, ours in self._about.items():
            if saved.about is not None and saved.about.get(what) != ours:
                raise ValueError(
                    f"{path} holds a learner with {what} {saved.about.get(what)}; this one has {ours}"
                )
        before = copy.deepcopy(self._model.get_parameters())
        variables = self._model._get_torch_save_params()[1]
        parameters = dict(saved.parameters)
        try:
            for name in variables:
                check_tensor(name, saved.variables[name], recursive_getattr(self._model, name))
            for name, ours in before.items():
                if isinstance(optimizer := recursive_getattr(self._model, name), torch.optim.Optimizer):
                    parameters[name] = optimizer_state(name, parameters[name], optimizer)
                else:
                    for key, tensor in ours.items():
                        check_tensor(f"{key} of {name}", parameters[name][key], tensor)
            self._model.set_parameters(parameters, exact_match=True)
        except (ValueError, KeyError, RuntimeError, AttributeError, TypeError, IndexError) as error:
            self._model.set_parameters(before)
            raise ValueError(
                f"{path} holds {', '.join(sorted(saved.parameters))} that do not fit this learner, "
                f"{self._about}: {str(error)[:300]}"
            ) from error
        for name in variables:
            recursive_setattr(self._model, f"{name}.data", saved.variables[name].data)
        self.num_timesteps = self._model.num_timesteps = saved.motions
        self._model._n_updates = saved.updates
        if (buffer := getattr(self._model, "replay_buffer", None)) is not None:
            buffer.reset()
            if self._by_key:  # whose reset leaves where its trials are
                buffer.ep_start[:] = buffer.ep_length[:] = buffer._current_ep_start[:] = 0
        if hasattr(self._model, "learning_starts"):
            self._model.learning_starts = saved.motions + self._warm_up
        return self


class _Translated(BaseCallback):
    """Keeps the agent's count of motions, calls its callback after each, and breaks a rollout at the end."""

    def __init__(self, agent: Agent, end: int, callback: Callback | None) -> None:
        super().__init__()
        self._agent, self._end, self._callback = agent, end, callback

    def _on_step(self) -> bool:
        self._agent.num_timesteps = self.num_timesteps
        goes_on = self._callback is None or self._callback(self._agent)
        return goes_on and (self.num_timesteps < self._end or not self._within_rollout())

    def _within_rollout(self) -> bool:
        """Whether the algorithm would make another motion before it updates its networks and can end."""
        now = self.locals
        if "n_rollout_steps" in now:
            return bool(now["n_steps"] + 1 < now["n_rollout_steps"])
        episodes = now["num_collected_episodes"] + int(np.sum(now["dones"]))
        return should_collect_more_steps(now["train_freq"], now["num_collected_steps"], episodes)


def _whole_trials(env: Any) -> int:
    """Motions of all rows by which one of their trials is over: hindsight learns from whole ones.

    Nothing where motions of a trial have no limit.
    """
    of_spec: Any = getattr(env.spec, "max_episode_steps", None)
    longest = getattr(env.unwrapped, "_max_episode_steps", of_spec) or 0
    return 0 if longest == math.inf else int(getattr(env, "num_envs", 1)) * int(longest)


def _warn_of_moving_goals(env: Any) -> None:
    """Warns where hindsight is wrong: on an arm's mount the object's image points move with the arm."""
    if getattr(env.unwrapped, "task", "") != "reach":
        return
    spec = getattr(env, "spec", None)
    mount = "stand" if spec is None else spec.kwargs.get("camera_mount", "waist")
    if set([mount] if isinstance(mount, str) else mount) - {"stand", "world"}:
        warnings.warn(
            f"hindsight relabelling is not valid on the {mount} mount: the object moves in the images when "
            "the arm moves the cameras. Make the environment with camera_mount='stand'",
            stacklevel=5,
        )


def _plain(value: Any) -> Any:
    """A setting that JSON does not know: a number of NumPy as one, a class by its name."""
    return value.item() if isinstance(value, np.generic) else getattr(value, "__name__", repr(value))
