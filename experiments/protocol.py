"""CalFree-Reach protocol 1: anybody's agent in frozen worlds, before and after a camera is knocked."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from inspect import signature
from typing import Any, Protocol

import numpy as np
import pandas as pd

from agents.base.checks import check_number
from calfree_gym import World
from calfree_gym.perturbations import CameraAim
from experiments.config.environment import EnvironmentConfig
from experiments.evaluation import Predictor, evaluate
from experiments.reporting.tables import Table
from experiments.running.lifetime import LifetimeRecorder, RowsRecorder
from experiments.statistics import Array

NAME = "CalFree-Reach protocol 1"
"""Changes with anything below, and with what the seeds draw."""
TRAIN_SEEDS = range(1_000_000)
"""Worlds to tune and to train in, as many of them as you like."""
TEST_SEEDS = range(2_000_000, 2_000_020)
"""Worlds to report: nothing is chosen by what happens in them."""
ENV = EnvironmentConfig.model_validate(
    {"id": "CalFree/ReachDense-v0", "world": "wild", "camera_mount": "waist", "dynamics": "kinematic"}
)
KNOCK = CameraAim(camera="left", degrees=20)
"""Towards a direction that a world's seed draws."""
TRIALS = 20
"""Held out, in each world and at each moment."""
MOMENTS = ("before the knock", "right after", "at the end")


