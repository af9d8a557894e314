"""What perturbations cost a policy: the same episodes under several schedules, compared pair by pair."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping
from contextlib import ExitStack, closing
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import gymnasium as gym
import numpy as np

from calfree_gym.errors import check_whole, to_install
from calfree_gym.perturb.paired_shares import mcnemar_p, score_interval
from calfree_gym.perturb.wrapper import Perturb

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SUCCESS = ("is_success", "success")
"""What environments call it in `info`."""
LIFE = 10**9
"""Steps of a life, which ends before, with its episodes (a guard)."""
Env = gym.Env[Any, Any]
Success = Callable[[Env, Mapping[str, Any]], bool]


class PairedRow(NamedTuple):
    """One schedule beside the first one.

    Attributes:
        schedule: Its name.
        success: Share of its episodes.
        won: Episodes in which it alone succeeded.
        lost: Episodes in which the first one alone did.
        p: Of McNemar's exact test.
        difference: Of the shares, this one's minus the first one's.
        low: Lower bound of the 95 % interval of the difference, Tango's, corrected.
        high: Upper bound.
    """

    schedule: str
    success: float
    won: int
    lost: int
    p: float
    difference: float
    low: float
    high: float


@dataclass(frozen=True)
class Paired:
    """What `paired` found. Printed, it is a table.

    Attributes:
        outcomes: Whether each episode succeeded, by the schedule's name; all of the same length.
    """

    outcomes: Mapping[str, tuple[bool, ...]]

    @property
    def rows(self) -> tuple[PairedRow, ...]:
        """One for each schedule; the first one is compared with itself."""
        first = np.array(next(iter(self.outcomes.values())), bool)
        return tuple(_row(name, np.array(found, bool), first) for name, found in self.outcomes.items())

    def __str__(self) -> str:
        head = ("schedule", "success", "won / lost", "p", "difference (95 %)")
        first, *others = self.rows
        lines = [head, (first.schedule, f"{first.success:.0%}", "", "", "")]
        for row in others:
            interval = f"{row.difference:+.0%} ({row.low:+.0%} to {row.high:+.0%})"
            compared = f"{row.won} / {row.lost}", f"{row.p:.2g}", interval
            lines.append((row.schedule, f"{row.success:.0%}", *compared))
        widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
        cells = ("  ".join(map(str.ljust, line, widths)).rstrip() for line in lines)
        return "\n".join(cells)

    def figure(self) -> Figure:
        """Shares of success; whiskers: the interval of the difference, from the first one's share.

        Raises:
            ModuleNotFoundError: matplotlib is not installed; says how.
        """
        try:
            from matplotlib.figure import Figure
        except ModuleNotFoundError as error:
            raise ModuleNotFoundError(f"a figure needs matplotlib: {to_install('perturb')}") from error
        rows = self.rows
        figure = Figure(figsize=(6.0, 0.8 + 0.4 * len(rows)), layout="constrained")
        axes = figure.subplots()
        axes.barh([row.schedule for row in rows], [100 * row.success for row in rows], color="0.75")
        for place, row in enumerate(rows[1:], 1):
            ends = [100 * (rows[0].success + end) for end in (row.low, row.high)]
            axes.plot(ends, [place, place], color="black", marker="|")
        axes.invert_yaxis()
        axes.set_xlim(0, 100)
        axes.set_xlabel(f"success in {len(next(iter(self.outcomes.values())))} episodes (%)")
        return figure


def paired(
    make_env: Callable[[], Env],
    policy: Any,
    schedules: Mapping[str, Any],
    *,
    episodes: int,
    seed: int = 0,
    learns: bool = False,
    success: Success | None = None,
    wrap: Callable[[Env], Env] | None = None,
    **perturb: Any,
) -> Paired:
    """Makes the same episodes under each schedule of perturbations.

    Episode k is reset with seed + k under all of them, and `Perturb` has the same seed. A schedule of which
    nothing was applied, as all is due later, is warned of.

    Args:
        make_env: Makes the environment. What it draws when it is made, not when it is reset (MetaWorld's
            goals), must be seeded there.
        policy: A function from observations to actions, or what has stable-baselines3's `predict`, whose
            state is passed on. If a function has `reset`, that is called before each episode.
        schedules: By name, in text, as for `Perturb`; the others are compared with the first one.
        episodes: Of each schedule.
        seed: Of the first episode, and of what perturbations draw.
        learns: `policy` is then a function that makes a learner, with `learn`, in an environment. Each
            schedule is one life of a fresh learner, in which each step and episode counts.
        success: Whether an episode that has ended succeeded, by environment and last info. By default
            `info["is_success"]` or `info["success"]` tells.
        wrap: Puts around the perturbed environment what the policy needs, such as `StereoPoints`.
        **perturb: Other arguments of `Perturb`, such as `images` and `per`.

    Raises:
        ValueError: There is no schedule, or one that is not allowed here; `episodes` is no whole number;
            `make_env` gives an environment twice; or infos do not tell success.
    """
    check_whole("episodes", episodes, 1, LIFE)
    if not isinstance(schedules, Mapping) or not schedules:
        raise ValueError(f"schedules is {schedules!r}; it must be schedules by name, such as {{'none': []}}")
    for name in schedules:
        if not isinstance(name, str):
            raise ValueError(f"schedules has the name {name!r}; names are text")
    with ExitStack() as made:
        lives: dict[str, _Episodes] = {}
        perturbed: list[Perturb] = []
        for name, schedule in schedules.items():
            bare = make_env()
            if any(bare.unwrapped is each.unwrapped for each in lives.values()):
                raise ValueError("make_env gave the same environment again; it must make a new one each time")
            try:
                env = made.enter_context(closing(Perturb(bare, schedule, seed=seed, **perturb)))
            except ValueError as error:
                raise ValueError(f"schedules.{name}: {error}") from error
            perturbed.append(env)
            lives[name] = _Episodes(wrap(env) if wrap else env, seed, success or _told)
        for (name, life), env in zip(lives.items(), perturbed, strict=True):
            if learns:
                policy(life).learn(LIFE, lambda *_, life=life: len(life.outcomes) < episodes)
                if (ended := len(life.outcomes)) < episodes:
                    raise ValueError(f"schedules.{name}: learn ended after {ended} of {episodes} episodes")
            else:
                for _ in range(episodes):
                    _episode(life, policy)
            if schedules[name] and not env.applied_in_all:
                warnings.warn(
                    f"nothing of the schedule {name!r} was applied in {episodes} episodes: it is due after "
                    "all of them, or, with per='episode', after the end of each",
                    stacklevel=2,
                )
            env.unperturbed()  # the next environment may share its model
        return Paired({name: tuple(life.outcomes[:episodes]) for name, life in lives.items()})


class _Episodes(gym.Wrapper[Any, Any, Any, Any]):
    """Resets with the seed of the next episode, and notes which ones succeeded."""

    def __init__(self, env: Env, seed: int, success: Success) -> None:
        super().__init__(env)
        self.outcomes: list[bool] = []
        self._seed, self._success = seed, success

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> Any:
        return self.env.reset(seed=self._seed + len(self.outcomes), options=options)

    def step(self, action: Any) -> Any:
        observation, reward, terminated, truncated, info = self.env.step(action)
        if terminated or truncated:
            self.outcomes.append(bool(self._success(self.env, info)))
        return observation, reward, terminated, truncated, info


def _told(env: Env, info: Mapping[str, Any]) -> bool:
    for name in SUCCESS:
        if name in info:
            return bool(info[name])
    raise ValueError(
        f"info has {', '.join(map(str, info)) or 'nothing'}; it must have one of {', '.join(SUCCESS)}, "
        "or give paired(..., success=) a function that tells"
    )


def _episode(env: Env, policy: Any) -> None:
    observation, _ = env.reset()
    predict = getattr(policy, "predict", None)
    if predict is None and hasattr(policy, "reset"):
        policy.reset()
    state, begins, over = None, True, False
    while not over:
        if predict is None:
            action = policy(observation)
        else:
            starts = np.array([begins])
            action, state = predict(observation, state=state, episode_start=starts, deterministic=True)
        observation, _, terminated, truncated, _ = env.step(action)
        begins, over = False, terminated or truncated


def _row(name: str, found: Any, first: Any) -> PairedRow:
    won, lost, pairs = int((found & ~first).sum()), int((first & ~found).sum()), len(first)
    low, high = score_interval(won, lost, pairs)
    interval = (won - lost) / pairs, float(low), float(high)
    return PairedRow(name, float(found.mean()), won, lost, mcnemar_p(won, lost), *interval)
