"""Perturbations in anybody's environment, in mid-episode and on a schedule."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from copy import deepcopy
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.utils import RecordConstructorArgs

from calfree_gym.errors import check_choice, check_whole
from calfree_gym.perturb.actions import executed, middle
from calfree_gym.perturb.images import at_fault, faulty
from calfree_gym.perturb.model import PerturbedModel, plain_world
from calfree_gym.perturb.observations import Path, leaf, with_leaf
from calfree_gym.perturb.scope import OF_IMAGES, OF_MODELS, OF_OBSERVATIONS, PERS, Scope
from calfree_gym.perturb.simulation import Adapter, Env
from calfree_gym.perturbations.arm import amount_of
from calfree_gym.perturbations.base import Perturbation
from calfree_gym.perturbations.schedule import PerturbationScheduler, Undo, parse_schedule
from calfree_gym.streams import stream
from calfree_gym.world import World
from calfree_gym.world.value import MAX_LATENCY

LARGEST_SEED = 2**63 - 1


class Perturb(gym.Wrapper[Any, Any, Any, Any], RecordConstructorArgs):
    """Knocks cameras, light, motors and images of anybody's environment, on a schedule, and undoes it again.

    MuJoCo environments of Gymnasium, Gymnasium-Robotics, MetaWorld, Shimmy (dm_control), gym-aloha and
    lerobot-env-so101 are known; another one needs an `Adapter`. Where there is no MuJoCo model, what acts on
    images, actions and observations still does.

        knock = [
            {"at": {"step": 25}, "do": {"type": "camera_aim", "camera": "front", "degrees": 10}},
            {"at": {"step": 75}, "undo": 0},
        ]
        env = Perturb(gym.make(...), knock, seed=0, images={"front": ("pixels", "front")})

    `info["perturbed"]` counts the perturbations applied before a step or reset, the environment's own too.

    What acts, and how:

    - `camera_aim`, `camera_roll`, `camera_shift`, `camera_zoom`: on a camera of the model. A shift is along
      the axes of the room, with the camera's mount where it is at MuJoCo's `qpos0`. A camera that follows a
      body goes on to follow it; one that looks at a body does not, until that is undone.
    - `light`: on the first lamp, which stays as far from the middle of the model, and on the headlight's
      ambient light. Without a lamp, `strength` is the headlight's.
    - `joint_zero`: `qpos0`. What holds the robot by its pose, such as a mocap body, works against it.
    - `exposure`, `blur`, `image_noise`, `lens`: delivered images, those of `render()` too.
    - `motor_sign`, `motor_gain`, `repeatability`, `shortfall`, `longest_motion`, `dead_zone`: numbers of the
      action, about the one at which the robot rests after the first reset: the middle of their range, or the
      position there if an action is one. A word of 1 is half of the range, a degree of repeatability is a
      hundredth of the range.
    - `latency`, `point_dropout`: observations come late by so many steps; in this share of the steps the one
      before comes again. After a reset the first one holds. Rewards are not late.

    Other types are refused. Where an environment builds its model anew at a reset, or changes it, the first
    image of that episode is of cameras and lights as it has left them. One that writes its cameras in every
    step undoes a knock; one that adds to where they are at a reset adds to the knock.

    Attributes:
        applied: The perturbations applied before the last step or reset, with all that they drew.
        applied_in_all: How many were applied so far.
        world: The present world; cameras, motors and joints are in the order of `parts`.
        parts: Names of what can be perturbed. The camera "render" is what `render()` shows, where that is
            none of a model: its images can be perturbed, but not its place.

    Args:
        env: The environment.
        schedule: See `calfree_gym.perturbations.parse_schedule`. Steps and resets of this wrapper count.
        seed: Of all that is drawn. By default it is the seed of the first reset.
        images: Where images are in observations, by camera, such as `{"top": ("pixels", "top")}`; `()` is the
            observation itself, None an image that whoever wraps this environment makes from the model. By
            default these are all images that are called as a camera of the model. What `render()` shows is of
            the camera that `gym.make(..., camera_name="track")` names; a viewer's own one is met by faults of
            images with `images={}`, or where observations have none.
        per: "life": the schedule runs over all episodes, and resets with a seed begin no draws anew;
            "episode": it begins anew in each of them, with other draws, and a reset with a seed repeats them.
        late: Which parts of observations `latency` and `point_dropout` meet; by default all.
        adapter: How to find the model of an environment that is not known.

    Raises:
        ValueError: The schedule cannot be applied here; says why. Nothing has been changed then.
    """

    def __init__(
        self,
        env: Env,
        schedule: Sequence[Any] = (),
        *,
        seed: int | None = None,
        images: Mapping[str, Path | None] | None = None,
        per: str = "life",
        late: Sequence[Path] | None = None,
        adapter: Adapter | None = None,
    ) -> None:
        events = parse_schedule(schedule, "schedule")
        RecordConstructorArgs.__init__(
            self,
            schedule=[event.to_dict() for event in events],
            seed=seed,
            images=images,
            per=per,
            late=late,
            adapter=adapter,
        )
        gym.Wrapper.__init__(self, env)
        check_choice("per", per, PERS)
        if seed is not None:
            check_whole("seed", seed, 0, LARGEST_SEED)
        wrapper: Any = env
        while isinstance(wrapper, gym.Wrapper):
            if isinstance(wrapper, Perturb):
                raise ValueError("the environment is in a Perturb already: give that one the whole schedule")
            wrapper = wrapper.env
        self._scope = Scope(env, images, late, adapter)
        self._scope.check(events, per)
        self.adapter, self.parts = self._scope.adapter, self._scope.parts
        parts: Any = self.parts
        self._scheduler = PerturbationScheduler(1, events, parts)
        kinds = {event.perturbation.type for event in events}
        self._faults_images = not kinds.isdisjoint(OF_IMAGES)
        self._keeps_observations = not kinds.isdisjoint(OF_OBSERVATIONS)
        self._model: PerturbedModel | None = None
        if self.adapter is not None and not kinds.isdisjoint((*OF_MODELS, "lens")):
            self._model = PerturbedModel(*self.adapter.simulation(env), self.parts)
        self._built = self._model.built if self._model else plain_world(self.parts)
        self._per, self._given_seed, self._rest = per, seed, np.zeros(0)
        self._seed: int | None = None
        self.world = self._built
        self.applied: list[Perturbation | Undo] = []
        self.applied_in_all = 0
        self._counts = {"motion": 0, "trial": 0}
        self._done: dict[str, tuple[int, list[Perturbation | Undo]]] = {}
        self._resets = self._steps = 0
        self._past: deque[Any] = deque(maxlen=MAX_LATENCY + 1)
        self._delivered: Any = None

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Begins an episode, after the perturbations that are due."""
        if self._seed is None or (seed is not None and self._per == "episode"):
            self._seed, self._resets, self._steps = self._seed_of_draws(seed), 0, 0
        begins = self._resets == 0 or self._per == "episode"
        if begins:
            self._begin()
        self.applied = self._apply_due("trial") + (self._apply_due("motion") if begins else [])
        before = self._model.copies() if self._model else {}
        observation, info = self.env.reset(seed=seed, options=options)
        if self._model is not None and self.adapter is not None:
            self._model.follow(*self.adapter.simulation(self.env), self.world, before)
        if self._resets == 0 and self.parts.motors:
            rest = None if self.adapter is None else self.adapter.rest(self.env)
            self._rest = middle(self.action_space) if rest is None else np.asarray(rest, float)
            if self._rest.shape != self.action_space.shape:
                raise ValueError(
                    f"the adapter's rest has shape {self._rest.shape}; it must have {self.action_space.shape}"
                )
        self._resets += 1
        self._counts["trial"] += 1
        self._past.clear()
        return self._observed(observation), self._told(info)

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """Makes a step, after the perturbations that are due."""
        self.applied = self._apply_due("motion") if self._counts["motion"] else []
        if self.world is not self._built and self.parts.motors:
            action = self._executed(action)
        observation, reward, terminated, truncated, info = self.env.step(action)
        self._counts["motion"] += 1
        self._steps += 1
        return self._observed(observation), reward, terminated, truncated, self._told(info)

    def render(self) -> Any:
        """The frame, with the faults of its camera."""
        frame = self.env.render()
        return self._faulty(frame, self._scope.rendered) if self._scope.frames_can_be_at_fault else frame

    def unperturbed(self) -> None:
        """Makes all as it was built, to the bit, until the next perturbation."""
        self._scheduler.forget(0)
        self._enter(self._built)

    def close(self) -> None:
        """Closes the environment, whose model is as built again: others may share it, made while it is so."""
        self.unperturbed()
        super().close()

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state)
        if self._model is not None and self.adapter is not None:
            self._model.find(*self.adapter.simulation(self.env))
            self._model.write(self.world)

    def _seed_of_draws(self, of_reset: int | None) -> int:
        """The one that was given; of episodes also by that of the reset; any, where there is none."""
        seeds = [] if self._given_seed is None else [self._given_seed]
        if of_reset is not None and (not seeds or self._per == "episode"):
            seeds.append(of_reset)
        if len(seeds) == 1:
            return seeds[0]
        return int(np.random.SeedSequence(seeds or None).generate_state(1)[0])

    def _begin(self) -> None:
        """Begins the schedule."""
        assert self._seed is not None
        of_episode = stream(self._seed, "perturbed episode", self._resets)
        self._scheduler.seed(0, self._seed if self._per == "life" else int(of_episode.integers(LARGEST_SEED)))
        self._counts, self._done = {"motion": 0, "trial": 0}, {}
        self._enter(self._built)

    def _apply_due(self, clock: str) -> list[Perturbation | Undo]:
        """Applies what is due, but once: the environment may have refused a call that comes again."""
        applied: list[Perturbation | Undo] = []
        count = self._counts[clock]
        if clock in self._done and self._done[clock][0] == count:
            return self._done[clock][1]
        for place, event in self._scheduler.events[clock]:
            if event.is_due(count):
                world, perturbation = self._scheduler.apply(place, event, 0, count, self.world)
                self._enter(world)
                if perturbation is not None:
                    applied.append(perturbation)
        self._done[clock] = count, applied
        self.applied_in_all += len(applied)
        return applied

    def _enter(self, world: World) -> None:
        if world is not self.world:
            self.world = world
            if self._model is not None:
                self._model.write(world)

    def _told(self, info: dict[str, Any]) -> dict[str, Any]:
        own = info.get("perturbed")
        inner = own if isinstance(own, int | np.integer) else 0
        return {**info, "perturbed": np.int64(len(self.applied) + inner)}

    def _executed(self, action: Any) -> Any:
        if np.shape(action)[-1:] != (shape := self.action_space.shape):
            raise ValueError(f"the action has shape {np.shape(action)}; it must have {shape}")
        spread, normal = self.world.repeatability, np.zeros(len(self.parts.motors))
        if spread.any():
            parts: Any = self.parts
            spread = 2 * spread / [amount_of(parts, motor, 100.0) for motor in range(len(normal))]
            normal = self._numbers("repeatability").standard_normal(len(normal))
        return executed(action, self.world, self._rest, self.action_space, spread, normal)

    def _observed(self, observation: Any) -> Any:
        if self._faults_images and self.world is not self._built:
            for camera, paths in self._scope.images.items():
                for keys in paths:
                    image = self._faulty(leaf(observation, keys), camera)
                    observation = with_leaf(observation, keys, image)
        return self._late(observation) if self._keeps_observations else observation

    def _faulty(self, image: Any, camera: str) -> Any:
        row = self.parts.cameras.index(camera)
        if not at_fault(self.world, row):
            return image
        return faulty(image, self.world, row, self._numbers("image_noise", row).random(2))

    def _late(self, observation: Any) -> Any:
        """Late, or the one before again."""
        first, past = not self._past, self._past
        past.append(deepcopy(observation))
        dropout = float(self.world.point_dropout)
        if first or not dropout or self._numbers("point_dropout").random() >= dropout:
            self._delivered = past[max(0, len(past) - 1 - int(self.world.latency))]
        if self._delivered is past[-1]:
            return observation
        for keys in self._scope.late:
            observation = with_leaf(observation, keys, deepcopy(leaf(self._delivered, keys)))
        return observation

    def _numbers(self, name: str, *indices: int) -> np.random.Generator:
        """Random numbers for the present observation."""
        return stream(self._seed or 0, name, self._resets, self._steps, *indices)