class Learner(Predictor, Protocol):
    """What the protocol runs: the surface of stable-baselines3's algorithms."""

    def learn(self, total_timesteps: int) -> Any:
        """Makes so many motions, or as many more as it needs, and learns from them."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """What an agent came to; prints as its table and the line to quote.

    Attributes:
        agent: As its author calls it.
        seeds: Of the worlds.
        motions: Made before the knock, and in all: of both parts the most that any world took.
        motions_per_reach: A trial without a rendezvous counts as 60 (worlds, moments).
        reached: Share of trials with a rendezvous (worlds, moments).
    """

    agent: str
    seeds: tuple[int, ...]
    motions: tuple[int, int]
    motions_per_reach: Array
    reached: Array

    @property
    def table(self) -> Table:
        """A row a moment: the median world, most worlds, and the share of trials that reached."""
        low, middle, high = np.quantile(self.motions_per_reach, (0.1, 0.5, 0.9), axis=0)
        columns = {
            "moment": MOMENTS,
            "motions per reach": middle,
            "10th to 90th of worlds": [f"{a:.1f} to {b:.1f}" for a, b in zip(low, high, strict=True)],
            "reached": self.reached.mean(axis=0),
        }
        formats = {"motions per reach": ".1f", "reached": ".0%"}
        return Table("protocol", self.agent, pd.DataFrame(columns), formats, "A failed trial counts as 60.")

    @property
    def line(self) -> str:
        """The line to quote."""
        before, right_after, end = np.median(self.motions_per_reach, axis=0)
        learned, lived = self.motions
        worlds = "its 20 test worlds"
        if self.seeds != tuple(TEST_SEEDS):
            others = "others than" if {*self.seeds} - {*TEST_SEEDS} else "some of"
            worlds = f"{len(self.seeds)} worlds, {others} its {len(TEST_SEEDS)} test worlds"
        return (
            f"{self.agent} by {NAME} ({worlds}): {before:.1f} motions per reach after {learned:,} motions, "
            f"{right_after:.1f} right after the knock, {end:.1f} after {lived - learned:,} more "
            "(median world; a failed trial counts as 60)."
        )

    def __str__(self) -> str:
        return f"{self.table.markdown()}\n\n{self.line}"


def run(
    make_agent: Callable[[Any, int], Learner],
    name: str,
    motions: int,
    after: int,
    rows: int = 1,
    seeds: Sequence[int] = TEST_SEEDS,
    wrap: Callable[[Any], Any] = lambda env: env,
) -> Outcome:
    """Lets a fresh agent live in each world, and scores it on held-out trials; prints how far it is.

    In each world it learns, the left camera is turned by 20 degrees, and it learns on. It is scored before
    and right after the knock, and at the end. Nobody tells it of the knock.

    Args:
        make_agent: Makes an agent of an environment and a seed. Its `predict` takes that environment's
            observations and gives its actions.
        name: Of the agent.
        motions: That it learns before the knock.
        after: That it learns after it.
        rows: Arms in the one world, whose motions are summed. 1: the environment is a single one, to which
            agents of stable-baselines3 can be made. More: a batched one; `calfree_gym.sb3.as_sb3_env`
            presents it to stable-baselines3.
        seeds: Other worlds, such as some of `TRAIN_SEEDS`, to try it out; the line to quote then says so.
        wrap: Puts wrappers around each single environment, to learn in and to be scored in. A batched one
            `make_agent` wraps in the same itself.

    Raises:
        ValueError: A number is not allowed, or there is no seed.
        TypeError: What `make_agent` makes cannot learn or predict.
    """
    for what, number, least in (("motions", motions, 0), ("after", after, 0), ("rows", rows, 1)):
        check_number(what, number, least=least, whole=True)
    seeds = tuple(np.ravel(np.asarray(seeds)).tolist())
    if not seeds:
        raise ValueError("found no seeds; allowed: one or more, such as TEST_SEEDS")
    for seed in seeds:
        check_number("a seed", seed, least=0, whole=True)
    lives = []
    for number, seed in enumerate(seeds, 1):
        lives.append(_life(make_agent, motions, after, rows, seed, wrap))
        shown = ", ".join(f"{value:.1f} {at}" for value, at in zip(lives[-1][1][0], MOMENTS, strict=True))
        print(f"world {number} of {len(seeds)}: motions per reach {shown}", flush=True)
    made, scores = zip(*lives, strict=True)
    motions_per_reach, reached = np.transpose(scores, (1, 0, 2))
    learned, more = np.max(made, axis=0).tolist()
    return Outcome(name, seeds, (learned, learned + more), motions_per_reach, reached)


def worlds_of(seed: int) -> tuple[World, World]:
    """The world of a seed, and what the knock makes of it: the first direction drawn that stays in view."""
    env = ENV.make()
    env.reset(seed=seed)
    arm: Any = env.unwrapped
    world, rng = arm.world, np.random.default_rng(seed)
    while True:
        knocked = KNOCK.apply(world, rng)
        try:
            arm.set_world(knocked)
        except ValueError:
            continue
        return world, knocked


def _life(
    make_agent: Callable[[Any, int], Learner],
    motions: int,
    after: int,
    rows: int,
    seed: int,
    wrap: Callable[[Any], Any],
) -> tuple[tuple[int, int], Array]:
    """Motions made before the knock and after it; motions per reach and share reached (2, moments)."""
    world, knocked = worlds_of(seed)
    recorder: Any = LifetimeRecorder(ENV.make(), seed) if rows == 1 else RowsRecorder(ENV, rows, (), (), seed)
    agent = make_agent(wrap(recorder) if rows == 1 else recorder, seed)
    for method in ("learn", "predict"):
        if not callable(getattr(agent, method, None)):
            raise TypeError(f"make_agent made {type(agent).__name__}, which has no {method}()")
    agent.learn(motions)
    learned = recorder.motions
    scores = [_score(agent, wrap, at, seed) for at in (world, knocked)]
    recorder.unwrapped.set_world(knocked)
    goes_on = "reset_num_timesteps" in signature(agent.learn).parameters  # else a learner of sb3 begins anew
    agent.learn(after, **({"reset_num_timesteps": False} if goes_on else {}))
    scores.append(_score(agent, wrap, knocked, seed))
    return (learned, recorder.motions - learned), np.transpose(scores)


def _score(agent: Predictor, wrap: Callable[[Any], Any], world: World, seed: int) -> tuple[float, float]:
    """Motions per reach and share reached, in held-out trials, by the same seed at all moments.

    Motions are counted within the wrappers; of the first trials, one that these left counts as failed.
    """
    env: Any = ENV.make()
    env.unwrapped.set_world(world)
    recorder = LifetimeRecorder(env, seed + len(TRAIN_SEEDS))
    evaluate(agent, wrap(recorder), TRIALS, seed)
    records = [record for record in recorder.records if record.trial < TRIALS]
    cap = ENV.max_episode_steps
    motions = sum(record.motions_per_reach(cap) for record in records) + cap * (TRIALS - len(records))
    return motions / TRIALS, sum(record.rendezvous for record in records) / TRIALS
