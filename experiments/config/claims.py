"""What a paper claims or asks, and how it is put to the test: read from YAML into frozen models."""

from typing import Literal, Self

from pydantic import Field, model_validator

from experiments.config.model import Model, Name

Measure = Literal[
    "success",
    "near",
    "far",
    "rendezvous",
    "quickly",
    "motions",
    "most_motions",
    "worst_world",
    "seconds",
    "first_motion",
    "as_expected",
    "kept",
]
"""What is measured in a trial, and averaged over the trials of a world:

- success: the true error at the end is within the tolerance.
- near: the true error at the end is within 16 px.
- far: the true distance at the end is more than 10 mm.
- rendezvous: the last observation was within the tolerance.
- quickly: it was, after at most `within` motions.
- motions: motions of a reach; a trial without a rendezvous counts as the cap.
- most_motions: the same, such that 95 % of all trials need no more.
- worst_world: the same, of the world in which they are most.
- seconds: robot seconds of a reach, where a look takes `look` seconds; without a rendezvous it goes on to the
  cap at its own pace.
- first_motion: the true error after the first motion is within 4 px.
- as_expected: of the held-out trials in which the agent told before how far off its first motion would end,
  the share in which it was right about 16 px: within where it expected that, and not where it did not.
- kept: of the held-out trials that took at most two motions at the time of `than`, the share that still do.
"""
HELD_OUT = ("as_expected", "kept")
"""Measures of held-out trials alone."""
EXTREMES = ("most_motions", "worst_world")
"""Measures that compare nothing, and have no interval."""


class TrialsOf(Model):
    """Trials of an agent: its own, held-out ones, or those at one value of a sweep.

    Attributes:
        scenario: Name of the scenario or sweep.
        trials: First and last of its own trials, from 1.
        motions: Lifetime motions after which held-out trials were made: at the first checkpoint from there.
    """

    agent: Name
    scenario: Name
    trials: tuple[int, int] | None = Field(None, strict=False)
    motions: int | None = Field(None, ge=0)
    value: float | None = Field(None, strict=False)

    @model_validator(mode="after")
    def _one_kind_of_trials(self) -> "TrialsOf":
        given = [name for name in ("trials", "motions", "value") if getattr(self, name) is not None]
        if len(given) != 1:
            found = " and ".join(given) or "none"
            raise ValueError(f"one of trials, motions and value says which trials; found {found}")
        if self.trials and not 1 <= self.trials[0] <= self.trials[1]:
            raise ValueError(f"trials are the first and the last one, from 1; found {list(self.trials)}")
        return self


class Number(Model):
    """One number of the results.

    Attributes:
        than: If given, the number is by how much `of` differs from it, world by world.
        relative: Whether that is told as a share of what it is at `than`.
        look: Seconds that a look takes, for seconds.
        within: Motions, for quickly.
    """

    measure: Measure
    of: TrialsOf
    than: TrialsOf | None = None
    relative: bool = False
    look: float | None = Field(None, gt=0, allow_inf_nan=False)
    within: int | None = Field(None, gt=0)

    @model_validator(mode="after")
    def _complete(self) -> Self:
        if (self.measure == "seconds") != (self.look is not None):
            raise ValueError("seconds need look, the seconds that a look takes; other measures have none")
        if (self.measure == "quickly") != (self.within is not None):
            raise ValueError("quickly needs within, the most motions; other measures have none")
        if self.relative and self.than is None:
            raise ValueError("relative needs than, what it is relative to")
        if self.measure == "kept" and (self.than is None or self.relative):
            raise ValueError("kept needs than, the earlier trials, and is a share already")
        if self.measure in HELD_OUT and any(each.motions is None for each in self.trials()):
            raise ValueError(f"{self.measure} is of held-out trials: motions says which")
        if self.measure in EXTREMES and self.than is not None:
            raise ValueError(f"{self.measure} compares nothing; leave than out")
        return self

    def trials(self) -> tuple[TrialsOf, ...]:
        """All trials that it is about."""
        return (self.of, self.than) if self.than else (self.of,)


class Criterion(Number):
    """A number, and what it must be: its whole interval lies there, and that of a null agent does not.

    Attributes:
        null_agent: One without what is claimed, which should fail; a suite refuses a criterion without one.
    """

    null_agent: Name | None = None
    above: float | None = Field(None, allow_inf_nan=False)
    below: float | None = Field(None, allow_inf_nan=False)

    @model_validator(mode="after")
    def _one_threshold(self) -> Self:
        if (self.above is None) == (self.below is None):
            raise ValueError("one of above and below is the threshold")
        if self.measure in EXTREMES:
            raise ValueError(f"{self.measure} has no interval to judge by; it can only be required")
        if self.null_agent in (compared := [each.agent for each in self.trials()]):
            raise ValueError(
                f"null_agent is {self.null_agent!r}; it must be another agent than {' and '.join(compared)}"
            )
        return self

    def by_null(self) -> Number:
        """The same number of the null agent, in place of `of`'s on either side."""

        def by_null(trials: TrialsOf) -> TrialsOf:
            own = trials.agent == self.of.agent
            return trials.model_copy(update={"agent": self.null_agent}) if own else trials

        return self.model_copy(update={"of": by_null(self.of), "than": self.than and by_null(self.than)})


class Requirement(Number):
    """A number that the project asks of itself, whatever its interval."""

    at_least: float | None = Field(None, allow_inf_nan=False)
    at_most: float | None = Field(None, allow_inf_nan=False)

    @model_validator(mode="after")
    def _one_bound(self) -> Self:
        if (self.at_least is None) == (self.at_most is None):
            raise ValueError("one of at_least and at_most is the bound")
        return self


class Claim(Model):
    """What the paper claims or asks.

    Attributes:
        kind: A question is what the paper leaves open; its words are the answer that it suggests.
        section: Of the paper, where it is of the paper.
        remark: What they do not show.
    """

    name: Name
    kind: Literal["claim", "question"] = "claim"
    section: str = ""
    words: str
    criteria: tuple[Criterion, ...] = Field(min_length=1, strict=False)
    remark: str = ""

    @model_validator(mode="after")
    def _one_kind_of_reach(self) -> Self:
        if {"success", "rendezvous"} <= {each.measure for each in self.criteria}:
            raise ValueError(f"{self.name} mixes success and rendezvous; allowed: one of them in a claim")
        return self
