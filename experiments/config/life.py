"""When something happens in a life: perturbations, and held-out trials."""

from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise, takewhile
from typing import Any

from pydantic import Field, field_validator, model_validator

from calfree_gym.perturbations import parse_schedule
from experiments.config.environment import EnvironmentConfig
from experiments.config.model import Model

SHARE = "share"


def shares(schedule: Sequence[dict[str, Any]]) -> Iterator[tuple[int, Any]]:
    """The places of events that come at a share of a life, each with that share."""
    for i, entry in enumerate(schedule):
        when = entry.get("at") if isinstance(entry, Mapping) else None
        if isinstance(when, Mapping) and when.keys() == {SHARE}:
            yield i, when[SHARE]


def with_shares_as_motions(
    schedule: Sequence[dict[str, Any]], motions: int | None
) -> tuple[dict[str, Any], ...]:
    """A schedule in which `at: {share: 0.5}` is the motion that it means, of a life that has so many.

    Of a life that is counted in trials `motions` is None.
    """
    found = list(schedule)
    for i, share in shares(schedule):
        where = f"perturbations.{i}.at.{SHARE}"
        if isinstance(share, bool) or not isinstance(share, int | float) or not 0 < share < 1:
            raise ValueError(f"{where} is {share!r}; it must be a number between 0 and 1, such as 0.5")
        if motions is None:
            raise ValueError(
                f"{where} is {share!r}: a share is of a life's motions, and this one is counted in trials; "
                "allowed: {trial: n}"
            )
        found[i] = {**found[i], "at": {"motion": round(share * motions)}}
    return tuple(found)


def check_reached(
    schedule: Sequence[dict[str, Any]], lengths: Mapping[str, int | None], of: str = ""
) -> None:
    """Raises ValueError where lives of these lengths, by clock, never reach an event; a trial has a motion.

    `of` says whose lengths they are.
    """
    for i, event in enumerate(parse_schedule(list(schedule))):
        counted = event.clock if lengths.get(event.clock) is not None else "motion"
        length = lengths.get(counted)
        if length is not None and event.at >= length:
            raise ValueError(
                f"perturbations.{i}.at.{event.clock} is {event.at}: never, in {of}{length} {counted}s"
            )


WHENS = ("every", "at", "per_decade")


class EvaluationConfig(Model):
    """Held-out trials at checkpoints: by `offsets`, right before and after a perturbation, and at the end.

    Attributes:
        trials: How many at each checkpoint.
        every: A checkpoint each time that so many more motions of the life are over.
        at: Motions since the beginning of the life, and since each perturbation, ascending.
        per_decade: The same, evenly on a logarithmic axis: motion 0, 1, then so many a decade.
    """

    later = frozenset(WHENS)

    trials: int = Field(gt=0)
    every: int | None = Field(default=None, gt=0)
    at: tuple[int, ...] | None = Field(default=None, min_length=1, strict=False)
    per_decade: int | None = Field(default=None, gt=0, le=100)

    @field_validator("at")
    @classmethod
    def _ascending(cls, value: tuple[int, ...] | None) -> tuple[int, ...] | None:
        if value is not None and (
            value[0] < 0 or any(later <= earlier for earlier, later in pairwise(value))
        ):
            raise ValueError("it must be whole numbers from 0 on that ascend")
        return value

    @model_validator(mode="after")
    def _one_of_them(self) -> "EvaluationConfig":
        given = [name for name in WHENS if getattr(self, name) is not None]
        if len(given) != 1:
            found = " and ".join(given) or "none"
            raise ValueError(f"one of {', '.join(WHENS)} says when; found {found}")
        return self

    @property
    def begins_anew(self) -> bool:
        """Whether its motions count from each perturbation, too."""
        return self.every is None

    def offsets(self, motions: int, rows: int = 1) -> tuple[int, ...]:
        """Checkpoints in so many motions, ascending, 0 the first unless `at` begins later.

        Args:
            motions: Of the life, or that are left of it.
            rows: Arms that move together; numbers that were not written out are rounded up to whole moves.
        """
        if self.every is not None:
            return tuple(range(0, motions + 1, self.every))
        if self.at is not None:
            return tuple(takewhile(lambda at: at <= motions, self.at))
        assert self.per_decade is not None
        exact = {0} | {-(-_tenth(i, self.per_decade) // rows) * rows for i in range(20 * self.per_decade)}
        return tuple(sorted(at for at in exact if at <= motions))


def check_one_world(env: EnvironmentConfig, where: str) -> None:
    """Raises where held-out trials would be in another world than those before."""
    if env.redraw != "never":
        raise ValueError(
            f"held-out trials need one world a lifetime; {where} draws another at each trial: leave held-out "
            "trials out (evaluation: null), or set redraw to never"
        )


def most_motions(motions: int | None, trials: int | None, env: EnvironmentConfig) -> int:
    """The most motions that a life of so many motions, or trials, can have."""
    return motions if motions is not None else (trials or 0) * env.max_episode_steps


def _tenth(step: int, per_decade: int) -> int:
    """The first whole number that is not below 10 ** (step / per_decade)."""
    decades, rest = divmod(step, per_decade)
    return int(-(-(10 ** (rest / per_decade) * 10**decades) // 1))
